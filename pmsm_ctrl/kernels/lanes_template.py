"""Drives side by side: the control period of `drive_template` for LANES drives at once. `simulate.lanes` completes it.

`simulate.lanes` replaces the drive's `run` by this one: measurement, controllers, torque balance and Runge-Kutta step
are the same functions. Every quantity is a row of LANES numbers in one flat array, and every loop over the lanes is
straight code, which LLVM turns into vector instructions. Rare branches (the voltage limit outside the inscribed
circle, a speed that meets zero inside a step) are counted in those loops and then computed drive by drive by the
functions of the scalar kernel.
"""

# mypy: ignore-errors

from math import isfinite

from pmsm_ctrl.kernels import inlined, kernel
from pmsm_ctrl.kernels.control import integrate, record, voltage_demand
from pmsm_ctrl.kernels.drive_template import measure, runge_kutta, shaft_torque, speed_control, step_dry  # <drive>
from pmsm_ctrl.kernels.rotation import hexagon_scale

LANES = 16
# First row of each group in the flat array, times LANES.
MACHINE = 15 * LANES  # after the states, in the scalar kernel's order
U_DC, CURRENT_NOISE = MACHINE + 6 * LANES, MACHINE + 9 * LANES
GAINS = MACHINE + 10 * LANES
THETA_M, I_D_M, I_Q_M, U_D, U_Q, ANGLE = (GAINS + n * LANES for n in range(15, 21))
SCALE, HELD, BEFORE, CROSSED = GAINS + 21 * LANES, GAINS + 22 * LANES, GAINS + 25 * LANES, GAINS + 29 * LANES
INPUTS = GAINS + 30 * LANES
EFFECTS = INPUTS + 6 * LANES  # <rows>


@inlined
def gains_of(x, l):
    """The controller of lane `l`."""
    return (
        x[GAINS + l], x[GAINS + 1 * LANES + l], x[GAINS + 2 * LANES + l], x[GAINS + 3 * LANES + l],
        x[GAINS + 4 * LANES + l], x[GAINS + 5 * LANES + l], x[GAINS + 6 * LANES + l], x[GAINS + 7 * LANES + l],
        x[GAINS + 8 * LANES + l], x[GAINS + 9 * LANES + l], x[GAINS + 10 * LANES + l], x[GAINS + 11 * LANES + l],
        x[GAINS + 12 * LANES + l], x[GAINS + 13 * LANES + l], x[GAINS + 14 * LANES + l],
    )  # fmt: skip


@inlined
def machine_of(x, l):
    """The machine of lane `l`."""
    return (
        x[MACHINE + l], x[MACHINE + 1 * LANES + l], x[MACHINE + 2 * LANES + l], x[MACHINE + 3 * LANES + l],
        x[MACHINE + 4 * LANES + l], x[MACHINE + 5 * LANES + l],
    )  # fmt: skip


@inlined
def four(x, row, l):
    """Four rows from `row` on, of lane `l`."""
    return x[row + l], x[row + LANES + l], x[row + 2 * LANES + l], x[row + 3 * LANES + l]


@inlined
def reference_of(x, l):
    """The references of lane `l`."""
    return x[INPUTS + l], x[INPUTS + LANES + l]  # <reference>


@inlined
def effects_of(x, l):
    """The parameters of the effects of lane `l`."""
    return (x[EFFECTS + l],)  # <effects>


@kernel
def measure_all(x, counts, noise, j):
    """Measured angle and currents of all lanes; row `j` of `noise` is that of the two currents."""
    for l in range(LANES):
        y, p = four(x, 0, l), x[MACHINE + 3 * LANES + l]
        theta_m, i_d_m, i_q_m = measure(y, p, counts, ())  # <measure>
        x[THETA_M + l] = theta_m
        x[I_D_M + l] = i_d_m + x[CURRENT_NOISE + l] * noise[j, 0, l]
        x[I_Q_M + l] = i_q_m + x[CURRENT_NOISE + l] * noise[j, 1, l]


@kernel
def speed_all(x, inputs, j, T_s):
    """The speed and position controllers of all lanes, with row `j` of the references."""
    shared = inputs.shape[2] == 1
    for c in range(inputs.shape[1]):
        for l in range(LANES):
            x[INPUTS + c * LANES + l] = inputs[j, c, 0 if shared else l]
    for l in range(LANES):
        memory = (x[6 * LANES + l], x[7 * LANES + l], x[8 * LANES + l], x[14 * LANES + l])
        memory, i_q_ref = speed_control(gains_of(x, l), memory, x[THETA_M + l], reference_of(x, l), T_s)
        x[6 * LANES + l], x[7 * LANES + l], x[8 * LANES + l], x[14 * LANES + l] = memory
        x[9 * LANES + l] = i_q_ref
        x[10 * LANES + l] = x[INPUTS + 4 * LANES + l]


