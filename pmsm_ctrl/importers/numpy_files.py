"""NumPy arrays: ``.npy`` and ``.npz``. Objects, which are pickles, are never read."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.guard import afford, guarded
from pmsm_ctrl.importers.table import Array, Table, one_line
from pmsm_ctrl.importers.vectors import table_of

__all__ = ["is_npz", "open_npy", "open_npz"]

# Names of a text array that names the columns of the one matrix beside it.
HEADERS = ("columns", "names", "channels", "labels", "header")


def is_npz(path: Path) -> bool:
    """Whether a zip archive holds NumPy arrays and nothing else."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return False
    return bool(names) and all(name.endswith(".npy") for name in names)


def open_npy(path: Path, file: str) -> Table:
    """Open a single array: a vector a column, a narrow matrix its columns, a structured array its fields.

    Raises
    ------
    LogError
        When it is damaged, holds objects, or no vector of numbers.
    """
    with guarded(file, "NumPy"), open(path, "rb") as stream:
        array = _array(stream, path.stat().st_size, file, path, "")
    return table_of(file, "NumPy array", _columns({"": array}), "NumPy file")


def open_npz(path: Path, file: str) -> Table:
    """Open an archive of arrays by their names.

    Raises
    ------
    LogError
        When it is damaged, holds objects, declares more than it can hold, or no vector of numbers.
    """
    arrays: dict[str, Any] = {}
    with guarded(file, "NumPy"), zipfile.ZipFile(path) as archive:
        declared = sum(member.file_size for member in archive.infolist())
        afford(file, "NumPy", declared / 8.0, path)
        for member in archive.infolist():
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as stream:
                arrays[name] = _array(stream, member.file_size, file, path, name)
    return table_of(file, "NumPy archive", _columns(arrays), "NumPy file")


def _array(stream: IO[bytes], size: int, file: str, path: Path, name: str) -> Any:
    """Read one array whose header declares no more than the file holds."""
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read_header(stream)
    if dtype.hasobject:
        what = f"array '{one_line(name)}'" if name else "the array"
        raise LogError(f"{file}: {what} holds Python objects, a pickle, which is never read; numbers were expected")
    count = 1
    for length in shape:  # of Python integers, which do not overflow
        count *= int(length)
    if count * dtype.itemsize > size:
        raise LogError(f"{file}: damaged NumPy file: {count:.3g} values declared in {1e-6 * size:.3g} MB")
    afford(file, "NumPy", count * dtype.itemsize / 8.0, path)
    values = np.frombuffer(stream.read(count * dtype.itemsize), dtype=dtype, count=count)
    return values.reshape(shape, order="F" if fortran else "C")


def _columns(arrays: dict[str, Any]) -> dict[str, Array | None]:
    """Return fields of structured arrays and numeric arrays by name; a text array may name the columns of a matrix."""
    found: dict[str, Array | None] = {}
    titles = _titles(arrays)
    for name, array in arrays.items():
        prefix = f"{name}." if name else ""
        if array.dtype.names:
            found |= {f"{prefix}{field}": _numbers(array[field]) for field in array.dtype.names}
        elif array.ndim == 2 and (len(titles) in array.shape or not name):
            tall = array if array.shape[1] == len(titles) or array.shape[0] >= array.shape[1] else array.T
            named = titles if len(titles) == tall.shape[1] else tuple(f"#{k + 1}" for k in range(tall.shape[1]))
            found |= {title: _numbers(tall[:, k]) for k, title in enumerate(named)}
        else:
            found[name or "#1"] = _numbers(array)
    return found


def _titles(arrays: dict[str, Any]) -> tuple[str, ...]:
    for name in HEADERS:
        array = arrays.get(name)
        if array is not None and array.ndim == 1 and array.dtype.kind == "U" and len(set(array.tolist())) == array.size:
            return tuple(str(title) for title in array)
    return ()


def _numbers(array: Any) -> Array | None:
    """Return an array of numbers as float64, one of times as seconds from the first one; None for anything else."""
    if array.dtype.kind in "mM" and np.datetime_data(array.dtype)[0] in ("Y", "M"):
        return None  # of no fixed length
    if array.dtype.kind in "mM" and array.size:
        since = array - array.reshape(-1)[0] if array.dtype.kind == "M" else array
        return np.asarray(since / np.timedelta64(1, "ns"), dtype=np.float64) * 1e-9
    return np.asarray(array, dtype=np.float64) if array.dtype.kind in "fiub" else None
