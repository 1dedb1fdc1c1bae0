"""The base model of the diagnosis as a regression of the torque: parameters of the axis, and nuisance parameters.

With it `identify` reads a log as `diagnose` and `compare` do: the same band, weights, reversals, sampling and
instruments of the reference.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.bandwidth import with_sound_inertia
from pmsm_ctrl.regression.base_fit import Settled, reads_torque, settled_model
from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.drive_timing import AGE, LATENESS, Sampling
from pmsm_ctrl.regression.filter_profile import LOWERED
from pmsm_ctrl.regression.inverse_dynamics import Column, Problem
from pmsm_ctrl.regression.least_squares import Fit, solve
from pmsm_ctrl.regression.model import FIXED
from pmsm_ctrl.regression.notices import AS_STATED, NO_REGRESSION, ONE_DIRECTION
from pmsm_ctrl.regression.one_way import goes_one_way
from pmsm_ctrl.regression.sampling_terms import in_step
from pmsm_ctrl.regression.timed_record import FRICTION, as_possible_command, timed_record
from pmsm_ctrl.units import axis_unit

__all__ = ["Based", "based"]

Array = NDArray[np.float64]

FALLING = np.array([0.01, 0.03, 0.1, 0.3])  # of the highest speed, over which a friction may fall
FREE = 1e6  # times what would explain the whole torque: as good as free


@dataclass(frozen=True, eq=False)
class Based:
    """The torque balance of a record with the base model, solved.

    Attributes
    ----------
    record : Record
    problem : Problem
        Not weighted.
    fit : Fit
        By the weights of the record; its residual is not weighted.
    """

    record: Record
    problem: Problem
    fit: Fit

    @property
    def sampling(self) -> Sampling:
        """How the drive signal was sampled."""
        name = AGE if self.record.age is not None else LATENESS
        value, stderr = self.fit.nuisances.get(name, (0.0, 0.0))
        if self.record.age is not None:  # a speed that is old makes a torque early
            value = -(self.record.age.delay + value)
        sure = stderr <= FIXED * max(self.record.sampling, self.record.early)
        return Sampling(self.record.timing, value, 0.0 if sure else stderr)


def based(design: Design, log: Log) -> Based:
    """Fit the base model to the torque of a log, its parameters free of any prior.

    Parameters
    ----------
    design : Design
    log : Log

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    """
    timed = as_possible_command(timed_record(design, log))
    found = _based(design, log, timed)
    viscous = found.fit.at_bound.get(FRICTION["viscous"])
    if viscous is None or (other := in_step(timed, FRICTION["viscous"], viscous.free, viscous.stderr)) is None:
        return found
    again = _based(design, log, other)
    return again if _left(again) < min(LOWERED * _left(found), _left_by_curves(found)) else found


def _left(found: Based) -> float:
    """Weighted norm of what the fit leaves of the torque."""
    return float(np.linalg.norm(found.record.weight[0] * found.record.mask * found.fit.residual))


def _left_by_curves(found: Based) -> float:
    """Return what is left at least with a friction that falls towards a level, in place of one along a straight line.

    Friction of the base model has one slope: that of a curve that falls is below zero as well.
    """
    rows, columns = found.record.weight[0] * found.record.mask, {one.name: one.values for one in found.problem.columns}
    if (dry := columns.get(FRICTION["coulomb"])) is None:  # it stays as stated
        return math.inf
    speed, left = np.abs(found.problem.omega), []
    others = [values for name, values in columns.items() if name != FRICTION["viscous"]]
    for width in FALLING * float(np.max(speed)):
        matrix = rows[:, None] * np.column_stack([*others, dry * np.exp(-speed / width)])
        target = rows * found.problem.target
        left.append(np.linalg.norm(target - matrix @ np.linalg.lstsq(matrix, target, rcond=None)[0]))
    return float(min(left))


def _based(design: Design, log: Log, timed: Record) -> Based:
    found = settled_model(design, timed)
    problem = _problem(design, found)
    weight = found.record.weight[0]
    columns = tuple(replace(column, values=weight * column.values) for column in problem.columns)
    weighted = replace(problem, target=weight * problem.target, columns=columns)
    if problem.inertia is not None and columns[problem.inertia].prior is None:
        weighted = with_sound_inertia(design, log, weighted)
        problem = replace(problem, inertia_cutoff=weighted.inertia_cutoff)
    fit = solve(weighted, by_blocks=True)
    fit = replace(fit, residual=problem.target - problem.matrix() @ fit.coefficients)
    return Based(found.record, problem, fit)


def _problem(design: Design, found: Settled) -> Problem:
    record, model, prepared = found.record, found.model, found.record.prepared
    entering = [k for k in range(len(model.names)) if np.any(model.matrix[0][:, k])]
    shares = [k for k in entering if model.as_stated(k) and reads_torque(model.group_of(k).effect)]
    held = [k for k in entering if k in shares or not _identified(model.group_of(k))]
    stateful = (effect.id for effect, _ in bound_effects(design) if effect.has_state and effect.enters == "torque")
    return Problem(
        target=record.target[0] - model.matrix[0][:, held] @ model.nominal[held],
        columns=tuple(_columns(design, found, [k for k in entering if k not in held])),
        mask=record.mask,
        t=record.t,
        omega=prepared.smooth(record.signals["omega"]),
        torque=prepared.smooth(record.signals["torque_meas"]),
        unit=axis_unit("N m", prepared.motion),
        rate=record.rate,
        cutoff=record.cutoff,
        notes=(
            *record.notes,
            *(NO_REGRESSION(effect=name) for name in stateful),
            *(AS_STATED(parameters=model.names[k]) for k in shares),
            *([ONE_DIRECTION()] if _holds_load(found, entering) else []),
        ),
    )


def _holds_load(found: Settled, entering: list[int]) -> bool:
    """Whether the dry friction of an axis that goes one way is the sum of it and of any constant load."""
    free = [found.model.names[k] for k in entering if not found.model.as_stated(k)]
    return FRICTION["coulomb"] in free and goes_one_way(found.record)


def _identified(group: Group) -> bool:
    """Whether the torque tells a group's parameters; those with a memory and of the measurement stay as stated."""
    return group.effect is None or not (group.effect.has_state or group.effect.enters == "measurement")


