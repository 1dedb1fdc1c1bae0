"""
A compensator that is accepted in CI
====================================

A design can state what its axis has to reach; ``pytest design.toml`` runs it, and a gain that spoils the axis fails the
build of the machine's software.
"""

# %%
# **The acceptance** stands in the design's own file.

import matplotlib.pyplot as plt

from pmsm_ctrl import Design
from pmsm_ctrl.compensate import baseline, compensated, measure, run_trial, study_trials

design = Design.example("low_speed")
for limit in design.acceptance[:4]:
    print(f"{limit.scenario}: {limit.metric} <= {limit.limit:g}")

# %%
# **What the feedforward does** at a slow reversal, without and with the friction of the design fed forward.

base, trial = baseline(design), study_trials(design)["reversal 2 rad/s"]
friction = [entry.id for entry in design.effects]
believed = {"without": base, " + ".join(friction): compensated(base, friction)}
figure, axes = plt.subplots(figsize=(7.0, 3.2))
for name, one in believed.items():
    log = run_trial(one, trial, truth=design)[0]
    error = 1e3 * (log["theta_ref"] - log["theta_true"])
    axes.plot(log.t, error, lw=1, label=f"{name}: rms {1e3 * measure(log).rms:.3f} mrad")
axes.set_xlabel("time [s]")
axes.set_ylabel("following error [mrad]")
axes.legend(loc="upper right", fontsize=8)
figure.tight_layout()

# %%
# **In CI**: ``pip install pmsm-ctrl pytest``, then ``pytest designs/low_speed.toml``. Each line of the acceptance is
# one test. :doc:`../compensation` tells how the gain was chosen and up to which one it is safe.
