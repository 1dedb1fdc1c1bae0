"""An axis that goes one way and is driven by a load: friction below zero, as it is without the load."""

from __future__ import annotations

from dataclasses import replace

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.regression.notices import DRIVEN_ONE_WAY
from pmsm_ctrl.regression.one_way import goes_one_way
from pmsm_ctrl.regression.timed_record import FRICTION

__all__ = ["driven_one_way"]


def driven_one_way(case: Case) -> Case:
    """Return the case with the dry friction as the design states it, where a load drives an axis that goes one way.

    There a constant load and dry friction are one column. Their sum is surely below zero where a load drives the axis,
    as of a lift that goes down, and no friction is: what it is below the stated friction is a load.

    Parameters
    ----------
    case : Case
    """
    record, name = case.record, FRICTION["coulomb"]
    offered = any(one.both_ways and not one.structure.has_memory for one in case.effects.values())
    if not offered or not goes_one_way(record):
        return case
    fit = case.fit(())
    k = fit.model.names.index(name) if name in fit.model.names else -1
    if k not in fit.estimate.held or fit.model.as_stated(k):
        return case
    if float(fit.plain.values[k]) >= -case.policy.sure_errors * float(fit.plain.stderr[k]):
        return case
    said = DRIVEN_ONE_WAY(parameter=name)
    others = tuple(replace(one, driven=True, memo={}, kept={}) for one in case.holdouts)
    record = replace(record, driven=True, notes=(*record.notes, said), memo={}, kept={})
    return replace(case, record=record, holdouts=others, fits=[], bands={})
