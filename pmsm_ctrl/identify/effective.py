"""Whether identified parameters describe a log, or only stand for what the design lacks."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.identify import notices as words
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.drive_timing import LATENESS, SURE, Sampling
from pmsm_ctrl.regression.model import FIXED
from pmsm_ctrl.regression.prediction import predict
from pmsm_ctrl.residuals import policy
from pmsm_ctrl.residuals.predicted import structures, traces_of
from pmsm_ctrl.section import Notice

__all__ = ["effective_only"]


def _too_late(found: Design, record: Record, sampling: Sampling) -> float | None:
    """Return by how much the drive signal is late, s, where sampling surely cannot make it; None where it can."""
    undone = 0.0 if record.sampling_stated else record.timing.late  # what is stated is no lag
    if record.age is not None or undone + sampling.late < (1.0 - FIXED) * record.sampling:
        return None
    value, stderr = base_fit(found, record, settled=False).value(LATENESS)
    late = undone + value
    return late if late - record.sampling > SURE * stderr else None


def effective_only(found: Design, record: Record, log: Log, sampling: Sampling) -> Notice | None:
    """Return what says that identified values are effective ones; None where the rest looks like noise.

    The residual of the torque is judged as `compare` judges it: by the curves of what it may depend on, in its own
    correlated noise, and by its noise floor; but for edges and reversals, which a fit weighs lightly.

    Parameters
    ----------
    found : Design
        With the identified values.
    record : Record
        The log, made ready.
    log : Log
    sampling : Sampling
        How the drive signal was sampled, as it was found.
    """
    if (late := _too_late(found, record, sampling)) is not None:
        return words.EFFECTIVE_BY_DELAY(quantity=record.drive, late=1e3 * late, most=1e3 * record.sampling)
    prediction = predict(found, record)
    structure = structures(prediction, log, found.J, ("torque",), policy.SOUND)["torque"]
    residual = traces_of(prediction)["torque"].residual[structure.mask]
    rms = float(np.sqrt(np.mean(residual**2)))
    seen = [one.coordinate for one in structure.named]
    if seen or structure.offset_significant:
        names = ", ".join((*seen, *(["a constant"] if structure.offset_significant else [])))
        explained = 100.0 * (sum(one.added for one in structure.named) or structure.offset_share)
        return words.EFFECTIVE_VALUES(explained=explained, names=names)
    if structure.floor > 0.0 and rms > policy.ABOVE_FLOOR * structure.floor:
        return words.EFFECTIVE_BY_FLOOR(ratio=rms / structure.floor)
    return None
