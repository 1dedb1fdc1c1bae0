"""The log conditioned once more with the effects found so far: conditioned without one, it looks like a second one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.other_bands import without_what_happened_once
from pmsm_ctrl.diagnose.selection import Selection

__all__ = ["conditioned_again"]


def conditioned_again(case: Case, found: Selection, select: Callable[[Case], Selection]) -> tuple[Case, Selection]:
    """Select again on the log conditioned with the first effect, where others were accepted beside it, or with a delay.

    The filter of the drive signal, the band and the weights were found with a model that lacked it, and what they are
    wrong by looks like a second effect; a bristle alone looks like a filter. The moments of reversal were found from a
    torque that a delay makes late. The new answer counts where the effect stands in it as well.

    Parameters
    ----------
    case : Case
    found : Selection
    select : function
        Of a case.

    Returns
    -------
    (Case, Selection)
    """
    usual = case
    first = found.accepted[0].effect if found.steps else None
    if first and (len(found.steps) > 1 or first.structure.replaces_direction) and first.enters != "measurement":
        case, found = _conditioned_with(1, usual, (case, found), select)
    late = next((number for number, one in enumerate(found.accepted, start=1) if one.effect.structure.delays), 0)
    return _conditioned_with(late, usual, (case, found), select) if late else (case, found)


def _conditioned_with(
    number: int, usual: Case, so_far: tuple[Case, Selection], select: Callable[[Case], Selection]
) -> tuple[Case, Selection]:
    """Select again on the log conditioned with this many effects, where that is another one; the last has to stand."""
    case, found = so_far
    if usual.conditioned_with is None:
        return so_far
    last = found.accepted[number - 1].effect
    other = usual.conditioned_with(fitted_design(case.design, found.fits[number]), case)
    now, then = other.record, case.record
    alike = now.timing == then.timing and now.cutoff == then.cutoff and np.allclose(now.weight, then.weight)
    if alike and not last.structure.delays:  # a delay moves the reversals as well
        return so_far
    remarks = tuple(dict.fromkeys((*other.remarks, *case.remarks)))
    other = replace(other, remarks=remarks, minor_too=case.minor_too, surely=case.surely)
    other = without_what_happened_once(other)
    again = select(other)
    names = [(one.effect.id, *step.equivalents) for one, step in zip(again.accepted, again.steps, strict=True)]
    stands = names if last.structure.delays else names[:1]
    return (other, again) if any(last.id in them for them in stands) else so_far
