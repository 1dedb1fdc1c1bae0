"""What no effect changes: the current controller, its memory, and a row of the log. Compiled once for all combinations.

Every number that is read from an array costs milliseconds to compile, wherever it is inlined.
"""

# mypy: ignore-errors

from pmsm_ctrl.kernels import inlined, kernel
from pmsm_ctrl.kernels.rotation import hexagon_scale, normal

__all__ = [
    "control_memory",
    "current_control",
    "integrate",
    "keep_control_memory",
    "noisy",
    "record",
    "settings",
    "voltage_demand",
]


@inlined
def settings(plant):
    """Return the machine; voltage, period, encoder counts and noise; steps, both dividers and the delay in periods."""
    machine = plant[0], plant[1], plant[2], plant[3], plant[4], plant[5]
    whole = int(plant[10]), int(plant[11]), int(plant[12]), int(plant[13])
    return machine, (plant[6], plant[7], plant[8], plant[9]), whole


@inlined
def control_memory(states):
    """Return integrators and references of the currents, and the voltage and its angle for the next period."""
    return (states[4], states[5]), (states[10], states[9]), (states[11], states[12], states[13])


@inlined
def keep_control_memory(states, integrators, i_ref, ahead):
    """Store what `control_memory` returns."""
    states[4], states[5] = integrators
    states[10], states[9] = i_ref
    states[11], states[12], states[13] = ahead


@inlined
def noisy(i_d, i_q, current_noise, noise):
    """Return the currents with white noise of this standard deviation, A."""
    if current_noise > 0.0:
        i_d += current_noise * normal(noise)
        i_q += current_noise * normal(noise)
    return i_d, i_q


@kernel
def voltage_demand(gains, I_d, I_q, i_ref, i_m, omega_e):
    """PI, decoupling and EMF feedforward, before the voltage limit: return the voltage."""
    # Read where they are used: held in registers through the whole loop they would cost the plant's step 2 %.
    K_d, K_q = gains[0], gains[2]
    L_d_hat, L_q_hat, psi_hat = gains[12], gains[13], gains[14]
    u_d = K_d * (i_ref[0] - i_m[0]) + I_d - omega_e * L_q_hat * i_m[1]
    u_q = K_q * (i_ref[1] - i_m[1]) + I_q + omega_e * (L_d_hat * i_m[0] + psi_hat)
    return u_d, u_q


@kernel
def integrate(gains, I_d, I_q, i_ref, i_m, u_d, u_q, scale):
    """Advance both integrators; what the voltage limit takes away is fed back, so that they never wind up."""
    K_d, b_d, K_q, b_q = gains[0], gains[1], gains[2], gains[3]
    I_d += b_d * (K_d * (i_ref[0] - i_m[0]) + (scale - 1.0) * u_d)
    I_q += b_q * (K_q * (i_ref[1] - i_m[1]) + (scale - 1.0) * u_q)
    return I_d, I_q


@inlined
def current_control(gains, integrators, i_ref, i_m, omega_e, angle, u_dc):
    """The current controller inside the voltage hexagon: return the integrators, and the voltage and its angle."""
    u_d, u_q = voltage_demand(gains, integrators[0], integrators[1], i_ref, i_m, omega_e)
    scale = hexagon_scale(u_d, u_q, angle, u_dc)
    return integrate(gains, integrators[0], integrators[1], i_ref, i_m, u_d, u_q, scale), (
        u_d * scale,
        u_q * scale,
        angle,
    )


@inlined
def record(row, t, y, theta_m, omega_hat, i_m, i_ref, u, reference):
    """Write one row of the log."""
    row[0], row[1], row[2] = t, theta_m, omega_hat
    row[3], row[4] = i_m
    row[5], row[6] = i_ref
    row[7], row[8] = u[0], u[1]
    row[9], row[10], row[11] = reference[1], reference[0], reference[5]
    row[12], row[13] = y[3], y[2]
