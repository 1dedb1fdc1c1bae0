"""Shipped designs as `tune` leaves them, each tuned once for all tests that begin there."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pmsm_ctrl.design import Design
from pmsm_ctrl.tune.result import Tuning
from pmsm_ctrl.tune.tuning import tune

__all__ = ["DESIGNS", "tuned"]

DESIGNS = Path(__file__).resolve().parents[2] / "designs"


@cache
def tuned(name: str) -> Tuning:
    """Return a shipped design tuned by the default rules, not checked in simulation."""
    return tune(Design.read(DESIGNS / f"{name}.toml"), prove=False)
