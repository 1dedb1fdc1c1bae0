"""Constant load: a torque that keeps its sign whatever the motion."""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(T_0: float) -> float:
    """T_0, positive when it opposes positive motion."""
    return T_0


effect = Effect(
    id="constant_load",
    title="Constant load torque",
    equation=r"T_0",
    source="torque balance; M. Gautier, A. Janot, P. O. Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428",
    enters="torque",
    parameters=(Parameter("T_0", "N m", 0.0, -inf, inf, "constant torque", linear=True),),
    term=term,
    both_ways=True,
    as_sensor="an offset of the current or torque sensor",
    example={"T_0": 0.01},
    needs="motion in both directions",
    look_alikes={"coulomb": "while moving, a Coulomb level that differs by direction is the same"},
    validated="simulated logs, EMPS",
)
