"""What no effect changes: the current controller and a row of the log. Compiled once for all combinations."""

# mypy: ignore-errors

from pmsm_ctrl.kernels import inlined, kernel
from pmsm_ctrl.kernels.rotation import hexagon_scale

__all__ = ["current_control", "integrate", "record", "voltage_demand"]


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
def current_control(gains, I_d, I_q, i_ref, i_m, omega_e, angle, u_dc):
    """The current controller inside the voltage hexagon: return the integrators and the voltage."""
    u_d, u_q = voltage_demand(gains, I_d, I_q, i_ref, i_m, omega_e)
    scale = hexagon_scale(u_d, u_q, angle, u_dc)
    I_d, I_q = integrate(gains, I_d, I_q, i_ref, i_m, u_d, u_q, scale)
    return I_d, I_q, u_d * scale, u_q * scale


@inlined
def record(row, t, y, theta_m, omega_hat, i_m, i_ref, u_d, u_q, reference):
    """Write one row of the log."""
    row[0], row[1], row[2] = t, theta_m, omega_hat
    row[3], row[4] = i_m
    row[5], row[6] = i_ref
    row[7], row[8] = u_d, u_q
    row[9], row[10], row[11] = reference[1], reference[0], reference[5]
    row[12], row[13] = y[3], y[2]
