"""Output error: the parameters with which the simulated drive, its sampled controller included, makes that torque.

Unlike the regression this differentiates nothing, treats measured and modelled friction alike through every reversal,
and finds parameters that a term is not linear in, and those of effects with states of their own. It trusts the loops
and the references.

Sources: M. Gautier, A. Janot, P. O. Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428 (torque as the output
of a closed-loop simulation); L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, sec. 13.5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.errors import DesignError, SimulationError
from pmsm_ctrl.identify import policy
from pmsm_ctrl.identify.notices import DIFFERS, NOT_CONVERGED, WRONG_LOOPS
from pmsm_ctrl.identify.replay import Replay, plant_with
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.drive_timing import LATENESS, sampling_columns
from pmsm_ctrl.regression.inverse_dynamics import Column, Problem
from pmsm_ctrl.regression.least_squares import Cause, Fit, Unidentifiable, solve
from pmsm_ctrl.regression.notices import NO_REGRESSION
from pmsm_ctrl.regression.signals import logged_torque
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["output_error"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Model:
    """The simulated torque of one log as a function of the parameters, shapes (columns,) to (m,).

    The steps are those over which sensitivities are taken; `kept` remembers the latest torque.
    """

    design: Design
    prepared: Prepared
    replay: Replay
    columns: tuple[Column, ...]
    steps: Array
    kept: dict[bytes, Array] = field(default_factory=dict)

    def torque(self, values: Array) -> Array:
        """Return the filtered torque of the simulated drive on the thinned grid, N m, as late as the logged one."""
        whole, period = self.simulated(values), 1.0 / self.prepared.rate
        late = 0.0 if self.prepared.sampling is None else self.prepared.sampling.late
        return self.prepared.column(whole + late * sampling_columns(whole, period, late)[LATENESS])

    def simulated(self, values: Array) -> Array:
        """Return the torque of the simulated drive, sampled with its motion, at the log's rate, N m."""
        log = self.replay.run(plant_with(self.design, self.columns, values))
        return logged_torque(self.design, log.channels)

    def nuisances(self, values: Array) -> list[Column]:
        """Return how the drive signal may have been sampled otherwise."""
        sampling = self.prepared.sampling
        if sampling is None or not all(sampling.sigma):
            return []
        made = sampling_columns(self.simulated(values), 1.0 / self.prepared.rate, sampling.late)
        return [
            Column(name, self.prepared.column(part), unit, 0.0, symbol=name, sigma=sigma)
            for (name, part), unit, sigma in zip(made.items(), ("s", "s^2"), sampling.sigma, strict=True)
        ]

    def latest(self, values: Array) -> Array:
        """Return the same, without a second simulation with the same values."""
        if values.tobytes() not in self.kept:
            made = self.torque(values)
            self.kept.clear()
            self.kept[values.tobytes()] = made
        return self.kept[values.tobytes()]

    def slopes(self, values: Array, which: Iterable[int]) -> Array:
        """Return sensitivities, shape (m, parameters asked for), by differences."""
        made, base = [], self.latest(values)
        for k in which:
            moved = values.copy()
            step = self.steps[k]
            moved[k] += step if values[k] + step <= self.columns[k].upper else -step
            made.append((self.torque(moved) - base) / (moved[k] - values[k]))
        return np.column_stack(made)


def output_error(
    design: Design, problem: Problem, prepared: Prepared, replay: Replay, each: Callable[[], None] = lambda: None
) -> tuple[Problem, Fit, tuple[Notice, ...]]:
    """Fit the inertia and all parameters of the design's effects by simulation.

    Starts from the solution of the log's regression. The log is prepared as it was logged: the simulation has the
    measurement effects of the design. Returns the problem that is linear at the solution, its columns the
    sensitivities. `each` is called in every round.
    """
    ordinary = solve(problem)
    columns = _parameters(design, problem)
    mask = prepared.mask
    measured = prepared.column(prepared.signals["torque"])
    force = float(np.sqrt(np.mean(measured[mask] ** 2)))
    start = np.array([ordinary.values.get(c.name, c.nominal) for c in columns])
    steps = np.array([_step(c, problem, force, value) for c, value in zip(columns, start.tolist(), strict=True)])
    model = _Model(design, prepared, replay, columns, steps)
    slopes = model.slopes(start, range(len(columns)))
    size = np.sqrt(np.mean(slopes[mask] ** 2, axis=0)) * steps / policy.DIFFERENCE
    free = np.flatnonzero(size > policy.NO_EFFECT * force)
    values, found, notices = _fitted(model, measured, start, free, slopes[:, free], each)
    slopes = np.zeros_like(slopes)
    slopes[:, free] = found
    nuisances = model.nuisances(values)
    late = {c.name: prepared.sampling.late for c in nuisances if prepared.sampling and c.name == LATENESS}
    linear = replace(
        problem,
        target=measured
        - model.latest(values)
        + slopes @ values
        + sum((late[c.name] * c.values for c in nuisances if c.name in late), np.zeros(len(measured))),
        columns=(*(replace(c, values=s) for c, s in zip(columns, slopes.T, strict=True)), *nuisances),
        notes=tuple(note for note in problem.notes if note.code != NO_REGRESSION.code),
    )
    fit = _without_absent(design, solve(linear, ratio=policy.LEAST_ACCELERATION), columns)
    return linear, fit, (*notices, *_mismatch(ordinary, fit, mask))


