"""The inertia by instruments from the simulated drive beside that of least squares.

Least squares takes a sample of the torque for the mean about it. Behind a reference that is held for a sample of the
log the current answers every step alike, and the log meets that answer at the same place: the samples are off by a
share of the acceleration, which looks like inertia. The log alone does not tell; the simulated drive does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol

from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.identify.notices import INERTIA_BY_INSTRUMENTS, NOT_CONVERGED
from pmsm_ctrl.identify.policy import MOVED
from pmsm_ctrl.regression.least_squares import Fit
from pmsm_ctrl.section import Notice

__all__ = ["Found", "apart", "by_instruments"]


class Found(Protocol):
    """An identification, as far as it is looked at here."""

    @property
    def fit(self) -> Fit:
        """What was solved."""

    @property
    def improved(self) -> bool:
        """Whether the design that was found is better than the given one."""

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Reasons to doubt it."""


def by_instruments(find: Callable[[], Found]) -> Fit | None:
    """Return the fit by instruments; None where there is none that another one could be compared with.

    Parameters
    ----------
    find : function
        Identifies by instruments.
    """
    try:
        found = find()
    except PmsmCtrlError:  # loops that are not stable on this plant, say
        return None
    sound = found.improved and not found.fit.at_bound
    return found.fit if sound and NOT_CONVERGED.code not in {one.code for one in found.notices} else None


def apart(fit: Fit, other: Fit | None, unit: str) -> tuple[Notice, ...]:
    """Return a notice where two inertias differ by more than their intervals, and than their uncertainty together.

    Parameters
    ----------
    fit : Fit
        By least squares.
    other : Fit or None
        By instruments; None where the drive cannot be simulated.
    unit : str
        Of the inertia.
    """
    if other is None or "J" not in fit.values or "J" not in other.values:
        return ()
    own, found = fit.values["J"], other.values["J"]
    (low, high), (lower, upper) = fit.interval("J"), other.interval("J")
    both = math.hypot(fit.stderr["J"], other.stderr["J"])
    if low <= found <= high or lower <= own <= upper or abs(own - found) <= MOVED * both:
        return ()
    percent = 100.0 * (own / found - 1.0)
    stderr, others = fit.stderr["J"], other.stderr["J"]
    return (INERTIA_BY_INSTRUMENTS(value=own, stderr=stderr, other=found, others=others, unit=unit, percent=percent),)
