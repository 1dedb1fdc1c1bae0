"""Logs that are no files yet: bytes, open streams and data frames."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.frames import index_of, labels_of, stated_unit
from pmsm_ctrl.importers.names import guess_channel, split_header
from pmsm_ctrl.importers.table import Array, Column, Table, left_out

__all__ = ["Frame", "Source", "as_file", "frame_digest", "frame_table", "is_frame"]

# A data frame: an object with `columns` (pandas, polars), `column_names` (pyarrow) or `data_vars` (xarray) that gives a
# column by its name.
Frame = Any
Source = str | os.PathLike[str] | bytes | IO[bytes] | Frame


def is_frame(source: Source) -> bool:
    """Whether a source is a data frame."""
    return hasattr(source, "__getitem__") and any(
        hasattr(source, name) for name in ("columns", "column_names", "data_vars")
    )


@contextmanager
def as_file(source: Source, name: str) -> Iterator[tuple[str | os.PathLike[str], str]]:
    """Yield the file that holds a source, and the name by which messages call it.

    Bytes and streams stand in a temporary file for as long as the block lasts, with the suffix of their name.

    Parameters
    ----------
    source : path, bytes or binary stream
    name : str
        Empty for the path itself, or for ``log``.

    Yields
    ------
    (path, str)

    Raises
    ------
    LogError
        For a stream of text or an object that is none of these.
    """
    if isinstance(source, (str, os.PathLike)):
        yield source, name or os.fspath(source)
        return
    label = name or Path(str(getattr(source, "name", "") or "log")).name
    with tempfile.TemporaryDirectory(prefix="pmsm_ctrl_") as folder:
        target = Path(folder) / f"log{Path(label).suffix[:10]}"
        with open(target, "wb") as stream:
            if isinstance(source, (bytes, bytearray, memoryview)):
                stream.write(source)
            elif hasattr(source, "read"):
                try:
                    shutil.copyfileobj(source, stream)
                except TypeError:
                    raise LogError(f"{label}: a stream of text; one of bytes was expected, open(path, 'rb')") from None
            else:
                accepted = "a path, bytes, a stream of bytes or a data frame was expected"
                raise LogError(f"{label}: found {type(source).__name__}; {accepted}")
        yield target, label


def frame_table(frame: Frame, name: str) -> Table:
    """Return the columns of a data frame as those of a file.

    The index of pandas is a column where it holds times, or is named as a time, and no column is one.

    Parameters
    ----------
    frame : data frame
    name : str

    Returns
    -------
    Table

    Raises
    ------
    LogError
        When no column holds numbers.
    """
    label = name or "data frame"
    names = labels_of(frame)
    numbers = {str(key): values for key in names if (values := _numbers(frame[key])) is not None}
    if not numbers:
        raise LogError(f"{label}: no column of numbers (found: {', '.join(map(str, names)) or 'none'})")
    stated = {str(key): stated_unit(frame[key]) for key in names}
    dates = {str(key) for key in names if np.asarray(frame[key]).dtype.kind in "mM"}
    columns = tuple(
        Column(name, "s" if key in dates else unit or stated[key], header=key, is_date=key in dates)
        for key, (name, unit) in ((key, split_header(key)) for key in numbers)
    )
    arrays = list(numbers.values())
    if not any(column.is_date or guess_channel(column.name) == "t" for column in columns):
        clock, times = _index(frame)
        columns, arrays = (*columns, *clock), [*arrays, *times]

    def load(indices: Sequence[int]) -> list[Array]:
        return [arrays[k] for k in indices]

    def locate(column: int, sample: int) -> str:
        return f"column '{columns[column].label}', row {sample + 1}"

    left = [str(key) for key in names if str(key) not in numbers]
    return Table(label, type(frame).__name__, columns, load, locate, left_out("columns", left))


def _index(frame: Frame) -> tuple[tuple[Column, ...], tuple[Array, ...]]:
    """Return the index of a data frame as a time column and its numbers; nothing where it is no time."""
    label, stamps = index_of(frame)
    values = None if stamps is None else _numbers(stamps)
    if stamps is None or values is None:
        return (), ()
    name, unit = split_header(str("index" if label is None else label))
    if stamps.dtype.kind in "mM":
        return (Column(name, "s", header=name, is_date=True),), (values,)
    return ((Column(name, unit, header=str(label)),), (values,)) if guess_channel(name) == "t" else ((), ())


def _numbers(column: Any) -> Array | None:
    """Return a column as float64; times become seconds from the first one; None for what is no column of numbers."""
    values = np.asarray(column)
    if values.ndim != 1:
        return None
    if values.dtype.kind in "mM":
        since = values - values[:1] if values.dtype.kind == "M" else values  # of none as well
        return np.asarray(since / np.timedelta64(1, "ns"), dtype=np.float64) * 1e-9
    return values.astype(np.float64) if values.dtype.kind in "fiub" else None


def frame_digest(table: Table) -> str:
    """Return the SHA-256 of the names and numbers of a data frame."""
    digest = hashlib.sha256()
    for column, values in zip(table.columns, table.load(range(len(table.columns))), strict=True):
        digest.update(column.header.encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
