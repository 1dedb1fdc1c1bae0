"""Unbalance, or gravity on the shaft: the first mechanical order."""

from __future__ import annotations

from math import cos, inf, sin

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(theta: float, a_s: float, a_c: float) -> float:
    """a_s sin(theta) + a_c cos(theta), that is A sin(theta + phi)."""
    return a_s * sin(theta) + a_c * cos(theta)


effect = Effect(
    id="unbalance",
    title="Unbalance or gravity",
    equation=r"A\,\sin(\theta + \varphi)",
    source="torque balance of an eccentric mass in a gravity field",
    enters="torque",
    parameters=(
        Parameter("a_s", "N m", 0.0, -inf, inf, "sine part, A cos(phi)", linear=True),
        Parameter("a_c", "N m", 0.0, -inf, inf, "cosine part, A sin(phi)", linear=True),
    ),
    term=term,
    example={"a_s": 0.01, "a_c": 0.004},
    needs="at least one slow turn, in both directions",
    look_alikes={
        "position_dependent_friction": "in one direction of motion both are a first mechanical order",
        "encoder_eccentricity": "at constant speed both are a first mechanical order; this one keeps its size",
        "cogging": "with order 1 they are the same",
    },
)
