"""The drive of the third simulator, one loop over the control periods.

Currents by the trapezoidal rule (a Cayley step of the coupled 2 x 2 system), motion by a midpoint rule with friction
that is stopped exactly where the speed crosses zero inside a step. The friction curve, the bristle and the inverter are
written in other forms than the package's own.
"""

from __future__ import annotations

import math

import numba
import numpy as np

# What the plant's vector of hidden physics holds; all zero is a clean drive.
HIDDEN = (
    "stribeck", "stribeck_speed", "stribeck_lorentz", "viscous_asymmetry", "constant_load", "drag_gain", "drag_power",
    "load_friction", "position_friction", "position_phase", "warm_share", "warm_time", "wave", "wave_order",
    "wave_phase", "ripple", "ripple_order", "saturation", "load_inertia", "stiffness", "damping", "gap", "dead_voltage",
    "dead_current", "inductance_drop", "offset_a", "offset_b", "gain_a", "eccentricity", "eccentricity_phase",
    "bristle", "hysteresis", "eddy", "load_dry",
)  # fmt: skip
PLACE = {name: k for k, name in enumerate(HIDDEN)}
# Columns of what a run returns, one row a control period.
COLUMNS = ("theta", "omega", "i_d", "i_q", "u_d", "u_q", "i_q_ref", "omega_ref", "theta_ref")
# What the hidden physics adds, known to the simulator alone: torque, N m, that a rigid axis with dry and viscous
# friction does not have, mean of the period; errors of angle, rad, currents, A, without noise, and voltages, V, mean.
TRUTH = ("torque", "angle", "i_d", "i_q", "u_d", "u_q")


@numba.njit(cache=True)
def friction_level(w, torque, theta, warm, F_c, x):
    """Dry friction while sliding, N m, and what it adds that keeps its sign with the speed."""
    level = F_c * warm + x[7] * abs(torque) + x[8] * math.sin(theta + x[9])
    if x[0] != 0.0:
        r = abs(w) / x[1]
        level += x[0] * (1.0 / (1.0 + r * r) if x[2] > 0.5 else math.exp(-r))
    if x[5] != 0.0:
        level += x[5] * abs(w) ** x[6]
    return max(level + x[31] - x[33], 0.0)


