"""Torque ripple: harmonics of the flux make torque proportional to current vary with electrical angle."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, sin

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView
from pmsm_ctrl.kernels import kernel


@kernel
def term(theta: float, torque: float, p: float, r_s: float, r_c: float, order: float) -> float:
    """-T (r_s sin(n p theta) + r_c cos(n p theta)): the share of the torque that is missing at this angle."""
    return -torque * (r_s * sin(order * p * theta) + r_c * cos(order * p * theta))


def search(log: LogView) -> Iterator[dict[str, float]]:
    """Yield the electrical orders that machines and sensors make."""
    for order in (1.0, 2.0, 6.0, 12.0):
        yield {"order": order}


effect = Effect(
    id="torque_ripple",
    title="Torque ripple",
    equation=r"-T_{em}\,r_n\sin(n p \theta + \varphi_n)",
    source="T. M. Jahns, W. L. Soong, IEEE Trans. Ind. Electron. 43 (1996) 321",
    enters="torque",
    parameters=(
        Parameter("r_s", "1", 0.0, -0.5, 0.5, "sine part of the relative ripple", linear=True),
        Parameter("r_c", "1", 0.0, -0.5, 0.5, "cosine part of the relative ripple", linear=True),
        Parameter("order", "1", 6.0, 1.0, 48.0, "electrical order n: 6 and 12 from the flux, 1 and 2 from sensors"),
    ),
    term=term,
    search=search,
    order="order",
    repeated=True,
    example={"r_s": 0.03, "r_c": 0.01, "order": 6.0},
    needs="slow turns at clearly different torques",
    look_alikes={
        "cogging": "at constant current an order that both can have is the same",
        "current_offset": "its torque error is the first electrical order",
        "current_gain": "its torque error is the second electrical order",
        "dead_time": "its current distortion makes the sixth electrical order",
    },
)
