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
    estimate: tuple[str, ...] | None, idle: float | None, window: float,
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
    window : float
        Duration of motion of a record, s: alarms are changes over records.

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
        estimate=estimate, patience=math.inf if idle is None else idle, window=window,
        show=_show(design), alarm=_alarm_line(design),
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


def _alarm_line(design: Design) -> Callable[[Alarm], None]:
    from pmsm_ctrl.rendering.numbers import probability
    from pmsm_ctrl.track.result import UNITS
    from pmsm_ctrl.units import axis_unit

    def tell(alarm: Alarm) -> None:
        unit = axis_unit(UNITS[alarm.parameter], design.motion)
        where = (
            f"at {alarm.t:.1f} s ({alarm.earliest:.1f} to {alarm.latest:.1f} s)"
            if alarm.kind == "step"
            else f"from {alarm.earliest:.1f} to {alarm.latest:.1f} s"
        )
        change = f"{alarm.parameter} {alarm.before:.4g} -> {alarm.after:.4g} {unit}"
        print(f"\nalarm: {change}, a {alarm.kind} {where}, p = {probability(alarm.p_value)}", flush=True)

    return tell
