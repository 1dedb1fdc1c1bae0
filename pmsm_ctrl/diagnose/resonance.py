"""A resonance that a frequency response has shown: a start for the search of a spring, and a second opinion on it.

`frf` and `diagnose` fit the same two masses in other ways, one in the frequency domain around a constant speed, the
other in time with friction and the drive's sampling in the model. What both find within their joint errors is sure.
A log that names no spring still tells the load's inertia behind the measured one: it may be that inertia, or none.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.diagnose import notices as words
from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.fitted_design import with_errors
from pmsm_ctrl.diagnose.result import Agreement, Diagnosis, Verdict
from pmsm_ctrl.diagnose.search import try_group
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import read_text
from pmsm_ctrl.regression.columns import effect_group
from pmsm_ctrl.rendering.numbers import with_error
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice

if TYPE_CHECKING:
    from pmsm_ctrl.frf import FrequencyResponse

__all__ = ["Measured", "compared", "measured", "read_measured", "started"]

SCHEMA = "pmsm-ctrl/frf/1"
# What is compared: nearly independent in either fit, where stiffness and inertia are not.
COMPARED = ("antiresonance", "load_inertia", "damping_ratio")
_MEANS = {True: "both agree", False: "they differ", None: "this log tells neither it nor its absence"}


@dataclass(frozen=True)
class Measured:
    """What a frequency response says of a second mass.

    Attributes
    ----------
    log_name : str
    mass : SecondMass or None
        None for a rigid axis.
    estimates : dict of name to Estimate
        Those of `COMPARED`; empty for a rigid axis.
    highest : float
        Highest frequency that was measured, Hz.
    """

    log_name: str
    mass: SecondMass | None
    estimates: Mapping[str, Estimate]
    highest: float


def measured(given: FrequencyResponse | Mapping[str, Any]) -> Measured:
    """Take the resonance out of a result of `frf`, or out of its JSON.

    Parameters
    ----------
    given : FrequencyResponse or mapping

    Raises
    ------
    RequestError
        When it is not one.
    """
    try:
        data = given if isinstance(given, Mapping) else given.to_dict()
        found = {name: _estimate(one) for name, one in data["estimates"].items()}
        highest = float(max(data["responses"]["plant"]["frequency_hz"]))
        if "stiffness" not in found:
            return Measured(str(data["log"]), None, {}, highest)
        mass = SecondMass(*(found[name].value for name in ("load_inertia", "stiffness", "damping")))
        if not all(math.isfinite(value) and value > 0.0 for value in (mass.J_load, mass.k, mass.d)):
            raise ValueError
        return Measured(str(data["log"]), mass, {name: found[name] for name in COMPARED}, highest)
    except (AttributeError, KeyError, TypeError, ValueError):
        raise RequestError("start: a result of frf, or its JSON, was expected") from None


def read_measured(file: Path) -> Mapping[str, Any]:
    """Read what ``pmsm-ctrl frf --json FILE`` wrote.

    Parameters
    ----------
    file : Path

    Raises
    ------
    RequestError
        When the file is not one of these.
    """
    try:
        data = json.loads(read_text(file))
    except OSError as error:
        raise RequestError(f"{file}: {error.strerror or error}") from error
    except (ValueError, RecursionError):
        data = None
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise RequestError(f"{file}: found no frequency response; the file that frf --json writes was expected")
    return data


def _estimate(one: Mapping[str, Any]) -> Estimate:
    stderr = one["stderr"]
    return Estimate(float(one["value"]), str(one["unit"]), math.nan if stderr is None else float(stderr))


def started(effects: Mapping[str, Effect], found: Measured | None) -> dict[str, Effect]:
    """Return the effects, those with a spring starting from the measured one as well.

    Parameters
    ----------
    effects : dict of id to Effect
    found : Measured or None
    """
    if found is None or found.mass is None:
        return dict(effects)
    out = {}
    for name, effect in effects.items():
        plain = effect.structure
        structure = plain.starting_from(found.mass)
        out[name] = effect if structure is plain else replace(effect, structure=structure)
    return out


def compared(case: Case, found: Diagnosis, told: Measured) -> Diagnosis:
    """Return the diagnosis with whether it agrees with the frequency response, and a notice where it does not.

    Parameters
    ----------
    case : Case
    found : Diagnosis
    told : Measured
    """
    if found.verdict is Verdict.IMPLAUSIBLE:
        return found
    if any(effect.structure.splits_inertia for effect, _ in bound_effects(case.as_given)):
        return replace(found, remarks=(*found.remarks, words.RESONANCE_STATED()))
    fit = found.selection.fit
    springs = [k for k, one in enumerate(fit.accepted) if one.effect.structure.resonance(one.shape) is not None]
    if springs:
        agreement = _beside(case, fit, springs[0], told)
    elif told.mass is None:
        agreement = Agreement(told.log_name, "", True)
    else:
        agreement = _unnamed(case, fit, told)
    notice = _notice(case, found, agreement, told)
    doubts = () if notice is None else (notice,)
    return replace(found, resonance=agreement, notices=(*found.notices, *doubts))


def _unnamed(case: Case, fit: Fitted, told: Measured) -> Agreement:
    """Compare the load's inertia that this log has behind the measured spring with the measured one, and with none."""
    assert told.mass is not None
    agreement = Agreement(told.log_name, "", None, frf=told.estimates)
    for effect in case.effects.values():
        structure = effect.structure
        values = structure.values_of(told.mass)
        if not values or structure.available(fit.record, effect):
            continue
        shape = structure.shape(effect, values)
        group = effect_group(fit.record, effect, shape)
        trial = try_group(fit.plain, fit.weights, Candidate(effect, (shape,)), group)
        if trial.singular:
            return agreement
        own = Estimate(float(trial.values[0]), told.estimates["load_inertia"].unit, float(trial.stderr[0]))
        agreement = replace(agreement, diagnosed={"load_inertia": own})
        limit = NormalDist().inv_cdf(1.0 - 0.5 * case.policy.significance)
        if not agreement.apart["load_inertia"] <= limit:
            return replace(agreement, agrees=False)
        return replace(agreement, agrees=True if own.value > limit * own.stderr else None)
    return agreement


