"""Plots of a compensation: the gain sweep, and one line of the acceptance."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from pmsm_ctrl.compensate.notices import sentence
from pmsm_ctrl.units import axis_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pmsm_ctrl.compensate.acceptance import Verdict
    from pmsm_ctrl.compensate.examples import Example
    from pmsm_ctrl.compensate.result import CompensationStudy

__all__ = ["acceptance", "circle", "gain_sweep", "reversal"]

# Colours of Okabe and Ito, distinguishable with any colour vision.
BLUE, GREEN, RED, PURPLE = "#0072B2", "#009E73", "#D55E00", "#CC79A7"


def gain_sweep(study: CompensationStudy) -> Figure:
    """Draw error and limit cycle against the gain, for each source."""
    figure, upper, lower = _panels()
    for (source, window), colour in zip(study.windows.items(), (BLUE, GREEN, RED, PURPLE), strict=False):
        percent = 100.0 * window.gains
        upper.plot(
            percent,
            100.0 * window.rms,
            "o-",
            color=colour,
            markersize=3,
            label=source,
        )
        lower.plot(percent, 1e3 * window.cycle, "o-", color=colour, markersize=3)
        for axis in (upper, lower):
            axis.axvline(100.0 * window.safe, color=colour, linestyle=":", linewidth=1.0)
    own = study.design.compensation.source
    used = own if own in study.windows else next(iter(study.windows))  # a tracker feeds forward by the reference
    for axis in (upper, lower):
        axis.axvspan(0.0, 100.0 * study.windows[used].safe, color=BLUE, alpha=0.1, linewidth=0)
    upper.axhline(100.0, color="black", linewidth=0.6)
    if not any(window.resolved for window in study.windows.values()):
        told = "the encoder does not resolve the error without compensation"
        upper.text(0.5, 0.5, told, transform=upper.transAxes, ha="center", va="bottom")
    upper.set(
        ylabel="worst RMS error\n[% of the uncompensated]",
        title=f"Gain sweep, parameters right and {100.0 * study.doubt.share:.0f} % wrong\n"
        f"(dotted: highest safe gain; shaded: safe by {used} speed)",
    )
    _legend(figure, upper)
    angle = axis_unit("rad", study.design.motion)
    lower.set(ylabel=f"limit cycle at rest [m{angle}]", xlabel="gain of the compensation [%]")
    return figure


def reversal(example: Example, angle: str) -> Figure:
    """Draw the position error around a reversal with and without compensation, and the reference speed."""
    figure, upper, lower = _panels((2, 1))
    figure.set_size_inches(6.4, 4.2)
    upper.plot(example.t, 1e3 * example.without, "--", color=RED, linewidth=1.2, label="without compensation")
    upper.plot(example.t, 1e3 * example.compensated, color=BLUE, linewidth=1.2, label=example.label)
    upper.set_ylabel(f"position error [m{angle}]")
    _legend(figure, upper)
    lower.plot(example.t, example.speed, color="black", linewidth=1.2)
    lower.axhline(0.0, color="black", linewidth=0.6)
    lower.set(ylabel=f"reference\nspeed [{angle}/s]", xlabel="time from the reversal [s]")
    return figure


def circle(example: Example, angle: str) -> Figure:
    """Draw the radial error of a circle, magnified, with and without compensation."""
    from matplotlib.figure import Figure

    assert example.angle is not None
    peak = max(float(np.max(np.abs(error))) for error in (example.without, example.compensated))
    rough = 0.4 * example.radius / max(peak, 1e-300)
    decade = 10.0 ** np.floor(np.log10(rough))
    magnified = decade * max(k for k in (1.0, 2.0, 5.0) if k * decade <= rough)
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    around = np.linspace(0.0, 2.0 * np.pi, 361)
    axes.plot(example.radius * np.cos(around), example.radius * np.sin(around), color="#888888", linewidth=0.8)
    plain, full = (example.without, "--", RED, "without compensation"), (example.compensated, "-", BLUE, example.label)
    for error, style, colour, label in (plain, full):
        r = example.radius + magnified * error
        axes.plot(r * np.cos(example.angle), r * np.sin(example.angle), style, color=colour, linewidth=1.2, label=label)
    axes.axhline(0.0, color="#888888", linewidth=0.5)
    axes.axvline(0.0, color="#888888", linewidth=0.5)
    axes.set_aspect("equal")
    axes.set(xlabel=f"axis 1 [{angle}]", ylabel=f"axis 2 [{angle}]")
    axes.set_title(f"radial error magnified {magnified:g} times, largest {1e3 * peak:.3g} m{angle}", fontsize="medium")
    _legend(figure, axes)
    return figure


def acceptance(verdict: Verdict) -> Figure:
    """Draw the position error with and without the compensation, and the current reference."""
    angle = axis_unit("rad", verdict.design.motion)
    figure, upper, lower = _panels()
    head, _, rest = sentence(verdict).partition(" (")
    title = f"{verdict.design.name}, {head}"
    figure.suptitle(f"{title}\n{rest.removesuffix(')')}" if rest else title, fontsize="medium", parse_math=False)
    for label, logs, colour in (
        ("without compensation", verdict.without, BLUE),
        ("as designed", verdict.with_it, RED),
    ):
        for axis, log in enumerate(logs):
            style, name = ("-", "--")[axis], label if len(logs) == 1 else f"{label}, axis {axis + 1}"
            error = log["theta_ref"] - log["theta_true"]
            upper.plot(log.t, 1e3 * error, style, color=colour, linewidth=0.8, label=name)
            lower.plot(log.t, log["i_q_ref"], style, color=colour, linewidth=0.6)
    upper.set_ylabel(f"position error [m{angle}]")
    _legend(figure, upper)
    lower.set(ylabel="current reference [A]", xlabel="time [s]")
    return figure


def _legend(figure: Figure, axes: Axes) -> None:
    """Name the curves below the figure, where the names cover none of them."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4), fontsize="small")


def _panels(heights: tuple[int, int] = (1, 1)) -> tuple[Figure, Axes, Axes]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    panels: Iterable[Axes] = figure.subplots(2, 1, sharex=True, height_ratios=heights)
    upper, lower = panels
    for axis in (upper, lower):
        axis.grid(alpha=0.3)
    return figure, upper, lower
