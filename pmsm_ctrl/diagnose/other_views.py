"""Where else an effect is looked for in a log that names none in its usual band: other bands, and minor parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

from pmsm_ctrl.diagnose import notices as words
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.other_bands import hidden_by_noise, in_bands_of_springs, in_narrower_bands, rings_beyond
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.selection import Selection, significant

__all__ = ["View", "other_views"]


@dataclass(frozen=True, eq=False)
class View:
    """The same log in another band, or judged for minor parts.

    Attributes
    ----------
    case : Case
    hidden : function
        Of a selection in it that accepts something: whether the usual band hides the first effect of it.
    """

    case: Case
    hidden: Callable[[Selection], bool]


def other_views(case: Case, found: Selection) -> Iterator[View]:
    """Yield the views in which a candidate may pass that is significant in the usual band, and refused there.

    Parameters
    ----------
    case : Case
        In its usual band.
    found : Selection
        In it. Where it accepts something, there is no other view.
    """
    shown = set() if found.steps else significant(found.fit, case.policy)
    if not shown:
        return
    for other in in_narrower_bands(case):
        yield View(other, lambda again: hidden_by_noise(again.steps[0], shown, found.refused, case.policy))
    for other in in_bands_of_springs(case, found, shown):
        yield View(other, partial(rings_beyond, case.record.cutoff, other))
    if any(why.reason is Reason.MINOR for why in found.refused.values()):
        remarks = (*case.remarks, words.MINOR_PART())
        yield View(replace(case, minor_too=True, remarks=remarks), lambda again: True)
