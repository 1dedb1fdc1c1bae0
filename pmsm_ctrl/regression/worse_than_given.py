"""Whether a fitted design is worse on its own log than the given one; then the given one is kept."""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.notices import WORSE_THAN_GIVEN
from pmsm_ctrl.regression.prediction import predict
from pmsm_ctrl.section import Notice

__all__ = ["torque_error", "worse_by_error", "worse_than_given"]

# Error over that of the given design from which on a design is worse: by less two fits of one log differ that weigh
# reversals differently.
WORSE = 1.02


def worse_by_error(found: float, given: float) -> Notice | None:
    """Return what is to be said where a fitted design is worse than the given one; None where it is not.

    Parameters
    ----------
    found, given : float
        Relative errors of the torque of either, of the same samples.
    """
    return WORSE_THAN_GIVEN(percent=100.0 * found, given=100.0 * given) if found > WORSE * given else None


def torque_error(design: Design, record: Record) -> tuple[float, float]:
    """Return rms and relative error of the torque that a design predicts of a record, as `compare` gives it.

    Parameters
    ----------
    design : Design
    record : Record
    """
    return predict(design, record).torque_error


def worse_than_given(given: Design, found: Design, record: Record) -> Notice | None:
    """Return the same for two designs and the record that one was fitted to, each with the sampling that suits it best.

    Parameters
    ----------
    given, found : Design
    record : Record
    """
    return worse_by_error(torque_error(found, record)[1], torque_error(given, record)[1])