def _columns(design: Design, found: Settled, which: list[int]) -> Iterator[Column]:
    model, record = found.model, found.record
    for k in which:
        name, values, nominal = model.names[k], model.matrix[0][:, k], float(model.nominal[k])
        group, sigma = model.group_of(k), float(model.sigma[k])
        if group.effect is not None and group.entry >= 0:
            symbol = name.split("#")[0]
            known = group.effect.parameter(symbol)
            unit = axis_unit(known.unit, record.prepared.motion)
            yield Column(name, values, unit, nominal, known.lower, known.upper, group.effect.id, group.entry, symbol)
        elif name == "J":
            yield _inertia(design, found, k)
        else:
            # a finite width even of what nothing is known of: it is no parameter of the axis
            widest = FREE * float(np.max(np.abs(record.target[0])) / np.max(np.abs(values)))
            width = min(model.doubt.get(k, sigma), widest)
            yield Column(name, values, "", nominal, symbol=name, sigma=width, held=k in model.doubt)


def _inertia(design: Design, found: Settled, k: int) -> Column:
    """Return the inertia's column: by the reference, or free, and as biased as the noise of the motion may make it."""
    model, record = found.model, found.record
    unit, least = axis_unit("kg m^2", record.prepared.motion), design.load.kept(design.motor.J)
    plain = Column("J", model.matrix[0][:, k], unit, design.J, lower=least, symbol="J")
    if k in model.doubt and model.nominal[k] != design.J:
        return replace(plain, prior=(float(model.nominal[k]), model.doubt[k]), held=True)
    return replace(plain, bias=model.bias.get(k, 0.0))
