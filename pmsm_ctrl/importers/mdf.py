"""MDF 3 and 4 files by asammdf: every channel group has a time base of its own."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.guard import not_installed
from pmsm_ctrl.importers.isolated import ask
from pmsm_ctrl.importers.names import split_header
from pmsm_ctrl.importers.table import Array, Column, Table, left_out

__all__ = ["open_mdf"]


def open_mdf(path: Path, file: str) -> Table:
    """Open an MDF file.

    Raises
    ------
    LogError
        When asammdf is not installed, the file is damaged, or it holds no numeric channels.
    """
    if find_spec("asammdf") is None:
        raise not_installed(file, "MDF", "asammdf", "mdf")
    answer, _ = ask("MDF", path, file)
    columns: list[Column] = []
    places: list[str] = []
    for name, stated, group, index, is_time in answer["columns"]:
        short, unit = split_header(name)
        columns.append(Column(short, stated or unit, name, group, is_time))
        places.append(f"{group}:{index}")
    if all(column.is_time for column in columns):
        raise LogError(f"{file}: no numeric channels with a time base in this MDF file")

    def load(indices: Sequence[int]) -> list[Array]:
        sizes, raw = ask("MDF", path, file, [places[i] for i in indices])
        ends = np.cumsum([0, *sizes["sizes"]]) * 8
        return [np.frombuffer(raw[a:b], dtype=np.float64) for a, b in pairwise(ends)]

    def locate(column: int, sample: int) -> str:
        return f"channel '{columns[column].label}', group {columns[column].group}, sample {sample + 1}"

    left = answer["left"]
    return Table(file, f"MDF {answer['version']}", tuple(columns), load, locate, left_out("channels", left))
