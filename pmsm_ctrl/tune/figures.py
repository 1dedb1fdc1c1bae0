"""Plots of tuned loops: Bode, Nyquist, Nichols, steps; the discrete loop as it runs and the simulated check."""

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

__all__ = ["filtered", "overview", "unstable"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Colours of Okabe and Ito, distinguishable with any colour vision.
COLOURS = {"current": "#0072B2", "speed": "#D55E00", "position": "#009E73"}
GREY = "#666666"
CIRCLE = -1.0 + 0.5 * np.exp(1j * np.linspace(0.0, 2.0 * math.pi, 200))  # sensitivity 2


def overview(tuning: Tuning) -> Figure:
    """Draw Bode, Nyquist, Nichols, step and load step plots of a tuning on one page."""
    figure = _figure(12, 13)
    loops, predicted, proof = open_loops(tuning.cascade), tuning.predicted, tuning.proof
    grid = figure.add_gridspec(4, 2)
    upper = figure.add_subplot(grid[0, 0])
    lower = figure.add_subplot(grid[1, 0], sharex=upper)
    for name, loop in loops.items():
        _bode(upper, lower, loop, COLOURS[name], f"{name} loop")
        if proof is not None and name in proof.loops:
            _points(upper, lower, loop, proof.loops[name], COLOURS[name])
    _finish_bode(upper, lower, "Open loops (crosses: simulated)")
    upper.set_ylim(1e-3, 1e3)
    lower.set(ylim=(-360, 0), yticks=[-360, -270, -180, -90, 0])
    _nyquist(figure.add_subplot(grid[0:2, 1]), loops)
    _nichols(figure.add_subplot(grid[2, 0]), loops)
    simulated = proof.steps if proof is not None else {}
    _steps(
        figure.add_subplot(grid[2, 1]), {n: predicted[n] for n in ("speed", "position") if n in predicted}, simulated
    )
    _steps(figure.add_subplot(grid[3, 0]), {"current": predicted["current"]}, simulated)
    axis = figure.add_subplot(grid[3, 1])
    _steps(axis, {"load": predicted["load"]}, simulated)
    axis.set(ylabel="speed deviation [rad/s per N m]", title="Speed after a load step")
    return figure


def filtered(tuning: Tuning, words: str) -> Figure:
    """Draw the open speed loop of a resonant axis without and with the best filter, which is labelled with `words`."""
    resonant = tuning.resonance
    assert resonant is not None
    figure = _figure(9, 6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    cascade, gains = tuning.cascade, resonant.gains
    _bode(upper, lower, open_loop(cascade, gains), COLOURS["speed"], "without a filter")
    _bode(upper, lower, open_loop(cascade, gains, (resonant.options[0].filter,)), COLOURS["current"], words)
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
    upper.loglog(f, np.abs(L), color=colour, label=label)
    lower.semilogx(f, _phase(L), color=colour)


def _points(upper: Axes, lower: Axes, loop: Any, points: MeasuredLoop, colour: str) -> None:
    """Mark a measured loop, its phase on the branch of the predicted one."""
    f, L = _curve(loop)
    upper.loglog(points.frequency, np.abs(points.simulated), "x", color=colour, ms=4, alpha=0.7)
    predicted = np.interp(points.frequency, f, _phase(L))
    offset = np.degrees(np.angle(points.simulated * np.exp(-1j * np.radians(predicted))))
    lower.semilogx(points.frequency, predicted + offset, "x", color=colour, ms=4, alpha=0.7)


def _finish_bode(upper: Axes, lower: Axes, title: str) -> None:
    upper.axhline(1.0, color=GREY, lw=0.8)
    lower.axhline(-180.0, color=GREY, lw=0.8)
    upper.set(ylabel="magnitude of L [1]", title=title)
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
