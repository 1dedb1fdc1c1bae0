"""
Friction from two records, and what is missing
==============================================

Two records of one axis: parameters are fitted to the first one, and the second one, of which nothing is fitted, judges
them. The axis has an effect that the design does not know.
"""

# %%
# **The records.** Here they are simulated, with a cogging torque hidden in the plant; yours come from
# ``read_log("record.csv", design)``.

from pmsm_ctrl import Design, compare, diagnose, identify, simulate
from pmsm_ctrl.simulate import scenario

design = Design.example("seed_motor")
cogging = {"a_s": 0.004, "a_c": 0.003, "order": 24.0}
truth = design.with_parameters(J=0.97 * design.J).with_effect("cogging", cogging)
motion = scenario("identification", design, duration=10.0)
first, second = (simulate(design, motion, truth=truth, seed=seed) for seed in (1, 2))

# %%
# **Friction and inertia.** The result says whether to trust it before it says the numbers.

friction = identify(design, [first, second])
friction

# %%
# **Where the model fails**: the torque that is left, over speed, position and acceleration.

failed = compare(friction.design, second)
failed

# %%
# **What is missing**, and how the error falls on both records.

found = diagnose(design, first, holdout=second)
found

# %%
# `found.design` holds the effect with its parameters and their errors, and is the start of a compensator.

print([entry.id for entry in found.design.effects])
