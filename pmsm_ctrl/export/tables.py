"""What drives accept as data: friction over commanded speed, cogging as order, amplitude and phase."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.effects.evaluate import column

__all__ = ["cogging_table", "friction_table"]

Array = NDArray[np.float64]


def friction_table(design: Design, speeds: Iterable[float]) -> Array:
    """Return rows (speed rad/s, torque N m), shape (n, 2), of every effect that depends on speed alone."""
    omega = np.array(list(speeds), dtype=np.float64)
    total = np.zeros_like(omega)
    for effect, values in bound_effects(design):
        if effect.enters == "torque" and effect.structure == "term" and set(effect.signals) <= {"omega", "direction"}:
            total += column(effect, {"omega": omega, "direction": np.sign(omega)}, values)
    return np.column_stack([omega, total])


def cogging_table(design: Design) -> list[tuple[float, float, float]]:
    """Return (order, amplitude N m, phase rad) of every cogging effect: amplitude sin(order theta + phase)."""
    rows = []
    for effect, values in bound_effects(design):
        if effect.id == "cogging" and effect.active(values):
            a_s, a_c = values["a_s"], values["a_c"]
            rows.append((values["order"], math.hypot(a_s, a_c), math.atan2(a_c, a_s)))
    return rows


def table_files(design: Design) -> dict[str, str]:
    """placeholder"""
    return {}
