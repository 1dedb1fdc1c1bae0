"""From channels to what the filters read: drive torque, and the torque of effects that are taken as known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import SIGNALS, Effect
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.kernels.balance import torque_em
from pmsm_ctrl.units import psi_f_from

__all__ = ["KnownTorque", "drive_torque"]

Array = NDArray[np.float64]
AVAILABLE = ("omega", "theta", "direction", "i_d", "i_q", "torque", "t", "p")


def drive_torque(design: Design, i_d: ArrayLike, i_q: ArrayLike) -> Array | float:
    """Torque of the drive in N m from its currents, with the torque constant that the evaluation assumes."""
    motor = design.motor
    if motor.p is None or motor.L_d is None or motor.L_q is None:
        return design.K_t_assumed * np.asarray(i_q, dtype=np.float64)
    psi_f = psi_f_from(design.K_t_assumed, motor.p)
    # the kernel's own Python source works on arrays as well
    return torque_em.py_func(motor.p, psi_f, motor.L_d, motor.L_q, i_d, i_q)


class KnownTorque:
    """Torque of every effect of a design beside the tracked Coulomb and viscous friction.

    Attributes
    ----------
    notes : tuple of str
        Effects that cannot be evaluated sample by sample, and are left out.
    """

    def __init__(self, design: Design) -> None:
        self._effects: list[tuple[Effect, dict[str, float]]] = []
        self._p = float(design.motor.p or 0)
        notes = []
        tracked = {"coulomb", "viscous"}
        for effect, values in bound_effects(design):
            if effect.enters != "torque" or not effect.active(values):
                continue
            if effect.id in tracked:
                tracked.remove(effect.id)
                continue
            missing = [name for name in effect.signals if name not in AVAILABLE]
            if effect.structure != "term" or missing:
                notes.append(f"{effect.id} is left out: a tracker that sees the motor alone cannot evaluate it")
                continue
            self._effects.append((effect, values))
        self.notes = tuple(notes)

    @property
    def effects(self) -> tuple[tuple[Effect, dict[str, float]], ...]:
        """The effects whose torque is known, with their parameter values."""
        return tuple(self._effects)

    def __bool__(self) -> bool:
        return bool(self._effects)

    def over(self, signals: Mapping[str, Array]) -> Array:
        """Return the torque over a log, shape (n,)."""
        total = np.zeros(len(signals["t"]))
        for effect, values in self._effects:
            total += column(effect, {**signals, "p": self._p}, values)
        return total

    def at(self, signals: Mapping[str, float]) -> float:
        """Return the torque at one sample."""
        total = 0.0
        for effect, values in self._effects:
            given = {**signals, "p": self._p, **values}
            total += effect.term(*(float(given[name]) for name in effect.arguments))
        return total


assert set(AVAILABLE) <= set(SIGNALS)
