"""MDF 3 and 4 files by asammdf: every channel group has a time base of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.names import split_header
from pmsm_ctrl.importers.table import Array, Column, Table, one_line

__all__ = ["open_mdf"]

PATIENCE = 600.0  # s; a damaged file may send the reader in circles


def open_mdf(path: Path, file: str) -> Table:
    """Open an MDF file.

    Raises
    ------
    LogError
        When asammdf is not installed, the file is damaged, or it holds no numeric channels.
    """
    if find_spec("asammdf") is None:
        raise LogError(f"{file}: MDF needs asammdf: pip install 'pmsm-ctrl[mdf]'")
    answer, _ = _ask(path, file)
    columns: list[Column] = []
    places: list[str] = []
    for name, stated, group, index, is_time in answer["columns"]:
        short, unit = split_header(name)
        columns.append(Column(short, stated or unit, name, group, is_time))
        places.append(f"{group}:{index}")
    if all(column.is_time for column in columns):
        raise LogError(f"{file}: no numeric channels with a time base in this MDF file")

    def load(indices: Sequence[int]) -> list[Array]:
        sizes, raw = _ask(path, file, [places[i] for i in indices])
        ends = np.cumsum([0, *sizes["sizes"]]) * 8
        return [np.frombuffer(raw[a:b], dtype=np.float64) for a, b in pairwise(ends)]

    def locate(column: int, sample: int) -> str:
        return f"channel '{columns[column].label}', group {columns[column].group}, sample {sample + 1}"

    left = answer["left"]
    notes = [f"channels that are no numbers left out: {one_line(', '.join(left[:12]))}"] if left else []
    return Table(file, f"MDF {answer['version']}", tuple(columns), load, locate, tuple(notes))


def _ask(path: Path, file: str, places: Sequence[str] = ()) -> tuple[dict[str, Any], bytes]:
    """Ask the reader's own process; return its answer and the values' bytes."""
    command = [sys.executable, "-m", "pmsm_ctrl.importers.mdf_worker", str(path.absolute()), *places]
    try:
        run = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        raise LogError(f"{file}: damaged MDF file (not read after {PATIENCE:g} s)") from None
    line, _, rest = run.stdout.partition(b"\n")
    if run.returncode or not line:
        raise LogError(f"{file}: damaged MDF file (its reader crashed)")
    answer: dict[str, Any] = json.loads(line)
    if "error" in answer:
        what = one_line(answer["error"][:120])
        raise LogError(f"{file}: damaged or unsupported MDF file ({what})")
    return answer, rest
