"""Stribeck friction: the extra torque at low speed that vanishes as the lubricating film builds up."""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, inf

import numpy as np

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView
from pmsm_ctrl.kernels import kernel

# Friction that falls with speed, where a film carries to a tenth of that at rest: the coefficients are 0.1 to 0.15 at
# the boundary, and 0.01 and less on a film (R. Stribeck, as below). What rises from standstill is no Stribeck friction
# but a bristle, or a lag.
FALLING = (0.0, 10.0)


@kernel
def term(omega: float, direction: float, dF_s: float, w_s: float, delta: float) -> float:
    """dF_s exp(-abs(omega / w_s)^delta) sgn(omega), with dF_s = F_s - F_c."""
    return dF_s * exp(-(abs(omega / w_s) ** delta)) * direction


def search(log: LogView) -> Iterator[dict[str, float]]:
    """Yield Stribeck speeds from 0.3 to 40 % of the log's top speed, Gaussian and exponential."""
    for w_s in np.geomspace(0.003, 0.4, 9) * log.top_speed:
        for delta in (1.0, 2.0):
            yield {"w_s": float(w_s), "delta": delta}


effect = Effect(
    id="stribeck",
    title="Stribeck friction",
    equation=r"(F_s - F_c)\,e^{-|\omega/\omega_s|^{\delta}}\,\mathrm{sgn}(\omega)",
    source="R. Stribeck, Z. VDI 46 (1902) 1341; L. C. Bo, D. Pavelescu, Wear 82 (1982) 277",
    enters="torque",
    parameters=(
        Parameter(
            "dF_s",
            "N m",
            0.0,
            0.0,
            inf,
            "breakaway above Coulomb torque",
            linear=True,
            shares_of_F_c=FALLING,
        ),
        Parameter("w_s", "rad/s", 5.0, 1e-9, inf, "Stribeck speed"),
        Parameter("delta", "1", 2.0, 0.3, 4.0, "shape: 2 is Gaussian, 1 exponential", soft=True),
    ),
    term=term,
    search=search,
    bends_over="w_s",
    example={"dF_s": 0.01, "w_s": 5.0, "delta": 2.0},
    needs="steady motion at several speeds below and around the Stribeck speed, both directions best",
    look_alikes={
        "coulomb": "if all speeds lie below or all far above the Stribeck speed it is a constant",
        "presliding": "just around reversals both bend the friction curve",
        "viscous_power": "a sub-linear drag rises as steeply at low speed",
    },
)
