"""A rigid axis or two masses, fitted to a measured response by maximum likelihood.

The residuals are weighted by the measured variances, so that the sum of their squares tells whether the structure
suffices. Of two masses the antiresonance, its ratio to the resonance and the damping are fitted: they are nearly
independent, where stiffness and inertias are not.

What the recorder does to the current between its samples is a nuisance: a delay, and a spread, whose prior is that of
means over a period of the log. A current that is held for a period of the speed loop and sampled once in each of them
has such a spread.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import f as f_distribution

from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.frf import policy
from pmsm_ctrl.frf.result import Response
from pmsm_ctrl.tune.linearise import mobility

__all__ = ["Axis", "fit_axis", "refitted"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RIGID, TWO = 4, 7  # parameters
STARTS, TRIED = 60, 5  # antiresonances on a grid, and the best that are refined
RATIOS = (1.05, 1.3, 2.5)  # resonance over antiresonance, of the grid
DAMPINGS = (0.005, 0.05)
NO_INERTIA = (
    60.0  # logarithm of an inertia, kg m^2, that noise alone can lead to: no axis has one of exp(-60) or exp(60)
)
LATEST, DELAYS = 3.0, 121  # delays to start from, in periods of the log, and how many
STEP = float(np.sqrt(np.finfo(float).eps))  # of differences, for parameters of the size of 1
BEYOND = 3.0  # antiresonances outside of the measured range by more are not looked for


@dataclass(frozen=True, eq=False)
class Axis:
    """A fitted axis.

    Attributes
    ----------
    values : array, shape (4,) or (7,)
        ln J, friction slope, delay (s), spread of the torque's samples in time (in variances of a mean over a period of
        the log); of two masses also ln antiresonance (rad/s), ln (resonance / antiresonance - 1) and ln damping ratio.
    covariance : array
        Of these, widened by `misfit`.
    misfit : float
        Residual over noise.
    spread : float
        Variance in time of a mean over a period of the log, s^2.
    p_resonance : float
        Chance of such a gain by two masses where the axis is rigid; NaN where two masses were not tried.
    """

    values: Array
    covariance: Array
    misfit: float
    spread: float
    p_resonance: float = math.nan

    @property
    def mass(self) -> SecondMass | None:
        """The load behind a spring, or None."""
        return second_mass(self.values)

    @property
    def J(self) -> float:
        """Total inertia, kg m^2."""
        return math.exp(self.values[0])

    def near(self, other: Axis) -> bool:
        """Whether two fits differ by less than a tenth of a standard error.

        Parameters
        ----------
        other : Axis
        """
        if len(self.values) != len(other.values):
            return False
        return bool(np.all(np.abs(self.values - other.values) < 0.1 * np.sqrt(np.diag(self.covariance))))

    def response(self, frequency: Array) -> Complex:
        """Return the response at frequencies (Hz), with the delay.

        Parameters
        ----------
        frequency : array, shape (n,)
        """
        return _response(self.values, 2.0 * math.pi * frequency, self.spread)

    def errors(self) -> dict[str, tuple[float, float]]:
        """Return the physical parameters with their standard errors."""
        names, centre = _physical(self.values)
        spread = self.propagated(lambda axis: _physical(axis.values)[1])
        return {name: (float(v), float(e)) for name, v, e in zip(names, centre, spread, strict=True)}

    def propagated(self, of: Callable[[Axis], Array]) -> Array:
        """Return the standard errors of quantities of the axis, by linear propagation.

        Parameters
        ----------
        of : function of Axis
            Returns the quantities, shape (q,).
        """
        step = 0.1 * np.sqrt(
            np.diag(self.covariance)
        )  # of differences: small beside the curvature, large beside rounding
        moved = (
            (of(replace(self, values=self.values + up)) - of(replace(self, values=self.values - up))) / (2.0 * size)
            for up, size in zip(np.diag(step), step, strict=True)
        )
        with np.errstate(invalid="ignore"):  # a margin without a limit has no error
            slope = np.stack(list(moved), axis=1)
        return np.asarray(np.sqrt(np.einsum("ik,kl,il->i", slope, self.covariance, slope)))


def second_mass(values: Array) -> SecondMass | None:
    """Return the load behind a spring of an axis' parameters, or None for a rigid one."""
    if len(values) == RIGID:
        return None
    antiresonance, ratio, damping = np.exp(values[RIGID:])
    load = np.exp(values[0]) * (1.0 - 1.0 / (1.0 + ratio) ** 2)
    stiffness = antiresonance**2 * load
    return SecondMass(J_load=load, k=stiffness, d=2.0 * damping * stiffness / antiresonance)


