"""Friction that rises from standstill: the opposite of Stribeck's, on axes whose lubricant carries from the start."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, tanh

import numpy as np

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView
from pmsm_ctrl.kernels import kernel


@kernel
def term(omega: float, dF_r: float, w_r: float) -> float:
    """dF_r tanh(omega / w_r): nothing at standstill, dF_r above a few w_r."""
    return dF_r * tanh(omega / w_r)


def search(log: LogView) -> Iterator[dict[str, float]]:
    """Yield speeds from 0.3 to 40 % of the log's top speed."""
    for w_r in np.geomspace(0.003, 0.4, 9) * log.top_speed:
        yield {"w_r": float(w_r)}


effect = Effect(
    id="rising_friction",
    title="Friction that rises from standstill",
    equation=r"\Delta F_r\,\tanh(\omega/\omega_r)",
    source="C. Makkar, W. E. Dixon, W. G. Sawyer, G. Hu, Proc. IEEE/ASME AIM 2005, 600",
    enters="torque",
    parameters=(
        Parameter("dF_r", "N m", 0.0, 0.0, inf, "dry friction in motion above that at rest", linear=True),
        Parameter("w_r", "rad/s", 5.0, 1e-9, inf, "speed over which it rises"),
    ),
    term=term,
    search=search,
    bends_over="w_r",
    rounds=True,
    example={"dF_r": 0.01, "w_r": 5.0},
    needs="slow changes of direction, and steady motion at several speeds around the one over which it rises",
    look_alikes={
        "coulomb": "if all speeds lie far above the one over which it rises it is a constant",
        "viscous_power": "a sub-linear drag rises as steeply at low speed",
        "presliding": "just around reversals both round off the step of dry friction",
    },
    validated="simulated logs, EMPS",
)
