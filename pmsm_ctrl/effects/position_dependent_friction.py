"""Friction that varies over the turn: a bent shaft, an eccentric seal, a screw's pitch error."""

from __future__ import annotations

from math import cos, inf, sin

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(theta: float, direction: float, b_s: float, b_c: float) -> float:
    """(b_s sin(theta) + b_c cos(theta)) sgn(omega): F_c a sin(theta + phi) with F_c a = hypot(b_s, b_c)."""
    return (b_s * sin(theta) + b_c * cos(theta)) * direction


effect = Effect(
    id="position_dependent_friction",
    title="Position-dependent friction",
    equation=r"F_c\,a\,\sin(\theta + \varphi)\,\mathrm{sgn}(\omega)",
    source="B. Armstrong, Control of Machines with Friction, Kluwer (1991), ch. 4",
    enters="torque",
    parameters=(
        Parameter("b_s", "N m", 0.0, -inf, inf, "sine part of the variation over one turn", linear=True),
        Parameter("b_c", "N m", 0.0, -inf, inf, "cosine part of the variation over one turn", linear=True),
    ),
    term=term,
    example={"b_s": 0.004, "b_c": 0.002},
    needs="slow turns in both directions",
    look_alikes={"unbalance": "in one direction of motion both are a first mechanical order"},
)
