"""Encoder eccentricity: the measured angle swings about the true one once per turn."""

from __future__ import annotations

from math import cos, sin

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(theta: float, e_s: float, e_c: float) -> float:
    """Measured less true angle: e_s sin(theta) + e_c cos(theta)."""
    return e_s * sin(theta) + e_c * cos(theta)


effect = Effect(
    id="encoder_eccentricity",
    title="Encoder eccentricity",
    equation=r"\Delta\theta = e_s\sin\theta + e_c\cos\theta",
    source="H. Lu, C. Fan, Measurement 46 (2013) 3146: eccentricity error of grating encoders",
    enters="measurement",
    channels=("theta",),
    parameters=(
        Parameter("e_s", "rad", 0.0, -0.2, 0.2, "sine part of the angle error", linear=True),
        Parameter("e_c", "rad", 0.0, -0.2, 0.2, "cosine part of the angle error", linear=True),
    ),
    term=term,
    example={"e_s": 0.002, "e_c": 0.001},
    needs="turns at clearly different constant speeds: its speed error grows with speed, its torque error with speed^2",
    look_alikes={"unbalance": "at constant speed both are a first mechanical order"},
)
