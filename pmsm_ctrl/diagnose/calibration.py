"""False-alarm rate at the accepted model: it is simulated through the experiment of the log, and diagnosed again.

The model with everything that was accepted repeats the log's experiment with the design's sensors, and goes through the
same sampling and processing. Whatever is then named is a false alarm, since nothing is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from pmsm_ctrl.diagnose.result import Calibration, Diagnosis, Verdict
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.log import Log

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.identify.replay import Replay

__all__ = ["calibrated", "replay_of"]

QUIET = (Verdict.CONSISTENT, Verdict.INCONCLUSIVE, Verdict.NOT_EXCITED)


def replay_of(model: Design, log: Log) -> Replay:
    """Return the log's experiment, to be run on the model.

    Parameters
    ----------
    model : Design
    log : Log

    Raises
    ------
    LogError, DesignError
        When the log has no reference, or the design no loops, electrical data or sensor noise: the drive cannot be
        simulated as it was logged.
    """
    from pmsm_ctrl.identify.replay import build_replay

    if model.sensor.current_noise <= 0.0 and model.sensor.encoder_counts <= 0:
        raise DesignError(
            f"{model.source or model.name}: calibration simulates the design's sensors; give sensor.current_noise or "
            "sensor.encoder_counts"
        )
    return build_replay(model, log)


def calibrated(
    model: Design, log: Log, runs: int, diagnose: Callable[[Log], Diagnosis], progress: Callable[[float], None]
) -> Calibration:
    """Simulate the accepted model with fresh noise and diagnose each run.

    Parameters
    ----------
    model : Design
    log : Log
        Whose experiment is repeated.
    runs : int
    diagnose : function
        Diagnoses one simulated log by the model.
    progress : function
        Called with the share done, 0 to 1.

    Raises
    ------
    LogError, DesignError
        As `replay_of`.
    """
    from pmsm_ctrl.regression.signals import logged_torque
    from pmsm_ctrl.simulate.run import simulate

    replay = replay_of(model, log)
    plant = model.replace(sensor={"log_divider": replay.divider})
    alarms = []
    for seed in range(runs):
        again = simulate(replay.controller, replay.scenario, truth=plant, seed=seed)
        kept = {name: values for name, values in again.channels.items() if name in log}
        if "torque" in log:
            kept["torque"] = logged_torque(model, again.channels)
        found = diagnose(Log(kept, again.motion))
        if found.verdict not in QUIET:
            alarms.append(found.steps[0].effect if found.steps else found.verdict.value)
        progress((seed + 1) / runs)
    return Calibration(runs, tuple(alarms))