def _beside(case: Case, fit: Fitted, number: int, told: Measured) -> Agreement:
    """Compare the spring at this position with the measured one, each quantity at its share of the significance."""
    one = fit.accepted[number]
    structure = one.effect.structure

    def quantities(found: Mapping[str, float]) -> dict[str, float]:
        mass = structure.second_mass(structure.parameters(one.effect, found))
        assert mass is not None  # it has a resonance
        return {"antiresonance": mass.antiresonance, "load_inertia": mass.J_load, "damping_ratio": mass.damping_ratio}

    values, stderr = with_errors(fit, number, quantities)
    if told.mass is None:
        seen = values["antiresonance"] < told.highest
        own = {"antiresonance": Estimate(values["antiresonance"], "Hz", stderr.get("antiresonance", math.nan))}
        return Agreement(told.log_name, one.effect.id, False if seen else None, own)
    own = {name: Estimate(values[name], told.estimates[name].unit, stderr.get(name, math.nan)) for name in COMPARED}
    limit = NormalDist().inv_cdf(1.0 - 0.5 * case.policy.significance / len(COMPARED))
    both = Agreement(told.log_name, one.effect.id, None, own, told.estimates)
    away = both.apart.values()
    return both if any(math.isnan(z) for z in away) else replace(both, agrees=all(z <= limit for z in away))


def _notice(case: Case, found: Diagnosis, agreement: Agreement, told: Measured) -> Notice | None:
    """Return what does not fit together, or is not told by this log; None where both say the same."""
    if not agreement.effect and told.mass is not None:
        at = with_error(told.estimates["antiresonance"].value, told.estimates["antiresonance"].stderr)
        why = "; ".join(
            f"{row.effect} is {row.why_not}"
            for row in found.ranking
            if row.refusal is not None and case.effects[row.effect].structure.splits_inertia
        )
        behind = "not told by this log"
        if agreement.diagnosed:
            own, other = agreement.diagnosed["load_inertia"], told.estimates["load_inertia"]
            behind = f"{with_error(own.value, own.stderr)} {own.unit} behind such a spring, against "
            behind += f"{with_error(other.value, other.stderr)} ({_MEANS[agreement.agrees]})"
        return words.RESONANCE_NOT_NAMED(antiresonance=at, log=told.log_name, why=why, load=behind)
    if agreement.agrees is not False:
        return None
    ours = agreement.diagnosed["antiresonance"]
    if told.mass is None:
        return words.RESONANCE_NOT_MEASURED(
            effect=agreement.effect, antiresonance=with_error(ours.value, ours.stderr), highest=told.highest,
            log=told.log_name,
        )  # fmt: skip
    name, errors = max(agreement.apart.items(), key=lambda one: one[1])
    own, other = agreement.diagnosed[name], agreement.frf[name]
    return words.RESONANCES_DIFFER(
        effect=agreement.effect, quantity=name.replace("_", " "), own=with_error(own.value, own.stderr),
        other=with_error(other.value, other.stderr), unit=own.unit, errors=errors,
    )  # fmt: skip