def _physical(values: Array) -> tuple[tuple[str, ...], Array]:
    names: tuple[str, ...] = ("J", "friction_slope", "delay")
    with np.errstate(over="ignore"):  # an inertia that noise alone leads to has no end
        found = [float(np.exp(values[0])), values[1], values[2]]
    mass = second_mass(values)
    if mass is None:
        return names, np.array(found)
    antiresonance, damping = math.exp(values[4]) / (2.0 * math.pi), math.exp(values[6])
    found += [antiresonance, antiresonance * (1.0 + math.exp(values[5])), damping, mass.J_load, mass.k, mass.d]
    names += ("antiresonance", "resonance", "damping_ratio", "load_inertia", "stiffness", "damping")
    return names, np.array(found)


def _response(values: Array, omega: Array, spread: float) -> Complex:
    """Return the response of an axis, shape (n,); of axes side by side, shape (parameters, k, 1), shape (k, n)."""
    moved = mobility(np.asarray(1j * omega, np.complex128), np.exp(values[0]), values[1], second_mass(values))
    return np.asarray(moved * np.exp(-1j * omega * values[2] - 0.5 * values[3] * spread * omega**2))


def fit_axis(response: Response, J: float, period: float) -> Axis:
    """Fit a rigid axis, and two masses where they explain the response better than chance allows.

    Parameters
    ----------
    response : Response
        From torque to speed, (rad/s)/(N m).
    J : float
        Inertia to start from, kg m^2.
    period : float
        Of the log, s.
    """
    task = _Task(response, 2.0 * math.pi * response.frequency, period**2 / 12.0, np.abs(response.value))
    late = _late(response, task.omega, period)
    rigid = task.refined(_rigid_start(response, task.omega, J, late))
    if 2 * len(response) < 4 * TWO:
        return task.axis(rigid)
    two = min((task.refined(start) for start in _two_mass_starts(response, task.omega, late)), key=task.cost)
    # errors in proportion to what was measured would favour the points that came out small
    p = task.sized(rigid, two).chance(rigid, two)
    task = task.sized(two)
    two = task.refined(two)
    found = task.axis(two, p)
    if p < policy.RESONANCE and _inside(two, task.omega) and _determined(found):
        return found
    task = task.sized(rigid)
    return task.axis(task.refined(rigid), p)


def refitted(axis: Axis, response: Response, value: Complex) -> Axis:
    """Return an axis fitted from itself to other values of a response, at the errors that the axis gives them.

    Parameters
    ----------
    axis : Axis
    response : Response
        Its frequencies and errors.
    value : complex array, shape (n,)
    """
    omega = 2.0 * math.pi * response.frequency
    size = np.abs(_response(axis.values, omega, axis.spread))
    errors = response.stderr * (np.abs(value) / np.abs(response.value))  # relative ones stay
    task = _Task(replace(response, value=value, stderr=errors), omega, axis.spread, size)
    return replace(axis, values=task.refined(axis.values))


