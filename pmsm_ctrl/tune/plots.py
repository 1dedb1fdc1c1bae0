"""Plots of tuned loops: Bode, Nyquist, Nichols, steps. The discrete loop as it runs; measured points on top."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pmsm_ctrl.tune.margins import Margins, response
from pmsm_ctrl.tune.sampled import frequencies

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pmsm_ctrl.tune.proof import MeasuredLoop, Proof
    from pmsm_ctrl.tune.steps import Step

__all__ = ["bode", "nichols", "nyquist", "overview", "step_plot", "unstable_figure"]

Array = NDArray[np.float64]

# Okabe and Ito's colours, told apart by every eye.
COLOURS = {"current": "#0072B2", "speed": "#D55E00", "position": "#009E73"}
GREY = "#666666"


def _curve(loop: Any) -> tuple[Array, NDArray[np.complex128]]:
    omega = frequencies(loop.dt, 1e-3, 1500)
    return omega / (2.0 * math.pi), response(loop, omega)


def _phase(L: NDArray[np.complex128]) -> Array:
    """Phase in degrees, continuous, starting between -270 and 90."""
    phase = np.degrees(np.unwrap(np.angle(L)))
    return np.asarray(phase - 360.0 * math.ceil((phase[0] - 90.0) / 360.0))


def bode(axes: tuple[Axes, Axes], loops: dict[str, Any], measured: dict[str, MeasuredLoop] | None = None) -> None:
    """Magnitude and phase of open loops; crosses are measured by multisine."""
    upper, lower = axes
    for name, loop in loops.items():
        f, L = _curve(loop)
        colour = COLOURS.get(name.split()[0], GREY)
        upper.loglog(f, np.abs(L), color=colour, label=f"{name} loop")
        lower.semilogx(f, _phase(L), color=colour)
        if measured and name in measured:
            points = measured[name]
            upper.loglog(points.frequency, np.abs(points.measured), "x", color=colour, ms=4, alpha=0.7)
            # The measured phase is drawn on the branch of the promised one.
            promised = np.interp(points.frequency, f, _phase(L))
            offset = np.degrees(np.angle(points.measured * np.exp(-1j * np.radians(promised))))
            lower.semilogx(points.frequency, promised + offset, "x", color=colour, ms=4, alpha=0.7)
    upper.axhline(1.0, color=GREY, lw=0.8)
    lower.axhline(-180.0, color=GREY, lw=0.8)
    upper.set(ylabel="magnitude of L [1]", ylim=(1e-3, 1e3), title="Open loops (crosses: measured)")
    lower.set(xlabel="frequency [Hz]", ylabel="phase of L [deg]", ylim=(-360, 0))
    lower.set_yticks([-360, -270, -180, -90, 0])
    upper.legend(fontsize=8)
    for axis in axes:
        axis.grid(True, which="major", alpha=0.3)


def nyquist(axis: Axes, loops: dict[str, Any]) -> None:
    """Open loops around the critical point, with the circle that a sensitivity of 2 must not enter."""
    for name, loop in loops.items():
        _, L = _curve(loop)
        axis.plot(L.real, L.imag, color=COLOURS.get(name.split()[0], GREY), label=f"{name} loop")
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    axis.plot(-1.0 + 0.5 * np.cos(turn), 0.5 * np.sin(turn), "--", color=GREY, lw=1, label="sensitivity 2 (6 dB)")
    axis.plot([-1.0], [0.0], "+", color="black", ms=10)
    axis.set(
        xlim=(-2.5, 1.0), ylim=(-2.0, 1.5), xlabel="real part of L [1]", ylabel="imaginary part of L [1]",
        title="Nyquist: the curves stay outside the circle",
    )  # fmt: skip
    axis.set_aspect("equal")
    axis.grid(True, alpha=0.3)
    axis.legend(fontsize=8)


def nichols(axis: Axes, loops: dict[str, Any]) -> None:
    """Open loops as gain over phase, with the curve of a sensitivity of 2."""
    for name, loop in loops.items():
        _, L = _curve(loop)
        axis.plot(_phase(L), 20.0 * np.log10(np.abs(L)), color=COLOURS.get(name.split()[0], GREY), label=f"{name} loop")
    circle = -1.0 + 0.5 * np.exp(1j * np.linspace(0.0, 2.0 * math.pi, 200))
    axis.plot(
        np.degrees(np.angle(circle)) % 360.0 - 360.0, 20.0 * np.log10(np.abs(circle)), "--", color=GREY, lw=1,
        label="sensitivity 2 (6 dB)",
    )  # fmt: skip
    axis.plot([-180.0], [0.0], "+", color="black", ms=10)
    axis.set(
        xlim=(-300, -60), ylim=(-40, 40), xlabel="phase of L [deg]", ylabel="magnitude of L [dB]",
        title="Nichols: distance to the cross is the margin",
    )  # fmt: skip
    axis.grid(True, alpha=0.3)
    axis.legend(fontsize=8)


def step_plot(axis: Axes, promised: dict[str, Step], measured: dict[str, Step] | None = None) -> None:
    """Step responses, promised as lines and simulated as dashes, time in units of each loop's own settling."""
    for name, step in promised.items():
        colour = COLOURS.get(name.split()[0], GREY)
        axis.plot(1e3 * step.t, step.y, color=colour, label=f"{name}: promised")
        if measured and name in measured:
            axis.plot(1e3 * measured[name].t, measured[name].y, "--", color="black", lw=1, label=f"{name}: simulated")
    axis.axhline(1.0, color=GREY, lw=0.8)
    axis.set(xlabel="time [ms]", ylabel="response / step [1]", title=f"Step response: {', '.join(promised)}")
    axis.grid(True, alpha=0.3)
    axis.legend(fontsize=8)


