"""Would the diagnosis raise an alarm at its own answer? The accepted model, simulated and diagnosed again.

The model with everything that was accepted repeats the log's experiment with the design's sensors, and goes through the
same sampling and processing. Whatever is then named is a false alarm, since nothing is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.log import Log

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.diagnose.diagnosis import Diagnosis
    from pmsm_ctrl.identify.replay import Replay

__all__ = ["Calibration", "calibrated", "repeated"]

# Share of alarms, in simulations, from which the answer is doubted.
TRUSTED = 0.05


@dataclass(frozen=True)
class Calibration:
    """False alarms of the diagnosis at the accepted model, simulated through the log's own experiment.

    Attributes
    ----------
    runs : int
    alarms : tuple of str
        What was named, or the verdict, one a run that was not ``consistent``.
    """

    runs: int
    alarms: tuple[str, ...]

    @property
    def most(self) -> float:
        """Upper end of the 95 % interval of the false-alarm rate. Source: Clopper and Pearson, Biometrika 26 (1934)."""
        from scipy.special import betaincinv

        k = len(self.alarms)
        return 1.0 if k >= self.runs else float(betaincinv(k + 1, self.runs - k, 0.975 if k else 0.95))

    def sentence(self) -> str:
        """Say it in words."""
        text = f"of {self.runs} simulations of the accepted model {len(self.alarms)} raised an alarm"
        if self.alarms:
            text += f" ({', '.join(sorted(set(self.alarms)))})"
        return f"{text}: a false-alarm rate of at most {100.0 * self.most:.0f} % on this motion, at 95 % confidence"

    @property
    def doubt(self) -> str:
        """Why not to trust the answer; empty when nothing speaks against it."""
        if len(self.alarms) <= TRUSTED * self.runs:
            return ""
        return f"the diagnosis is not calibrated on this motion: {self.sentence()}"


def repeated(model: Design, log: Log) -> Replay:
    """Return the log's experiment, to be run on the model.

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
    found: Diagnosis, log: Log, runs: int, candidates: Iterable[str] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Calibration:  # fmt: skip
    """Simulate the accepted model `runs` times with fresh noise and diagnose each.

    Raises
    ------
    LogError, DesignError
        As `repeated`.
    """
    from pmsm_ctrl.diagnose.diagnosis import diagnose
    from pmsm_ctrl.regression.signals import logged_torque
    from pmsm_ctrl.simulate.run import simulate

    offered = tuple(candidates) if candidates is not None else None
    model = found.design
    replay = repeated(model, log)
    plant = model.replace(sensor={"log_divider": replay.divider})
    alarms = []
    for seed in range(runs):
        again = simulate(replay.controller, replay.scenario, truth=plant, seed=seed)
        kept = {name: values for name, values in again.channels.items() if name in log}
        if "torque" in log:
            kept["torque"] = logged_torque(model, again.channels)
        result = diagnose(model, Log(kept, again.motion), candidates=offered, plan=False)
        if result.verdict not in ("consistent", "not_excited"):
            alarms.append(result.steps[0].effect if result.steps else result.verdict)
        if progress is not None:
            progress((seed + 1) / runs)
    return Calibration(runs, tuple(alarms))
