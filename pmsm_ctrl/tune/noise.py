"""Effect of sensor noise: current ripple from encoder quantisation and from the current measurement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np

from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.tune.sampled import Cascade, current_loop

__all__ = ["Noise", "h2_norm", "noise"]


def h2_norm(system: Any) -> float:
    """Return the H2 norm of a stable sampled system: rms at the output over rms of white noise at the input.

    By `control.dlyap`. `control.system_norm` returns infinity here, because states that the noise does not reach
    (the pending voltages of the other axis) make the covariance singular.
    """
    from scipy.linalg import matrix_balance

    # Balanced first: states of a large machine differ by so many decades that rounding would dominate.
    balanced, scale = matrix_balance(system.A, permute=False)
    entering, leaving = np.linalg.solve(scale, system.B), system.C @ scale
    covariance = ct.dlyap(balanced, entering @ entering.T)
    return float(np.sqrt(np.trace(leaving @ covariance @ leaving.T + system.D @ system.D.T)))


@dataclass(frozen=True)
class Noise:
    """Predicted noise of a tuned cascade.

    Attributes
    ----------
    encoder_gain : float
        From white angle noise to the current reference (H2 norm), A/rad.
    encoder_ripple : float
        Of i_q_ref, for quantisation as white noise of step/sqrt(12), A rms.
    speed_ripple : float
        Of the *measured* speed for the same, rad/s rms.
    current_gain : float
        From measured to true current (H2 norm).
    current_ripple : float
        Of the true current, from the noise of the current measurement, A rms.
    torque_ripple : float
        Of the true torque, from both, N m rms.
    """

    encoder_gain: float
    encoder_ripple: float
    speed_ripple: float
    current_gain: float
    current_ripple: float
    torque_ripple: float


def noise(cascade: Cascade) -> Noise:
    """Predict the noise of a cascade with its speed loop closed.

    Quantisation is white while the angle crosses many steps per sample or crosses them irregularly; on a slow
    or stationary shaft it is not, and the ripple is a limit cycle of one step instead.
    """
    design = cascade.design
    sigma = design.encoder_step / math.sqrt(12.0)
    closed = cascade.with_gains(position=None)
    by_reference = h2_norm(closed.system(("angle_noise",), ("i_q_ref",)))
    by_speed = h2_norm(closed.system(("angle_noise",), ("omega_hat",)))
    by_current = h2_norm(closed.system(("angle_noise",), ("i_q",)))
    loop = ct.feedback(current_loop(design, cascade.current), 1)
    tracking = h2_norm(loop)
    current = Plant.of(design).current_noise
    return Noise(
        encoder_gain=by_reference,
        encoder_ripple=sigma * by_reference,
        speed_ripple=sigma * by_speed,
        current_gain=tracking,
        current_ripple=current * tracking,
        torque_ripple=design.K_t * math.hypot(sigma * by_current, current * tracking),
    )