def load_plot(axis: Axes, promised: Step, measured: Step | None = None) -> None:
    """Speed after a load step of 1 N m."""
    axis.plot(1e3 * promised.t, promised.y, color=COLOURS["speed"], label="promised")
    if measured is not None:
        axis.plot(1e3 * measured.t, measured.y, "--", color="black", lw=1, label="simulated")
    axis.set(xlabel="time [ms]", ylabel="speed deviation [rad/s per N m]", title="Load step: the dip and the way back")
    axis.grid(True, alpha=0.3)
    axis.legend(fontsize=8)


def overview(loops: dict[str, Any], promised: dict[str, Step], proof: Proof | None = None) -> Figure:
    """Bode, Nyquist, Nichols, steps and load step of a tuned drive on one page."""
    figure = Figure(figsize=(12, 13), layout="constrained")
    grid = figure.add_gridspec(4, 2)
    upper = figure.add_subplot(grid[0, 0])
    lower = figure.add_subplot(grid[1, 0], sharex=upper)
    bode((upper, lower), loops, dict(proof.loops) if proof else None)
    nyquist(figure.add_subplot(grid[0:2, 1]), loops)
    nichols(figure.add_subplot(grid[2, 0]), loops)
    measured = {name: pair[1] for name, pair in proof.steps.items()} if proof else {}
    references = {name: step for name, step in promised.items() if name in ("speed", "position")}
    step_plot(figure.add_subplot(grid[2, 1]), references, measured)
    step_plot(figure.add_subplot(grid[3, 0]), {"current": promised["current"]}, measured)
    load_plot(figure.add_subplot(grid[3, 1]), promised["load"], measured.get("load"))
    return figure


def resonance_figure(before: Any, after: Any, label: str) -> Figure:
    """Open speed loop of a resonant axis without and with the proposed filter."""
    figure = Figure(figsize=(9, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for loop, colour, name in ((before, COLOURS["speed"], "without a filter"), (after, COLOURS["current"], label)):
        f, L = _curve(loop)
        upper.loglog(f, np.abs(L), color=colour, label=name)
        lower.semilogx(f, _phase(L), color=colour)
    upper.axhline(1.0, color=GREY, lw=0.8)
    lower.axhline(-180.0, color=GREY, lw=0.8)
    upper.set(ylabel="magnitude of L [1]", title="Speed loop: where the peak stands above 1 the phase decides")
    lower.set(xlabel="frequency [Hz]", ylabel="phase of L [deg]")
    for axis in (upper, lower):
        axis.grid(True, alpha=0.3)
    upper.legend(fontsize=8)
    return figure


def unstable_figure(name: str, loop: Any, found: Margins) -> Figure:
    """Nyquist plot of a loop that is unstable, for the answer to a bad request."""
    figure = Figure(figsize=(6, 6), layout="constrained")
    axis = figure.add_subplot()
    nyquist(axis, {name: loop})
    axis.set_title(f"{name} loop: unstable, phase margin {found.phase_margin:.1f} deg; the curve encloses the cross")
    return figure
