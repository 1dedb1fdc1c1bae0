"""diagnose: which physical effect a design lacks, judged by a log.

The algorithm is `_answer` and `_select`; each step is a function of a module of that name:

- `criteria`: what an effect has to pass, as pure functions of numbers; their thresholds are in `policy`
- `events`: what happened once, kept out of every fit
- `late`: the log as it was logged, where torque and currents lag the motion by more than any sampling
- `selection`: one round, the best candidate that passes
- `together`: effects that are each a minor part of what is left, and most of it together
- `swap`: effects that another one can replace
- `other_bands`: the same log in other bands, where nothing is named in the usual one
- `bands`: the same log in a narrower band, where a name is checked
- `above_band`: a wave of a turn where it is too fast for the band
- `fast_torque`: an effect that the torque beyond the band alone makes
- `final_fit`, `shapes`: nonlinear parameters, fitted together with all others
- `unexplained`: structure of the residual that no effect explains
- `experiment`: the motion that separates what this log cannot
- `outcome`: parameters, errors, ranking and verdict, as a `result`
- `resonance`: a start from a frequency response, and whether the two agree
- `written`: whether each effect lowers the error that `compare` will give, and the design is better than the given one
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import notices as words
from pmsm_ctrl.diagnose.bands import unlike_in_half
from pmsm_ctrl.diagnose.calibration import calibrated, replay_of
from pmsm_ctrl.diagnose.candidates import offered_effects
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.driven import driven_one_way
from pmsm_ctrl.diagnose.experiment import next_experiment
from pmsm_ctrl.diagnose.final_fit import finally_fitted
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.held_out import same_as_log
from pmsm_ctrl.diagnose.in_step import as_found, sampled_in_step
from pmsm_ctrl.diagnose.late import begun_late, better_late, not_ahead, with_its_delay
from pmsm_ctrl.diagnose.measures import order_of
from pmsm_ctrl.diagnose.notices import of_calibration
from pmsm_ctrl.diagnose.other_bands import (
    hidden_by_noise,
    in_bands_of_springs,
    in_narrower_bands,
    in_wider_band,
    rings_beyond,
    without_what_happened_once,
)
from pmsm_ctrl.diagnose.outcome import outcome, strangers
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.polish import with_polish
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.resonance import compared, measured, started
from pmsm_ctrl.diagnose.result import Diagnosis
from pmsm_ctrl.diagnose.selection import Selection, best, significant, with_sampling_told
from pmsm_ctrl.diagnose.swap import swap
from pmsm_ctrl.diagnose.together import standing, together
from pmsm_ctrl.diagnose.unexplained import unexplained
from pmsm_ctrl.diagnose.verdict import explains_most, explains_most_beside_noise
from pmsm_ctrl.diagnose.written import as_written, astray, lowering
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Log, Logs, as_logs, names_of
from pmsm_ctrl.plausibility import doubts_about, of_holdout, with_inertia
from pmsm_ctrl.plausibility.late_steps import moved_by_its_steps
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import SINGLE, forget_effects
from pmsm_ctrl.regression.fast_orders import beyond_band
from pmsm_ctrl.regression.joining import name_of as name_of_log
from pmsm_ctrl.regression.made import Made, for_design
from pmsm_ctrl.regression.one_axis import other_record
from pmsm_ctrl.regression.timed_record import timed_record, with_friction
from pmsm_ctrl.result import Verdict

if TYPE_CHECKING:
    from pmsm_ctrl.frf import FrequencyResponse

__all__ = ["condition", "diagnose", "finished", "searched"]

# Verdicts after which a name is looked for in other bands: those of a log that belongs to its design, and shows it.
NOTHING_NAMED = (Verdict.CONSISTENT, Verdict.INCONCLUSIVE, Verdict.UNEXPLAINED)

LEADS = 2  # times that a lead of the drive signal is taken out: the first one may be too small

Progress = Callable[[float], None]
Taken = Callable[[Selection], None]


def diagnose(
    design: Design,
    log: Logs,
    *,
    holdout: Logs | None = None,
    candidates: Iterable[str] | None = None,
    calibrate: int = 0,
    plan: bool = True,
    polish: bool = False,
    start: FrequencyResponse | Mapping[str, Any] | None = None,
    policy: Policy = POLICY,
    progress: Progress | None = None,
) -> Diagnosis:
    """Name the physical effects that a design lacks, judged by a log.

    The base parameters are re-estimated inside their tolerance. Candidates are accepted one at a time, by a prewhitened
    group F-test (Holm over all candidates), cross-validation on blocks of time, and the gain on the held-out record;
    everything is fitted again each time, until no candidate passes.

    Parameters
    ----------
    design : Design
        Its own effects are candidates beside the catalogue.
    log : Log or sequence of Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``; with ``u_d`` and ``u_q`` the winding is judged too.
        Several records share inertia and structure; dry and viscous friction, a constant torque and the zero of the
        angle may differ. Three or more are left out in turn in place of blocks of time.
    holdout : Log or sequence of Log, optional
        Other records of the same axis; no effect is accepted that makes them worse, all taken together. Beside several
        logs their friction may differ too: they are judged with its level refitted.
    candidates : iterable of str, optional
        Ids to choose from; the whole catalogue and the design's own effects when left out.
    calibrate : int
        Simulations of the accepted model, each diagnosed again, that say how often this diagnosis raises a false
        alarm on this motion; each takes about as long as the diagnosis itself.
    plan : bool
        Whether to look for the next experiment where the log cannot tell two effects apart: eight motions are
        simulated, some seconds.
    polish : bool
        Whether to refine the parameters of the fitted design by simulation, where that predicts left-out stretches
        better; a few seconds.
    start : FrequencyResponse or mapping, optional
        Result of `frf`, or its JSON: the spring it has found is searched as well, and the answer says whether the two
        agree.
    policy : Policy
        The decision thresholds.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    Diagnosis

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves; with `calibrate`, when the log has no references.
    DesignError, RequestError
        When the design or `candidates` names an unknown effect; when `start` is no frequency response; with
        `calibrate`, when the drive cannot be simulated.
    """
    if calibrate < 0:
        raise RequestError(f"calibrate: found {calibrate}; the number of simulations, 0 or more, was expected")
    logs, holdouts = as_logs(log), () if holdout is None else as_logs(holdout, "holdout")
    if calibrate and len(logs) > 1:
        raise RequestError(f"calibrate: found {len(logs)} logs; one, whose experiment is simulated, was expected")
    design = with_inertia(design, logs)
    if calibrate:
        replay_of(design, logs[0])  # what cannot be simulated is said before the work, not after it
    told = None if start is None else measured(start)
    offered = started(offered_effects(catalogue_of(design), candidates), told)
    advance = progress or (lambda share: None)
    share = 1.0 / (1.0 + calibrate)
    case = condition(design, logs, holdouts, offered, policy)
    case, found = _answer(case, plan, lambda done: advance(share * done))
    found = with_polish(case, found) if polish else found
    if told is None:
        found = replace(found, selection=found.selection.light())  # columns are large, and nothing shows them
    found = finished(case, found, holdouts)
    if told is not None:
        found = compared(case, found, told)
    if calibrate:
        again = partial(diagnose, found.design, candidates=offered, plan=False, start=start, policy=policy)
        rate = calibrated(found.design, logs[0], calibrate, again, lambda done: advance(share + (1.0 - share) * done))
        found = replace(found, calibration=rate, notices=(*found.notices, *of_calibration(rate, policy)))
    advance(1.0)
    return found


def _answer(case: Case, plan: bool, progress: Progress) -> tuple[Case, Diagnosis]:
    """Accept effects, swap those that another one explains better, and add what they do not explain."""
    if case.believed is not None and case.believed.contradictions:
        return case, outcome(case, Selection((case.fit(()),)), None, None)  # no name would mean anything
    case = driven_one_way(case)
    found = searched(without_what_happened_once(case), plan, progress)
    for _ in range(LEADS):
        if (later := not_ahead(found)) is None:
            break
        found = searched(without_what_happened_once(later), plan, progress)
    late = with_its_delay(case)
    return found if late is None else better_late(found, searched(without_what_happened_once(late), plan, progress))


def searched(case: Case, plan: bool, progress: Progress, taken: Taken | None = None) -> tuple[Case, Diagnosis]:
    """Accept effects, swap those that another one explains better, and judge what is left.

    Parameters
    ----------
    case : Case
        Without what happened once.
    plan : bool
        Whether to look for the next experiment.
    progress : function
        Called with the share done, 0 to 1; what it raises ends the search.
    taken : function, optional
        Called with the selection after every accepted effect, before any of them is swapped for another one.

    Returns
    -------
    (Case, Diagnosis)
        The log conditioned as what was found in it calls for, and the answer.
    """
    if (wide := in_wider_band(case)) is not None:
        waves = _select(wide, progress=lambda share: progress(0.9))
        if any(order_of(one, case.design.motor.p or 0) in case.too_fast for one in waves.accepted):
            return _answered(wide, together(wide, waves), plan, progress)
    selection = _selected(case, progress=progress, taken=taken)
    shown = set() if selection.steps else significant(selection.fit, case.policy)
    minor = replace(case, minor_too=True, remarks=(*case.remarks, words.MINOR_PART()))
    small = selection  # any other refusal would be the same again; and `_answered` forgets the columns
    if shown and any(why.reason is Reason.MINOR for why in selection.refused.values()):
        small = _select(minor, progress=lambda share: progress(0.9))
    case, found = _answered(case, selection, plan, progress)
    if shown and found.verdict in NOTHING_NAMED and explains_most(found.selection.fit, case.policy):
        for other in in_narrower_bands(case):
            again = _select(other, progress=lambda share: progress(0.9))
            hidden = again.steps and hidden_by_noise(again.steps[0], shown, selection.refused, case.policy)
            if hidden and (named := _answered(other, again, plan, progress))[1].steps:
                return named
        for other in in_bands_of_springs(case, selection, shown):
            again = _select(other, progress=lambda share: progress(0.9))
            rings = rings_beyond(case.record.cutoff, other, again)
            if rings and (named := _answered(other, again, plan, progress))[1].steps:
                return named
        if small.steps and (named := _answered(minor, small, plan, progress))[1].steps:
            return named
    if not found.steps and (held := sampled_in_step(case, found.selection.fit)) is not None:
        return _answered(held, _selected(held, progress=progress), plan, progress)
    return case, found


def _answered(case: Case, selection: Selection, plan: bool, progress: Progress) -> tuple[Case, Diagnosis]:
    """Swap effects that another one explains better, and judge what is left."""
    again = partial(_selected, progress=lambda share: progress(0.9))
    selection = swap(case, selection, again)
    case, selection = conditioned_again(case, selection, lambda other: swap(other, again(other), again))
    selection = standing(case, selection)
    same = _same_beside_noise(case, selection)
    forget_effects(case.record)  # hundreds of columns that no test of a candidate needs any more
    case.fits.clear()
    if selection.steps:
        case.bands.clear()  # nothing is looked for in a narrower band
    selection = lowering(case, with_sampling_told(case, selection))
    selection = finally_fitted(case, selection.with_last_candidates())
    structure = None
    if same or _explains_most(case, selection):
        structure = unexplained(selection, case.policy)
        if structure is not None and not selection.steps and astray(case, selection.fit):
            structure = None  # what its own parameters make is no structure of the axis
    else:  # what most of the torque is, no name can tell
        selection = Selection((case.fit(()),), (), selection.refused)
    experiment = next_experiment(case, selection) if plan else None
    return case, outcome(case, selection, structure, experiment)


def _same_beside_noise(case: Case, found: Selection) -> bool:
    """Whether the torque is mostly noise, and every effect surely of the same size in half the band: noise is not."""
    if not found.steps or _explains_most(case, found) or not explains_most_beside_noise(found.fit, case.policy):
        return False
    pairs = zip(found.fits, found.fits[1:], strict=False)
    return all(unlike_in_half(case, before, after, surely=True) is None for before, after in pairs)


def _explains_most(case: Case, found: Selection) -> bool:
    # each fit has weights of its own: an effect never makes a model explain less
    return any(explains_most(fit, case.policy) for fit in (found.fit, found.fits[0]))


def conditioned_again(case: Case, found: Selection, select: Callable[[Case], Selection]) -> tuple[Case, Selection]:
    """Select again on the log conditioned with the first effect, where others were accepted beside it, or with a delay.

    The filter of the drive signal, the band and the weights were found with a model that lacked it, and what they are
    wrong by looks like a second effect; a bristle alone looks like a filter. The moments of reversal were found from a
    torque that a delay makes late. The new answer counts where the effect stands in it as well.

    Parameters
    ----------
    case : Case
    found : Selection
    select : function
        Of a case.

    Returns
    -------
    (Case, Selection)
    """
    usual = case
    first = found.accepted[0].effect if found.steps else None
    if first and (len(found.steps) > 1 or first.structure.replaces_direction) and first.enters != "measurement":
        case, found = _conditioned_with(1, usual, (case, found), select)
    late = next((number for number, one in enumerate(found.accepted, start=1) if one.effect.structure.delays), 0)
    return _conditioned_with(late, usual, (case, found), select) if late else (case, found)


def _conditioned_with(
    number: int, usual: Case, so_far: tuple[Case, Selection], select: Callable[[Case], Selection]
) -> tuple[Case, Selection]:
    """Select again on the log conditioned with this many effects, where that is another one; the last has to stand."""
    case, found = so_far
    if usual.conditioned_with is None:
        return so_far
    last = found.accepted[number - 1].effect
    other = usual.conditioned_with(fitted_design(case.design, found.fits[number]), case)
    now, then = other.record, case.record
    alike = now.timing == then.timing and now.cutoff == then.cutoff and np.allclose(now.weight, then.weight)
    if alike and not last.structure.delays:  # a delay moves the reversals as well
        return so_far
    remarks = tuple(dict.fromkeys((*other.remarks, *case.remarks)))
    other = replace(other, remarks=remarks, minor_too=case.minor_too, surely=case.surely)
    other = without_what_happened_once(other)
    again = select(other)
    names = [(one.effect.id, *step.equivalents) for one, step in zip(again.accepted, again.steps, strict=True)]
    stands = names if last.structure.delays else names[:1]
    return (other, again) if any(last.id in them for them in stands) else so_far


def finished(case: Case, found: Diagnosis, holdouts: tuple[Log, ...]) -> Diagnosis:
    """Return a diagnosis with the names of its logs, and what `compare` will say of its design.

    Parameters
    ----------
    case : Case
    found : Diagnosis
    holdouts : tuple of Log

    Returns
    -------
    Diagnosis
    """
    found = as_written(case, found)
    others = strangers(found.records, found.errors["final"]["torque"]["rms"], case.policy)
    for record in (case.record, *case.holdouts):
        record.kept.clear()  # what was remembered of the log stays with no result
    found = replace(found, notices=(*found.notices, *others))
    return replace(found, log_name=case.name, holdout_name=names_of(holdouts, "the held-out log"))


def _select(
    case: Case, start: tuple[str, ...] = (), progress: Progress | None = None, taken: Taken | None = None
) -> Selection:
    """Accept effects until no candidate passes; with `start` the first ones are these, or none is accepted at all."""
    selection = Selection((case.keep(case.fit(())),))
    if (late := begun_late(case, start)) is not None:
        selection = selection.plus(late)
    while (found := best(case, selection, start)).accepted:
        selection = selection.plus(found)
        case.keep_alone(selection.fit)
        if progress is not None:
            progress(0.9 - 0.7 * 0.8 ** len(selection.steps))  # how many are to come is not known
        if taken is not None:
            taken(selection)
        del found  # the model that the effect was judged by, which the selection has no use for
    if len(selection.steps) < len(start):
        return Selection(selection.fits[:1], (), found.refused)
    return selection.plus(found)


def _selected(
    case: Case, start: tuple[str, ...] = (), progress: Progress | None = None, taken: Taken | None = None
) -> Selection:
    """Accept effects, and those that are most of what is left together; with `start` as `_select` does."""
    selection = _select(case, start, progress, taken)
    whole = selection if start else together(case, selection)
    if taken is not None and whole is not selection:
        taken(whole)
    return whole


def condition(
    design: Design, log: Logs, holdouts: tuple[Log, ...], offered: Mapping[str, Effect], policy: Policy,
    made: Made | None = None, shown: Design | None = None, first: Case | None = None, band: float | None = None,
    nameable: frozenset[str] | None = None,
) -> Case:  # fmt: skip
    """Condition the log, and the held-out ones in the same way.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log
    holdouts : tuple of Log
    offered : dict of id to Effect
        The candidates.
    policy : Policy
    made : Made, optional
        What was made of the log before.
    shown : Design, optional
        The same with effects that the log has shown, which say more of how it was sampled.
    first : Case, optional
        The same log conditioned without these, or in its usual band.
    band : float, optional
        Low-pass, Hz, in place of the one that the log calls for.
    nameable : frozenset of str, optional
        Ids that may be named; any where left out.

    Returns
    -------
    Case
    """
    believed = (first and first.believed) or doubts_about(design, log)
    anew, made = made is None, made or Made.kept(believed.log)
    whole = with_friction(design)
    record = timed_record(shown or whole, believed.log, made, band)
    if anew and shown is None and (late := moved_by_its_steps(believed, record)) is not None:
        believed, made = late, Made.kept(late.log)
        record = timed_record(whole, believed.log, made, band)
    made.forget_models(record)
    record = record if first is None else as_found(record, first.record)
    if shown is not None:
        record = for_design(record, whole)
        if first is not None and not anew and (record.cutoff, record.timing, record.age) == (
            first.record.cutoff, first.record.timing, first.record.age,
        ):  # fmt: skip
            return replace(first, record=record, conditioned_with=None, events=(), fits=[])
    others: list[Record] = []
    # a band in which a name is checked says nothing of its own; see `in_narrower_bands`
    beyond = None if band else beyond_band(design, believed.log, record.cutoff)
    remarks = [*([] if beyond is None else [beyond.notice]), *same_as_log(as_logs(log), holdouts)]
    for holdout in holdouts:
        held_out = doubts_about(design, holdout)
        if first is not None and believed.lag > 0.0 and believed.logged is None:
            held_out = held_out.as_logged  # as the log is judged
        zero = first.holdouts[len(others)].shifts if first is not None else None
        others.append(other_record(design, held_out.log, record, zero))
        remarks += map(of_holdout, held_out.notices)
    names = tuple(name_of_log(one, number) for number, one in enumerate(holdouts, start=1))
    again = partial(condition, design, log, holdouts, offered, policy, made, nameable=nameable)
    long = len(record.mask) > SINGLE
    return Case(
        whole, record, offered, tuple(others), names, policy, believed, tuple(dict.fromkeys(remarks)),
        name=names_of(as_logs(log), "the given log"), given=design, beyond=beyond,
        conditioned_with=None if long or (shown and not anew) else partial(again, band=band), in_band=again,
        anew=partial(condition, design, log, holdouts, offered, policy), nameable=nameable,
    )  # fmt: skip
