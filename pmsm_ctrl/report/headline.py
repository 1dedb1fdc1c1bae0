"""The first screen of a study: what was done, the verdict, and the numbers that matter most."""

from __future__ import annotations

from pathlib import Path

from pmsm_ctrl.compare import Comparison
from pmsm_ctrl.compare.notices import HOLDOUT_IS_LOG
from pmsm_ctrl.compensate import CompensationStudy, Variant
from pmsm_ctrl.compensate.notices import safe_gain, why_none
from pmsm_ctrl.compensate.present import first_pictures as compensation_pictures
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import Diagnosis, Verdict
from pmsm_ctrl.diagnose.present import first_pictures, verdict_text
from pmsm_ctrl.identify import SweepResult
from pmsm_ctrl.rendering.numbers import percent
from pmsm_ctrl.report.result import Headline
from pmsm_ctrl.result import Result
from pmsm_ctrl.section import Picture
from pmsm_ctrl.units import drives

__all__ = ["of_compensation", "of_diagnosis", "of_result", "of_simulation"]

ACCEPTED_PERCENT = 1.0  # deviation of the reference experiment that its noise and quantisation allow
SURE = 3.0  # standard errors of an estimate that noise alone hardly reaches


def of_simulation(design: Design, swept: SweepResult, duration: float) -> Headline:
    """Compare the friction that a simulated sweep returns with the design's own.

    Parameters
    ----------
    design : Design
        The simulated drive.
    swept : SweepResult
    duration : float
        Length of the identification motion, s.

    Returns
    -------
    Headline
    """
    true = {**design.parameters("coulomb"), **design.parameters("viscous")}
    numbers, deviations, sure = [], [], []
    for symbol, estimate in swept.estimates.items():
        label = f"{symbol} from the sweep"
        if true.get(symbol):
            deviations.append(100.0 * (estimate.value / true[symbol] - 1.0))
            sure.append(not abs(estimate.value - true[symbol]) <= SURE * estimate.stderr)  # of an unknown error as well
            label += f", {deviations[-1]:+.2f} % from the simulated value"
        numbers.append((f"{estimate.value:.4g} {estimate.unit}", label))
    if deviations:  # of no friction there is no torque of which it would be a share
        averaged = f"rms error between the friction line and the averaged {drives(design.motion)}"
        numbers.append((f"{swept.rms_percent:.2f} %", averaged))
    done = (
        f"The drive {design.name} was simulated with its sampled controllers: a speed sweep of {len(swept.levels)} "
        f"levels gives its friction, a motion of {duration:.3g} s its inertia and friction by regression."
    )
    line = tuple(block for block in swept.section().blocks if isinstance(block, Picture))[:1]
    if not deviations:
        verdict = (
            "The design states no Coulomb or viscous friction: identify finds it from a log, or init takes that of the "
            "data sheet. What the sweep returns is the noise of the simulation."
        )
        return Headline(done, verdict, None, tuple(numbers), line)
    worst = max(map(abs, deviations))
    verdict = f"The sweep returns the simulated friction within {worst:.2f} %"
    if worst <= ACCEPTED_PERCENT:
        return Headline(done, f"{verdict} (accepted: {ACCEPTED_PERCENT:g} %).", True, tuple(numbers), line)
    verdict = f"The sweep misses the simulated friction by up to {worst:.2f} % (accepted: {ACCEPTED_PERCENT:g} %)"
    if any(sure):
        verdict += ": more than the noise of the simulation explains."
    else:
        verdict += ": the noise of the simulation explains this."
    return Headline(done, verdict, False if any(sure) else None, tuple(numbers), line)


def of_result(result: Result) -> Headline | None:
    """Return the first screen of a page on one result; None where it has none.

    Parameters
    ----------
    result : Result

    Returns
    -------
    Headline or None
    """
    if isinstance(result, Diagnosis):
        return of_diagnosis(result)
    return of_compensation(result) if isinstance(result, CompensationStudy) else None


