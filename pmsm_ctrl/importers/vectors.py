"""Named arrays of a binary file as a `Table`: vectors, narrow matrices, and the records of arrays of structs."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.names import guess_channel, split_header
from pmsm_ctrl.importers.table import Array, Column, Table, one_line
from pmsm_ctrl.importers.vocabulary import meaning_of

__all__ = ["table_of"]

WIDEST = 64  # columns of a matrix that are channels; a wider one is an image or a table of parameters


def table_of(file: str, kind: str, content: Mapping[str, Array | None], what: str) -> Table:
    """Return the vectors and the columns of narrow matrices as a table.

    Parameters
    ----------
    file, kind : str
    content : mapping of str to array or None
        None is what holds no numbers.
    what : str
        What messages call the file, such as ``MAT file``.

    Returns
    -------
    Table

    Raises
    ------
    LogError
        When no vector is among them.
    """
    vectors: list[tuple[str, Array]] = []
    scalars: list[str] = []
    left: list[str] = []
    for name, value in content.items():
        if value is None:
            left.append(name)
        elif value.size == 1:
            scalars.append(f"{name} = {value.reshape(-1)[0]:.9g}")
        elif value.size == max(value.shape, default=0):
            vectors.append((name, value.reshape(-1)))
        elif value.ndim == 2 and min(value.shape) <= WIDEST and value.size:
            tall = value if value.shape[0] >= value.shape[1] else value.T
            vectors += [(f"{name}.{i + 1}", tall[:, i]) for i in range(tall.shape[1])]
        else:
            left.append(name)
    if not vectors:
        raise LogError(
            f"{file}: no numeric vectors in this {what} (found: {one_line(', '.join(content)) or 'nothing'})"
        )
    return _grouped(file, kind, vectors, scalars, left)


def _grouped(
    file: str, kind: str, vectors: Sequence[tuple[str, Array]], scalars: Sequence[str], left: Sequence[str]
) -> Table:
    notes = []
    if scalars:
        notes.append(f"scalars not used: {one_line(', '.join(scalars[:12]))}")
    if left:
        notes.append(f"variables that are no vectors not used: {one_line(', '.join(left[:12]))}")
    # vectors of one length share one time base
    lengths = list(dict.fromkeys(values.size for _, values in vectors))
    columns: list[Column] = []
    for name, values in vectors:
        short, unit = split_header(name)
        group = lengths.index(values.size)
        timed = any(column.group == group and column.is_time for column in columns)
        columns.append(Column(short, unit, name, group, len(lengths) > 1 and not timed and _is_time(short, values)))

    def load(indices: Sequence[int]) -> list[Array]:
        return [np.asarray(vectors[i][1], dtype=np.float64) for i in indices]

    def locate(column: int, sample: int) -> str:
        return f"variable '{columns[column].label}', sample {sample + 1}"

    return Table(file, kind, tuple(columns), load, locate, tuple(notes))


def _is_time(name: str, values: Array) -> bool:
    """Whether a vector is the time of those of its length: so it is named, ``t_slow`` too, and it increases."""
    meaning = meaning_of(name)
    said = guess_channel(name) == "t" or (meaning is not None and meaning.channel == "t")
    named = said or re.match(r"t(?![^\W\d_])", name) is not None
    return named and values.size > 1 and bool(np.all(np.diff(values) > 0.0))
