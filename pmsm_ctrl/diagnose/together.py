"""Effects that are a minor part of what is left, and most of it together; and those that others make superfluous.

Of three effects that are missing alike each is a third of the residual, and a third is no evidence: sampling and
filters leave errors that any effect explains in part. So where most of the residual is no noise, and no candidate
passes, the one that explains most is assumed, and the selection goes on beside it. What comes of that counts only if
every effect, taken out alone, passes all criteria beside the others, as if it were the last to come: then it is most of
what is left. An effect that was accepted while others were missing, and does not, goes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.criteria import CrossValidation
from pmsm_ctrl.diagnose.fit import Accepted, Fitted
from pmsm_ctrl.diagnose.judging import Evidence
from pmsm_ctrl.diagnose.level import level_of
from pmsm_ctrl.diagnose.measures import contribution, excess_of
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.diagnose.selection import Found, Selection, Step, best, name_of, passes, with_p_values, with_trial

__all__ = ["above_floor", "standing", "together"]

# What may refuse an effect because others are missing as well.
IN_PART = (Reason.MINOR, Reason.NOT_CONFIRMED, Reason.MODEL_OUT_OF_BOUNDS)
DEEPEST = 3  # effects that are assumed at once


def above_floor(fit: Fitted, policy: Policy) -> bool:
    """Whether most of the residual of a balance is no noise.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    return any(level_of(fit, row).above_floor(policy) for row in range(len(fit.record.channels)))


def together(case: Case, found: Selection) -> Selection:
    """Return a selection with more effects, each of which passes beside all others; the same where there is none.

    Parameters
    ----------
    case : Case
    found : Selection
        Complete. Where nothing is named, what is left may be no effect at all: then the usual band has to show the new
        effects, and hardly more than noise beside them.
    """
    first = not found.steps
    if (first and (case.minor_too or case.surely)) or not above_floor(found.fit, case.policy):
        return found
    assumed = found
    for _ in range(DEEPEST):
        following = next(_in_part(assumed, case.policy), None)
        if following is None or len(assumed.steps) == case.policy.most_steps:
            break
        assumed = _assuming(case, assumed, following)
        while (more := best(case, assumed)).accepted:
            assumed = assumed.plus(more)
        assumed = assumed.plus(more)
        if len(assumed.steps) == len(found.steps) + 1 or (first and above_floor(assumed.fit, case.policy)):
            continue
        sure = _confirmed(case, found, assumed)
        if sure is not None and not (first and above_floor(sure.fit, case.policy)):
            return sure
    return found


def standing(case: Case, found: Selection) -> Selection:
    """Return the selection without effects that do not pass beside those that came after them.

    What was named while others were missing may have stood in for them. A wave with an order of its own does not. Where
    less is left by those up to it than by the others, it is the later ones that go.

    Parameters
    ----------
    case : Case
    found : Selection
        Complete.
    """
    for _ in found.steps:  # what has lost its name may come again as the last
        accepted, steps = list(found.accepted), list(found.steps)
        asked = [k for k in reversed(range(len(accepted) - 1)) if not accepted[k].effect.repeated]
        _, falling = _judged(case, accepted, steps, asked)
        if falling is None:
            break
        alone = found.fits[falling + 1]
        del accepted[falling]
        fallen = steps.pop(falling)
        without = _built(case, accepted, [_alike_too(step, fallen) for step in steps])
        found = _as_far_as(case, found, falling + 1) if alone.plain.chi2 < without.fit.plain.chi2 else without
    return found


def _alike_too(step: Step, fallen: Step) -> Step:
    """Return a step with one that was taken out as its equivalent, where that one had it as its own."""
    alike = step.trial.candidate.effect.id in fallen.equivalents
    return replace(step, equivalents=(*step.equivalents, fallen.trial.candidate.effect.id)) if alike else step


def _as_far_as(case: Case, found: Selection, count: int) -> Selection:
    """Return the first effects of a selection: the others contradict one of them, and explain less."""
    gone = {name_of(step.trial): Refusal(Reason.NOT_NEEDED) for step in found.steps[count:]}
    fits = (*found.fits[:count], case.fit(found.accepted[:count]))
    return Selection(fits, found.steps[:count], {**found.refused, **gone})


def _in_part(found: Selection, policy: Policy) -> Iterator[Trial]:
    """Yield the significant candidates that others may have been in the way of, the one that explains most first.

    None with a memory: what it explains of several effects is no evidence.
    """
    for trial, p in with_p_values(found.fit):
        refusal = found.refused.get(name_of(trial))
        usable = not (
            trial.singular or trial.wrong_sign or trial.at_bound or trial.candidate.effect.structure.has_memory
        )
        if usable and p <= policy.significance and refusal is not None and refusal.reason in IN_PART:
            yield trial


def _assuming(case: Case, found: Selection, trial: Trial) -> Selection:
    """Return the selection with an effect that has not passed."""
    fit = found.fit
    share, _ = excess_of(fit.plain, trial, trial.plain_gain)
    nothing = CrossValidation(0.0, 0.0, 0, 1.0)
    evidence = Evidence(trial.gain, trial.p_value, 1.0, contribution(fit, trial), share, nothing)
    return Selection((*found.fits, with_trial(case, fit, trial)), (*found.steps, Step(trial, evidence, ())))


def _confirmed(case: Case, found: Selection, assumed: Selection) -> Selection | None:
    """Return the selection of those effects that pass beside all others; None unless they are more than before."""
    accepted, steps = list(assumed.accepted), list(assumed.steps)
    known = {name_of(step.trial) for step in found.steps}
    while len(accepted) > len(found.steps):
        passed, falling = _judged(case, accepted, steps, reversed(range(len(accepted))))
        if falling is None:
            sure = [passed[k] for k in range(len(accepted))]
            return _built(case, accepted, [replace(one, together=name_of(one.trial) not in known) for one in sure])
        del accepted[falling], steps[falling]
    return None


def _judged(
    case: Case, accepted: list[Accepted], steps: list[Step], numbers: Iterable[int]
) -> tuple[dict[int, Step], int | None]:
    """Judge effects each beside all others; the steps of those that pass, up to the first that does not."""
    passed: dict[int, Step] = {}
    for k in numbers:
        one = _alone(case, accepted, steps, k)
        if isinstance(one, Refusal):
            return passed, k
        passed[k] = one
    return passed, None


def _alone(case: Case, accepted: list[Accepted], steps: list[Step], k: int) -> Step | Refusal:
    """Judge an effect as if it were the last to come."""
    before = case.fit((*accepted[:k], *accepted[k + 1 :]))
    others = Selection((before,), (*steps[:k], *steps[k + 1 :]))
    wanted = accepted[k].effect.label(accepted[k].shape)
    for trial, p_holm in with_p_values(before):
        if name_of(trial) == wanted:
            passed = passes(case, others, trial, p_holm)
            return passed if isinstance(passed, Refusal) else passed[0]
    return Refusal(Reason.NOT_INDEPENDENT)


def _built(case: Case, accepted: list[Accepted], steps: list[Step]) -> Selection:
    """Return the selection that accepts these effects in this order."""
    whole = Selection((case.fit(()),))
    for k, step in enumerate(steps):
        fit = case.fit(tuple(accepted[: k + 1]))
        whole = whole.plus(Found(step, fit, {}))
        case.keep_alone(fit)
    while (more := best(case, whole)).accepted:
        whole = whole.plus(more)
    return whole.plus(more)
