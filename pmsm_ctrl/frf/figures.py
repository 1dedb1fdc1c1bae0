"""Figures of measured frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.frf.result import FrequencyResponse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["loops", "plant"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Colours of Okabe and Ito, distinguishable with any colour vision.
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
COLOURS = {"current": BLUE, "speed": ORANGE, "position": GREEN}
BARS = 1.96 / np.sqrt(2.0)  # a modulus and a phase feel one part of a complex error


def plant(result: FrequencyResponse) -> Figure:
    """Draw the response from torque to speed with its bars, the design's and the fitted one, and their ratio."""
    figure = _figure(9.0, 7.6)
    upper, middle, lower = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 2))
    one, curves = result.plant, result.curves
    error = BARS * one.stderr / np.abs(one.value)
    _points(upper, one.frequency, _db(one.value), 8.686 * error, "measured, 95 %")
    upper.plot(curves.frequency, _db(curves.model), color=ORANGE, label="design")
    upper.plot(curves.frequency, _db(curves.fitted), color=GREEN, ls="--", zorder=4, label="fitted axis")
    linear = result.design.motion == "linear"
    upper.set(ylabel=f"dB of {'(m/s)/N' if linear else '(rad/s)/(N m)'}", title="Axis: from drive torque to speed")
    upper.legend(frameon=False)
    _points(middle, one.frequency, np.degrees(np.angle(one.value)), np.degrees(error), "")
    middle.plot(curves.frequency, np.degrees(np.angle(curves.model)), color=ORANGE)
    middle.plot(curves.frequency, np.degrees(np.angle(curves.fitted)), color=GREEN, ls="--", zorder=4)
    middle.set(ylabel="phase [deg]", yticks=[-180, -90, 0, 90])
    _points(lower, one.frequency, _db(one.value / result.model), 8.686 * error, "")
    lower.axhline(0.0, color=ORANGE)
    lower.plot(curves.frequency, _db(curves.fitted / curves.model), color=GREEN, ls="--", zorder=4)
    lower.set(ylabel="measured / design [dB]", xlabel="frequency [Hz]")
    for axes in (upper, middle, lower):
        for band in result.bands:
            axes.axvspan(band.low, band.high, color=GREY, alpha=0.12, lw=0)
        _finish(axes)
    return figure


def loops(result: FrequencyResponse) -> Figure:
    """Draw the closed loops that were excited."""
    figure = _figure(9.0, 5.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for name, one in result.responses.items():
        if name != "plant":
            error = BARS * one.stderr / np.abs(one.value)
            _points(upper, one.frequency, _db(one.value), 8.686 * error, f"{name} loop", COLOURS[name])
            _points(lower, one.frequency, np.degrees(np.angle(one.value)), np.degrees(error), "", COLOURS[name])
    upper.axhline(-3.0, color=GREY, ls=":")
    upper.set(ylabel="dB", title="Closed loops: from the reference to what it controls")
    upper.legend(frameon=False)
    lower.set(ylabel="phase [deg]", xlabel="frequency [Hz]", yticks=[-180, -90, 0, 90, 180])
    for axes in (upper, lower):
        _finish(axes)
    return figure


def _points(axes: Axes, x: Array, y: Array, error: Array, label: str, colour: str = BLUE) -> None:
    axes.errorbar(x, y, yerr=error, fmt=".", ms=4, lw=0.8, color=colour, alpha=0.8, label=label or None)


def _finish(axes: Axes) -> None:
    from matplotlib.ticker import LogFormatter

    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(LogFormatter())  # 20 and 100, not 2 x 10^1
    axes.xaxis.set_minor_formatter(LogFormatter(minor_thresholds=(2.0, 0.5)))
    axes.grid(True, which="both", alpha=0.25)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _db(value: Complex) -> Array:
    return np.asarray(20.0 * np.log10(np.abs(value)))


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")
