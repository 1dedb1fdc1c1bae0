"""The first screen of a study: what was done, the verdict, and the numbers that matter most."""

from __future__ import annotations

from collections.abc import Sequence

from pmsm_ctrl.compare import Comparison
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import Diagnosis, Verdict
from pmsm_ctrl.identify import SweepResult
from pmsm_ctrl.log import Log
from pmsm_ctrl.report.result import Headline
from pmsm_ctrl.units import drives

__all__ = ["of_diagnosis", "of_simulation"]

ACCEPTED_PERCENT = 1.0  # deviation of the reference experiment that its noise and quantisation allow


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
    numbers, deviations = [], []
    for symbol, estimate in swept.estimates.items():
        label = f"{symbol} from the sweep"
        if true.get(symbol):
            deviations.append(100.0 * (estimate.value / true[symbol] - 1.0))
            label += f", {deviations[-1]:+.2f} % from the simulated value"
        numbers.append((f"{estimate.value:.4g} {estimate.unit}", label))
    numbers.append((f"{swept.rms_percent:.2f} %", "rms error between the friction line and the averaged torque"))
    done = (
        f"The drive {design.name} was simulated with its sampled controllers: a speed sweep of {len(swept.levels)} "
        f"levels gives its friction, a motion of {duration:.3g} s its inertia and friction by regression."
    )
    if not deviations:
        verdict = "The design has no Coulomb or viscous friction to compare the sweep with."
        return Headline(done, verdict, None, tuple(numbers))
    worst = max(map(abs, deviations))
    verdict = f"The sweep returns the simulated friction within {worst:.2f} % (accepted: {ACCEPTED_PERCENT:g} %)."
    return Headline(done, verdict, worst <= ACCEPTED_PERCENT, tuple(numbers))


def of_diagnosis(design: Design, logs: Sequence[Log], found: Diagnosis, comparison: Comparison) -> Headline:
    """Take the verdict of a diagnosis, and the errors before and after it.

    Parameters
    ----------
    design : Design
    logs : sequence of Log
    found : Diagnosis
    comparison : Comparison
        Of the same logs: where it finds that something is left, the diagnosis alone does not call the design sound.

    Returns
    -------
    Headline
    """
    plain = found.to_dict()
    name = logs[0].provenance.file or "a given log"
    if len(logs) > 1:
        name = f"{len(logs)} logs"
    seconds, rate = sum(log.duration for log in logs), min(log.rate for log in logs)
    done = f"The axis {design.name} was diagnosed from {name}, {seconds:.3g} s at {rate:.4g} Hz."
    before, after = (100.0 * plain["errors"][rung]["torque"]["relative"] for rung in ("nominal", "final"))
    verdict = next(block for block in found.section().blocks if isinstance(block, str))
    count = len(plain["steps"])
    numbers = (
        (f"{before:.2f} %", f"relative {drives(design.motion)} error of the design as given"),
        (f"{after:.2f} %", "relative error with the effects that were found"),
        (f"{count}", f"missing effect{'' if count == 1 else 's'}"),
    )
    good: bool | None = None
    if found.verdict is Verdict.CONSISTENT:
        good = comparison.verdict is Verdict.CONSISTENT or None
        if good is None:
            verdict = f"No effect was named, but the comparison is not clean: {comparison.reasons[0].text}."
    elif found.verdict is Verdict.IMPLAUSIBLE:
        good = False
    return Headline(done, verdict, good, numbers)
