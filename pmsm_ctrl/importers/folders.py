"""From what stands on a command line to files: several files, a pattern, a folder of logs."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable
from pathlib import Path

from pmsm_ctrl.errors import LogError

__all__ = ["SUFFIXES", "log_files"]

# Files of a folder that are taken for logs; what stands on the command line itself may have any name.
SUFFIXES = (
    ".csv", ".txt", ".tsv", ".dat", ".mat", ".mf4", ".mdf", ".tdms", ".parquet", ".h5", ".npz", ".npy",
    ".mcap", ".db3",
)  # fmt: skip


def log_files(paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Return the files that are meant, in the order given; those of a pattern or a folder by name, 2 before 10.

    Parameters
    ----------
    paths : iterable of path
        Files, patterns such as ``logs/run_*.csv``, and folders, of which every file with one of `SUFFIXES` is taken.

    Raises
    ------
    LogError
        When a pattern or a folder holds no log, or a file is meant twice.
    """
    found: list[Path] = []
    for path in paths:
        found += _expanded(os.fspath(path))
    seen: set[Path] = set()
    for one in found:
        whole = Path(os.path.realpath(one))  # a link that leads to itself is an error of the reader
        if whole in seen:
            raise LogError(f"{one}: given twice; every log is one record")
        seen.add(whole)
    return found


def _expanded(path: str) -> list[Path]:
    target = Path(path)
    if target.is_dir():
        inside = [one for one in target.iterdir() if one.suffix.lower() in SUFFIXES and not one.name.startswith(".")]
        if not inside:
            raise LogError(f"{path}: no log in this folder (looked for {', '.join(f'*{s}' for s in SUFFIXES)})")
        return sorted(inside, key=_natural)
    if glob.has_magic(path) and not target.exists():
        matching = [Path(one) for one in glob.glob(path, recursive=True) if Path(one).is_file()]
        if not matching:
            raise LogError(f"{path}: no file matches this pattern; a log was expected")
        return sorted(matching, key=_natural)
    return [target]


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key: numbers inside a name by their value."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]
