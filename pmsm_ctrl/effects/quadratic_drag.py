"""Drag with the square of speed: windage, a fan, a stirrer."""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(omega: float, k_2: float) -> float:
    """k_2 omega abs(omega)."""
    return k_2 * omega * abs(omega)


effect = Effect(
    id="quadratic_drag",
    title="Quadratic drag",
    equation=r"k_2\,\omega\,|\omega|",
    source="J. E. Vrancik, Prediction of windage power loss in alternators, NASA TN D-4849 (1968)",
    enters="torque",
    parameters=(Parameter("k_2", "N m s^2/rad^2", 0.0, 0.0, inf, "quadratic drag coefficient", linear=True),),
    term=term,
    example={"k_2": 5e-07},
    needs="steady motion at three or more speeds up to high speed",
    look_alikes={
        "viscous_power": "with n = 2 they are the same",
        "viscous": "over a narrow range of speeds both are a straight line",
    },
)