@dataclass(frozen=True, eq=False)
class _Task:
    """A response to be explained: angular frequencies, the variance in time of the spread, and the modulus assumed."""

    response: Response
    omega: Array
    spread: float
    size: Array

    def left(self, values: Array) -> Array:
        """Return the residual in standard errors, the last one being the prior of the spread."""
        errors = self.response.stderr * (self.size / np.abs(self.response.value))
        residual = (self.response.value - _response(values, self.omega, self.spread)) * (math.sqrt(2.0) / errors)
        prior = values[3:4] if values.ndim == 1 else values[3]
        return np.concatenate([residual.real, residual.imag, prior], axis=-1)

    def slope(self, values: Array) -> Array:
        """Return the derivatives of the residual by differences of all parameters at once, shape (rows, parameters)."""
        step = STEP * np.maximum(np.abs(values), 1.0)
        moved = values[:, None] + np.diag(step)
        return np.asarray((self.left(moved[..., None]) - self.left(values)).T / step)

    def sized(self, *axes: Array) -> _Task:
        """Return the task with the modulus that an axis has; of several the largest."""
        size = np.max([np.abs(_response(values, self.omega, self.spread)) for values in axes], axis=0)
        return replace(self, size=size)

    def chance(self, rigid: Array, two: Array) -> float:
        """Return the chance of such a gain by two masses where the axis is rigid, over all frequencies.

        The modulus should be that of both: errors of two masses alone would be small where these are small, and the
        rigid axis would seem to be far away there.
        """
        freedom = 2 * len(self.response) - TWO
        left = self.cost(self.refined(two))
        gain = (self.cost(self.refined(rigid)) - left) / (TWO - RIGID) / max(1.0, left / freedom)
        return float(f_distribution.sf(gain, TWO - RIGID, freedom)) * len(self.response)

    def cost(self, values: Array) -> float:
        residual = self.left(values)
        return float(residual @ residual)

    def refined(self, start: Array) -> Array:
        scale = np.array([0.1, math.exp(start[0]), 1e-4, 0.3, 0.05, 0.3, 0.5])[: len(start)]
        slowest, fastest = math.log(self.omega[0] / BEYOND), math.log(self.omega[-1] * BEYOND)
        lower = np.array([-NO_INERTIA, *([-math.inf] * (RIGID - 1)), slowest, -7.0, -9.0])[: len(start)]
        upper = np.array([NO_INERTIA, *([math.inf] * (RIGID - 1)), fastest, 3.0, 1.0])[: len(start)]
        start = np.clip(start, lower, upper)
        found = least_squares(self.left, start, self.slope, x_scale=scale, bounds=(lower, upper), max_nfev=200)
        return np.asarray(found.x)

    def axis(self, values: Array, p: float = math.nan) -> Axis:
        slope = self.slope(values)
        misfit = math.sqrt(self.cost(values) / max(1, 2 * len(self.response) - len(values)))
        information = slope.T @ slope
        size = np.sqrt(np.maximum(np.diag(information), 1e-24))  # what nothing depends on gets an error beyond reason
        scaled = information / np.outer(size, size) + 1e-12 * np.eye(len(size))
        covariance = np.linalg.inv(scaled) / np.outer(size, size)
        return Axis(values, covariance * max(1.0, misfit) ** 2, misfit, self.spread, p)


def _determined(axis: Axis) -> bool:
    """Whether the errors of antiresonance, resonance and damping are below their own size."""
    return bool(np.all(np.diag(axis.covariance)[RIGID:] < 1.0))


def _inside(values: Array, omega: Array) -> bool:
    """Whether antiresonance or resonance lies in the measured range: else the spring is not seen, but guessed."""
    low, high = math.exp(values[4]), math.exp(values[4]) * (1.0 + math.exp(values[5]))
    return bool(omega[0] < high and low < omega[-1])


def _late(response: Response, omega: Array, period: float) -> float:
    """Return the delay to start from, s: the phase of an axis without losses is 90 deg either way, twice it 180."""
    delays = period * np.linspace(-LATEST, LATEST, DELAYS)
    twice = (response.value / np.abs(response.value)) ** 2
    return float(delays[np.argmin([np.sum(twice * np.exp(2j * omega * late)).real for late in delays])])


def _rigid_start(response: Response, omega: Array, J: float, late: float) -> Array:
    """Return inertia and slope from the reciprocal of the response, weighted, and the delay it starts from."""
    turned = np.exp(-1j * omega * late) / response.value
    weight = np.abs(response.value) / response.stderr
    found = float(np.sum(weight**2 * turned.imag / omega) / np.sum(weight**2))
    return np.array([math.log(found if found > 0.0 else J), 0.0, late, 0.0])


def _two_mass_starts(response: Response, omega: Array, late: float) -> list[Array]:
    """Return the best of a grid, by the distance in nepers and radians: a far start is not drowned by the noise.

    Without friction the response is in inverse proportion to the inertia, which follows from the mean.
    """
    weight = np.gradient(np.log(omega))
    found: list[tuple[float, Array]] = []
    for antiresonance in np.geomspace(0.7 * omega[0], 1.2 * omega[-1], STARTS):
        tried = np.array([
            [0.0, 0.0, late, 0.0, math.log(antiresonance), math.log(ratio - 1.0), math.log(damping)]
            for ratio in RATIOS for damping in DAMPINGS
        ])  # fmt: skip
        away = np.log(_response(tried.T[..., None], omega, 0.0) / response.value)
        tried[:, 0] = away.real @ weight / weight.sum()
        distance = np.minimum(np.abs(away - tried[:, :1]) ** 2, 4.0) @ weight
        best = int(np.argmin(distance))
        found.append((float(distance[best]), tried[best]))
    return [start for _, start in sorted(found, key=lambda one: one[0])[:TRIED]]
