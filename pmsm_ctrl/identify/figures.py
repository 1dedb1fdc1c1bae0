"""Figures of the identification, and the colours that all figures share: Okabe and Ito's, safe for the colour-blind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pmsm_ctrl.regression.least_squares import t_quantile
from pmsm_ctrl.section import gaps_of
from pmsm_ctrl.units import axis_unit, drives

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pmsm_ctrl.identify.identification import Identification
    from pmsm_ctrl.identify.staircase import SweepResult

__all__ = [
    "BLACK", "BLUE", "GREEN", "VERMILION", "friction_over_speed", "parted", "residual_figure",
    "scaled_by_most",
]  # fmt: skip

Array = NDArray[np.float64]

BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
MOST = 0.995  # share of the samples that set the scale of a residual
ROOM = 1.5  # over that scale: so far a residual is shown whole


def scaled_by_most(axes: Axes, residual: NDArray[np.float64], least: float = 0.0) -> int:
    """Scale a residual by nearly all of its samples, so that a few do not hide it; say how many lie outside.

    Parameters
    ----------
    axes : Axes
    residual : array, shape (n,)
        The samples that count.
    least : float
        What has to be shown in any case.

    Returns
    -------
    int
        Samples that lie outside.
    """
    size = np.abs(residual[np.isfinite(residual)])
    if not size.size:
        return 0
    largest, limit = float(size.max()), max(ROOM * float(np.quantile(size, MOST)), 1.1 * least)
    limit = 1.1 * largest if largest <= limit or limit == 0.0 else limit
    if limit > 0.0:
        axes.set_ylim(-limit, limit)
    outside = int(np.sum(size > limit))
    if outside:
        said = f"{outside} of {size.size} samples outside, up to {largest:.2g}"
        axes.text(0.01, 0.97, said, transform=axes.transAxes, fontsize="x-small", va="top")
    return outside


def parted(t: Array, y: Array) -> tuple[Array, Array]:
    """Return a line over time that is broken at gaps.

    Parameters
    ----------
    t, y : array, shape (n,)

    Returns
    -------
    (array, array)
        With a sample that is not a number in every gap.
    """
    at = gaps_of(t)
    return np.insert(t, at, t[at]), np.insert(y, at, np.nan)


def residual_figure(result: Identification) -> Figure:
    """Draw measured and predicted torque over the residual; standstill is left out."""
    shown, quantity = result.shown, drives(result.design.motion)
    t, unit = shown.t, shown.unit
    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    hidden = np.where(shown.mask, 1.0, np.nan)
    upper.plot(*parted(t, shown.torque * hidden), color=BLACK, linewidth=0.6, alpha=0.6, label="measured")
    predicted = (shown.torque - result.unexplained) * hidden
    upper.plot(*parted(t, predicted), color=BLUE, linewidth=1.3, label="predicted")
    upper.set_ylabel(f"{quantity} [{unit}]")
    upper.legend(loc="upper right", fontsize="small")
    upper.set_title(f"{quantity.capitalize()}: measured and predicted, filtered; without standstill")
    lower.plot(*parted(t, result.unexplained * hidden), color=VERMILION, linewidth=0.8)
    lower.axhline(0.0, color=BLACK, linewidth=0.5)
    lower.set_ylabel(f"residual [{unit}]")
    lower.set_xlabel("time [s]")
    scaled_by_most(lower, result.unexplained[shown.mask])
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return figure


def friction_over_speed(result: SweepResult) -> Figure:
    """Draw torque against speed with the joint line, and the residual."""
    torque_unit, speed_unit = axis_unit("N m", result.motion), axis_unit("rad/s", result.motion)
    omega = np.array([level.omega for level in result.levels])
    torque = np.array([level.torque for level in result.levels])
    error = np.array([t_quantile(0.95, level.dof) * level.stderr for level in result.levels])
    model = result.joint.torque(omega)
    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    upper.errorbar(omega, torque, error, fmt="o", color=BLACK, markersize=3, label="measured, 95 %")
    for side in (omega < 0, omega > 0):
        upper.plot(omega[side], model[side], color=BLUE, label="$F_c + F_v\\omega$" if omega[side].max() > 0 else None)
    upper.set_ylabel(f"{drives(result.motion)} [{torque_unit}]")
    upper.set_title("Friction against speed: the intercept is $F_c$, the slope $F_v$")
    upper.legend(loc="upper left", fontsize="small")
    lower.errorbar(omega, torque - model, error, fmt="o", color=VERMILION, markersize=3)
    lower.axhline(0.0, color=BLACK, linewidth=0.5)
    lower.set_ylabel(f"residual [{torque_unit}]")
    lower.set_xlabel(f"speed [{speed_unit}]")
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return figure
