"""What a tracking says: warnings, the friction at the end of the log, its course."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pmsm_ctrl.rendering.numbers import number, probability, with_error
from pmsm_ctrl.section import Block, Picture, Section, Table, present
from pmsm_ctrl.track.result import Tracking
from pmsm_ctrl.track.watching import Watched

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE_ROWS = 12


@present.register
def _(tracking: Tracking) -> Section:
    mean = tracking.mean_nis
    samples = ", ".join(f"{name} {count}" for name, count in tracking.counts.items())
    consistency = "" if mean is None else f" Mean normalised innovation squared: {number(mean)}, expected 1."
    return Section(
        f"Friction tracked over {Path(tracking.log_name).name}",
        (
            f"Extended Kalman filter for {tracking.design.name} over {number(float(np.ptp(tracking.t)))} s.",
            *tracking.notices,
            _estimates(tracking),
            *([_records(tracking)] if tracking.by_record else []),
            f"Samples: {samples}.{consistency}",
            "At standstill the filter keeps the friction. At constant speed only the sum F_c + F_v abs(omega) is "
            "observable, and the ratio of F_c and F_v is kept.",
            _history(tracking),
            Picture(lambda: _figure(tracking), "The 95 % bands are narrow where the motion separates F_c and F_v."),
        ),
    )


def _estimates(tracking: Tracking) -> Table:
    rows = tuple(
        (
            f"{name} [{e.unit}]",
            with_error(e.value, e.stderr),
            number(float(tracking.history[name].min())),
            number(float(tracking.history[name].max())),
            "-" if e.nominal is None else number(e.nominal),
        )
        for name, e in tracking.estimates.items()
    )
    return Table(("parameter", "at the end", "smallest", "largest", "design"), rows)


def _records(tracking: Tracking) -> Table:
    """Return the friction at the end of each record."""
    header = ("record", *(f"{name} [{e.unit}]" for name, e in tracking.estimates.items()))
    rows = tuple(
        (name, *(with_error(e.value, e.stderr) for e in found.values())) for name, found in tracking.by_record.items()
    )
    return Table(header, rows, "At the end of each record")


def _history(tracking: Tracking) -> Table:
    header = ("t [s]", *(f"{name} [{e.unit}]" for name, e in tracking.estimates.items()))
    rows = []
    for k in np.unique(np.linspace(0, tracking.t.size - 1, TABLE_ROWS).astype(np.int64)).tolist():
        cells = (with_error(float(tracking.history[n][k]), float(tracking.stderr[n][k])) for n in tracking.history)
        rows.append((number(float(tracking.t[k])), *cells))
    return Table(header, tuple(rows), caption="Course of the estimates", folded=True)


def _figure(tracking: Tracking) -> Figure:
    from pmsm_ctrl.track.figures import draw

    return draw(tracking)


@present.register
def _(watched: Watched) -> Section:
    rows = tuple(
        (f"{name} [{e.unit}]", with_error(e.value, e.stderr), "-" if e.nominal is None else number(e.nominal))
        for name, e in watched.estimates.items()
    )
    samples = ", ".join(f"{name} {count}" for name, count in watched.counts.items())
    blocks: list[Block] = [
        f"{watched.samples} samples of {watched.source} over {number(float(np.ptp(watched.t)))} s.",
        *watched.notices,
        Table(("parameter", "last", "design"), rows),
    ]
    if watched.alarms:
        blocks.append(_alarms(watched))
    blocks.append(f"Samples: {samples}.")
    blocks.append(Picture(lambda: _course(watched), "F_c and F_v with 95 % bands; alarms are orange lines."))
    return Section(f"Friction tracked live: {watched.source}", tuple(blocks))


def _alarms(watched: Watched) -> Table:
    rows = tuple(
        (
            one.parameter, one.kind, f"{one.t:.3f}", f"{one.earliest:.3f} to {one.latest:.3f}", number(one.before),
            number(one.after), probability(one.p_value),
        )
        for one in watched.alarms
    )  # fmt: skip
    header = ("parameter", "change", "t [s]", "between [s]", "before", "after", "p")
    return Table(header, rows, "Friction that changed over the windows of the stream, in the units above")


def _course(watched: Watched) -> Figure:
    from pmsm_ctrl.track.figures import course

    return course(watched)
