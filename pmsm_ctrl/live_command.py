"""What the command line does with a live source: F_c and F_v line by line, alarms, and the last state at Ctrl-C."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pmsm_ctrl.console import parse_map
from pmsm_ctrl.errors import RequestError

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.track import Alarm, Reading, Watched

__all__ = ["watch_source"]


def watch_source(
    design: Design, live: str | None, log: Sequence[Path] | None, *, mapping: list[str] | None,
    estimate: tuple[str, ...] | None, idle: float | None,
) -> Watched:  # fmt: skip
    """Track a live source and print what it tells.

    Parameters
    ----------
    design : Design
    live : str or None
        A path, ``-`` for standard input, or ``ads://[HOST/]NETID[:PORT]``.
    log : sequence of Path, optional
        Logs, which exclude a live source.
    mapping : list of str, optional
        ``CHANNEL=COLUMN``.
    estimate : tuple of str, optional
        What is estimated beside F_c and F_v.
    idle : float, optional
        Time without a sample after which the source has ended, s.

    Returns
    -------
    Watched

    Raises
    ------
    RequestError
        When there is neither a log nor a source, or both; or a PLC cannot be reached.
    """
    if live is None:
        raise RequestError("track: neither LOG nor --live SOURCE is given; one of them was expected")
    if log:
        raise RequestError("--live: excludes LOG; one of them was expected")
    from pmsm_ctrl.track import watch
    from pmsm_ctrl.track.sources import lines_from

    channels = parse_map(mapping)
    return watch(
        design, lines_from(live, channels), source="standard input" if live == "-" else live, mapping=channels,
        estimate=estimate, patience=math.inf if idle is None else idle, show=_show(design), alarm=_tell,
    )  # fmt: skip


def _show(design: Design) -> Callable[[Reading], None]:
    from pmsm_ctrl.rendering.numbers import with_error
    from pmsm_ctrl.track.result import UNITS
    from pmsm_ctrl.units import axis_unit

    c, v = (axis_unit(UNITS[name], design.motion) for name in ("F_c", "F_v"))
    # on a terminal one line that changes, in a pipe one line after another
    end = "\r" if sys.stdout.isatty() else "\n"

    def show(reading: Reading) -> None:
        F_c, F_v = with_error(reading.F_c, reading.stderr_F_c), with_error(reading.F_v, reading.stderr_F_v)
        print(f"{reading.t:10.3f} s: F_c {F_c} {c}, F_v {F_v} {v} ({reading.event})".ljust(79), end=end, flush=True)

    return show


def _tell(alarm: Alarm) -> None:
    changed = ", ".join(f"{name} {alarm.before[name]:.4g} -> {alarm.after[name]:.4g}" for name in alarm.before)
    print(f"\nalarm: friction or load changed abruptly at {alarm.t:.3f} s: {changed}", flush=True)
