"""The sampled drive: PMSM, inverter, encoder and cascade controller. A template that `simulate.compose` completes.

It is ordinary Python with marks: a comment ``# <name>`` on a line of its own is replaced by the lines of the active
effects; at the end of a line, it marks a line that they replace. Without effects the marks do nothing, so that an
effect that is off costs nothing. Every name that an effect's lines may use is a local here.

The voltage is constant in the stator frame for one control period while the rotor turns; the plant sees it through
the angle between the two, which is small, hence the polynomial.
"""

# mypy: ignore-errors

from math import isfinite

from pmsm_ctrl.kernels import inlined, kernel
from pmsm_ctrl.kernels.balance import torque_em, voltage_d, voltage_q
from pmsm_ctrl.kernels.control import control_memory, current_control, keep_control_memory, noisy, record, settings
from pmsm_ctrl.kernels.rotation import cos_small, quantise, sin_small

# <imports>


@inlined
def drive_torque(y, machine):
    """Electromagnetic torque in N m."""
    return torque_em(machine[3], machine[4], machine[1], machine[2], y[0], y[1])  # <drive torque>


@inlined
def shaft_torque(y, t, direction, held, machine, effects):
    """Accelerating torque of the shaft in N m."""
    i_d, i_q, omega, theta = y[0], y[1], y[2], y[3]  # noqa: F841 - an effect may read them
    R, L_d, L_q, p, psi_f, J = machine
    # <parameters>
    # <states>
    torque = drive_torque(y, machine)
    opposing = held[3]  # <coupling>
    # <bristle>
    # <torque>
    # <behind>
    return torque - opposing


@inlined
def derivative(y, t, direction, held, machine, effects):
    """Time derivatives of the states; with dry friction, direction 0 holds the shaft."""
    i_d, i_q, omega, theta = y[0], y[1], y[2], y[3]
    R, L_d, L_q, p, psi_f, J = machine
    # <parameters>
    # <states>
    angle = held[2] - p * theta
    c, s = cos_small(angle), sin_small(angle)
    u_d = c * held[0] - s * held[1]
    u_q = s * held[0] + c * held[1]
    di_d, di_q = 0.0, 0.0
    # <voltage>
    di_d = (u_d - voltage_d(R, L_d, L_q, p, i_d, i_q, 0.0, omega)) * (1.0 / L_d)  # <direct current>
    di_q = (u_q - voltage_q(R, L_d, L_q, p, psi_f, i_d, i_q, 0.0, omega)) * (1.0 / L_q)  # <incremental inductance>
    domega = shaft_torque(y, t, direction, held, machine, effects) * (1.0 / J)  # <acceleration>
    # <load>
    # <hold>
    return di_d, di_q, domega, omega  # <rates>


@inlined
def advance(y, h, k):
    """Return y + h k for the tuple of states."""
    return y[0] + h * k[0], y[1] + h * k[1], y[2] + h * k[2], y[3] + h * k[3]  # <advance>


@inlined
def runge_kutta(y, t, h, direction, held, machine, effects):
    """One classical Runge-Kutta step with the direction of dry friction held."""
    a = derivative(y, t, direction, held, machine, effects)
    b = derivative(advance(y, 0.5 * h, a), t + 0.5 * h, direction, held, machine, effects)
    c = derivative(advance(y, 0.5 * h, b), t + 0.5 * h, direction, held, machine, effects)
    d = derivative(advance(y, h, c), t + h, direction, held, machine, effects)
    y = advance(y, h / 6.0, a)
    y = advance(y, h / 3.0, b)
    y = advance(y, h / 3.0, c)
    return advance(y, h / 6.0, d)


@inlined
def impending(y, t, held, machine, effects):
    """Direction in which a shaft at rest starts to move: 1, -1, or 0 while friction holds it."""
    if shaft_torque(y, t, 1.0, held, machine, effects) > 0.0:
        return 1.0
    if shaft_torque(y, t, -1.0, held, machine, effects) < 0.0:
        return -1.0
    return 0.0


@inlined
def step_dry(y, t, h, held, machine, effects):
    """One plant step with set-valued friction: where the speed meets zero the step is split, and rest is exact."""
    # One call of runge_kutta for all cases: it is inlined here, and compiled once.
    done, trial = 0.0, h
    direction, undecided, landing = 0.0, True, False
    for _ in range(16):
        if undecided:
            if y[2] > 0.0:
                direction = 1.0
            elif y[2] < 0.0:
                direction = -1.0
            else:
                direction = impending(y, t + done, held, machine, effects)
        new = runge_kutta(y, t + done, trial, direction, held, machine, effects)
        if landing:
            new = (new[0], new[1], 0.0, new[3])  # <landed>
        elif direction * new[2] < 0.0:
            undecided = False
            if y[2] == 0.0:
                # The torque that started this step reverses inside it: rest until the next one.
                direction = 0.0
            else:
                trial *= y[2] / (y[2] - new[2])
                landing = True
            continue
        y = new
        done += trial
        if done >= h * (1.0 - 1e-12):
            break
        trial = h - done
        undecided, landing = True, False
    return y


