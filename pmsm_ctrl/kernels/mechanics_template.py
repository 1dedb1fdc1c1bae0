"""The axis alone, driven by a torque that was logged. `simulate.mechanics` completes it.

`simulate.mechanics` puts the drive's own torque balance, Runge-Kutta step and set-valued friction of `drive_template`
before this, with the logged torque in the place of the electromagnetic one.
"""

# mypy: ignore-errors

from pmsm_ctrl.kernels import kernel
from pmsm_ctrl.kernels.drive_template import runge_kutta, step_dry, step_smooth  # noqa: F401  # <drive>


@kernel
def run(inputs, starts, memory, period, steps, p, J, effects, measured, gains, out):
    """Simulate stretches of a log from the states given at their starts, and leave those of their ends in `memory`.

    `inputs` are torque, load torque, i_d and i_q at every sample, straight in between; `starts` the first samples, one
    row of `memory` each; `out` takes speed and position at every sample, shape (stretches, samples, 2). Behind every
    sample speed and position are corrected by `gains` times what the `measured` position is beside the simulated one.
    A correction is no travel: noise of the angle would unload a bristle at every sample.
    """
    # <parameters>
    h = period / steps
    for stretch in range(len(starts)):
        first, states = starts[stretch], memory[stretch]
        y = (0.0, 0.0, states[2], states[3])  # <load states>
        # <load memory>
        out[stretch, 0, 0], out[stretch, 0, 1] = y[2], y[3]
        for n in range(out.shape[1] - 1):
            k = first + n
            t = k * period
            for m in range(steps):
                x = (m + 0.5) / steps
                torque = inputs[0, k] + x * (inputs[0, k + 1] - inputs[0, k])
                load = inputs[1, k] + x * (inputs[1, k + 1] - inputs[1, k])
                i_d = inputs[2, k] + x * (inputs[2, k + 1] - inputs[2, k])
                i_q = inputs[3, k] + x * (inputs[3, k + 1] - inputs[3, k])
                y = (i_d, i_q) + y[2:]  # noqa: RUF005 - the compiler knows no star here
                machine = (torque, 1.0, 1.0, p, 0.0, J)
                held = (0.0, 0.0, 0.0, load)
                # <held>
                # <load at rest>
                y = step_smooth(y, t + m * h, h, held, machine, effects)  # <step>
                # <load landed>
            out[stretch, n + 1, 0], out[stretch, n + 1, 1] = y[2], y[3]
            apart = measured[k + 1] - y[3]
            y = y[:2] + (y[2] + gains[0] * apart, y[3] + gains[1] * apart) + y[4:]  # noqa: RUF005 - as above
        states[2], states[3] = y[2], y[3]  # <store states>
        # <store memory>
