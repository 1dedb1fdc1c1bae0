"""Noise of one drive drawn beforehand, for drives simulated side by side."""

from __future__ import annotations

from typing import Any

from pmsm_ctrl.kernels import kernel
from pmsm_ctrl.kernels.rotation import normal

__all__ = ["draw"]


@kernel
def draw(rows: Any, lane: int, generator: Any) -> None:
    """Fill ``rows[:, :, lane]`` in the order in which the scalar kernel draws; numpy's own filling takes twice as long.

    Shape of `rows`: (periods, 2, lanes), for i_d and i_q.
    """
    for k in range(rows.shape[0]):
        rows[k, 0, lane] = normal(generator)
        rows[k, 1, lane] = normal(generator)