@inlined
def step_smooth(y, t, h, held, machine, effects):
    """One plant step without dry friction."""
    return runge_kutta(y, t, h, 0.0, held, machine, effects)


@inlined
def measure(y, p, counts, sensed):
    """Measured angle, and the currents in the frame of that angle."""
    i_d, i_q, omega, theta = y
    # <measurement parameters>
    theta_m = quantise(theta, counts)  # <encoder>
    angle = p * (theta - theta_m)
    c, s = cos_small(angle), sin_small(angle)
    i_d_m = c * i_d - s * i_q
    i_q_m = s * i_d + c * i_q
    # <measure current>
    return theta_m, i_d_m, i_q_m


@inlined
def speed_control(gains, memory, theta_m, reference, T_s):
    """Position P and speed PI with feedforward: return the new memory and the current reference.

    The memory is the integrator, the last angle, the filtered speed and the filtered reference; a disturbance
    observer adds its filter and the last current reference.
    """
    K_s, b_s, a_speed, a_ref = gains[4], gains[5], gains[6], gains[7]
    K_v, k_omega, k_alpha, i_max = gains[8], gains[9], gains[10], gains[11]
    I_s, theta_last, omega_hat, omega_filtered = memory  # <speed memory>
    omega_hat += a_speed * ((theta_m - theta_last) / T_s - omega_hat)
    omega_filtered += a_ref * (k_omega * reference[1] - omega_filtered)
    omega_ref = omega_filtered
    if K_v > 0.0:
        omega_ref += K_v * (reference[0] - theta_m)
    e = omega_ref - omega_hat
    wanted = K_s * e + I_s + k_alpha * reference[2] + reference[3]
    # <compensation>
    # <filters>
    i_q_ref = min(max(wanted, -i_max), i_max)
    # Anti-windup: the part cut off by the limit is fed back.
    I_s += b_s * (K_s * e + i_q_ref - wanted)
    return (I_s, theta_m, omega_hat, omega_filtered), i_q_ref  # <speed result>


@kernel
def run(n, k, states, plant, controller, effects, inputs, out, noise):
    """Run `n` control periods from tick `k`; fill `out` with logged rows and leave the state in `states`.

    Returns the rows written, or ``-1 - tick`` when a state stops being finite.
    """
    machine, (u_dc, T, counts, current_noise), (steps, divider, log_divider, delay) = settings(plant)
    p = machine[3]
    # <parameters>
    sensed = ()  # <sensed>
    y = (states[0], states[1], states[2], states[3])  # <load states>
    integrators, i_ref, ahead = control_memory(states)
    speed_memory = (states[6], states[7], states[8], states[14])  # <load speed memory>
    # <load memory>
    h = T / steps
    row = 0
    # Counters, because a division of integers takes as long as half a Runge-Kutta stage.
    to_speed, to_log = -k % divider, -k % log_divider
    j = -1 if to_speed == 0 else 0
    for _ in range(n):
        t = k * T
        seen = y[:4]
        theta_m, i_d_m, i_q_m = measure(seen, p, counts, sensed)
        i_m = noisy(i_d_m, i_q_m, current_noise, noise)
        # <delay line>
        if to_speed == 0:
            to_speed = divider
            j += 1
            speed_memory, i_q_ref = speed_control(controller, speed_memory, theta_m, inputs[j], T * divider)
            i_ref = (inputs[j, 4], i_q_ref)
        omega_hat = speed_memory[2]
        angle = p * (theta_m + (delay + 0.5) * T * omega_hat)
        integrators, u = current_control(controller, integrators, i_ref, i_m, p * omega_hat, angle, u_dc)
        if to_log == 0:
            to_log = log_divider
            if not (isfinite(y[0]) and isfinite(y[1]) and isfinite(y[2])):
                return -1 - k
            record(out[row], t, seen, theta_m, omega_hat, i_m, i_ref, u, inputs[j])
            # <log current>
            # <log>
            row += 1
        if delay == 1:
            u, ahead = ahead, u
        held = (u[0], u[1], u[2], inputs[j, 5])
        # <held>
        for m in range(steps):
            # <load at rest>
            y = step_smooth(y, t + m * h, h, held, machine, effects)  # <step>
            # <load landed>
        k += 1
        to_speed -= 1
        to_log -= 1

    states[0], states[1], states[2], states[3] = y[0], y[1], y[2], y[3]  # <store states>
    states[6], states[7], states[8], states[14] = speed_memory  # <store speed memory>
    keep_control_memory(states, integrators, i_ref, ahead)
    # <store memory>
    return row