def _without_absent(design: Design, fit: Fit, columns: tuple[Column, ...]) -> Fit:
    """Withhold the shape of an effect that may just as well be absent: noise of any shape resembles it."""
    linear = {effect.id: {p.symbol for p in effect.linear} for effect, _ in bound_effects(design)}
    lost = dict(fit.unidentifiable)
    for entry in {c.entry for c in columns if c.entry >= 0}:
        mine = [c for c in columns if c.entry == entry]
        sizes = tuple(c.name for c in mine if c.symbol in linear[c.effect])
        if sizes and all(n in fit.values and np.prod(fit.interval(n)) <= 0.0 for n in sizes):
            lost |= {
                c.name: Unidentifiable(Cause.EFFECT_ABSENT, c.effect, {"sizes": sizes})
                for c in mine
                if c.name in fit.values and c.name not in sizes
            }
    values, stderr = ({n: v for n, v in known.items() if n not in lost} for known in (fit.values, fit.stderr))
    return replace(fit, values=values, stderr=stderr, unidentifiable=lost)


def _parameters(design: Design, problem: Problem) -> tuple[Column, ...]:
    """Return a column without values for the inertia and for every parameter that can be searched."""
    made = [column for column in problem.columns if column.is_inertia]
    for index, (effect, parameters) in enumerate(bound_effects(design)):
        for known in effect.parameters:
            symbol = known.symbol
            told = symbol not in effect.common_scale  # no log tells it from the torque constant
            if symbol == effect.order or symbol in effect.structure.absent(effect, parameters) or not told:
                continue  # a whole number, or what the design has not
            twins = sum(column.symbol == symbol for column in made)
            name = f"{symbol}#{twins + 1}" if twins else symbol
            unit, value = axis_unit(known.unit, design.motion), parameters[symbol]
            made.append(Column(name, np.zeros(0), unit, value, known.lower, known.upper, effect.id, index, symbol))
    return tuple(made)


def _step(column: Column, problem: Problem, force: float, value: float) -> float:
    """Return the difference over which a parameter's sensitivity is taken."""
    size = max(abs(value), abs(column.nominal)) * policy.DIFFERENCE
    for regressor in problem.columns:
        if regressor.name == column.name:
            alone = force / max(float(np.sqrt(np.mean(regressor.values[problem.mask] ** 2))), 1e-300)
            size = max(size, policy.FIRST_DIFFERENCE * alone * (0.1 if size else 1.0))
    if size == 0.0:
        span = column.upper - column.lower
        size = policy.DIFFERENCE * (span if np.isfinite(span) else 1.0)
    return size


def _fitted(
    model: _Model, measured: Array, start: Array, free: NDArray[np.intp], first: Array, each: Callable[[], None]
) -> tuple[Array, Array, tuple[Notice, ...]]:
    """Fit the simulated torque to the measured one, shape (m,); parameters that are not free stay as they are.

    Returns the values, shape (columns,), the sensitivities there, shape (m, free), and notices; `first` are the
    sensitivities at the start.
    """
    from scipy.optimize import least_squares

    mask = model.prepared.mask
    force = float(np.sqrt(np.mean(measured[mask] ** 2)))
    scale = model.steps[free] / policy.DIFFERENCE
    slopes: dict[bytes, Array] = {}  # the latest only

    def full(x: Array) -> Array:
        values = start.copy()
        values[free] = x * scale
        return values

    def residual(x: Array) -> Array:
        try:
            return (model.latest(full(x)) / force - measured / force)[mask]
        except (DesignError, SimulationError):  # a load with more inertia or friction than the whole axis
            return np.full(int(mask.sum()), policy.UNSTABLE)

    def jacobian(x: Array) -> Array:
        each()
        return slopes_at(x)[mask] * scale / force

    def slopes_at(x: Array) -> Array:
        if x.tobytes() not in slopes:
            made = model.slopes(full(x), free.tolist())
            slopes.clear()
            slopes[x.tobytes()] = made
        return slopes[x.tobytes()]

    low = np.array([model.columns[k].lower for k in free]) / scale
    high = np.array([model.columns[k].upper for k in free]) / scale
    inside = np.clip(start[free] / scale, low, high)  # a start at a bound may have been rounded beyond it
    slopes[inside.tobytes()] = first
    # A sum of squares that falls by a ten thousandth moves a parameter by a fraction of its standard error; the
    # linear problem that follows takes that step as well.
    found = least_squares(
        residual, inside, jac=jacobian, bounds=(low, high), x_scale="jac", xtol=1e-5,
        ftol=1e-4, max_nfev=policy.FIT_ROUNDS,
    )  # fmt: skip
    failed = NOT_CONVERGED(method="the fit by simulation", rounds=policy.FIT_ROUNDS, names="")
    return full(found.x), slopes_at(found.x), () if found.status > 0 else (failed,)


def _mismatch(ordinary: Fit, fit: Fit, mask: Mask) -> tuple[Notice, ...]:
    """Compare the simulation with inverse dynamics, which needs neither loops nor references."""
    simulated, inverse = (float(np.sqrt(np.mean(f.residual[mask] ** 2))) for f in (fit, ordinary))
    if simulated > policy.WRONG_LOOPS * inverse:
        return (WRONG_LOOPS(ratio=simulated / inverse),)
    far = []
    for name, value in fit.values.items():
        if name in ordinary.values and fit.stderr[name] > 0.0:
            apart = (value - ordinary.values[name]) / fit.stderr[name]
            if abs(apart) > policy.DIFFERENT:
                far.append(f"{name} by {apart:+.0f}")
    return (DIFFERS(names=", ".join(far)),) if far else ()
