"""Where a live stream comes from, by the name that a user gives it."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping

from pmsm_ctrl.track.stream import follow, lines_of

__all__ = ["lines_from"]


def lines_from(source: str, mapping: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of a growing file, of standard input or of a PLC.

    Parameters
    ----------
    source : str
        A path, ``-`` for standard input, or ``ads://[HOST/]NETID[:PORT]``.
    mapping : dict of str to str
        Channel to column; of a PLC, to symbol.

    Returns
    -------
    iterator of str

    Raises
    ------
    RequestError
        When a PLC cannot be asked for that.
    """
    if source.startswith("ads:"):
        from pmsm_ctrl.track.ads import ads_lines

        return ads_lines(source, mapping)
    if source != "-":
        return follow(source)
    return lines_of(getattr(sys.stdin, "buffer", sys.stdin))
