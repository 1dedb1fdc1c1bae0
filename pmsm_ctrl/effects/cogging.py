"""Cogging torque: the magnets' pull on the slots, without any current."""

from __future__ import annotations

from math import cos, inf, sin

import numpy as np

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView, Search
from pmsm_ctrl.kernels import kernel

# Mechanical orders that are looked at, and how many of them are tried.
HIGHEST, TRIED = 600, 6


@kernel
def term(theta: float, a_s: float, a_c: float, order: float) -> float:
    """a_s sin(order theta) + a_c cos(order theta), that is A_k sin(k theta + phi_k)."""
    return a_s * sin(order * theta) + a_c * cos(order * theta)


def search(log: LogView) -> Search:
    """Return the mechanical orders that stand out most; the first one is called unbalance."""
    score = log.orders(HIGHEST)
    best = np.argsort(score)[::-1][:TRIED]
    shapes = tuple({"order": float(k + 1)} for k in best if k > 0 and score[k] > 0.0)
    if not shapes:
        return Search((), 1, "no motion is slow and long enough to see two periods of an order above the first")
    return Search(shapes, max(int(np.sum(score > 0.0)), 1))


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
    search=search,
    order="order",
    repeated=True,
    lowest_order=12,
    example={"a_s": 0.005, "a_c": 0.002, "order": 24.0},
    needs="at least one slow turn, slow enough that order times speed stays below half the logging rate",
    look_alikes={
        "torque_ripple": "at constant current an order that both can have is the same",
        "unbalance": "with order 1 they are the same",
        "current_offset": "with the order of the pole pairs they are the same",
    },
    validated="simulated logs, LAAS MN4004",
)
