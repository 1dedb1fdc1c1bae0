"""Drives drawn at random, on which the window of the gain is checked."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.design import Design


def random_drive(design: Design, rng: np.random.Generator) -> Design:
    """Return a drive with other inertia, friction and encoder, its speed loop scaled with the inertia."""
    J = 9e-5 * 10.0 ** rng.uniform(-0.3, 1.0)
    F_c = 0.0213 * 10.0 ** rng.uniform(-0.5, 0.5)
    assert design.loops is not None
    speed = {"K_p": 0.0274 * J / 9e-5 * rng.uniform(0.6, 1.2), "T_n": 0.0127 * rng.uniform(0.8, 3.0)}
    changed = design.with_parameters(J=J).replace(
        sensor={"encoder_counts": int(2 ** rng.integers(13, 21))},
        loops={"speed": speed, "position": {"K_v": rng.uniform(10.0, 40.0), "acceleration_feedforward": 1.0}},
    )
    return (
        changed.with_effect("coulomb", {"F_c": F_c})
        .with_effect("viscous", {"F_v": 0.000168 * 10.0 ** rng.uniform(-0.5, 0.5)})
        .with_effect("stribeck", {"dF_s": F_c * rng.uniform(0.0, 0.8), "w_s": rng.uniform(0.5, 5.0), "delta": 2.0})
    )