@kernel
def current_all(x, T, delay):
    """The current controllers of all lanes; sets the voltage of this period and the next one."""
    outside = 0
    for l in range(LANES):
        i_ref, i_m = (x[10 * LANES + l], x[9 * LANES + l]), (x[I_D_M + l], x[I_Q_M + l])
        p, omega_hat = x[MACHINE + 3 * LANES + l], x[8 * LANES + l]
        u_d, u_q = voltage_demand(gains_of(x, l), x[4 * LANES + l], x[5 * LANES + l], i_ref, i_m, p * omega_hat)
        x[ANGLE + l] = p * (x[THETA_M + l] + (delay + 0.5) * T * omega_hat)
        x[U_D + l], x[U_Q + l], x[SCALE + l] = u_d, u_q, 1.0
        outside += 1 if 3.0 * (u_d * u_d + u_q * u_q) > x[U_DC + l] * x[U_DC + l] else 0
    if outside > 0:
        for l in range(LANES):
            x[SCALE + l] = hexagon_scale(x[U_D + l], x[U_Q + l], x[ANGLE + l], x[U_DC + l])
    for l in range(LANES):
        i_ref, i_m = (x[10 * LANES + l], x[9 * LANES + l]), (x[I_D_M + l], x[I_Q_M + l])
        u_d, u_q, scale = x[U_D + l], x[U_Q + l], x[SCALE + l]
        I_d, I_q = integrate(gains_of(x, l), x[4 * LANES + l], x[5 * LANES + l], i_ref, i_m, u_d, u_q, scale)
        x[4 * LANES + l], x[5 * LANES + l] = I_d, I_q
        x[U_D + l], x[U_Q + l] = u_d * scale, u_q * scale
        last_d, last_q, last_angle = x[11 * LANES + l], x[12 * LANES + l], x[13 * LANES + l]
        x[11 * LANES + l], x[12 * LANES + l], x[13 * LANES + l] = x[U_D + l], x[U_Q + l], x[ANGLE + l]
        x[HELD + l] = last_d if delay == 1 else x[U_D + l]
        x[HELD + LANES + l] = last_q if delay == 1 else x[U_Q + l]
        x[HELD + 2 * LANES + l] = last_angle if delay == 1 else x[ANGLE + l]


@inlined
def held_of(x, l):
    """Voltage and angle held in this period, and the load torque, of lane `l`."""
    return x[HELD + l], x[HELD + LANES + l], x[HELD + 2 * LANES + l], x[INPUTS + 5 * LANES + l]


@inlined
def direction_of(y, t, held, machine, effects):
    """Direction of dry friction: of the motion, of the impending motion, or 0 while friction holds the shaft.

    All cases are computed and one is selected: a branch would prevent vector instructions.
    """
    forward = shaft_torque(y, t, 1.0, held, machine, effects)
    backward = shaft_torque(y, t, -1.0, held, machine, effects)
    impending = 1.0 if forward > 0.0 else (-1.0 if backward < 0.0 else 0.0)
    return 1.0 if y[2] > 0.0 else (-1.0 if y[2] < 0.0 else impending)


@kernel
def step_all(x, t, h):
    """One plant step of all lanes; those whose speed meets zero inside it take the scalar kernel's split step."""
    crossed = 0
    for l in range(LANES):
        y, held, machine, effects = four(x, 0, l), held_of(x, l), machine_of(x, l), effects_of(x, l)
        direction = 0.0  # <direction>
        new = runge_kutta(y, t, h, direction, held, machine, effects)
        x[BEFORE + l], x[BEFORE + LANES + l], x[BEFORE + 2 * LANES + l], x[BEFORE + 3 * LANES + l] = y
        x[l], x[LANES + l], x[2 * LANES + l], x[3 * LANES + l] = new
        x[CROSSED + l] = direction * new[2]
        crossed += 1 if direction * new[2] < 0.0 else 0
    if crossed > 0:
        for l in range(LANES):
            if x[CROSSED + l] < 0.0:
                y = step_dry(four(x, BEFORE, l), t, h, held_of(x, l), machine_of(x, l), effects_of(x, l))
                x[l], x[LANES + l], x[2 * LANES + l], x[3 * LANES + l] = y


@kernel
def record_all(x, rows, t):
    """Write one row of every lane's log; return False when a state is not finite."""
    fine = True
    for l in range(LANES):
        y = four(x, 0, l)
        fine = fine and isfinite(y[0]) and isfinite(y[1]) and isfinite(y[2])
        i_ref, i_m = (x[10 * LANES + l], x[9 * LANES + l]), (x[I_D_M + l], x[I_Q_M + l])
        reference = reference_of(x, l)
        record(rows[l], t, y, x[THETA_M + l], x[8 * LANES + l], i_m, i_ref, (x[U_D + l], x[U_Q + l]), reference)
    return fine


@kernel
def run(n, k, x, timing, inputs, noise, out):
    """Run `n` control periods of all lanes from tick `k`; rows of `inputs` and `noise` begin there.

    Returns the rows written, or -1 when a state stops being finite.
    """
    T, counts = timing[0], timing[1]
    steps, divider, log_divider, delay = int(timing[2]), int(timing[3]), int(timing[4]), int(timing[5])
    quiet = noise.shape[0] == 1
    h = T / steps
    row = 0
    to_speed, to_log = -k % divider, -k % log_divider
    j = -1 if to_speed == 0 else 0
    for m in range(n):
        t = k * T
        measure_all(x, counts, noise, 0 if quiet else m)
        if to_speed == 0:
            to_speed = divider
            j += 1
            speed_all(x, inputs, j, T * divider)
        current_all(x, T, delay)
        if to_log == 0:
            to_log = log_divider
            if not record_all(x, out[row], t):
                return -1
            row += 1
        for i in range(steps):
            step_all(x, t + i * h, h)
        k += 1
        to_speed -= 1
        to_log -= 1
    return row
