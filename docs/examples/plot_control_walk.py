"""
From python-control to the simulated drive
==========================================

You know python-control and have a drive. The toolbox gives the drive's linear model as a ``control.StateSpace``, so
that everything of python-control applies; the gains that come out are then tried on the nonlinear simulation.
"""

# %%
# **The plant.** A design holds the datasheet. `linearise` gives the Jacobian at a speed and a load; the states are the
# currents, the speed and the angle.

import control
import matplotlib.pyplot as plt
import numpy as np

from pmsm_ctrl import Design, simulate
from pmsm_ctrl.simulate import scenario
from pmsm_ctrl.tune import linearise

design = Design.example("seed_motor")
model = linearise(design, speed=50.0)
print(model.states, "friction slope", f"{model.point.friction_slope:.3g} N m s/rad")

# %%
# As a system of python-control: from the q voltage to the speed, and the part that a fast current loop leaves of it,
# the rotor alone, from torque to speed.

names = {"inputs": ["u_d", "u_q", "load"], "outputs": list(model.states)}
drive = control.ss(model.A, model.B, np.eye(4), 0, **names)
voltage_to_speed = drive["omega", "u_q"]
rotor = control.tf([1.0], [design.J, model.point.friction_slope])

# %%
# **A controller of your own.** A PI speed controller by the symmetrical optimum, with the current loop as a lag of half
# a millisecond; the gain is that of the torque, N m/(rad/s).

lag, a = 0.5e-3, 3.0
K_p, T_n = design.J / (a * lag), a**2 * lag
controller = K_p * control.tf([T_n, 1.0], [T_n, 0.0])
loop = controller * control.tf([1.0], [lag, 1.0]) * rotor
loop.name = "speed loop"
gain_margin, phase_margin, _, crossover = control.margin(loop)
print(f"crossover {crossover / (2 * np.pi):.0f} Hz, phase margin {phase_margin:.0f} deg")

control.bode_plot(loop, np.logspace(0, 4, 400), Hz=True, dB=True, display_margins=True)
plt.gcf().set_size_inches(7.0, 5.0)

# %%
# **On the simulated drive**, with its sampling, its encoder, its noise and its friction. The design's gain is in
# A/(rad/s): the torque over the torque constant. Only the speed loop is replaced.

mine = design.replace(loops={"speed": {"K_p": K_p / design.K_t, "T_n": T_n}})
motion = scenario("triangle", design, speed=20.0, period=0.5, cycles=2)

figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7.0, 4.5))
for name, drive_design in (("as designed", design), ("symmetrical optimum", mine)):
    log = simulate(drive_design, motion, seed=1)
    upper.plot(log.t, log["omega"], label=name, lw=1)
    lower.plot(log.t, log["omega"] - log["omega_ref"], lw=1)
upper.plot(log.t, log["omega_ref"], "k--", lw=0.8, label="reference")
upper.set_ylabel("speed [rad/s]")
lower.set_ylabel("error [rad/s]")
lower.set_xlabel("time [s]")
upper.legend(loc="lower right", fontsize=8)
figure.tight_layout()

# %%
# At every reversal the friction changes its sign, and the loop has to find the new torque: that is the peak in the
# error, which no linear model has. :doc:`../compensation` feeds it forward.
