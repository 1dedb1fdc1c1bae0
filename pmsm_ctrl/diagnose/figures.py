"""Figures of the diagnosis: falling error, residual maps, worst stretch, contributions. Colours of Okabe and Ito."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.figures import SHADE
from pmsm_ctrl.compare.notices import motion_words
from pmsm_ctrl.compare.stretches import Stretch, worst_stretches
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.identify.figures import BLACK, BLUE, VERMILION, parted
from pmsm_ctrl.rendering.numbers import percent, with_prefix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmsm_ctrl.diagnose.fit import Fitted
    from pmsm_ctrl.diagnose.result import Diagnosis, Errors, Structure

__all__ = [
    "Plane", "contributions", "contributions_figure", "ends_figure", "error_figure", "falling_figure", "maps_figure",
    "plane_of", "rms_within", "structure_figure", "worst_stretch", "worst_stretch_figure",
]  # fmt: skip

Array = NDArray[np.float64]

# Told apart by the colour-blind; from the fifth on they are hatched as well.
PALETTE = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#F0E442", "#D55E00", "#7f8a97")
MOST_MAPS = 6
CELLS = (24, 18)  # of a map: over speed, and over the other coordinate
LEAST = 3  # samples in a cell that is drawn
SPEED_BINS = 24
WHITE = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}  # behind a number, which a line may cross
NEGLIGIBLE = 1e-3  # of the largest part: a smaller one is not drawn


def _names(d: Diagnosis) -> list[str]:
    return [step.name for step in d.steps]


def _linear(d: Diagnosis) -> bool:
    return d.record.linear


def _speed_label(d: Diagnosis) -> str:
    return "speed [m/s]" if _linear(d) else "speed [rad/s]"


def _balance(d: Diagnosis, channel: str) -> str:
    return d.record.drive if channel == "torque" else channel


def _torque_label(d: Diagnosis, what: str = "") -> str:
    return f"{d.record.drive}{what} [{d.record.unit('torque')}]"


# ---- falling error --------------------------------------------------------------------------------------------------


def error_figure(d: Diagnosis) -> Figure:
    """Draw the relative error of every balance after every step, on the log and on the held-out record."""
    from matplotlib.figure import Figure

    channels = list(d.errors["base"])
    models = ["design\nas given", "parameters\nrefitted", *(f"+ {name}" for name in _names(d))]
    figure = Figure(figsize=(9.0, 3.6 if len(channels) == 1 else 2.6 * len(channels) + 0.8), layout="constrained")
    panels = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for axes, channel in zip(panels, channels, strict=True):
        own = [d.errors[model][channel]["relative"] for model in ("nominal", "base")]
        own += [s.error_after[channel]["relative"] for s in d.steps]
        held_out = bool(d.steps) and channel in d.steps[0].holdout_before
        _steps(axes, list(range(len(own))), own, BLUE, "o-", "log", (0, -13) if held_out else (0, 7))
        if held_out:
            other = [d.steps[0].holdout_before[channel]["relative"]]
            other += [s.holdout_after[channel]["relative"] for s in d.steps]
            _steps(axes, list(range(1, 1 + len(other))), other, VERMILION, "s--", "held-out record", (0, 7))
        floor = d.errors["noise_floor"][channel]["relative"] * 100
        axes.axhline(floor, color=BLACK, linestyle=":", label=f"noise floor, {floor:.3g} %")
        axes.set_ylim(0.0, 1.28 * axes.get_ylim()[1])
        axes.set_ylabel(f"{_balance(d, channel)} error [%]")
        axes.legend(fontsize="small", loc="best")
        axes.grid(alpha=0.3)
    panels[-1].set_xticks(range(len(models)), models, fontsize="small", rotation=0 if len(models) < 6 else 20)
    panels[-1].set_xlim(-0.4, len(models) - 0.6)
    panels[-1].tick_params(axis="x", pad=14)  # an error near zero is written below its point
    panels[0].set_title("Relative error, step by step")
    return figure


def _steps(
    axes: Any, x: list[int], values: Sequence[float], colour: str, style: str, label: str, offset: tuple[int, int]
) -> None:
    axes.plot(x, 100 * np.array(values), style, color=colour, label=label)
    for k, value in zip(x, values, strict=True):
        axes.annotate(
            f"{100 * value:.3g}", (k, 100 * value), textcoords="offset points", xytext=offset, fontsize="x-small",
            ha="center", color=colour, bbox=WHITE, zorder=3,
        )  # fmt: skip


def falling_figure(d: Diagnosis) -> Figure:
    """Draw the relative error of the torque (force) after every step as bars, on fitted and held-out records."""
    from matplotlib.figure import Figure

    names = ["design as given", "parameters refitted", *(f"+ {name}".replace("_", " ") for name in _names(d))]
    own = [d.errors["nominal"], d.errors["base"], *(step.error_after for step in d.steps)]
    other: list[Errors] = []
    if d.steps and "torque" in d.steps[0].holdout_before:
        other = [{}, d.steps[0].holdout_before, *(step.holdout_after for step in d.steps)]
    figure = Figure(figsize=(6.4, 1.5 + (0.62 if other else 0.42) * len(names)), layout="constrained")
    axes = figure.subplots()
    rows = [("fitted", BLUE, own), *([("held-out", VERMILION, other)] if other else [])]
    width = 0.36 if other else 0.6
    for k, (label, colour, errors) in enumerate(rows):
        places = [n + (k - 0.5) * 1.05 * width * (len(rows) > 1) for n, one in enumerate(errors) if one]
        values = [100.0 * one["torque"]["relative"] for one in errors if one]
        bars = axes.barh(places, values, width, color=colour, hatch="" if k == 0 else "//", edgecolor="white", lw=0,
                         label=f"{label} record")  # fmt: skip
        axes.bar_label(bars, [percent(value / 100.0) for value in values], padding=5, fontsize=10, bbox=WHITE, zorder=3)
    floor = 100.0 * d.errors["noise_floor"]["torque"]["relative"]
    axes.axvline(floor, color=BLACK, linestyle=":", label=f"noise floor {floor:.2f} %")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel(f"{d.record.drive} error [% of its rms]")
    axes.margins(x=0.14)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside lower center", frameon=False, ncols=3, fontsize="small")
    return figure


# ---- residual maps --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Plane:
    """The second coordinate of the maps, shape (m,), in which the first residual has the most shape."""

    name: str
    label: str
    values: Array


def plane_of(d: Diagnosis) -> Plane:
    """Choose position or acceleration for the maps: where the cells' means explain more of the first residual.

    On a rotary axis the position is the angle within one wave of the first order found, or within a turn.
    """
    first = d.selection.fits[0]
    record, used = first.record, first.record.mask
    theta = record.at_grid(record.signals["theta"])
    planes = [
        Plane(
            "acceleration",
            f"acceleration [{'m/s²' if _linear(d) else 'rad/s²'}]",
            record.at_grid(record.signals["alpha"]),
        )
    ]
    if _linear(d):
        planes.append(Plane("position", "position [m]", theta))
    else:
        effects = catalogue_of(d.design)
        orders = [s.parameters[effects[s.effect].order].value for s in d.steps if effects[s.effect].order]
        order = orders[0] if orders else 1.0
        within = f"angle in a wave of order {order:g} [rad]" if order != 1.0 else "angle in a turn [rad]"
        planes.append(Plane("position", within, np.mod(order * theta, 2.0 * np.pi)))
    omega = record.at_grid(record.signals["omega"])
    shares = [_explained(omega[used], p.values[used], first.left[0][used]) for p in planes]
    return planes[int(np.argmax(shares))]


def _edges(values: Array, count: int) -> Array:
    """Edges of cells, half-way between evenly spread ones and ones that hold equally many samples."""
    low, high = np.quantile(values, [0.005, 0.995])
    even = np.linspace(low, high if high > low else low + 1.0, count + 1)
    full = np.quantile(values, np.linspace(0.005, 0.995, count + 1))
    edges: Array = 0.5 * (even + np.maximum(full, low))
    return edges


def _explained(omega: Array, other: Array, residual: Array) -> float:
    """Share of the residual's variance that the cells' means explain, the cells paid for."""
    mean, count = _cells(omega, other, residual, _edges(omega, CELLS[0]), _edges(other, CELLS[1]))
    full = count >= LEAST
    between = float(np.sum(count[full] * mean[full] ** 2))
    noise = float(np.mean(residual**2)) * int(full.sum())
    return between - noise


def _cells(omega: Array, other: Array, residual: Array, x: Array, y: Array) -> tuple[Array, Array]:
    """Mean residual and number of samples of every cell."""
    count, _, _ = np.histogram2d(omega, other, bins=(x, y))
    total, _, _ = np.histogram2d(omega, other, bins=(x, y), weights=residual)
    return np.divide(total, count, out=np.zeros_like(total), where=count > 0), count


def maps_figure(d: Diagnosis) -> Figure:
    """Draw the mean residual over speed and a second coordinate, before and after each step, in one colour scale."""
    fits = list(d.selection.fits)
    titles = ["before", *(f"with {name}" for name in _names(d)[: len(fits) - 1])]
    if len(fits) > MOST_MAPS:  # the first ones and the last
        fits, titles = [*fits[: MOST_MAPS - 1], fits[-1]], [*titles[: MOST_MAPS - 1], f"... {titles[len(fits) - 1]}"]
    return _maps(d, fits, titles)


def ends_figure(d: Diagnosis) -> Figure:
    """Draw the mean residual as in `maps_figure`, before the first step and after the last."""
    first, last = d.selection.fits[0], d.selection.fits[-1]
    if first is last:
        return _maps(d, [first], ["parameters refitted"])
    return _maps(d, [first, last], ["before", "with the effects found"])


def _maps(d: Diagnosis, fits: Sequence[Fitted], titles: Sequence[str]) -> Figure:
    from matplotlib.figure import Figure

    plane = plane_of(d)
    used = fits[0].record.mask
    omega = fits[0].record.at_grid(fits[0].record.signals["omega"])[used]
    x, y = _edges(omega, CELLS[0]), _edges(plane.values[used], CELLS[1])
    cells = [_cells(omega, plane.values[used], fit.left[0][used], x, y) for fit in fits]
    columns = min(3, len(fits))
    rows = -(-len(fits) // columns)
    figure = Figure(figsize=(3.2 * columns + 0.8, 2.9 * rows + 0.3), layout="constrained")
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    limit = float(np.quantile(np.abs(cells[0][0][cells[0][1] >= LEAST]), 0.98))
    drawn = None
    for k, axes in enumerate(panels.ravel()):
        if k >= len(fits):
            axes.set_axis_off()
            continue
        mean, count = cells[k]
        shown = np.ma.masked_where(count < LEAST, mean)
        axes.set_facecolor("#dddddd")
        drawn = axes.pcolormesh(x, y, shown.T, cmap="PuOr", vmin=-limit, vmax=limit, rasterized=True)
        rms = float(np.sqrt(np.mean(fits[k].left[0][used] ** 2)))
        axes.set_title(f"{titles[k]}\nrms {with_prefix(rms, d.record.unit('torque'))}", fontsize="small")
    for axes in panels[-1]:
        axes.set_xlabel(_speed_label(d))
    figure.supylabel(plane.label, fontsize="medium")
    assert drawn is not None
    figure.colorbar(drawn, ax=panels, label=f"mean residual [{d.record.unit('torque')}]", extend="both")
    return figure


# ---- worst stretch --------------------------------------------------------------------------------------------------


def worst_stretch(d: Diagnosis) -> Stretch | None:
    """The stretch in which the design as it was, refitted, fails worst; None where none stands out."""
    first = d.selection.fits[0]
    record = first.record
    omega = record.at_grid(record.signals["omega"])
    found = worst_stretches(record.t, first.left[0], record.mask, omega, 1)
    return found[0] if found else None


def doing(d: Diagnosis, stretch: Stretch) -> str:
    """Return what the axis was doing in a stretch."""
    return motion_words(stretch.motion, "m/s" if _linear(d) else "rad/s")


def rms_within(fit: Fitted, stretch: Stretch) -> float:
    """Rms torque residual of a fit inside a stretch of time."""
    inside = fit.record.mask & (fit.record.t >= stretch.start) & (fit.record.t <= stretch.stop)
    return float(np.sqrt(np.mean(fit.left[0][inside] ** 2)))


def worst_stretch_figure(d: Diagnosis, stretch: Stretch) -> Figure:
    """Draw measured against predicted, before and with all effects, in the worst stretch."""
    from matplotlib.figure import Figure

    first, last = d.selection.fits[0], d.selection.fits[-1]
    t = first.record.t
    around = 0.5 * (stretch.stop - stretch.start)
    part = (t >= stretch.start - around) & (t <= stretch.stop + around)
    measured = first.record.target[0][part]
    figure = Figure(figsize=(8.5, 5.0), layout="constrained")
    upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=[3, 1.5, 1])
    upper.plot(*parted(t[part], measured), color=BLACK, linewidth=1.4, label="measured")
    named = "predicted with the effects found"
    for fit, colour, style, label in ((first, VERMILION, "--", "predicted before"), (last, BLUE, "-.", named)):
        residual = fit.left[0][part]
        if fit is last and len(d.selection.fits) == 1:
            continue
        upper.plot(*parted(t[part], fit.record.target[0][part] - residual), color=colour, linestyle=style, label=label)
        middle.plot(*parted(t[part], residual), color=colour, linestyle=style, linewidth=1.0)
    middle.axhline(0.0, color=BLACK, linewidth=0.5)
    speed = first.record.at_grid(first.record.signals["omega"])[part]
    lower.plot(*parted(t[part], speed), color=BLACK, linewidth=1.0)
    lower.axhline(0.0, color=BLACK, linewidth=0.5)
    upper.set_ylabel(_torque_label(d))
    middle.set_ylabel(f"residual [{d.record.unit('torque')}]")
    lower.set_ylabel(_speed_label(d))
    lower.set_xlabel("time [s]")
    upper.legend(fontsize="small", loc="upper left", bbox_to_anchor=(0.0, -0.02), ncols=3, frameon=False)
    upper.set_title(f"{stretch.start:.4g} to {stretch.stop:.4g} s: {doing(d, stretch)}")
    for axes in (upper, middle, lower):
        axes.axvspan(stretch.start, stretch.stop, color=SHADE, alpha=0.3, linewidth=0)
        axes.grid(alpha=0.3)
    return figure


# ---- contributions --------------------------------------------------------------------------------------------------


def contributions(fit: Fitted) -> dict[str, Array]:
    """What every part of the model adds to the torque balance, shape (m,); the parts sum to the prediction.

    What only sets clocks right is called timing.
    """
    out: dict[str, Array] = {}
    for position, group in enumerate(fit.model.groups):
        columns = fit.model.columns_of(position)
        values = fit.model.matrix[0][:, columns] @ fit.estimate.values[columns]
        if not np.any(values):
            continue
        key = "inertia" if group.symbols == ("J",) else "timing"
        if group.effect is not None:
            key = group.effect.label(group.shape)
        out[key] = out.get(key, 0.0) + values
    return out


def contributions_figure(d: Diagnosis) -> Figure:
    """Draw the mean contribution of every effect over speed, stacked, and its rms beside it."""
    from matplotlib.figure import Figure

    fit = d.selection.fits[-1]
    used = fit.record.mask
    omega = fit.record.at_grid(fit.record.signals["omega"])[used]
    edges = np.unique(np.quantile(omega, np.linspace(0.0, 1.0, SPEED_BINS + 1)))
    place = np.clip(np.searchsorted(edges, omega, side="right") - 1, 0, len(edges) - 2)
    count = np.maximum(np.bincount(place, minlength=len(edges) - 1), 1)
    x = np.bincount(place, omega, len(edges) - 1) / count
    parts = {name: values[used] for name, values in contributions(fit).items()}
    size = {name: float(np.mean(values**2)) for name, values in parts.items()}
    names = [n for n in sorted(parts, key=lambda n: -size[n]) if size[n] > NEGLIGIBLE**2 * max(size.values())]
    figure = Figure(figsize=(9.5, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    above, below = np.zeros(len(x)), np.zeros(len(x))
    for k, name in enumerate(names):
        mean = np.bincount(place, parts[name], len(x)) / count
        colour, hatch = PALETTE[k % len(PALETTE)], ("" if k < 4 else "//")
        look = {"facecolor": colour, "hatch": hatch, "edgecolor": "white", "linewidth": 0}
        left.fill_between(x, above, above + np.maximum(mean, 0.0), label=name, **look)
        left.fill_between(x, below, below + np.minimum(mean, 0.0), **look)
        above, below = above + np.maximum(mean, 0.0), below + np.minimum(mean, 0.0)
        if name != "inertia":  # it would dwarf the others
            rms = np.sqrt(np.bincount(place, parts[name] ** 2, len(x)) / count)
            right.plot(x, rms, color=colour, linestyle="-" if k < 4 else "--", marker=".", ms=4, label=name)
    measured = np.bincount(place, fit.record.target[0][used], len(x)) / count
    left.plot(x, above + below, color=BLACK, linewidth=1.0, label="sum")
    left.plot(x, measured, "o", color=BLACK, ms=3.5, label="measured")
    left.axhline(0.0, color=BLACK, linewidth=0.5)
    left.set_ylabel(_torque_label(d, ", mean"))
    left.set_title("Means, stacked")
    right.set_ylabel(_torque_label(d, ", rms"))
    right.set_title("Size of each part without the inertia")
    right.set_ylim(bottom=0.0)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize="small")
    for axes in (left, right):
        axes.set_xlabel(_speed_label(d))
        axes.grid(alpha=0.3)
    return figure


# ---- structure of the residual ------------------------------------------------------------------------------------


def structure_figure(d: Diagnosis, found: Structure) -> Figure:
    """Draw the residual that nothing explains over its coordinate: a smooth curve, or means."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.5, 3.6), layout="constrained")
    axes = figure.subplots()
    x, forward, backward = found.curve
    what, mark = ("mean", ".") if found.resembles else ("smooth curve", "")
    unit = d.record.unit(found.channel)
    axes.plot(x, forward, color=VERMILION, marker=mark, linewidth=1.5, label=f"{what}, moving forward")
    axes.plot(x, backward, color=BLUE, marker=mark, linewidth=1.5, linestyle="--", label="moving backward")
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    axes.set_xlabel(f"{found.coordinate} [{found.unit}]" if found.unit else found.coordinate)
    axes.set_ylabel(f"{_balance(d, found.channel)} residual [{unit}]")
    title = f"Resembles {found.resembles}" if found.resembles else "Not explained by any effect of the catalogue"
    axes.set_title(f"{title}: {100 * found.share:.0f} % of the residual")
    axes.legend(fontsize="small")
    axes.grid(alpha=0.3)
    return figure
