"""Coulomb friction: a constant torque against the motion, and any smaller torque at standstill."""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(direction: float, F_c: float) -> float:
    """F_c sgn(omega); at standstill the simulation calls it with the direction of impending motion."""
    return F_c * direction


effect = Effect(
    id="coulomb",
    title="Coulomb friction",
    equation=r"F_c\,\mathrm{sgn}(\omega)",
    source="C. A. Coulomb 1785; B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994) 1083",
    enters="torque",
    parameters=(Parameter("F_c", "N m", 0.0, 0.0, inf, "Coulomb friction torque", linear=True),),
    term=term,
    example={"F_c": 0.0213},
    needs="motion in both directions, or two speeds in one direction",
    look_alikes={
        "viscous": "at a single speed only the sum of F_c and F_v omega shows",
        "constant_load": "in one direction of motion both are a constant",
    },
    validated="simulated logs, the reference paper's table, EMPS",
)
