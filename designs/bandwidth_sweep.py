"""Sweep the speed bandwidth; plot margins against the error that a 20 % short friction compensation leaves.

python designs/bandwidth_sweep.py [PLOT.png]
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pmsm_ctrl import Design, simulate, tune
from pmsm_ctrl.simulate import scenario
from pmsm_ctrl.tune import Specification

design = Design.read(Path(__file__).with_name("seed_motor.toml"))
F_c = 0.8 * design.parameters("coulomb")["F_c"]
slow = scenario("triangle", speed=10.0, period=1.0, cycles=2.0)


def compensated(t):
    inputs = slow.references(t)
    return {**inputs, "i_q_add": F_c / design.K_t * np.sign(inputs["omega_ref"])}


rows = []
for bandwidth in (20.0, 30.0, 45.0, 60.0, 80.0):
    wanted = Specification(speed="bandwidth", speed_bandwidth=bandwidth, phase_margin=60.0)
    tuning = tune(design, wanted, prove=False)
    log = simulate(tuning.design, replace(slow, references=compensated), keep_truth=True)
    error = np.sqrt(np.mean((log["omega_ref"] - log["omega_true"]) ** 2))
    margins = tuning.margins["speed"]
    rows.append((bandwidth, error, margins.gain_margin_db, margins.disk_margin))
    print(f"{bandwidth:5.1f} Hz: error {error:.4f} rad/s rms, gain margin {rows[-1][2]:.1f} dB, disk {rows[-1][3]:.2f}")

figure = Figure(figsize=(7, 5), layout="constrained")
axis = figure.subplots()
table = np.array(rows)
axis.plot(table[:, 1], table[:, 2], "o-", color="#0072B2")
for bandwidth, error, gain_margin, _ in rows:
    axis.annotate(f"{bandwidth:g} Hz", (error, gain_margin), textcoords="offset points", xytext=(6, 4))
axis.set(
    xlabel="speed error with compensation [rad/s rms]", ylabel="gain margin of the speed loop [dB]",
    title="Less error costs margin: choose the knee",
)  # fmt: skip
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "bandwidth_sweep.png")
