"""Curves on disk, and the few points of them that a screen can show.

Every column is a ``.npy`` file that is mapped into memory, and beside a long one stand the extremes of every 64
samples, so that a view of ten million samples reads no more than a view of a hundred thousand.
"""

from __future__ import annotations

import json
import shutil
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.files import write_text

__all__ = ["Curves", "overview", "packed", "write_curves"]

Array = NDArray[np.float64]
Single = NDArray[np.float32]

COARSE = 64  # samples that one pair of extremes stands for
LONG = 16 * COARSE  # samples from which on the extremes are kept
MOST_BINS = 4000


def write_curves(folder: Path, columns: Mapping[str, Array]) -> None:
    """Write columns of one length; the first one is time, s, ascending.

    Parameters
    ----------
    folder : Path
        Made anew; it is complete when its ``index.json`` stands there.
    columns : mapping of name to array, shape (n,)
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for number, values in enumerate(columns.values()):
        if number == 0:
            np.save(folder / "0.npy", np.asarray(values, dtype=np.float64))
            continue
        kept = np.asarray(values, dtype=np.float32)
        np.save(folder / f"{number}.npy", kept)
        if len(kept) >= LONG:
            np.save(folder / f"{number}.extremes.npy", np.stack(_extremes(kept, COARSE)))
    write_text(folder / "index.json", json.dumps(list(columns)))


def _extremes(values: Single, size: int) -> tuple[Single, Single]:
    """Return the smallest and the largest of every `size` samples; the last block may be shorter."""
    whole = len(values) // size * size
    blocks = values[:whole].reshape(-1, size)
    low, high = blocks.min(axis=1), blocks.max(axis=1)
    if whole < len(values):
        low, high = np.append(low, values[whole:].min()), np.append(high, values[whole:].max())
    return low, high


class Curves:
    """Columns that were written by `write_curves`.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    RequestError
        When there are none.
    """

    def __init__(self, folder: Path) -> None:
        try:
            self.names: list[str] = json.loads((folder / "index.json").read_text(encoding="utf-8"))
            self._columns = [np.load(folder / f"{k}.npy", mmap_mode="r") for k in range(len(self.names))]
        except (OSError, ValueError):
            raise RequestError("these curves are not there any more; reload the page") from None
        self.folder = folder
        self.t: Array = self._columns[0]

    def __getitem__(self, name: str) -> Single:
        if name not in self.names:
            raise RequestError(f"unknown curve '{name}'{nearest(name, self.names)}")
        found: Single = self._columns[self.names.index(name)]
        return found

    def _coarse(self, name: str) -> Single | None:
        path = self.folder / f"{self.names.index(name)}.extremes.npy"
        return np.load(path, mmap_mode="r") if path.exists() else None

    def within(self, start: float | None, stop: float | None) -> slice:
        """Return the samples of a stretch of time, and one more at either end.

        Parameters
        ----------
        start, stop : float or None
            s; None for the ends.

        Returns
        -------
        slice
        """
        first = 0 if start is None else max(0, int(np.searchsorted(self.t, start)) - 1)
        last = len(self.t) if stop is None else min(len(self.t), int(np.searchsorted(self.t, stop, side="right")) + 1)
        return slice(min(first, max(len(self.t) - 2, 0)), max(last, min(first + 2, len(self.t))))

    def view(self, names: Sequence[str], start: float | None, stop: float | None, bins: int) -> dict[str, Array]:
        """Return columns over a stretch of time as a screen shows them: all samples, or the extremes of every bin.

        Parameters
        ----------
        names : sequence of str
        start, stop : float or None
            s; None for the ends.
        bins : int
            Pixel columns.

        Returns
        -------
        dict of name to array
            ``t`` first. Of a bin every curve has its smallest value and then its largest one, at the bin's first
            sample and at its middle.
        """
        part, bins = self.within(start, stop), max(2, min(bins, MOST_BINS))
        count = part.stop - part.start
        if count <= 2 * bins:
            return {"t": np.array(self.t[part])} | {
                name: np.asarray(self[name][part], dtype=np.float64) for name in names
            }
        step = -(-count // bins)
        coarse = step >= 2 * COARSE
        if coarse:  # on the grid of the kept extremes
            step = step // COARSE * COARSE
            part = slice(part.start // COARSE * COARSE, part.stop)
        places = np.arange(part.start, part.stop, step)
        middles = np.minimum(places + step // 2, part.stop - 1)
        out = {"t": np.column_stack([self.t[places], self.t[middles]]).ravel()}
        for name in names:
            kept = self._coarse(name) if coarse else None
            if kept is None:
                low, high = _extremes(np.asarray(self[name][part]), step)
            else:
                rows = np.asarray(kept[:, part.start // COARSE : -(-part.stop // COARSE)])
                low, high = (_extremes(rows[k], step // COARSE)[k] for k in (0, 1))
            out[name] = np.column_stack([low, high]).ravel().astype(np.float64)
        return out


def overview(values: Array, bins: int = 150) -> list[float]:
    """Return a curve small enough for a picture of the size of a stamp: the extremes of every bin, in turn.

    Parameters
    ----------
    values : array, shape (n,)
    bins : int

    Returns
    -------
    list of float
        Scaled so that the smallest value is 0 and the largest one 1; all 0.5 for a constant.
    """
    kept = np.asarray(values, dtype=np.float32)
    if len(kept) > 2 * bins:
        kept = np.column_stack(_extremes(kept, -(-len(kept) // bins))).ravel()
    low, high = float(kept.min()), float(kept.max())
    scaled = (kept - low) / (high - low) if high > low else np.full(len(kept), 0.5)
    return [round(float(one), 3) for one in scaled]


def packed(columns: Mapping[str, Array], **facts: object) -> bytes:
    """Return columns as bytes that a page reads without parsing: length of a head, the head in JSON, doubles.

    Parameters
    ----------
    columns : mapping of name to array, shape (n,)
    **facts : object
        More entries of the head.

    Returns
    -------
    bytes
    """
    lengths = {name: len(values) for name, values in columns.items()}
    head = json.dumps({"columns": lengths, **facts}).encode()
    head += b" " * (-(len(head) + 4) % 8)
    body = b"".join(np.ascontiguousarray(values, dtype="<f8").tobytes() for values in columns.values())
    return struct.pack("<I", len(head)) + head + body
