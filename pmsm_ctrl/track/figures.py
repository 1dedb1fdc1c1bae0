"""The figure of a tracking: estimates with bands, speed and gating, innovations. Colours of Okabe and Ito."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pmsm_ctrl.track import model
from pmsm_ctrl.units import axis_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmsm_ctrl.track.result import Tracking
    from pmsm_ctrl.track.watching import Watched

__all__ = ["course", "draw"]

BLACK, BLUE, VERMILION, GREEN, GREY = "#000000", "#0072B2", "#D55E00", "#009E73", "#999999"
POINTS = 4000  # more than a page can show
SHADES = {
    "standstill": ((model.STANDSTILL,), GREY),
    "constant speed: only the sum is seen": ((model.CONSTANT,), "#56B4E9"),
    "rejected, implausible or missing": ((model.REJECTED, model.IMPLAUSIBLE, model.GAP), VERMILION),
}


def draw(tracking: Tracking) -> Figure:
    """Draw the estimates with 95 % bands, the speed with what was gated, and the innovations."""
    from matplotlib.figure import Figure

    names = list(tracking.history)
    figure = Figure(figsize=(8.0, 2.0 * (len(names) + 2)), layout="constrained")
    axes = figure.subplots(len(names) + 2, 1, sharex=True)
    shown = slice(None, None, max(1, tracking.t.size // POINTS))
    estimates = tracking.estimates
    for axis, name in zip(axes, names, strict=False):
        _estimate(axis, tracking, name, estimates[name].unit, estimates[name].nominal, shown)
    axes[0].set_title("Tracked friction with 95 % bands; narrow where the motion excites it")
    _gating(axes[-2], tracking, shown)
    _innovations(axes[-1], tracking)
    for axis in axes:
        axis.grid(alpha=0.3)
    axes[-1].set_xlabel("time [s]")
    return figure


def _estimate(axis: Any, tracking: Tracking, name: str, unit: str, nominal: float | None, shown: slice) -> None:
    t, values, spread = tracking.t[shown], tracking.history[name][shown], 1.96 * tracking.stderr[name][shown]
    axis.fill_between(t, values - spread, values + spread, color=BLUE, alpha=0.25, linewidth=0, label="95 % band")
    axis.plot(t, values, color=BLUE, linewidth=1.2, label="estimate")
    if nominal is not None:
        axis.axhline(nominal, color=BLACK, linewidth=0.8, linestyle=":", label="design")
    axis.set_ylabel(f"{name} [{unit}]")
    axis.legend(loc="upper right", fontsize="x-small", ncols=3)


def _gating(axis: Any, tracking: Tracking, shown: slice) -> None:
    """Speed, and behind it what kept the filter from learning."""
    unit = axis_unit("rad/s", tracking.design.motion)
    axis.plot(tracking.t[shown], tracking.omega[shown], color=BLACK, linewidth=0.8)
    low, high = axis.get_ylim()
    for label, (events, colour) in SHADES.items():
        found = np.isin(tracking.events, events)
        if not found.any():
            continue
        # one mark per event, or per update interval: thin lines merge into an area where they are dense
        where = tracking.t[found]
        where = where[:: max(1, where.size // POINTS)]
        axis.vlines(where, low, high, color=colour, alpha=0.35, linewidth=0.8, label=label, zorder=0)
    axis.set_ylim(low, high)
    axis.set_ylabel(f"speed [{unit}]")
    if axis.get_legend_handles_labels()[1]:
        axis.legend(loc="upper right", fontsize="x-small")


def _innovations(axis: Any, tracking: Tracking) -> None:
    judged = np.flatnonzero(np.isfinite(tracking.normalised))
    judged = judged[:: max(1, judged.size // POINTS)]
    axis.axhspan(-1.96, 1.96, color=GREEN, alpha=0.15, linewidth=0, label="95 % range")
    axis.plot(tracking.t[judged], tracking.normalised[judged], ".", markersize=1.5, color=VERMILION)
    axis.set_ylabel("normalised innovation [1]")
    axis.legend(loc="upper right", fontsize="x-small")


def course(watched: Watched) -> Figure:
    """Draw F_c and F_v of a live source with 95 % bands, alarms as lines."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    for axes, name in zip(figure.subplots(2, 1, sharex=True), ("F_c", "F_v"), strict=True):
        value, stderr = getattr(watched, name), getattr(watched, f"stderr_{name}")
        axes.fill_between(watched.t, value - 1.96 * stderr, value + 1.96 * stderr, alpha=0.25, lw=0)
        axes.plot(watched.t, value)
        for alarm in watched.alarms:
            axes.axvline(alarm.t, color="#D55E00", lw=0.8)
        axes.set_ylabel(f"{name} [{watched.estimates[name].unit}]")
        axes.grid(True, alpha=0.25)
    figure.axes[-1].set_xlabel("time [s]")
    return figure
