"""diagnose: which physical effect a design lacks, judged by a log.

The algorithm is `_answer` and `_select`; each step is a function of a module of that name:

- `criteria`: what an effect has to pass, as pure functions of numbers; their thresholds are in `policy`
- `events`: what happened once, kept out of every fit
- `selection`: one round, the best candidate that passes
- `swap`: effects that another one can replace
- `shapes`: nonlinear parameters, fitted together with all others
- `unexplained`: structure of the residual that no effect explains
- `experiment`: the motion that separates what this log cannot
- `outcome`: parameters, errors, ranking and verdict, as a `result`
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.calibration import calibrated, replay_of
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.events import events_of, without_events
from pmsm_ctrl.diagnose.experiment import next_experiment
from pmsm_ctrl.diagnose.notices import of_calibration
from pmsm_ctrl.diagnose.outcome import outcome
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.result import Diagnosis
from pmsm_ctrl.diagnose.selection import Selection, best
from pmsm_ctrl.diagnose.shapes import with_shapes_fitted
from pmsm_ctrl.diagnose.swap import swap
from pmsm_ctrl.diagnose.unexplained import unexplained
from pmsm_ctrl.diagnose.verdict import explains_most
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import doubts_about, of_holdout
from pmsm_ctrl.regression.balances import STANDSTILL, make_record
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.fast_orders import orders_beyond
from pmsm_ctrl.regression.timed_record import timed_record

__all__ = ["diagnose"]

Progress = Callable[[float], None]


def diagnose(
    design: Design,
    log: Log,
    *,
    holdout: Log | None = None,
    candidates: Iterable[str] | None = None,
    calibrate: int = 0,
    plan: bool = True,
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
    log : Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``; with ``u_d`` and ``u_q`` the winding is judged too.
    holdout : Log, optional
        Another record of the same axis; no effect is accepted that makes it worse.
    candidates : iterable of str, optional
        Ids to choose from; the whole catalogue and the design's own effects when left out.
    calibrate : int
        Simulations of the accepted model, each diagnosed again, that say how often this diagnosis raises a false
        alarm on this motion; each takes about as long as the diagnosis itself.
    plan : bool
        Whether to look for the next experiment where the log cannot tell two effects apart: eight motions are
        simulated, some seconds.
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
        When the design or `candidates` names an unknown effect; with `calibrate`, when the drive cannot be simulated.
    """
    if calibrate < 0:
        raise RequestError(f"calibrate: found {calibrate}; the number of simulations, 0 or more, was expected")
    if calibrate:
        replay_of(design, log)  # what cannot be simulated is said before the work, not after it
    offered = _offered(catalogue_of(design), candidates)
    advance = progress or (lambda share: None)
    share = 1.0 / (1.0 + calibrate)
    case = _condition(design, log, holdout, offered, policy)
    found = _answer(case, plan, lambda done: advance(share * done))
    case.record.kept.clear()  # hundreds of columns that nobody needs any more
    found = replace(
        found,
        log_name=log.provenance.file or "the given log",
        holdout_name=(holdout.provenance.file or "the held-out log") if holdout is not None else "",
    )
    if calibrate:
        again = partial(diagnose, found.design, candidates=offered, plan=False, policy=policy)
        rate = calibrated(found.design, log, calibrate, again, lambda done: advance(share + (1.0 - share) * done))
        found = replace(found, calibration=rate, notices=(*found.notices, *of_calibration(rate, policy)))
    advance(1.0)
    return found


def _answer(case: Case, plan: bool, progress: Progress) -> Diagnosis:
    """Accept effects, swap those that another one explains better, and add what they do not explain."""
    if case.believed is not None and case.believed.contradictions:
        return outcome(case, Selection((case.fit(()),)), None, None)  # no name would mean anything
    case = _without_events(case)
    selection = swap(case, _select(case, progress=progress), _select)
    last = with_shapes_fitted(case.design, selection.fit)
    selection = replace(selection, fits=(*selection.fits[:-1], last))
    structure = None
    if explains_most(selection.fit, case.policy):
        structure = unexplained(selection, case.policy)
    else:  # what most of the torque is, no name can tell
        selection = Selection(selection.fits[:1], (), selection.refused)
    experiment = next_experiment(case, selection) if plan else None
    return outcome(case, selection, structure, experiment)


def _without_events(case: Case) -> Case:
    """Keep what happened once out of every fit: no effect explains it, and it imitates some."""
    events = events_of(case.keep(case.fit(())), case.policy)
    if not events:
        return case
    return replace(case, record=without_events(case.record, events), events=events, fits=[])


def _select(case: Case, start: tuple[str, ...] = (), progress: Progress | None = None) -> Selection:
    """Accept effects until no candidate passes; with `start` the first ones are these, or none is accepted at all."""
    selection = Selection((case.keep(case.fit(())),))
    while (found := best(case, selection, start)).accepted:
        selection = selection.plus(found)
        case.keep(selection.fit)
        if progress is not None:
            progress(0.9 - 0.7 * 0.8 ** len(selection.steps))  # how many are to come is not known
    if len(selection.steps) < len(start):
        return Selection(selection.fits[:1], (), found.refused)
    return selection.plus(found)


def _condition(design: Design, log: Log, holdout: Log | None, offered: Mapping[str, Effect], policy: Policy) -> Case:
    """Condition the log, and the held-out one in the same way."""
    believed = doubts_about(design, log)
    record = timed_record(design, believed.log)
    fast = orders_beyond(design, believed.log, record.cutoff)
    if holdout is None:
        return Case(design, record, offered, None, policy, believed=believed, remarks=fast)
    held_out = doubts_about(design, holdout)
    same = Processing(standstill=STANDSTILL, cutoff=record.prepared.cutoff)
    other = make_record(design, held_out.log, same, record.age or 0.0, record.timing)
    return Case(
        design, record, offered, other, policy, believed=believed, remarks=(*fast, *map(of_holdout, held_out.notices))
    )


def _offered(effects: Mapping[str, Effect], candidates: Iterable[str] | None) -> dict[str, Effect]:
    if candidates is None:
        return dict(effects)
    out = {}
    for identifier in candidates:
        if identifier not in effects:
            raise RequestError(f"unknown effect '{identifier}'{nearest(identifier, effects)}")
        out[identifier] = effects[identifier]
    return out
