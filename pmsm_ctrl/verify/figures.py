"""Figures of a downloaded compensator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pmsm_ctrl.verify.quadrants import QuadrantError
from pmsm_ctrl.verify.result import Verification

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["added", "polar", "reversal"]

# Colours of Okabe and Ito, distinguishable with any colour vision.
BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#666666"
MOST = 4000  # points


def added(result: Verification) -> Figure:
    """Draw the added current over time and over the compensator's own."""
    figure = _figure(9.0, 3.8)
    left, right = figure.subplots(1, 2, width_ratios=(2, 1))
    step = max(1, len(result.t) // MOST)
    kept = slice(None, None, step)
    wanted = result.predicted / result.gain.value if abs(result.gain.value) > 0.05 else 0.0 * result.predicted
    left.plot(result.t[kept], result.added[kept], color=BLUE, lw=0.8, label="found in the log")
    left.plot(
        result.t[kept], result.predicted[kept], color=ORANGE, lw=1.0, ls="--", label="fitted share of the design's"
    )
    left.set(xlabel="time [s]", ylabel="added current [A]")
    left.legend(frameon=False)
    right.plot(wanted[kept], result.added[kept], ".", ms=2, color=BLUE, alpha=0.5)
    top = 1.1 * float(np.max(np.abs(wanted))) or 1.0
    right.plot([-top, top], [-top, top], color=GREY, lw=0.8)
    right.set(xlabel="compensator of the design [A]", ylabel="found [A]")
    right.locator_params(axis="x", nbins=4)  # labels of three decimals overlap beyond that
    for axes in (left, right):
        _finish(axes)
    return figure


def reversal(result: Verification) -> Figure:
    """Draw the mean error around a reversal before and after."""
    figure = _figure(6.0, 3.6)
    axes = figure.subplots()
    for one, colour, label in ((result.before, GREY, "before"), (result.after, BLUE, "after")):
        axes.plot(1e3 * one.t, one.error, color=colour, label=label)
    axes.axvline(0.0, color=GREY, lw=0.6, ls=":")
    axes.set(xlabel="time from the reversal [ms]", ylabel=f"tracking error [{result.after.unit}]")
    axes.legend(frameon=False)
    _finish(axes)
    return figure


def polar(result: QuadrantError) -> Figure:
    """Draw the deviation of both records around the circle, so enlarged that the largest is a quarter of the radius."""
    figure = _figure(5.6, 5.6)
    axes = figure.add_subplot(projection="polar")
    records = [(result.before, GREY, "before"), *([(result.after, BLUE, "after")] if result.after else [])]
    scale = 0.25 / max(one.worst for one, _, _ in records)
    turn = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(turn, np.ones_like(turn), color=ORANGE, lw=0.8, label="reference")
    for one, colour, label in records:
        step = max(1, len(one.angle) // MOST)
        axes.plot(one.angle[::step], 1.0 + scale * one.deviation[::step], color=colour, lw=0.9, label=label)
    axes.set(ylim=(0.0, 1.4), yticks=[1.0 - 0.25, 1.0, 1.25])
    axes.set_yticklabels([f"{-0.25 / scale:.2g}", "0", f"{0.25 / scale:.2g} {result.unit}"])
    axes.legend(frameon=False, loc="center")
    return figure


def _finish(axes: Axes) -> None:
    axes.grid(True, alpha=0.25)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")
