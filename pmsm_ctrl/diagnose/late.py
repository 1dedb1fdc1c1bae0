"""Torque and currents that lag the motion by more than any sampling: taken out to be examined, and named a delay.

A log that was moved shows what else is missing. That it was late is an effect as well: it is judged by the criteria of
all others on the log as it was logged, whose reversals and time of sampling are found with the lag that was taken out.
The delay is in the model from the start, linearised about itself: without it nothing of such a log is right.
"""

from __future__ import annotations

from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Accepted, judged
from pmsm_ctrl.diagnose.judging import judge_holdout, judge_refit, judge_trial
from pmsm_ctrl.diagnose.notices import DEPENDENCE
from pmsm_ctrl.diagnose.refusal import Refusal
from pmsm_ctrl.diagnose.result import Diagnosis
from pmsm_ctrl.diagnose.search import try_group
from pmsm_ctrl.diagnose.selection import Found, Step
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.structures import Delay
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.covariance import noise_covariance
from pmsm_ctrl.regression.drive_timing import SPREAD, DriveTiming, filter_behind
from pmsm_ctrl.regression.made import Made, for_design

__all__ = ["begun_late", "better_late", "not_ahead", "with_its_delay"]


def with_its_delay(case: Case) -> Case | None:
    """Return the case of the log as it was logged, conditioned with its delay; None where it is not late, or has one.

    Parameters
    ----------
    case : Case
    """
    believed, delay = case.believed, _delay_of(case)
    if believed is None or not believed.lag > 0.0 or case.anew is None or delay is None:
        return None
    late = case.anew(shown=_with(case, delay), first=replace(case, believed=believed.as_logged))
    design = _with(late, delay)
    free = base_fit(design, for_design(late.record, design), settled=False)
    if SPREAD not in free.model.names:
        return late
    spread = free.value(SPREAD)
    filtered = spread[0] > 0.5 * DriveTiming(lag=believed.lag).spread  # of which a delay leaves less than half
    return None if filtered or filter_behind(believed.lag, spread, late.record.sampling) is not None else late


def begun_late(case: Case, start: tuple[str, ...] = ()) -> Found | None:
    """Return the delay as the first effect of a case that is conditioned with it, if it passes every criterion.

    Parameters
    ----------
    case : Case
    start : tuple of str
        Ids that the selection begins with.
    """
    believed, delay = case.believed, _delay_of(case)
    if believed is None or delay is None or not 0.0 < believed.lag < 2.0 * case.record.delayed:
        return None
    if believed.logged is not None or (start and start[0] != delay.id):
        return None
    after = case.fit((Accepted(delay, {}, ({},)),))
    before, place = after.without_last(), after.position(0)
    if before is None or place is None:
        return None
    trial = try_group(before.plain, before.weights, Candidate(delay, ({},)), after.model.groups[place])
    covariance = noise_covariance(before.plain, before.weights, before.whitener)
    trial = judged((before.solved, before.whitener), covariance, [trial])[0]
    passed = judge_trial(before, trial, min(1.0, trial.p_value * len(case.effects)), case.policy)
    if isinstance(passed, Refusal) or judge_refit(before, after, trial, case.policy) is not None:
        return None
    if judge_holdout(case, before, after) is not None:
        return None
    return Found(Step(trial, passed, ()), after, {})


def better_late(moved: tuple[Case, Diagnosis], late: tuple[Case, Diagnosis]) -> tuple[Case, Diagnosis]:
    """Return the answer to the log as it was logged, where that names a delay, and all that the moved one shows.

    Nothing that depends on the motion may be left: a filter of many periods leaves that beside a delay.

    Parameters
    ----------
    moved, late : (Case, Diagnosis)
    """
    accepted = late[1].selection.accepted
    names = {one.effect.id for one in accepted}
    shown = {one.effect.id for one in moved[1].selection.accepted}
    delayed = any(one.effect.structure.delays for one in accepted)
    depends = late[1].left is not None and late[1].left.code == DEPENDENCE.code
    return late if delayed and shown <= names and not depends else moved


def not_ahead(found: tuple[Case, Diagnosis]) -> Case | None:
    """Return the case with the drive signal as late as a delay says that was named because it is ahead; None if none.

    A command is ahead of what acts by the lag of a current loop of which nothing is known. Unless the log states that
    its drive signal is no command, that is how it was sampled, and no effect. A current loop is not a delay alone: what
    it leaves beside one has a name only where it had that beside the delay as well.

    Parameters
    ----------
    found : (Case, Diagnosis)
    """
    case, fit = found[0], found[1].selection.fit
    if case.record.sampling_stated or case.record.age is not None or case.anew is None or case.believed is None:
        return None
    delays = [number for number, one in enumerate(fit.accepted) if one.effect.structure.delays]
    places = [place for number in delays if (place := fit.position(number)) is not None]
    ahead = -sum(float(fit.estimate.values[fit.model.columns_of(place).start]) for place in places)
    if ahead <= 0.0:
        return None
    ahead -= min(case.record.timing.late, 0.0)
    names = frozenset(one.effect.id for one in fit.accepted if not one.effect.structure.delays)
    return case.anew(made=replace(Made.kept(case.believed.log), ahead=ahead), first=case, nameable=names)


def _with(case: Case, delay: Effect) -> Design:
    """Return the design with the lag as its delay."""
    assert isinstance(delay.structure, Delay)
    assert case.believed is not None
    return case.design.add_effect(delay.id, {delay.structure.age: case.believed.lag})


def _delay_of(case: Case) -> Effect | None:
    """Return the delay among the candidates; None where the design has one."""
    delays = [one for one in case.effects.values() if isinstance(one.structure, Delay)]
    stated = {entry.id for entry in case.design.effects}
    return delays[0] if delays and not stated & {one.id for one in delays} else None
