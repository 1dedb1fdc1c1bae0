"""Figures of a comparison. Colours of Okabe and Ito, safe for the colour-blind."""

from __future__ import annotations

from pathlib import Path
from textwrap import shorten, wrap
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pmsm_ctrl.compare.notices import OBJECTIONS, motion_words
from pmsm_ctrl.identify.figures import BLACK, BLUE, VERMILION, scaled_by_most
from pmsm_ctrl.section import gaps_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pmsm_ctrl.compare.comparison import Record
    from pmsm_ctrl.residuals.dependence import Dependence, ResidualStructure

__all__ = ["SHADE", "outline", "stretches_figure", "structure_figure", "traces_figure"]

Array = NDArray[np.float64]

GREY, SHADE = "#7f8a97", "#F0E442"
DOTS = 4000  # samples shown of a longer log
PANEL_WIDTH = 44  # letters of a small title over a third of the figure


def outline(t: Array, y: Array, bins: int = 500) -> tuple[Array, Array]:
    """Thin a line to the lowest and highest sample of each of so many stretches: it looks the same.

    It is broken where a stretch holds no number, and at the gap between two records.
    """
    if (at := gaps_of(t)).size:
        pieces = [
            outline(time, values, max(1, bins * len(time) // len(t)))
            for time, values in zip(np.split(t, at), np.split(y, at), strict=True)
        ]
        times = [np.append(time, time[-1]) for time, _ in pieces]
        return np.concatenate(times)[:-1], np.concatenate([np.append(values, np.nan) for _, values in pieces])[:-1]
    width = -(-len(t) // bins)
    if width < 4:
        return t, y
    count = len(t) // width
    parts, start = y[: count * width].reshape(count, width), np.arange(count) * width
    empty = np.isnan(parts)
    lowest, highest = np.where(empty, np.inf, parts).argmin(axis=1), np.where(empty, -np.inf, parts).argmax(axis=1)
    picked = np.sort(np.stack([start + lowest, start + highest]), axis=0).T.ravel()
    return t[picked], y[picked]


def traces_figure(record: Record) -> Figure:
    """Draw measured, predicted and residual of every channel; shade the worst stretches."""
    traces = record.traces
    figure = Figure(figsize=(8.0, 3.4 * len(traces)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(2 * len(traces), 1, sharex=True, height_ratios=[2, 1] * len(traces)))
    for k, (name, trace) in enumerate(traces.items()):
        upper, lower = axes[2 * k], axes[2 * k + 1]
        shown = np.where(trace.mask, 1.0, np.nan)
        upper.plot(*outline(trace.t, trace.measured * shown), color=BLACK, linewidth=1.0, label="measured")
        upper.plot(
            *outline(trace.t, trace.predicted * shown), color=BLUE, linewidth=1.0, linestyle="--", label="predicted"
        )
        upper.set_ylabel(f"{'force' if trace.unit == 'N' else name} [{trace.unit}]")
        lower.plot(*outline(trace.t, trace.residual * shown), color=VERMILION, linewidth=0.8)
        lower.axhline(0.0, color=BLACK, linewidth=0.5)
        lower.set_ylabel(f"residual [{trace.unit}]")
        scaled_by_most(lower, trace.residual[trace.mask])
        for each in (upper, lower):
            each.grid(alpha=0.3)
            for stretch in record.stretches:
                each.axvspan(stretch.start, stretch.stop, color=SHADE, alpha=0.35, linewidth=0)
    axes[0].legend(loc="upper right", fontsize="small")
    name = shorten(Path(record.name).name, 60, placeholder=" ...")  # a name can be wider than the figure
    axes[0].set_title(f"Measured against predicted, {name}\nfiltered, without standstill", parse_math=False)
    axes[-1].set_xlabel("time [s]")
    return figure


def structure_figure(record: Record, channel: str = "torque") -> Figure:
    """Draw the shares, the residual over every coordinate with its curve, and the spectrum over the angle."""
    found, residual = record.structure[channel], record.traces[channel].residual
    spectral = [d for d in found.dependences if d.spectrum is not None]
    panels = 1 + len(found.dependences) + len(spectral)
    rows = -(-panels // 3)
    figure = Figure(figsize=(10.5, 2.9 * rows), layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, 3)).ravel()
    _share_panel(axes[0], found)
    here = iter(axes[1:])
    for d in found.dependences:
        _dependence_panel(next(here), d, residual, found)
        if d.spectrum is not None:
            _spectrum_panel(next(here), d, found.unit)
    for left in here:
        left.set_axis_off()
    figure.suptitle(f"Dependence of the {channel} residual", fontsize=11)
    return figure


def _state(d: Dependence) -> str:
    return f"{100 * d.share:.0f} %" if d.objection is None else OBJECTIONS[d.objection]


def _share_panel(axes: Axes, found: ResidualStructure) -> None:
    """Bars: what share of the residual each coordinate explains by itself."""
    shown = list(found.dependences)[::-1]
    colours = [VERMILION if d.significant else GREY for d in shown]
    axes.barh([d.coordinate for d in shown], [100 * d.share for d in shown], color=colours)
    for k, d in enumerate(shown):
        text = _state(d)
        axes.text(100 * d.share + 1.5, k, text, va="center", fontsize="x-small")
    axes.set_xlim(0.0, 118.0)
    axes.set_xticks([0, 25, 50, 75, 100])
    axes.set_xlabel("share of the residual [%]")
    axes.set_title("Each coordinate by itself", fontsize="small")
    axes.grid(alpha=0.3, axis="x")


def _dependence_panel(axes: Axes, d: Dependence, residual: Array, found: ResidualStructure) -> None:
    """The residual over one coordinate, and the fitted curve for either direction."""
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    used = np.flatnonzero(found.mask)
    used = used[:: max(1, len(used) // DOTS)]
    axes.plot(d.values[used], residual[used], ".", ms=1.5, alpha=0.35, color=GREY, rasterized=True, zorder=0)
    faint = 1.0 if d.significant else 0.35
    if d.coordinate == "direction":
        axes.plot([-1.0, 1.0], [d.backward[0], d.forward[1]], "s", color=VERMILION, ms=8, alpha=faint)
        axes.set_xticks([-1.0, 1.0], ["backward", "forward"])
        axes.set_xlim(-1.8, 1.8)
    elif d.coordinate == "speed":
        x, y = np.concatenate([-d.x[::-1], d.x]), np.concatenate([d.backward[::-1], d.forward])
        axes.plot(x, y, color=VERMILION, linewidth=1.6, alpha=faint)
        # friction bends at low speed, where a straight scale shows nothing
        slow, fast = (float(f"{share * d.x[-1]:.1g}") for share in (0.05, 1.0))
        axes.set_xscale("symlog", linthresh=slow, linscale=1.2)
        axes.set_xticks(marks := [-fast, -slow, 0.0, slow, fast], [f"{mark:g}" for mark in marks])
        axes.set_xticks([], minor=True)
        axes.set_xlabel(f"speed [{d.unit}], logarithmic")
    else:
        for y, colour, style, label in zip(
            (d.forward, d.backward), (BLUE, VERMILION), ("-", "--"), ("forward", "backward"), strict=True
        ):
            if np.isfinite(y).any():
                axes.plot(d.x, y, color=colour, linestyle=style, linewidth=1.5, label=label, alpha=faint)
        if d.significant:
            axes.legend(fontsize="x-small", loc="upper right", framealpha=0.7)
        axes.set_xlabel(("angle within a turn" if d.orders else d.coordinate) + f" [{d.unit}]")
        margin = 0.05 * float(d.x[-1] - d.x[0])
        axes.set_xlim(float(d.x[0]) - margin, float(d.x[-1]) + margin)
    scaled_by_most(axes, residual[used], d.peak)
    axes.set_ylabel(f"residual [{found.unit}]")
    said = f"over {d.coordinate}: {_state(d)}"
    axes.set_title("\n".join(wrap(said, PANEL_WIDTH, break_on_hyphens=False)), fontsize="small")
    axes.grid(alpha=0.3)


def _spectrum_panel(axes: Axes, d: Dependence, unit: str) -> None:
    """The residual's spectrum over the angle, mechanical orders; orders in the curve are marked."""
    assert d.spectrum is not None
    amplitude, level = d.spectrum
    orders = np.arange(1, len(amplitude) + 1)
    axes.vlines(orders, 0.0, amplitude, color=GREY, linewidth=1.2)
    axes.plot(orders, level, color=BLACK, linestyle=":", linewidth=1.0, label="noise limit")
    axes.legend(fontsize="x-small", loc="best", framealpha=0.7)
    for k in d.orders if d.significant else ():
        axes.plot([k, k], [0.0, amplitude[k - 1]], color=VERMILION, linewidth=2.2)
        axes.annotate(str(k), (k, amplitude[k - 1]), fontsize="x-small", ha="center", va="bottom")
    axes.set_ylim(bottom=0.0, top=1.2 * float(np.nanmax(amplitude)))
    axes.set_xlim(0.0, float(orders[np.isfinite(amplitude)].max()) + 2.0)
    axes.set_xlabel("order [waves per turn]")
    axes.set_ylabel(f"amplitude [{unit}]")
    axes.set_title("spectrum over the angle", fontsize="small")
    axes.grid(alpha=0.3)


def stretches_figure(record: Record) -> Figure:
    """Draw measured against predicted in the worst stretches, with the speed below."""
    trace, count = record.traces["torque"], max(1, len(record.stretches))
    figure = Figure(figsize=(3.6 * count, 4.2), layout="constrained")
    axes = figure.subplots(2, count, squeeze=False, sharex="col", height_ratios=[2, 1])
    linear = trace.unit == "N"
    speed_unit = "m/s" if linear else "rad/s"
    for k, stretch in enumerate(record.stretches):
        upper, lower = axes[0][k], axes[1][k]
        around = 0.6 * (stretch.stop - stretch.start)
        part = (trace.t >= stretch.start - around) & (trace.t <= stretch.stop + around)
        upper.axvspan(stretch.start, stretch.stop, color=SHADE, alpha=0.35, linewidth=0)
        upper.plot(trace.t[part], trace.measured[part], color=BLACK, linewidth=1.2, label="measured")
        upper.plot(trace.t[part], trace.predicted[part], color=BLUE, linewidth=1.2, linestyle="--", label="predicted")
        lower.plot(trace.t[part], record.omega[part], color=BLACK, linewidth=1.0)
        lower.axhline(0.0, color=BLACK, linewidth=0.5)
        lower.set_xlabel("time [s]")
        upper.set_title(
            f"{stretch.start:.4g} to {stretch.stop:.4g} s\n{motion_words(stretch.motion, speed_unit)}", fontsize="small"
        )
        for each in (upper, lower):
            each.grid(alpha=0.3)
    axes[0][0].set_ylabel(f"{'force' if linear else 'torque'} [{trace.unit}]")
    axes[1][0].set_ylabel(f"speed [{speed_unit}]")
    axes[0][0].legend(fontsize="x-small")
    return figure
