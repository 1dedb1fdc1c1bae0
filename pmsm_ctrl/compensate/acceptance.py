"""Acceptance: a design's ``[[acceptance]]`` lines, each a trial, a metric and a limit, run as the drive would."""

from __future__ import annotations

from dataclasses import dataclass

from pmsm_ctrl.compensate.metrics import CHANGE, UNITS
from pmsm_ctrl.compensate.motions import named_trial
from pmsm_ctrl.compensate.runs import judge, off_by, run_trial
from pmsm_ctrl.design import Acceptance, Design
from pmsm_ctrl.errors import DesignError, RequestError, nearest
from pmsm_ctrl.log import Log
from pmsm_ctrl.units import axis_unit

__all__ = ["METRICS", "Verdict", "accept", "require_known"]

# Metrics by name with their units for a shaft; NAME_change is the change against no compensation, -0.8 being -80 %.
METRICS = UNITS | {f"{name}_change": "1" for name in CHANGE}


@dataclass(frozen=True, eq=False)
class Verdict:
    """What became of one line of the acceptance.

    Attributes
    ----------
    design : Design
    wanted : Acceptance
    value : float
        The metric, in `unit`.
    unit : str
    found, reference : float
        What a change is made of: the metric with the compensation and with its gain at 0.
    with_it, without : tuple of Log
        Logs of the axes with the compensation and with its gain at 0.
    """

    design: Design
    wanted: Acceptance
    value: float
    unit: str
    found: float
    reference: float
    with_it: tuple[Log, ...]
    without: tuple[Log, ...]

    @property
    def passed(self) -> bool:
        """Whether the metric is within its limit; a number that is not finite is not."""
        return self.value <= self.wanted.limit


def require_known(design: Design, wanted: Acceptance) -> None:
    """Refuse a line of the acceptance whose metric or scenario does not exist, before anything runs.

    Parameters
    ----------
    design : Design
    wanted : Acceptance

    Raises
    ------
    RequestError
    """
    if wanted.metric not in METRICS:
        raise RequestError(
            f"unknown metric '{wanted.metric}'{nearest(wanted.metric, METRICS)} (known: {', '.join(METRICS)})"
        )
    named_trial(design, wanted.scenario)


def accept(design: Design, wanted: Acceptance, *, seed: int = 0) -> Verdict:
    """Run one line of a design's acceptance.

    The drive runs as the design says, its compensation included; the plant is the design. With a factor the
    compensated parameters are off by it, the plant's are not.

    Parameters
    ----------
    design : Design
    wanted : Acceptance
    seed : int
        Of the measurement noise.

    Returns
    -------
    Verdict

    Raises
    ------
    RequestError
        When the scenario or the metric does not exist.
    DesignError
        When the design cannot be simulated, or a change is asked of a design without compensation.
    """
    require_known(design, wanted)
    trial = named_trial(design, wanted.scenario)
    chosen = design.compensation
    if wanted.metric.endswith("_change") and chosen.share == 0.0:
        raise DesignError(
            f"{design.source or design.name}: compensation.gain: found 0; '{wanted.metric}' compares with no "
            "compensation and needs a gain above 0"
        )
    off = design.model_copy(update={"compensation": chosen.model_copy(update={"gain": 0.0})})
    believed = off_by(design, wanted.factor)
    with_it = run_trial(believed, trial, truth=design, seed=seed)
    without = with_it if chosen.share == 0.0 else run_trial(off, trial, truth=design, seed=seed)
    name = wanted.metric.removesuffix("_change")
    found, reference = (float(getattr(judge(trial, logs, design.encoder_step), name)) for logs in (with_it, without))
    value = found
    if name != wanted.metric:
        value = found / reference - 1.0 if reference > 0.0 else 0.0
    unit = axis_unit(METRICS[wanted.metric], design.motion)
    return Verdict(design, wanted, value, unit, found, reference, with_it, without)