@numba.njit(cache=True)
def run(m, x, ref, sizes, loop, mode, noise, encoder, seed):
    """Simulate; returns an array (control periods, len(COLUMNS) + len(TRUTH)).

    m: R, L_d, L_q, p, psi_f, J, F_c, F_v (p = 0: an axis that is known by its force alone).
    ref: rows of position, speed, acceleration (mode 0, 1) or torque-making current (mode 2), one a control period.
    sizes: control period, substeps, periods per speed loop, computation delay in periods.
    loop: kp_i, ki_i, kp_w, ki_w, kp_x, speed filter time, acceleration feedforward, current limit, kd_x.
    noise: current noise, its colour, ADC step. encoder: counts, line error amplitude, its order, seed of nothing.
    """
    R, L_d, L_q, p, psi, J, F_c, F_v = m
    period, substeps, divider, delay = sizes[0], int(sizes[1]), int(sizes[2]), int(sizes[3])
    kp_i, ki_i, kp_w, ki_w, kp_x, filter_time, forward, i_max, kd_x = loop
    np.random.seed(seed)  # noqa: NPY002 - numba's own generator
    n = ref.shape[0]
    out = np.zeros((n, 15))
    h = period / substeps
    electrical = p > 0
    K_t = 1.5 * p * psi if electrical else psi
    i_d = i_q = w = th = 0.0
    w_l = th_l = z = 0.0
    J_l = x[18]
    J_m = J - J_l
    queue = np.zeros((3, 2))
    I_d = I_q = I_w = 0.0
    i_ref = 0.0
    last_angle = 0.0
    w_hat = 0.0
    c_d = c_q = 0.0
    turn = 1.0
    two_pi = 2.0 * math.pi
    for k in range(n):
        t = k * period
        wrong = x[28] * math.sin(th + x[29]) + encoder[1] * math.sin(encoder[2] * th + 0.3)
        angle = th + wrong
        if encoder[0] > 0:
            angle = math.floor(angle * encoder[0] / two_pi) * two_pi / encoder[0]
        e = p * th
        shift = p * x[28] * math.sin(th + x[29])  # the frame turns with the eccentric angle
        cs, sn = math.cos(shift), math.sin(shift)
        c_d = noise[1] * c_d + math.sqrt(1.0 - noise[1] ** 2) * np.random.normal() * noise[0]  # noqa: NPY002
        c_q = noise[1] * c_q + math.sqrt(1.0 - noise[1] ** 2) * np.random.normal() * noise[0]  # noqa: NPY002
        a_d = i_d + x[25] * math.cos(e) + x[26] * math.sin(e) + c_d
        a_q = i_q - x[25] * math.sin(e) + x[26] * math.cos(e) + c_q
        if x[27] != 0.0:
            alpha = (i_d * math.cos(e) - i_q * math.sin(e)) * x[27]
            a_d += alpha * math.cos(e)
            a_q -= alpha * math.sin(e)
        m_d, m_q = a_d * cs + a_q * sn, a_q * cs - a_d * sn
        if noise[2] > 0.0:
            m_d, m_q = round(m_d / noise[2]) * noise[2], round(m_q / noise[2]) * noise[2]
        if k % divider == 0:
            T_w = divider * period
            raw = (angle - last_angle) / T_w if k > 0 else 0.0
            last_angle = angle
            w_hat += (raw - w_hat) * (T_w / (T_w + filter_time))
            if mode == 2:
                if w > ref[k, 1]:
                    turn = -1.0
                elif w < -ref[k, 1]:
                    turn = 1.0
                i_ref = ref[k, 0] if ref[k, 2] > 0.5 else turn * ref[k, 0]
            else:
                wanted = ref[k, 1] + (kp_x * (ref[k, 0] - angle) if mode == 1 else 0.0)
                error = wanted - w_hat
                i_ref = kp_w * error + I_w + forward * J * ref[k, 2] / K_t
                if mode == 1 and kd_x > 0.0:
                    i_ref += kd_x * (ref[k, 1] - w_hat)
                if abs(i_ref) < i_max:
                    I_w += ki_w * error * T_w
                else:
                    i_ref = math.copysign(i_max, i_ref)
        u_d = u_q = 0.0
        if electrical:
            e_d, e_q = -m_d, i_ref - m_q
            I_d += ki_i * e_d * period
            I_q += ki_i * e_q * period
            u_d = kp_i * e_d + I_d - p * w_hat * L_q * m_q
            u_q = kp_i * e_q + I_q + p * w_hat * (L_d * m_d + psi)
        queue[k % 3, 0], queue[k % 3, 1] = u_d, u_q
        v_d0, v_q0 = queue[(k - delay) % 3, 0], queue[(k - delay) % 3, 1]
        if k < delay:
            v_d0 = v_q0 = 0.0
        row = out[k]
        row[0], row[1], row[2], row[3], row[4], row[5] = angle, w_hat, m_d, m_q, u_d, u_q
        row[6], row[7], row[8] = i_ref, ref[k, 1] if mode != 2 else 0.0, ref[k, 0] if mode == 1 else 0.0
        row[10] = x[28] * math.sin(th + x[29])
        f_d, f_q = a_d - i_d - c_d, a_q - i_q - c_q
        row[11] = (i_d + f_d) * cs + (i_q + f_q) * sn - i_d
        row[12] = (i_q + f_q) * cs - (i_d + f_d) * sn - i_q
        for _ in range(substeps):
            e = p * th
            if electrical:
                v_d, v_q = v_d0 * cs - v_q0 * sn, v_q0 * cs + v_d0 * sn
                if x[22] != 0.0:
                    for phase in range(3):
                        b = e - two_pi * phase / 3.0
                        i_ph = i_d * math.cos(b) - i_q * math.sin(b)
                        drop = x[22] * (2.0 / math.pi) * math.atan(i_ph / x[23]) * 2.0 / 3.0
                        v_d -= drop * math.cos(b)
                        v_q += drop * math.sin(b)
                row[13] += (v_d0 - v_d) / substeps
                row[14] += (v_q0 - v_q) / substeps
                L_now = L_q * (1.0 - 2.0 * x[24] * abs(i_q))
                L_flux = L_q * (1.0 - x[24] * abs(i_q))
                # trapezoidal rule of i' = A i + b over the substep, speed held
                a11, a12, a21, a22 = -R / L_d, p * w * L_flux / L_d, -p * w * L_d / L_now, -R / L_now
                b1, b2 = v_d / L_d, (v_q - p * w * psi) / L_now
                g = 0.5 * h
                r1 = i_d + g * (a11 * i_d + a12 * i_q) + h * b1
                r2 = i_q + g * (a21 * i_d + a22 * i_q) + h * b2
                d11, d12, d21, d22 = 1.0 - g * a11, -g * a12, -g * a21, 1.0 - g * a22
                det = d11 * d22 - d12 * d21
                i_d, i_q = (d22 * r1 - d12 * r2) / det, (d11 * r2 - d21 * r1) / det
                T = 1.5 * p * (psi * i_q + (L_d - L_q) * i_d * i_q)
            else:
                i_q += (i_ref - i_q) * (1.0 - math.exp(-h * kp_i))  # the current loop as a lag of rate kp_i
                T = K_t * i_q
            T_0 = T
            T *= 1.0 - x[17] * abs(i_q)
            if x[15] != 0.0:
                T *= 1.0 + x[15] * math.cos(x[16] * max(p, 1.0) * th + 0.7)
            warm = 1.0 - x[10] * (1.0 - math.exp(-t / x[11])) if x[10] != 0.0 else 1.0
            smooth = (F_v * warm + x[32]) * w + x[3] * abs(w) + x[4] + x[12] * math.sin(x[13] * th + x[14])
            level = friction_level(w, T, th, warm, F_c, x)
            spring = 0.0
            if J_l > 0.0:
                twist = th - th_l
                if x[21] > 0.0:
                    half = 0.5 * x[21]
                    free = abs(twist) <= half
                    twist = 0.0 if free else twist - math.copysign(half, twist)
                    spring = 0.0 if free else x[19] * twist + x[20] * (w - w_l)
                    if spring * twist < 0.0:
                        spring = 0.0
                else:
                    spring = x[19] * twist + x[20] * (w - w_l)
            push = T - smooth - spring
            old = w
            if x[30] > 0.0:  # Dahl's bristle in place of the sign, exact over the travel
                w += h * (push - level * z) / J_m
                travel = 0.5 * h * (old + w)
                s = 1.0 if travel >= 0.0 else -1.0
                z = s - (s - z) * math.exp(-abs(travel) / x[30])
            elif old == 0.0:
                breakaway = friction_level(0.0, T, th, warm, F_c, x)
                if abs(push) > breakaway:
                    w = h * (push - math.copysign(breakaway, push)) / J_m
            else:
                s = 1.0 if old > 0.0 else -1.0
                w = old + h * (push - s * level) / J_m
                if w * s < 0.0:  # stopped inside the step: what is left of it begins at rest
                    rest = h * w / (w - old)
                    breakaway = friction_level(0.0, T, th, warm, F_c, x)
                    w = 0.0
                    if abs(push) > breakaway:
                        w = rest * (push - math.copysign(breakaway, push)) / J_m
            if w * old > 0.0:
                s = 1.0 if w > 0.0 else -1.0
                row[9] += (T_0 - J * (w - old) / h - F_c * s - F_v * old) / substeps
            th += 0.5 * h * (old + w)
            if J_l > 0.0:
                before = w_l
                if before == 0.0:  # held, or torn off
                    w_l = h * (spring - math.copysign(min(x[33], abs(spring)), spring)) / J_l
                else:
                    w_l = before + h * (spring - math.copysign(x[33], before)) / J_l
                    if w_l * before < 0.0 and x[33] > 0.0:
                        rest = h * w_l / (w_l - before)
                        w_l = rest * (spring - math.copysign(min(x[33], abs(spring)), spring)) / J_l
                th_l += 0.5 * h * (before + w_l)
    return out
