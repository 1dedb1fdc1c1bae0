"""MAT files, v4 to v7 by scipy and v7.3 (HDF5) by h5py. Only numeric arrays are read; nothing is executed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.guard import afford, guarded, not_installed
from pmsm_ctrl.importers.isolated import ask
from pmsm_ctrl.importers.names import split_header
from pmsm_ctrl.importers.table import Array, Column, Table, one_line

__all__ = ["open_hdf5", "open_mat"]


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
    return _table(file, "MATLAB v5", content)


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
    found: dict[str, Any] = {}
    total = 0.0
    with guarded(file, "HDF5"), h5py.File(path, "r") as content:

        def visit(name: str, item: Any) -> None:
            nonlocal total
            # names under #refs# are cells that other variables point to
            if not isinstance(item, h5py.Dataset) or name.startswith("#"):
                return
            if item.external is not None or item.is_virtual:
                raise LogError(
                    f"{file}: dataset '{one_line(name)}' points to another file; a log of its own was expected"
                )
            if item.dtype.kind in "fiub":
                total += item.size
                afford(file, "HDF5", total, path)  # before anything is read: a damaged header may declare any size
                found[name.replace("/", ".")] = item[()]

        content.visititems(visit)
    return _table(file, "MATLAB v7.3", {name: np.asarray(value, dtype=np.float64) for name, value in found.items()})


def _table(file: str, kind: str, content: dict[str, Array | None]) -> Table:
    vectors: list[tuple[str, Array]] = []
    scalars: list[str] = []
    left: list[str] = []
    for name, value in content.items():
        if value is None:
            left.append(name)
        elif value.size == 1:
            scalars.append(f"{name} = {value.reshape(-1)[0]:.9g}")
        elif value.size == max(value.shape):
            vectors.append((name, value.reshape(-1)))
        elif value.ndim == 2 and min(value.shape) <= 64 and value.size:
            tall = value if value.shape[0] >= value.shape[1] else value.T
            vectors += [(f"{name}.{i + 1}", tall[:, i]) for i in range(tall.shape[1])]
        else:
            left.append(name)
    if not vectors:
        raise LogError(
            f"{file}: no numeric vectors in this MAT file (found: {one_line(', '.join(content)) or 'nothing'})"
        )
    return _grouped(file, kind, vectors, scalars, left)


def _grouped(file: str, kind: str, vectors: list[tuple[str, Array]], scalars: list[str], left: list[str]) -> Table:
    notes = []
    if scalars:
        notes.append(f"scalars not used: {one_line(', '.join(scalars[:12]))}")
    if left:
        notes.append(f"variables that are no vectors not used: {one_line(', '.join(left[:12]))}")
    # vectors of one length share one time base
    lengths = list(dict.fromkeys(values.size for _, values in vectors))
    columns = []
    for name, values in vectors:
        short, unit = split_header(name)
        columns.append(Column(name=short, unit=unit, header=name, group=lengths.index(values.size)))

    def load(indices: Sequence[int]) -> list[Array]:
        return [vectors[i][1] for i in indices]

    def locate(column: int, sample: int) -> str:
        return f"variable '{columns[column].label}', sample {sample + 1}"

    return Table(file, kind, tuple(columns), load, locate, tuple(notes))
