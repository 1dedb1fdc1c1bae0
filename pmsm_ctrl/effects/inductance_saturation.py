"""Saturation of the quadrature inductance: the flux grows less than the current."""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(omega: float, p: float, i_q: float, di_q: float, k_L: float) -> tuple[float, float]:
    """Voltage drop of the missing flux psi_q = (L_q - k_L abs(i_q)) i_q: its rotation and its time derivative."""
    return p * omega * k_L * abs(i_q) * i_q, -2.0 * k_L * abs(i_q) * di_q


effect = Effect(
    id="inductance_saturation",
    title="Saturation of the quadrature inductance",
    equation=r"L_q(i_q) = L_q - k_L\,|i_q|",
    source="B. Stumberger et al., IEEE Trans. Ind. Appl. 39 (2003) 1264",
    enters="voltage",
    parameters=(Parameter("k_L", "H/A", 0.0, 0.0, inf, "loss of inductance per ampere", linear=True),),
    term=term,
    example={"k_L": 0.006},
    needs="voltages in the log, and speed together with small and large i_q",
    look_alikes={"L_q": "at one current amplitude it is a smaller inductance"},
)
