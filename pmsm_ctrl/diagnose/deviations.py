"""Parameters of the base model that deviate from the design; flagged where they are significantly outside tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import notices
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.held_reference import inertia_doubted, negative_friction
from pmsm_ctrl.diagnose.measures import WINDING, machine_of, seen_beyond, winding_deviation, winding_return
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.result import Deviation
from pmsm_ctrl.diagnose.selection import Selection, name_of
from pmsm_ctrl.regression.drive_timing import AGE, LATENESS
from pmsm_ctrl.regression.model import ALIGNED, ALIGNMENT, LOAD_SCALE
from pmsm_ctrl.regression.notices import AS_STATED, ONE_DIRECTION
from pmsm_ctrl.regression.one_way import goes_one_way
from pmsm_ctrl.regression.timed_record import FRICTION
from pmsm_ctrl.rendering.numbers import with_error
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["deviation_notices", "parameter_deviations", "winding_substitutes"]

UNITS = {"J": "kg m^2", "R": "Ohm", "L_d": "H", "L_q": "H", "psi_f": "Wb", "K_t": "N m/A"}


def parameter_deviations(design: Design, selection: Selection, policy: Policy = POLICY) -> tuple[Deviation, ...]:
    """Return the deviations: torque constant, then inertia and winding, then the design's own effects.

    Parameters
    ----------
    design : Design
    selection : Selection
    policy : Policy
    """
    fit = selection.fit
    constant = _torque_constant if "psi_f" in fit.model.names else _torque_constant_by_load
    return (*constant(design, fit, policy), *_machine(design, selection, policy), *_effects(fit), *_timing(fit))


def _torque_constant(design: Design, fit: Fitted, policy: Policy) -> Iterator[Deviation]:
    if design.motor.p is None:
        return
    k, factor = fit.model.names.index("psi_f"), 1.5 * design.motor.p
    allowed = _allowed(design, policy)
    estimate, error, nominal = factor * fit.plain.values[k], factor * fit.plain.stderr[k], design.K_t_assumed
    sure = abs(estimate - nominal) > policy.sure_errors * error
    outside = bool(abs(estimate / nominal - 1.0) > allowed and sure)
    flagged = outside and _is_seen(fit, k, _edge(nominal, estimate, allowed) / factor, policy)
    doubt = negative_friction(fit, policy) if flagged else ""
    flagged = flagged and not doubt
    note = f"beyond {100 * allowed:.0f} %: it scales every torque" if flagged else doubt or _unseen(outside)
    unit = axis_unit(UNITS["K_t"], design.motion)
    yield Deviation("K_t", nominal, float(estimate), float(error), unit, outside, flagged, note)


def _allowed(design: Design, policy: Policy) -> float:
    """Return the tolerance of the torque constant, as a share: that of psi_f, where it follows from such a one."""
    assumed = design.assumed.K_t is not None
    return policy.torque_constant if assumed else design.motor.tolerance_of("psi_f", policy.torque_constant)


def _torque_constant_by_load(design: Design, fit: Fitted, policy: Policy) -> Iterator[Deviation]:
    """Return the torque constant by a known load, of which it makes a share too much or too little."""
    if LOAD_SCALE in fit.model.names and "i_q" in fit.record.prepared.signals:
        k, nominal = fit.model.names.index(LOAD_SCALE), design.K_t_assumed
        estimate = nominal / (1.0 + float(fit.plain.values[k]))
        error = estimate**2 / nominal * float(fit.plain.stderr[k])
        unit = axis_unit(UNITS["K_t"], design.motion)
        outside = abs(estimate / nominal - 1.0) > _allowed(design, policy)
        outside = outside and abs(estimate - nominal) > policy.sure_errors * error
        yield Deviation("K_t", nominal, estimate, error, unit, outside, False, "by the known load")


def _machine(design: Design, selection: Selection, policy: Policy) -> Iterator[Deviation]:
    fit = selection.fit
    for name, (value, error, nominal, tolerance) in machine_of(design, fit, policy.tolerance).items():
        outside = abs(value - nominal) - tolerance * nominal > policy.sure_errors * error
        flagged = outside and _is_seen(fit, fit.model.names.index(name), _edge(nominal, value, tolerance), policy)
        doubt = _doubted(selection, name, (value, error), _edge(nominal, value, tolerance), policy) if flagged else ""
        if flagged and name == "J":
            doubt = inertia_doubted(fit, value / nominal - 1.0, tolerance, policy)
        flagged = flagged and not doubt
        note = f"beyond its tolerance of {100 * tolerance:.0f} %" if flagged else doubt or _unseen(outside)
        if flagged and name == "J" and not fit.record.sampling_stated:
            note += f", if the {fit.record.drive} was not sampled in step with a held reference"
        unit = axis_unit(UNITS[name], fit.record.prepared.motion)
        yield Deviation(name, nominal, value, error, unit, outside, flagged, note)


def _doubted(selection: Selection, name: str, found: tuple[float, float], edge: float, policy: Policy) -> str:
    """Return why a parameter of the winding beyond the end of its tolerance is none of the motor; empty where it is.

    No motor has a resistance of nothing. Where an effect was named that resembles it, the parameter is known no better
    than the effect's shape: an error of the shape moves it by a share of what the effect itself moved it. An effect
    that was refused may be what it is. A torque constant comes from psi_f.
    """
    if name not in WINDING:
        return ""
    value, error = found
    if value <= policy.sure_errors * error:
        return "not surely above zero, as that of every motor: an effect of another shape than the model's resembles it"
    doubt = negative_friction(selection.fit, policy) if name == "psi_f" else ""
    if doubt := doubt or _restored_by(selection.fit, policy) or _coarse(selection.fit, name):
        return doubt
    each = [float(fit.plain.values[fit.model.names.index(name)]) for fit in selection.fits]
    moved, by = max(
        ((abs(after - before), step) for before, after, step in zip(each[:-1], each[1:], selection.steps, strict=True)),
        key=lambda one: one[0],
        default=(0.0, None),
    )
    if by is None or moved <= abs(value - edge):
        return ""
    return f"outside its tolerance, but {name_of(by.trial)} resembles it and moved it by {moved:.3g}: not sure"


def _unseen(outside: bool) -> str:
    """Return the remark on a parameter that is not flagged."""
    return "outside its tolerance, but the error is nearly the same inside: not sure" if outside else ""


def _edge(nominal: float, value: float, tolerance: float) -> float:
    """Return the end of the tolerance on the side of the value."""
    return nominal + math.copysign(tolerance * nominal, value - nominal)


def _is_seen(fit: Fitted, column: int, edge: float, policy: Policy) -> bool:
    """Whether the log shows that a parameter is beyond its tolerance: it explains most of the residual where it acts.

    The standard error holds where the model is right. Where the log misses edges of the current, or a current loop
    answers noise, it says too little, and the residual at the frequencies of the voltage that R or L_q makes is as
    large with any value of it.
    """
    return seen_beyond(fit.plain, column, edge) > policy.above_floor


def _effects(fit: Fitted) -> Iterator[Deviation]:
    for k, name in enumerate(fit.model.names):
        group = fit.model.group_of(k)
        value, error, nominal = (float(x[k]) for x in (fit.estimate.values, fit.plain.stderr, fit.model.nominal))
        if group.effect is None or group.entry < 0 or nominal == 0.0 or not np.isfinite(error):
            continue
        unit = axis_unit(group.effect.parameter(name.split("#")[0]).unit, fit.record.prepared.motion)
        at_bound = k in fit.estimate.held
        note = "stays at its bound; the standard error is that without bounds" if at_bound else ""
        if fit.model.as_stated(k):
            error, note = float("nan"), "stays as stated: this log does not distinguish it from the others"
        yield Deviation(name, nominal, value, error, unit, False, False, note)


def _timing(fit: Fitted) -> Iterator[Deviation]:
    """Return the delay of the drive signal behind the position, a nuisance parameter: few logs state their sampling."""
    if LATENESS in fit.model.names:
        k, undone = fit.model.names.index(LATENESS), fit.record.timing
        value, error = undone.delay + float(fit.plain.values[k]), float(fit.plain.stderr[k])
        yield Deviation(LATENESS, 0.0, value, error, "s", False, False)
        if undone.lag > 0.0:
            yield Deviation("tau_filter", 0.0, undone.lag, float("nan"), "s", False, False)


def _restored_by(fit: Fitted, policy: Policy) -> str:
    """Name the effects that would bring the winding back to its datasheet."""
    ids = [
        trial.candidate.effect.id
        for trial in fit.trials
        if not (trial.wrong_sign or trial.singular)
        and winding_return(fit.plain, trial.plain_direction) > policy.returned
    ]
    return f"outside its tolerance, but not sure: {' or '.join(ids)} would bring it back" if ids else ""


def _coarse(fit: Fitted, name: str) -> str:
    """Say that a parameter acts above all in a voltage that is no larger than an error of its steps."""
    record, column = fit.record, fit.model.matrix[:, :, fit.model.names.index(name)]
    row = int(np.argmax(np.sum((column * record.mask) ** 2, axis=1)))
    size = float(np.sqrt(np.mean(record.target[row][record.mask] ** 2)))
    return f"not sure: {record.channels[row]} is no larger than its steps" if record.coarse[row] > size else ""


def deviation_notices(deviations: tuple[Deviation, ...], fit: Fitted, policy: Policy = POLICY) -> Iterator[Notice]:
    """Yield what follows from a wrong torque constant, a commutation that is off and a speed that lags; what is held.

    Parameters
    ----------
    deviations : tuple of Deviation
    fit : Fitted
    policy : Policy
    """
    for d in deviations:
        if d.parameter == "K_t" and d.flagged:
            percent = 100.0 * (d.nominal / d.estimate - 1.0)
            other = _pole_pairs_instead(fit.record.design, d, policy)
            yield notices.TORQUE_CONSTANT(nominal=d.nominal, percent=percent, estimate=d.estimate, other=other)
    if held := [name for k, name in enumerate(fit.model.names) if fit.model.as_stated(k)]:
        yield AS_STATED(parameters=", ".join(held))
    elif FRICTION["coulomb"] in fit.model.names and goes_one_way(fit.record):
        yield ONE_DIRECTION()
    yield from _commutation(fit, policy)
    if fit.record.age is None:
        return
    k = fit.model.names.index(AGE)
    lag, error = fit.record.age.delay + float(fit.plain.values[k]), float(fit.plain.stderr[k])
    if lag > max(policy.sure_errors * error, 0.1 * fit.record.period):  # an early speed is what sampling can do
        said, filtered = with_error(1e3 * lag, 1e3 * error), 1e3 * fit.record.age.lag
        yield notices.SPEED_FILTERED(lag=said, filter=filtered) if filtered > 0.0 else notices.SPEED_LAG(lag=said)


def _commutation(fit: Fitted, policy: Policy) -> Iterator[Notice]:
    """Say by how much the drive's axes are turned, where that is surely more than half of what is usual."""
    if ALIGNMENT not in fit.model.names:
        return
    k = fit.model.names.index(ALIGNMENT)
    angle, error = float(fit.plain.values[k]), float(fit.plain.stderr[k])
    if abs(angle) > max(policy.sure_errors * error, 0.5 * ALIGNED):
        said, lost = with_error(math.degrees(abs(angle)), math.degrees(error)), 50.0 * angle**2
        leads = "leads" if angle > 0.0 else "lags"
        yield notices.COMMUTATION(leads=leads, angle=said, percent=100.0 * abs(angle), lost=lost)


