"""MAT files, v4 to v7 by scipy and v7.3 (HDF5) by h5py. Only numeric arrays are read; nothing is executed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.guard import afford, guarded, not_installed
from pmsm_ctrl.importers.isolated import ask
from pmsm_ctrl.importers.table import Array, Table, one_line
from pmsm_ctrl.importers.vectors import table_of
from pmsm_ctrl.importers.worker import Record, flattened

__all__ = ["open_hdf5", "open_mat"]

DEEPEST = 4  # structs in structs
MOST_RECORDS = 4096  # elements of an array of structs
MOST_MEMBERS = 1 << 15  # of all structs, counted as often as something leads to them: that may run in a circle
LONGEST_NAME = 1000  # characters


def open_mat(path: Path, file: str) -> Table:
    """Open a MAT file of version 4 to 7.

    Raises
    ------
    LogError
        When the file is damaged or holds no numeric vectors.
    """
    answer, values = ask("MAT", path, file)
    content: dict[str, Array | None] = {}
    place = 0
    for name, shape in answer["variables"]:
        if shape is None:
            content[name] = None
            continue
        size = math.prod(shape)
        content[name] = np.frombuffer(values, dtype=np.float64, count=size, offset=place).reshape(shape)
        place += 8 * size
    return table_of(file, "MATLAB v5", content, "MAT file")


def open_hdf5(path: Path, file: str) -> Table:
    """Open a MAT file of version 7.3, or any HDF5 file whose datasets are vectors.

    Raises
    ------
    LogError
        When h5py is not installed, the file is damaged, or it holds no numeric vectors.
    """
    try:
        import h5py
    except ImportError:
        raise not_installed(file, "MATLAB v7.3 (HDF5)", "h5py", "matlab73") from None
    with guarded(file, "HDF5"), h5py.File(path, "r") as content:
        found = _Contents(file, path).of(content)
    return table_of(file, "MATLAB v7.3", flattened(found), "MAT file")


class _Contents:
    """The datasets of an HDF5 file; the fields of arrays of structs are read through MATLAB's references."""

    def __init__(self, file: str, path: Path) -> None:
        self.file, self.path, self.total, self.members = file, path, 0.0, 0

    def of(self, group: Any, depth: int = 0) -> dict[str, Any]:
        """Return the content of a group: arrays, texts, groups as dictionaries, arrays of structs as lists of them."""
        import h5py

        found: dict[str, Any] = {}
        for name, item in self._members(group):
            if isinstance(item, h5py.Dataset):
                found[name] = self._dataset(item)
            elif depth < DEEPEST:
                found[name] = self._struct(item, depth)
        return found

    def _members(self, group: Any) -> Iterator[tuple[str, Any]]:
        """Yield what stands in a group itself: links may lead to other files, devices among them."""
        import h5py

        for name in group:
            # what stands under #refs# belongs to the cells and structs that point to it
            link = group.get(name, getlink=True)
            self._count(1)
            if not name.startswith("#") and not isinstance(link, h5py.ExternalLink | h5py.SoftLink):
                yield name, group[name]

    def _struct(self, group: Any, depth: int) -> Any:
        """Return a struct as a dictionary, an array of structs as a list of them."""
        import h5py

        fields = dict(self._members(group))
        counts = {item.size for item in fields.values() if isinstance(item, h5py.Dataset)}
        referring = fields and all(
            isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is not None for item in fields.values()
        )
        if not referring or len(counts) != 1 or not 0 < max(counts) <= MOST_RECORDS:
            return self.of(group, depth + 1)
        pointers = {name: item[()].reshape(-1) for name, item in fields.items()}
        self._count(max(counts))
        return [
            Record({name: self._referred(group.file[refs[k]], depth + 1) for name, refs in pointers.items()})
            for k in range(counts.pop())
        ]

    def _count(self, more: int) -> None:
        self.members += more
        if self.members > MOST_MEMBERS:
            raise LogError(f"{self.file}: more than {MOST_MEMBERS} members of structs in structs; a log was expected")

    def _referred(self, item: Any, depth: int) -> Any:
        import h5py

        if isinstance(item, h5py.Dataset):
            return self._dataset(item)
        return self._struct(item, depth) if depth < DEEPEST else None

    def _dataset(self, item: Any) -> Any:
        """Return numbers as float64, MATLAB's characters as a text, and None for anything else."""
        if item.external is not None or item.is_virtual:
            name = one_line(str(item.name).lstrip("/"))
            raise LogError(f"{self.file}: dataset '{name}' points to another file; a log of its own was expected")
        if item.dtype.kind not in "fiub":
            return None
        self.total += item.size
        afford(self.file, "HDF5", self.total, self.path)  # before it is read: a damaged header may declare any size
        if item.attrs.get("MATLAB_class") == b"char":
            codes = np.asarray(item[()]).reshape(-1)
            return "".join(chr(int(code)) for code in codes[:LONGEST_NAME] if 0 < code < 0xD800)
        return np.asarray(item[()], dtype=np.float64)
