"""Tune one axis and verify what was promised on the simulated drive: python designs/tune_and_verify.py [DESIGN]."""

import sys
from pathlib import Path

from pmsm_ctrl import Design, tune

path = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("seed_motor.toml")
tuning = tune(Design.read(path), current="modulus_optimum", speed="symmetrical_optimum")
print(tuning.summary())
for figure in tuning.proof.figures:
    print(
        f"{figure.loop}: {figure.name} {figure.promised:.4g} -> {figure.measured:.4g} {figure.unit}, {figure.verdict}"
    )
sys.exit(0 if tuning.defended else 1)