def of_compensation(found: CompensationStudy) -> Headline:
    """Take what compensation gains and up to which gain it is safe, and the pictures of a reversal and a circle.

    Parameters
    ----------
    found : CompensationStudy

    Returns
    -------
    Headline
    """
    done = f"The axis {found.design.name} was simulated at low speed with and without friction compensation."
    verdict = next(block for block in found.section().blocks if isinstance(block, str))
    best = found.recommendation
    if best is None:
        gain = ("none", f"recommended gain: {why_none(found.verdict)}; changes below are at a gain of 100 %")
        variant, meant = Variant.ALL, "at a gain of 100 %, which is not recommended"
        meant += "" if found.resolved_motions() else " and below what the encoder resolves"
    else:
        chosen = best.compensation
        by = "of the disturbance observer" if chosen.source == "observer" else f"with {chosen.source}-speed feedforward"
        window = found.windows["reference" if chosen.source == "adaptive" else chosen.source]
        gain = (percent(best.gain, 0), f"recommended gain {by}; safe up to {safe_gain(window)}, the sweep ends at "
                f"{percent(float(window.gains[-1]), 0)}")  # fmt: skip
        variant, meant = Variant.RECOMMENDED, "at the recommended gain"
    rms, peak = (f"{100 * found.change(variant, metric):+.0f} %" for metric in ("rms", "reversal_peak"))
    if not found.resolved_motions():  # as in the tables
        rms, peak = f"({rms})", f"({peak})"
    numbers = (
        gain,
        (rms,
         f"change of the rms position error at reversals {meant}, parameters right, the worst of the speeds"),
        (peak, "the same of the peak error after a reversal"),
    )  # fmt: skip
    good = found.accepted if found.verdicts else None
    return Headline(done, verdict, good, numbers, compensation_pictures(found))


def of_diagnosis(found: Diagnosis, comparison: Comparison | None = None) -> Headline:
    """Take the verdict of a diagnosis, the errors before and after it, and the pictures of both.

    Parameters
    ----------
    found : Diagnosis
    comparison : Comparison, optional
        Of the same logs: where it finds that something is left, the diagnosis alone does not call the design sound.

    Returns
    -------
    Headline
    """
    fitted = [one for one in found.records if not one.held_out]
    name = Path(found.log_name).name if len(fitted) == 1 else f"{len(fitted)} records"
    seconds, rate = sum(one.duration for one in fitted), min(one.rate for one in fitted)
    done = f"The axis {found.design.name} was diagnosed from {name}, {seconds:.3g} s at {rate:.4g} Hz"
    done += f"; {found.holdout_name} was held out" if found.holdout_name else ""
    same = any(notice.code == HOLDOUT_IS_LOG.code for notice in found.notices)
    done += ", which is the same data and validates nothing." if same else "."
    verdict = f"{verdict_text(found)}."
    if found.reasons:
        verdict = next(block for block in found.section().blocks if isinstance(block, str))
    good: bool | None = None
    if found.verdict is Verdict.CONSISTENT:
        good = comparison is None or comparison.verdict is Verdict.CONSISTENT or None
        if good is None and comparison is not None:
            verdict = f"No effect was named, but the comparison is not clean: {comparison.reasons[0].text}."
    elif found.verdict is Verdict.IMPLAUSIBLE:
        good = False
    verdict = verdict[0].upper() + verdict[1:]
    return Headline(done, verdict, good, _errors(found), first_pictures(found))


def _errors(found: Diagnosis) -> tuple[tuple[str, str], ...]:
    """Return three errors, each with its definition."""
    kind = found.record.drive
    before, after, floor = (percent(found.errors[k]["torque"]["relative"]) for k in ("nominal", "final", "noise_floor"))
    numbers = [
        (before, f"{kind} error of the design as given: rms of measured less predicted, by the rms of the measured"),
        (after, f"the same with the {'effects that were found' if found.steps else 'parameters refitted'}"),
    ]
    if found.steps and "torque" in found.steps[-1].holdout_after:
        held = found.steps[-1].holdout_after["torque"]["relative"]
        fitted = "nothing was fitted" if not found.level_refitted else "the level of the friction alone was fitted"
        numbers.append((percent(held), f"the same on held-out records, to which {fitted}"))
    else:
        numbers.append((floor, "noise floor: the error that noise alone leaves"))
    return tuple(numbers)
