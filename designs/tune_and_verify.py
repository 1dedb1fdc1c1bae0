"""Tune one axis and check every predicted figure on the simulated drive: python designs/tune_and_verify.py [DESIGN]."""

import sys
from pathlib import Path

from pmsm_ctrl import Design, tune
from pmsm_ctrl.tune import Specification

path = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("seed_motor.toml")
tuning = tune(Design.read(path), Specification(current="modulus_optimum", speed="symmetrical_optimum"))
print(tuning.summary())
for check in tuning.proof.checks:
    numbers = f"{check.predicted:.4g} -> {check.simulated:.4g} {check.unit}"
    print(f"{check.subject}: {check.quantity} {numbers}, {check.outcome}")
sys.exit(0 if tuning.defended else 1)
