"""Whether an axis goes one way, where a constant load and dry friction are one column."""

from __future__ import annotations

from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.direction import LEAST_BACK, share_back

__all__ = ["goes_one_way", "share_gone_back"]


def share_gone_back(record: Record) -> float:
    """Return the smaller one of the two ways that an axis goes in the samples that count, as a share of both.

    Parameters
    ----------
    record : Record
    """
    return share_back(record.at_grid(record.signals["omega"])[record.mask])


def goes_one_way(record: Record) -> bool:
    """Return whether an axis hardly goes back: in the time between two records it may.

    Parameters
    ----------
    record : Record
    """
    return share_gone_back(record) <= LEAST_BACK
