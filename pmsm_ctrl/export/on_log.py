"""What a simulator's joint misses on a log: Coulomb and viscous friction alone, beside the full model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.log import Logs, as_logs, names_of
from pmsm_ctrl.plausibility import doubts_about, with_inertia
from pmsm_ctrl.regression.angle_zero import turned_by
from pmsm_ctrl.regression.balances import STANDSTILL
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.evaluated import record_as_evaluated
from pmsm_ctrl.regression.one_axis import sampled_alike
from pmsm_ctrl.regression.prediction import predict

__all__ = ["LogErrors", "errors_on_log", "joint_design"]


@dataclass(frozen=True)
class LogErrors:
    """Errors of the drive torque over the moving samples of a log, by inverse dynamics as in `compare`.

    Attributes
    ----------
    log : str
    full, joint : float
        Norm of measured less predicted over that of the measured torque: of the design, and of the joint.
    apart : float
        Norm of the difference of both predictions over that of the measured torque.
    """

    log: str
    full: float
    joint: float
    apart: float


def joint_design(design: Design, level: float, slope: float) -> Design:
    """Return the design with the friction of a simulator's joint in place of every effect on the torque.

    Parameters
    ----------
    design : Design
    level : float
        N m (N).
    slope : float
        N m s/rad (N s/m).
    """
    elsewhere = {effect.id for effect, _ in bound_effects(design) if effect.enters != "torque"}
    plain = design.replace_effects(tuple(one for one in design.effects if one.id in elsewhere))
    return plain.with_effect("coulomb", {"F_c": level}).with_effect("viscous", {"F_v": slope})


def errors_on_log(design: Design, logs: Logs, level: float, slope: float) -> LogErrors:
    """Return the torque error of the full model on a log, and that of a joint with level and slope.

    Parameters
    ----------
    design : Design
    logs : Log or sequence of Log
        As for `compare`.
    level, slope : float
        Friction of the joint, N m and N m s/rad (N and N s/m).

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    """
    given = as_logs(logs)
    for one in given:
        one.check_evaluable(100)
    design = with_inertia(design, logs)
    log = doubts_about(design, logs).log
    balances = record_as_evaluated(design, log)
    held = joint_design(design, level, slope)
    # the same samples in the same band, sampled in the same way
    same = Processing(standstill=STANDSTILL, cutoff=balances.cutoff)
    alike = sampled_alike(held, log, same, balances)
    alike = turned_by(alike, balances.shifts) if balances.shifts else alike
    full = predict(design, balances)
    joint = predict(held, alike, full)
    used = balances.mask & alike.mask
    measured = balances.target[0][used]
    size = float(np.linalg.norm(measured))
    left = [float(np.linalg.norm(measured - one.predicted[0][used])) / size for one in (full, joint)]
    apart = float(np.linalg.norm(full.predicted[0][used] - joint.predicted[0][used])) / size
    return LogErrors(names_of(given, "the given log"), left[0], left[1], apart)
