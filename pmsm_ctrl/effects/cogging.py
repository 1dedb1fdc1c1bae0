"""Cogging torque: the magnets' pull on the slots, without any current."""

from __future__ import annotations

from math import cos, inf, sin

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(theta: float, a_s: float, a_c: float, order: float) -> float:
    """a_s sin(order theta) + a_c cos(order theta), that is A_k sin(k theta + phi_k)."""
    return a_s * sin(order * theta) + a_c * cos(order * theta)


effect = Effect(
    id="cogging",
    title="Cogging torque",
    equation=r"A_k\,\sin(k\theta + \varphi_k)",
    source="Z. Q. Zhu, D. Howe, IEEE Trans. Energy Convers. 15 (2000) 407",
    enters="torque",
    parameters=(
        Parameter("a_s", "N m", 0.0, -inf, inf, "sine part, A_k cos(phi_k)", linear=True),
        Parameter("a_c", "N m", 0.0, -inf, inf, "cosine part, A_k sin(phi_k)", linear=True),
        Parameter("order", "1", 24.0, 1.0, 1000.0, "mechanical order k, found from the data"),
    ),
    term=term,
    example={"a_s": 0.005, "a_c": 0.002, "order": 24.0},
    needs="at least one slow turn, slow enough that order times speed stays below half the logging rate",
    look_alikes={
        "torque_ripple": "at constant current an order that both can have is the same",
        "unbalance": "with order 1 they are the same",
    },
    validated="simulated logs, LAAS MN4004",
)
