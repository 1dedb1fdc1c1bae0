"""Parquet files by pyarrow: one table, one time base."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.guard import afford, guarded, not_installed
from pmsm_ctrl.importers.names import split_header
from pmsm_ctrl.importers.table import Array, Column, Table, left_out

__all__ = ["open_parquet"]

_PER_SECOND = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}


def open_parquet(path: Path, file: str) -> Table:
    """Open a Parquet file.

    Raises
    ------
    LogError
        When pyarrow is not installed, the file is damaged, or it holds no numeric columns.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise not_installed(file, "Parquet", "pyarrow", "parquet") from None
    with guarded(file, "Parquet"), open(path, "rb") as stream:
        content = pyarrow.parquet.ParquetFile(stream)
        schema, rows = content.schema_arrow, content.metadata.num_rows
    fields = [field for field in schema if _usable(pyarrow, field.type)]
    if not fields:
        raise LogError(f"{file}: no numeric columns in this Parquet file (found: {', '.join(schema.names) or 'none'})")
    columns = tuple(_column(pyarrow, field) for field in fields)

    def load(indices: Sequence[int]) -> list[Array]:
        afford(file, "Parquet", float(rows) * len(indices), path)
        wanted = list(dict.fromkeys(fields[i].name for i in indices))
        with guarded(file, "Parquet"), open(path, "rb") as stream:
            table = pyarrow.parquet.read_table(stream, columns=wanted)
            found = [_values(pyarrow, table[fields[i].name]) for i in indices]
            del table
            pyarrow.default_memory_pool().release_unused()  # hundreds of MB of a long log
            return found

    def locate(column: int, sample: int) -> str:
        return f"column '{columns[column].label}', row {sample + 1}"

    left = [name for name in schema.names if name not in {field.name for field in fields}]
    return Table(file, "Parquet", columns, load, locate, left_out("columns", left))


def _usable(pyarrow: Any, kind: Any) -> bool:
    types = pyarrow.types
    tests = (types.is_integer, types.is_floating, types.is_boolean, types.is_timestamp, types.is_duration,
             types.is_decimal)  # fmt: skip
    return any(test(kind) for test in tests)


def _column(pyarrow: Any, field: Any) -> Column:
    name, unit = split_header(field.name)
    if pyarrow.types.is_timestamp(field.type) or pyarrow.types.is_duration(field.type):
        unit = "s"
    stated = (field.metadata or {}).get(b"unit", b"").decode("utf-8", errors="replace")
    return Column(name=name, unit=stated or unit, header=field.name)


def _values(pyarrow: Any, column: Any) -> Array:
    kind = column.type
    if pyarrow.types.is_timestamp(kind) or pyarrow.types.is_duration(kind):
        counts = np.concatenate([part.cast(pyarrow.int64()).to_numpy(zero_copy_only=False) for part in column.chunks])
        # dates are counted from the first sample: a double cannot hold nanoseconds since 1970
        start = counts[0] if pyarrow.types.is_timestamp(kind) and counts.size else 0
        return (counts - start).astype(np.float64) / _PER_SECOND[kind.unit]
    parts = [part.cast(pyarrow.float64(), safe=False).to_numpy(zero_copy_only=False) for part in column.chunks]
    return np.concatenate(parts) if parts else np.empty(0)
