"""Linear motors with windings: one like those of machine tools, and others drawn at random, all with own numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.tune.tuning import tune

__all__ = ["COUNTS", "LinearMotor", "linear_motor"]

COUNTS = 1_000_000  # of the encoder in a metre: 1 um


@dataclass(frozen=True)
class LinearMotor:
    """A tuned design, and what its data sheet says of the motor.

    Attributes
    ----------
    design : Design
    fastest : float
        Speed at which the EMF meets the voltage limit, m/s.
    strongest : float
        Acceleration at the current limit, m/s^2.
    F_c, F_v : float
        N, N s/m.
    """

    design: Design
    fastest: float
    strongest: float
    F_c: float
    F_v: float


@cache
def linear_motor(seed: int = 0) -> LinearMotor:
    """Return the motor of a machine tool (28 kg, 85 N/A peak, pole pitch 16 mm), or one drawn at random."""
    rng = np.random.default_rng(seed)
    mass, K_t, u_dc, strongest, pitch = 28.0, 85.0, 560.0, 60.0, 0.016
    if seed:
        mass, K_t = 10.0 ** rng.uniform(0.0, 1.7), 10.0 ** rng.uniform(1.2, 2.2)
        u_dc, strongest, pitch = rng.choice([320.0, 560.0]), rng.uniform(10.0, 80.0), rng.uniform(0.01, 0.03)
    p, i_max = math.pi / pitch, strongest * mass / K_t
    # in star a phase has u_dc / sqrt(3) at most, and its EMF is K_t / 1.5 times the speed
    fastest = u_dc / math.sqrt(3.0) * 1.5 / K_t
    F_c, F_v = 0.0131 * strongest * mass, 0.153 * strongest * mass / fastest
    design = Design.from_dict({
        "name": "slide", "motion": "linear",
        "motor": {"p": p, "psi_f": K_t / (1.5 * p), "R": 2e-4 * K_t**2, "L_d": 1e-6 * K_t**2, "L_q": 1e-6 * K_t**2,
                  "J": mass},
        "drive": {"u_dc": float(u_dc), "i_max": i_max, "f_control": 8000.0, "speed_divider": 2},
        "sensor": {"encoder_counts": COUNTS, "current_noise": 5e-4 * i_max, "speed_filter": 5e-4},
        "effects": [{"id": "coulomb", "F_c": F_c}, {"id": "viscous", "F_v": F_v}],
    })  # fmt: skip
    return LinearMotor(tune(design, prove=False).design, fastest, strongest, F_c, F_v)
