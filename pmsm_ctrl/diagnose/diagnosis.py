"""diagnose: which physical effect a design lacks, judged by a log.

The algorithm is `_answer` and `_select`; each step is a function of a module of that name:

- `made_ready`: the log believed or not, and conditioned in one band; `conditioned_again` with what was found in it
- `events`: what happened once, kept out of every fit
- `late`: the log as it was logged, where torque and currents lag the motion by more than any sampling
- `selection`: one round, the best candidate that passes
- `criteria`: what an effect has to pass, as pure functions of numbers; their thresholds are in `policy`
- `together`: effects that are each a minor part of what is left, and most of it together
- `swap`: effects that another one can replace
- `other_views`: other bands and minor parts, where nothing is named in the usual way
- `bands`: the same log in a narrower band, where a name is checked
- `above_band`: a wave of a turn where it is too fast for the band
- `fast_torque`: an effect that the torque beyond the band alone makes
- `final_fit`, `shapes`: nonlinear parameters, fitted together with all others
- `explained`: whether the model explains enough of the torque for a name to mean anything
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

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.calibration import calibrated, replay_of
from pmsm_ctrl.diagnose.candidates import offered_effects
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.conditioned_again import conditioned_again
from pmsm_ctrl.diagnose.driven import driven_one_way
from pmsm_ctrl.diagnose.experiment import next_experiment
from pmsm_ctrl.diagnose.explained import explains_most, may_name, same_beside_noise
from pmsm_ctrl.diagnose.final_fit import finally_fitted
from pmsm_ctrl.diagnose.in_step import sampled_in_step
from pmsm_ctrl.diagnose.late import begun_late, better_late, not_ahead, with_its_delay
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.measures import order_of
from pmsm_ctrl.diagnose.notices import of_calibration
from pmsm_ctrl.diagnose.other_bands import (
    in_wider_band,
    without_what_happened_once,
)
from pmsm_ctrl.diagnose.other_views import other_views
from pmsm_ctrl.diagnose.outcome import outcome
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.polish import with_polish
from pmsm_ctrl.diagnose.resonance import compared, measured, started
from pmsm_ctrl.diagnose.result import Diagnosis
from pmsm_ctrl.diagnose.selection import Selection, best, with_sampling_told
from pmsm_ctrl.diagnose.swap import swap
from pmsm_ctrl.diagnose.together import standing, together
from pmsm_ctrl.diagnose.unexplained import unexplained
from pmsm_ctrl.diagnose.written import astray, finished, lowering
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Logs, as_logs
from pmsm_ctrl.plausibility import with_inertia
from pmsm_ctrl.result import Verdict

if TYPE_CHECKING:
    from pmsm_ctrl.frf import FrequencyResponse

__all__ = ["diagnose", "searched"]

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
    case, found = _answered(case, selection, plan, progress)
    if found.verdict in NOTHING_NAMED and explains_most(found.selection.fit, case.policy):
        for view in other_views(case, selection):
            again = _select(view.case, progress=lambda share: progress(0.9))
            hidden = bool(again.steps) and view.hidden(again)
            if hidden and (named := _answered(view.case, again, plan, progress))[1].steps:
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
    same = same_beside_noise(case, selection)
    case.forget_candidates(bands=bool(selection.steps))
    selection = lowering(case, with_sampling_told(case, selection))
    selection = finally_fitted(case, selection.with_last_candidates())
    structure = None
    if same or may_name(selection, case.policy):
        structure = unexplained(selection, case.policy)
        if structure is not None and not selection.steps and astray(case, selection.fit):
            structure = None  # what its own parameters make is no structure of the axis
    else:  # what most of the torque is, no name can tell
        selection = Selection((case.fit(()),), (), selection.refused)
    experiment = next_experiment(case, selection) if plan else None
    return case, outcome(case, selection, structure, experiment)


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