def _pole_pairs_instead(design: Design, constant: Deviation, policy: Policy) -> str:
    """Say that another whole number of pole pairs makes the same of the torque constant, up to its tolerance."""
    p, ratio = design.motor.p or 0, constant.estimate / constant.nominal
    whole = round(p * ratio)
    if whole in (0, p) or abs(p * ratio / whole - 1.0) > _allowed(design, policy):
        return ""
    return f"; a motor with {whole} pole pairs in place of {p} shows the same"


def winding_substitutes(selection: Selection, policy: Policy = POLICY) -> Iterator[Notice]:
    """Yield which parameter of the winding would explain nearly as much as an accepted effect.

    Parameters
    ----------
    selection : Selection
    policy : Policy
    """
    for step, before, after in zip(selection.steps, selection.fits[:-1], selection.fits[1:], strict=True):
        if winding_deviation(before.plain) - winding_deviation(after.plain) <= policy.returned:
            continue
        model, values = before.model, before.plain.values
        places = [k for k, name in enumerate(model.names) if name in WINDING]
        k = max(places, key=lambda k: abs(values[k] - model.nominal[k]) / model.sigma[k])
        yield notices.WINDING_SUBSTITUTE(
            effect=name_of(step.trial), parameter=model.names[k], value=values[k], unit=UNITS[model.names[k]],
            ratio=values[k] / model.nominal[k],
        )  # fmt: skip
