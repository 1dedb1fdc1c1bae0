"""Stribeck friction: the extra torque at low speed that vanishes as the lubricating film builds up."""

from __future__ import annotations

from math import exp, inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(omega: float, direction: float, dF_s: float, w_s: float, delta: float) -> float:
    """dF_s exp(-abs(omega / w_s)^delta) sgn(omega), with dF_s = F_s - F_c."""
    return dF_s * exp(-(abs(omega / w_s) ** delta)) * direction


effect = Effect(
    id="stribeck",
    title="Stribeck friction",
    equation=r"(F_s - F_c)\,e^{-|\omega/\omega_s|^{\delta}}\,\mathrm{sgn}(\omega)",
    source="R. Stribeck, Z. VDI 46 (1902) 1341; L. C. Bo, D. Pavelescu, Wear 82 (1982) 277",
    enters="torque",
    parameters=(
        Parameter("dF_s", "N m", 0.0, -inf, inf, "breakaway above Coulomb torque; negative: it rises", linear=True),
        Parameter("w_s", "rad/s", 5.0, 1e-9, inf, "Stribeck speed"),
        Parameter("delta", "1", 2.0, 0.3, 4.0, "shape: 2 is Gaussian, 1 exponential"),
    ),
    term=term,
    example={"dF_s": 0.01, "w_s": 5.0, "delta": 2.0},
    needs="steady motion at several speeds below and around the Stribeck speed, both directions best",
    look_alikes={
        "coulomb": "if all speeds lie below or all far above the Stribeck speed it is a constant",
        "presliding": "just around reversals both bend the friction curve",
        "viscous_power": "a sub-linear drag rises as steeply at low speed",
    },
)
