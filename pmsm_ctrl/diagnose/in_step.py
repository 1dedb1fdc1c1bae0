"""A torque that was sampled in step with a held position reference: it falls with the speed, as no friction does."""

from __future__ import annotations

from dataclasses import replace

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.base_fit import torque_left
from pmsm_ctrl.regression.filter_profile import LOWERED
from pmsm_ctrl.regression.notices import DRIVEN_ONE_WAY, SAMPLED_IN_STEP
from pmsm_ctrl.regression.sampling_terms import in_step
from pmsm_ctrl.regression.timed_record import FRICTION

__all__ = ["as_found", "sampled_in_step"]


def sampled_in_step(case: Case, fit: Fitted) -> Case | None:
    """Return the case with a part of the torque in proportion to the speed that is no friction; None without need.

    Parameters
    ----------
    case : Case
    fit : Fitted
        Of the design, with nothing named.
    """
    name = FRICTION["viscous"]
    column = fit.model.names.index(name) if name in fit.model.names else -1
    if column not in fit.estimate.held:
        return None
    free, held = (torque_left(fit.record, one) for one in (fit.plain, fit.estimate))
    if not free < LOWERED * held:
        return None
    record = in_step(case.record, name, float(fit.plain.values[column]), float(fit.plain.stderr[column]))
    if record is None:
        return None
    others = tuple(replace(one, in_step=True, memo={}, kept={}) for one in case.holdouts)
    return replace(case, record=record, holdouts=others, fits=[], bands={})


def as_found(record: Record, like: Record) -> Record:
    """Return a record that was conditioned again as one sampled in step, or driven one way, where the first one was.

    Parameters
    ----------
    record, like : Record
    """
    if (record.in_step, record.driven) == (like.in_step, like.driven):
        return record
    found = {SAMPLED_IN_STEP.code, DRIVEN_ONE_WAY.code} - {note.code for note in record.notes}
    notes = (*record.notes, *(note for note in like.notes if note.code in found))
    in_step, driven = record.in_step or like.in_step, record.driven or like.driven
    return replace(record, in_step=in_step, driven=driven, notes=notes, memo={}, kept={})
