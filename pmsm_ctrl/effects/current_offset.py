"""Offset of the phase-current sensors: the measured current turns against the rotor, first electrical order."""

from __future__ import annotations

from math import cos, inf, sin

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(theta: float, p: float, o_alpha: float, o_beta: float) -> tuple[float, float]:
    """Measured less true current: the stator-fixed offset in rotor coordinates."""
    c, s = cos(p * theta), sin(p * theta)
    return c * o_alpha + s * o_beta, c * o_beta - s * o_alpha


effect = Effect(
    id="current_offset",
    title="Current sensor offset",
    equation=r"\Delta i_{\alpha\beta} = (o_\alpha, o_\beta)",
    source="D.-W. Chung, S.-K. Sul, IEEE Trans. Ind. Appl. 34 (1998) 1089",
    enters="measurement",
    parameters=(
        Parameter("o_alpha", "A", 0.0, -inf, inf, "offset along phase a", linear=True),
        Parameter("o_beta", "A", 0.0, -inf, inf, "offset across phase a, (i_b - i_c)/sqrt(3)", linear=True),
    ),
    term=term,
    electrical_order=1,
    example={"o_alpha": 0.01, "o_beta": -0.006},
    needs="slow turns, electrical order below half the logging rate",
    look_alikes={
        "torque_ripple": "with order 1 at constant torque they are the same",
        "cogging": "with the order of the pole pairs they are the same",
        "detent_force": "with the period of a pair of poles of a linear motor they are the same",
    },
)
