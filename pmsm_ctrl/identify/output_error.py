"""Output error: the parameters with which the simulated drive, its sampled controller included, makes that torque.

Unlike the regression this differentiates nothing, treats measured and modelled friction alike through every reversal,
and finds parameters that a term is not linear in, and those of effects with states of their own. It trusts the loops
and the references.

Sources: M. Gautier, A. Janot, P. O. Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428 (torque as the output
of a closed-loop simulation); L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, sec. 13.5.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import bound_effects, catalogue_of
from pmsm_ctrl.errors import SimulationError
from pmsm_ctrl.identify.problem import Column, Problem
from pmsm_ctrl.identify.regression import Fit, solve
from pmsm_ctrl.identify.replay import Replay, plant_with
from pmsm_ctrl.regression.conditioning import Prepared, drive_torque
from pmsm_ctrl.units import axis_unit

__all__ = ["output_error"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FIXED = ("order",)  # whole numbers
# Differences are taken over this share of a parameter: smaller ones drown in the steps of the simulation.
STEP = 2e-3
# Where a linear parameter is zero: over what makes this share of the torque.
FIRST = 0.01
# A parameter that changes the torque by less than this share of it when it is doubled does nothing.
NOTHING = 1e-6
# The same for the inertia, as a share of the residual: below it the answer hangs on a handful of moments.
SHAKEN = 0.1
# Standard errors by which two methods may differ that share most of their noise.
APART = 5.0
ROUNDS = 30
FAR = 100.0  # residual, in multiples of the torque, of a plant that could not be simulated


@dataclass(frozen=True, eq=False)
class _Model:
    """The simulated torque of one log as a function of the parameters, shapes (columns,) to (m,)."""

    design: Design
    prepared: Prepared
    replay: Replay
    columns: tuple[Column, ...]
    lower: Array
    upper: Array
    steps: Array

    def torque(self, values: Array) -> Array:
        """Return the filtered torque of the simulated drive on the thinned grid, N m.

        Raises
        ------
        SimulationError
            When this plant is not stable.
        """
        log = self.replay.run(plant_with(self.design, self.columns, values))
        return self.prepared.column(drive_torque(self.design, dict(log.channels)))

    def slopes(self, values: Array, which: Iterable[int], base: Array) -> Array:
        """Return sensitivities, shape (m, parameters asked for), by differences from `base`, the torque at `values`."""
        made = []
        for k in which:
            moved = values.copy()
            moved[k] += self.steps[k] if values[k] + self.steps[k] <= self.upper[k] else -self.steps[k]
            made.append((self.torque(moved) - base) / (moved[k] - values[k]))
        return np.column_stack(made)


def output_error(
    design: Design, problem: Problem, prepared: Prepared, replay: Replay
) -> tuple[Problem, Fit, tuple[str, ...]]:
    """Fit the inertia and all parameters of the design's effects by simulation.

    Parameters
    ----------
    problem : Problem
        The regression of the same log; its solution is the start.
    prepared : Prepared
        The log as it was logged: the simulation has the measurement effects of the design.

    Returns
    -------
    problem, fit
        Linear at the solution: the columns are the sensitivities, the values the estimates.
    warnings : tuple of str

    Raises
    ------
    SimulationError
        When the design's loops are not stable on the plant of the first guess.
    """
    effects = catalogue_of(design)
    ordinary = solve(problem, effects)
    columns = _parameters(design, problem)
    mask = prepared.mask
    measured = prepared.column(prepared.signals["torque"])
    force = float(np.sqrt(np.mean(measured[mask] ** 2)))
    lower, upper = (np.array([getattr(c, name) for c in columns]) for name in ("lower", "upper"))
    start = np.clip([ordinary.values.get(c.name, c.nominal) for c in columns], lower, upper)
    steps = np.array([_step(c, problem, force, value) for c, value in zip(columns, start.tolist(), strict=True)])
    model = _Model(design, prepared, replay, columns, lower, upper, steps)
    first = model.slopes(start, range(len(columns)), model.torque(start))
    size = np.sqrt(np.mean(first[mask] ** 2, axis=0)) * steps / STEP
    free = np.flatnonzero(size > NOTHING * force)
    values, simulated, found, warnings = _fitted(model, measured / force, mask, start, free, first[:, free], force)
    slopes = np.zeros_like(first)
    slopes[:, free] = found
    linear = replace(
        problem,
        target=measured - simulated + slopes @ values,
        columns=tuple(replace(c, values=s) for c, s in zip(columns, slopes.T, strict=True)),
        notes=tuple(note for note in problem.notes if "takes no part" not in note),
    )
    fit = _shaped(solve(linear, effects, ratio=SHAKEN), columns, effects)
    return linear, fit, (*warnings, *_mismatch(ordinary, fit, mask))


def _shaped(fit: Fit, columns: tuple[Column, ...], effects: Mapping[str, Effect]) -> Fit:
    """Withhold the shape of an effect that may just as well be absent: noise of any shape resembles it."""
    absent: dict[int, list[str]] = {}
    linear = {effect.id: {p.symbol for p in effect.linear} for effect in effects.values()}
    for entry in {c.entry for c in columns if c.entry >= 0}:
        sizes = [c.name for c in columns if c.entry == entry and c.symbol in linear[c.effect]]
        if sizes and all(n in fit.values and np.prod(fit.interval(n)) <= 0.0 for n in sizes):
            absent[entry] = sizes
    reasons = {
        c.name: f"its effect may be absent: the interval of {' and '.join(absent[c.entry])} holds zero"
        for c in columns
        if c.entry in absent and c.name in fit.values and c.symbol not in linear[c.effect]
    }
    values, stderr = ({n: v for n, v in known.items() if n not in reasons} for known in (fit.values, fit.stderr))
    return replace(fit, values=values, stderr=stderr, unidentifiable={**fit.unidentifiable, **reasons})


def _parameters(design: Design, problem: Problem) -> tuple[Column, ...]:
    """Return a column without values for the inertia and for every parameter that can be searched."""
    made = [column for column in problem.columns if column.entry < 0]
    for index, (effect, parameters) in enumerate(bound_effects(design)):
        for known in effect.parameters:
            if known.symbol in FIXED:
                continue
            twins = sum(column.symbol == known.symbol for column in made)
            name = f"{known.symbol}#{twins + 1}" if twins else known.symbol
            unit, value = axis_unit(known.unit, design.motion), parameters[known.symbol]
            made.append(
                Column(name, np.zeros(0), unit, value, known.lower, known.upper, effect.id, index, known.symbol)
            )
    return tuple(made)


def _step(column: Column, problem: Problem, force: float, value: float) -> float:
    """Return the difference over which a parameter's sensitivity is taken."""
    size = max(abs(value), abs(column.nominal)) * STEP
    for regressor in problem.columns:
        if regressor.name == column.name:
            alone = force / max(float(np.sqrt(np.mean(regressor.values[problem.mask] ** 2))), 1e-300)
            size = max(size, FIRST * alone * (0.1 if size else 1.0))
    if size == 0.0:
        span = column.upper - column.lower
        size = STEP * (span if np.isfinite(span) else 1.0)
    return size


