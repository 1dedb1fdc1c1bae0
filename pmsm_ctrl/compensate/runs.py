"""One run of a trial: the plant, the drive with the compensation it has, what came out, in logs and in numbers."""

from __future__ import annotations

from pmsm_ctrl.compensate.adaptive import simulate_adaptive
from pmsm_ctrl.compensate.metrics import Metrics, measure, measure_contour
from pmsm_ctrl.compensate.motions import Trial
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import simulate

__all__ = ["judge", "run_trial"]


def run_trial(believed: Design, trial: Trial, *, truth: Design | None = None, seed: int = 0) -> tuple[Log, ...]:
    """Simulate a trial as the design says, its tracker in the loop where the source is "adaptive".

    Parameters
    ----------
    believed : Design
        What the controller believes.
    truth : Design, optional
        The plant, before the trial changes it; `believed` when left out.
    seed : int
        Seed of the first axis' noise; the next has the next.

    Returns
    -------
    tuple of Log
        One an axis, with the truth.
    """
    plant = trial.plant(truth if truth is not None else believed)
    adaptive = believed.compensation.source == "adaptive" and believed.compensation.gain > 0.0
    logs = []
    for axis, motion in enumerate(trial.motions):
        if adaptive:
            log = simulate_adaptive(believed, motion, truth=plant, seed=seed + axis).log
        else:
            log = simulate(believed, motion, truth=plant, seed=seed + axis, keep_truth=True)
        logs.append(log)
    return tuple(logs)


def judge(trial: Trial, logs: tuple[Log, ...]) -> Metrics:
    """Return the metrics of a trial from the logs of its axes."""
    return measure_contour(logs[0], logs[1], trial.radius) if trial.radius > 0.0 else measure(logs[0])
