"""Whether the position of a log has another zero than what the design has over the position: cogging, an unbalance."""

from __future__ import annotations

from pmsm_ctrl.compare.notices import OTHER_ZERO_THAN_DESIGN
from pmsm_ctrl.design import Design
from pmsm_ctrl.regression.angle_zero import turned_by
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.one_axis import zero_of_design
from pmsm_ctrl.regression.prediction import Prediction, predict
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["other_zero"]


def other_zero(design: Design, record: Record, prediction: Prediction) -> Notice | None:
    """Return that the waves of the design fit a log with something added to its position; None where they do not.

    It is said, and nothing is moved: the waves of the axis may as well be others than those of the design.

    Parameters
    ----------
    design : Design
    record : Record
    prediction : Prediction
        Of the record by the design.
    """
    found = zero_of_design(design, record)
    if found is None:
        return None
    turned = predict(design, turned_by(record, (found,) * max(len(record.records), 1)))
    before, after = (100.0 * one.torque_error[1] for one in (prediction, turned))
    if after >= before:
        return None
    unit = axis_unit("rad", record.prepared.motion)
    return OTHER_ZERO_THAN_DESIGN(shift=found[0], unit=unit, before=before, after=after)
