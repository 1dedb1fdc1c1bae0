"""Plots of tuned loops: Bode with its margins, Nyquist, Nichols, steps; the loop as it runs and the simulated check."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.tune.margins import Margins, response
from pmsm_ctrl.tune.sampled import frequencies
from pmsm_ctrl.tune.speed import open_loop
from pmsm_ctrl.tune.tuning import open_loops

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from pmsm_ctrl.tune.proof import MeasuredLoop
    from pmsm_ctrl.tune.result import Tuning
    from pmsm_ctrl.tune.steps import Step

__all__ = ["bode", "distances", "filtered", "steps", "unstable"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Colours of Okabe and Ito, distinguishable with any colour vision.
COLOURS = {"current": "#0072B2", "speed": "#D55E00", "position": "#009E73"}
GREY = "#666666"
CIRCLE = -1.0 + 0.5 * np.exp(1j * np.linspace(0.0, 2.0 * math.pi, 200))  # sensitivity 2


def bode(tuning: Tuning) -> Figure:
    """Draw the open loops over frequency in dB, with crosses for the simulated drive and the margins marked."""
    figure = _figure(9, 6.4)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for name, loop in open_loops(tuning.cascade).items():
        _bode(upper, lower, loop, COLOURS[name], f"{name} loop")
        if tuning.proof is not None and name in tuning.proof.loops:
            _points(upper, lower, loop, tuning.proof.loops[name], COLOURS[name])
        if name in tuning.margins:
            _mark_margins(upper, lower, loop, tuning.margins[name], COLOURS[name])
    _finish_bode(upper, lower, "Open loops (crosses: simulated; arrows: gain and phase margin)")
    upper.set_ylim(-60, 60)
    lower.set(ylim=(-360, 0), yticks=[-360, -270, -180, -90, 0])
    return figure


def distances(tuning: Tuning) -> Figure:
    """Draw the open loops in the plane of Nyquist and in that of Nichols, with the circle of sensitivity 2."""
    figure, loops = _figure(10, 4.8), open_loops(tuning.cascade)
    left, right = figure.subplots(1, 2)
    _nyquist(left, loops)
    _nichols(right, loops)
    return figure


def steps(tuning: Tuning) -> Figure:
    """Draw the step responses of the closed loops, predicted and simulated, and the speed after a load step."""
    figure, predicted = _figure(10, 6.4), tuning.predicted
    simulated = tuning.proof.steps if tuning.proof is not None else {}
    (upper, right), (lower, load) = figure.subplots(2, 2)
    _steps(upper, {"current": predicted["current"]}, simulated)
    _steps(right, {n: predicted[n] for n in ("speed",) if n in predicted}, simulated)
    _steps(lower, {n: predicted[n] for n in ("position",) if n in predicted}, simulated)
    _steps(load, {"load": predicted["load"]}, simulated)
    load.set(
        ylabel=f"speed deviation [{'m/s per N' if tuning.design.motion == 'linear' else 'rad/s per N m'}]",
        title="Speed after a load step",
    )
    if "position" not in predicted:
        lower.set_axis_off()
    return figure


def _mark_margins(upper: Axes, lower: Axes, loop: Any, found: Margins, colour: str) -> None:
    """Mark the gain margin at the phase of -180 deg, and the smallest phase margin at a gain of 0 dB."""
    f, L = _curve(loop)
    size, phase = 20.0 * np.log10(np.abs(L)), _phase(L)
    words: dict[str, Any] = {
        "color": colour,
        "fontsize": 9,
        "bbox": {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1},
    }
    look: dict[str, Any] = {"arrowstyle": "<->", "color": colour, "shrinkA": 0, "shrinkB": 0}
    if 0.0 < found.gain_margin < math.inf and math.isfinite(found.phase_crossover):
        place = found.phase_crossover
        upper.annotate("", (place, 0.0), (place, -found.gain_margin_db), arrowprops=look)
        upper.text(1.06 * place, -0.7 * found.gain_margin_db, f"{found.gain_margin_db:.3g} dB", **words)
    crossings = np.flatnonzero(np.diff(np.sign(size)))
    if crossings.size and math.isfinite(found.phase_margin):
        k = int(crossings[np.argmin(np.abs((phase[crossings] + 360.0) % 360.0 - 180.0))])
        upper.plot(f[k], 0.0, "o", color=colour, ms=5)
        lower.annotate("", (f[k], phase[k]), (f[k], phase[k] - found.phase_margin), arrowprops=look)
        lower.text(1.06 * f[k], phase[k] - 0.6 * found.phase_margin, f"{found.phase_margin:.3g}°", **words)


def filtered(tuning: Tuning, words: str) -> Figure:
    """Draw the open speed loop of a resonant axis without and with the best filter, which is labelled with `words`."""
    resonant = tuning.resonance
    assert resonant is not None
    figure = _figure(9, 6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    cascade, gains = tuning.cascade, resonant.gains
    _bode(upper, lower, open_loop(cascade, gains), COLOURS["speed"], "without a filter")
    _bode(upper, lower, open_loop(cascade, resonant.options[0].gains), COLOURS["current"], words)
    _finish_bode(upper, lower, "Open speed loop")
    return figure


def unstable(name: str, loop: Any, found: Margins) -> Figure:
    """Draw the Nyquist plot of an unstable loop."""
    figure = _figure(6, 6)
    axis = figure.add_subplot()
    _nyquist(axis, {name: loop})
    axis.set_title(f"{name} loop: unstable, phase margin {found.phase_margin:.1f} deg; encloses the critical point")
    return figure


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _curve(loop: Any) -> tuple[Array, Complex]:
    omega = frequencies(loop.dt, 1e-3, 1500)
    return omega / (2.0 * math.pi), response(loop, omega)


def _phase(L: Complex) -> Array:
    """Phase in degrees, continuous, starting between -270 and 90."""
    phase = np.degrees(np.unwrap(np.angle(L)))
    return np.asarray(phase - 360.0 * math.ceil((phase[0] - 90.0) / 360.0))


def _bode(upper: Axes, lower: Axes, loop: Any, colour: str, label: str) -> None:
    f, L = _curve(loop)
    upper.semilogx(f, 20.0 * np.log10(np.abs(L)), color=colour, label=label)
    lower.semilogx(f, _phase(L), color=colour)


def _points(upper: Axes, lower: Axes, loop: Any, points: MeasuredLoop, colour: str) -> None:
    """Mark a measured loop, its phase on the branch of the predicted one."""
    f, L = _curve(loop)
    upper.semilogx(points.frequency, 20.0 * np.log10(np.abs(points.simulated)), "x", color=colour, ms=4, alpha=0.7)
    predicted = np.interp(points.frequency, f, _phase(L))
    offset = np.degrees(np.angle(points.simulated * np.exp(-1j * np.radians(predicted))))
    lower.semilogx(points.frequency, predicted + offset, "x", color=colour, ms=4, alpha=0.7)


def _finish_bode(upper: Axes, lower: Axes, title: str) -> None:
    upper.axhline(0.0, color=GREY, lw=0.8)
    lower.axhline(-180.0, color=GREY, lw=0.8)
    upper.set(ylabel="magnitude of L [dB]", title=title)
    lower.set(xlabel="frequency [Hz]", ylabel="phase of L [deg]")
    _finish(upper)
    lower.grid(True, alpha=0.3)


def _finish(axis: Axes) -> None:
    axis.grid(True, alpha=0.3)
    axis.legend(fontsize=8)


def _nyquist(axis: Axes, loops: dict[str, Any]) -> None:
    for name, loop in loops.items():
        _, L = _curve(loop)
        axis.plot(L.real, L.imag, color=COLOURS[name.split()[0]], label=f"{name} loop")
    axis.plot(CIRCLE.real, CIRCLE.imag, "--", color=GREY, lw=1, label="sensitivity 2 (6 dB)")
    axis.plot([-1.0], [0.0], "+", color="black", ms=10)
    axis.set(
        xlim=(-2.5, 1.0), ylim=(-2.0, 1.5), xlabel="real part of L [1]", ylabel="imaginary part of L [1]",
        title="Nyquist: the curves stay outside the circle",
    )  # fmt: skip
    axis.set_aspect("equal")
    _finish(axis)


def _nichols(axis: Axes, loops: dict[str, Any]) -> None:
    for name, loop in loops.items():
        _, L = _curve(loop)
        axis.plot(_phase(L), 20.0 * np.log10(np.abs(L)), color=COLOURS[name], label=f"{name} loop")
    phase = np.degrees(np.angle(CIRCLE)) % 360.0 - 360.0
    axis.plot(phase, 20.0 * np.log10(np.abs(CIRCLE)), "--", color=GREY, lw=1, label="sensitivity 2 (6 dB)")
    axis.plot([-180.0], [0.0], "+", color="black", ms=10)
    axis.set(
        xlim=(-300, -60), ylim=(-40, 40), xlabel="phase of L [deg]", ylabel="magnitude of L [dB]",
        title="Nichols: the distance to the cross is the margin",
    )  # fmt: skip
    _finish(axis)


def _steps(axis: Axes, predicted: Mapping[str, Step], simulated: Mapping[str, Step]) -> None:
    """Draw step responses, predicted as lines and simulated as dashes."""
    for name, step in predicted.items():
        axis.plot(1e3 * step.t, step.y, color=COLOURS.get(name, COLOURS["speed"]), label=f"{name}: predicted")
        if name in simulated:
            t, y = simulated[name].t, simulated[name].y
            axis.plot(1e3 * t, y, "--", color="black", lw=1, label=f"{name}: simulated")
    axis.axhline(0.0 if "load" in predicted else 1.0, color=GREY, lw=0.8)
    axis.set(xlabel="time [ms]", ylabel="response / step [1]", title=f"Step response: {', '.join(predicted)}")
    _finish(axis)
