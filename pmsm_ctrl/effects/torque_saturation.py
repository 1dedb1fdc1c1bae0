"""Saturation of the torque constant: at large current the iron gives less torque per ampere."""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(torque: float, i_q: float, k_s: float) -> float:
    """k_s abs(i_q) T: the torque missing against the unsaturated constant."""
    return k_s * abs(i_q) * torque


effect = Effect(
    id="torque_saturation",
    title="Saturation of the torque constant",
    equation=r"k_s\,|i_q|\,T_{em}",
    source="B. Stumberger et al., IEEE Trans. Ind. Appl. 39 (2003) 1264",
    enters="torque",
    parameters=(
        Parameter("k_s", "1/A", 0.0, 0.0, inf, "relative loss of the torque constant per ampere", linear=True),
    ),
    term=term,
    example={"k_s": 0.04},
    needs="accelerations at small and at large current",
    look_alikes={
        "load_dependent_friction": "both take away a share of large torques; driving and braking tell them apart"
    },
)