def _fitted(
    model: _Model, target: Array, mask: Mask, start: Array, free: NDArray[np.intp], first: Array, force: float
) -> tuple[Array, Array, Array, tuple[str, ...]]:
    """Fit the simulated torque to the measured one; parameters that are not free stay as they are.

    `target` is in multiples of `force`; `first`, shape (m, free), are the sensitivities at the start.

    Returns
    -------
    values : array, shape (columns,)
    torque : array, shape (m,)
        Simulated with these values.
    slopes : array, shape (m, free)
        Sensitivities there.
    warnings : tuple of str
    """
    from scipy.optimize import least_squares

    scale = model.steps / STEP
    torques: dict[bytes, Array] = {}  # the latest only
    slopes: dict[bytes, Array] = {}

    def full(x: Array) -> Array:
        values = start.copy()
        values[free] = x * scale[free]
        return values

    def torque_at(x: Array) -> Array:
        if x.tobytes() not in torques:
            made = model.torque(full(x))
            torques.clear()
            torques[x.tobytes()] = made
        return torques[x.tobytes()]

    def slopes_at(x: Array) -> Array:
        if x.tobytes() not in slopes:
            made = model.slopes(full(x), free.tolist(), torque_at(x))
            slopes.clear()
            slopes[x.tobytes()] = made
        return slopes[x.tobytes()]

    def residual(x: Array) -> Array:
        try:
            return (torque_at(x) / force - target)[mask]
        except SimulationError:
            return np.full(int(mask.sum()), FAR)

    def jacobian(x: Array) -> Array:
        return slopes_at(x)[mask] * scale[free] / force

    low, high = model.lower[free] / scale[free], model.upper[free] / scale[free]
    inside = np.clip(start[free] / scale[free], low, high)
    slopes[inside.tobytes()] = first
    # A sum of squares that falls by a ten thousandth moves a parameter by a fraction of its standard error; the
    # linear problem that follows takes that step as well.
    found = least_squares(
        residual, inside, jac=jacobian, bounds=(low, high), x_scale="jac", xtol=1e-5, ftol=1e-4, max_nfev=ROUNDS
    )
    warnings = () if found.status > 0 else (f"the fit by simulation had not converged after {ROUNDS} runs",)
    return full(found.x), torque_at(found.x), slopes_at(found.x), warnings


def _mismatch(ordinary: Fit, fit: Fit, mask: Mask) -> tuple[str, ...]:
    """Say when the simulation disagrees with inverse dynamics, which trusts less."""
    simulated, inverse = (float(np.sqrt(np.mean(f.residual[mask] ** 2))) for f in (fit, ordinary))
    if simulated > 1.5 * inverse:
        return (
            f"the simulated drive leaves {simulated / inverse:.2g} times the residual of inverse dynamics: its loops "
            "or references are not quite those of the log, and the numbers may be off by more than their errors",
        )
    apart = {
        name: (value - ordinary.values[name]) / fit.stderr[name]
        for name, value in fit.values.items()
        if name in ordinary.values and fit.stderr[name] > 0.0
    }
    far = [f"{name} by {share:+.0f}" for name, share in apart.items() if abs(share) > APART]
    if not far:
        return ()
    return (
        f"differs from inverse dynamics, in standard errors: {', '.join(far)}; either the loops and references of the "
        "simulation are not quite those of the log, or noise in the motion biases inverse dynamics: method iv tells",
    )
