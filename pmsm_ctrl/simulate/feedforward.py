"""Friction compensation in the drive: the terms of the compensated effects, evaluated once per speed period.

Their parameters are further columns of the references, so that a changed gain or parameter needs no new kernel, and
parameters may change with time (adaptive compensation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.errors import DesignError

__all__ = ["FIRST", "Feedforward", "compensation_lines"]

Array = NDArray[Any]

FIRST = 6  # columns of references, before those of the compensation
HEAD = 5  # gain, smoothing width, number of the source, K_t, p
# Speed of the feedforward: measured; of the reference; of the reference plus the position controller's output.
SOURCES = {"measured": 0.0, "reference": 1.0, "adaptive": 1.0, "commanded": 2.0}
# Signals that a compensator in the drive can read. `torque` is the controller's demand without compensation.
READABLE = ("omega", "direction", "theta", "torque", "i_q", "i_d", "p")


@dataclass(frozen=True, eq=False)
class Feedforward:
    """The effects that a design compensates, and the numbers that go with them.

    Attributes
    ----------
    effects : tuple of Effect
    values : array, shape (m,)
        Gain, smoothing width in rad/s, the source's number, K_t, p, then the parameters in order.
    names : tuple of str
        Names of the values: ``gain``, ``smoothing``, ``source``, ``K_t``, ``p``, ``coulomb.F_c``, ...
    left_out : tuple of str
        Ids of the effects that a drive cannot evaluate from its own signals.
    """

    effects: tuple[Effect, ...]
    values: Array
    names: tuple[str, ...]
    left_out: tuple[str, ...] = ()

    @classmethod
    def of(cls, design: Design) -> Feedforward | None:
        """Read the compensation of a design.

        Parameters
        ----------
        design : Design
            Its ``[compensation]``.

        Returns
        -------
        Feedforward or None
            None when the gain is 0 or all compensated effects are zero.

        Raises
        ------
        DesignError
            When it names an effect that the design does not have.
        """
        chosen = design.compensation
        if chosen.gain == 0.0:
            return None
        present = {entry.id for entry in design.effects}
        for name in chosen.effects:
            if name not in present and name not in ("coulomb", "viscous"):
                raise DesignError(
                    f"{design.source or design.name}: compensation.effects: '{name}' is not among the design's effects"
                    f" ({', '.join(sorted(present)) or 'none'})"
                )
        head = (chosen.gain, chosen.smoothing, SOURCES[chosen.source], design.K_t_assumed)
        values, names = [*head, float(design.motor.p or 0)], ["gain", "smoothing", "source", "K_t", "p"]
        effects, left_out = [], []
        for effect, parameters in bound_effects(design):
            if effect.id not in chosen.effects or not effect.active(parameters):
                continue
            if effect.enters != "torque" or effect.has_state or not set(effect.signals) <= set(READABLE):
                left_out.append(effect.id)
                continue
            effects.append(effect)
            values += parameters.values()
            names += [f"{effect.id}.{symbol}" for symbol in parameters]
        return cls(tuple(effects), np.array(values), tuple(names), tuple(left_out)) if effects else None

    def widen(self, inputs: Array) -> Array:
        """Return the references with the compensation's values beside them, shape (n, 6 + m)."""
        return np.hstack([inputs, np.broadcast_to(self.values, (inputs.shape[0], self.values.size))])


def compensation_lines(effects: Sequence[Effect]) -> list[str]:
    """Return the lines of the speed controller that add the feedforward to the current it wants.

    The sign of the speed is exact for a width of 0, else a straight line through zero over +- the width.
    """
    if not effects:
        return []
    lines = [
        "c_gain, c_width, c_reference = reference[6], reference[7], reference[8]",
        "c_K_t, p = reference[9], reference[10]",
        "omega = reference[1] if c_reference == 1.0 else (omega_ref if c_reference == 2.0 else omega_hat)",
        "direction = 0.0 if omega == 0.0 else (1.0 if omega > 0.0 else -1.0)",
        "direction = direction if c_width == 0.0 else min(max(omega / c_width, -1.0), 1.0)",
        "theta, i_d, i_q, torque = theta_m, reference[4], wanted, c_K_t * wanted",
    ]
    column = FIRST + HEAD
    calls = []
    for k, effect in enumerate(effects):
        own = {}
        for parameter in effect.parameters:
            own[parameter.symbol] = f"reference[{column}]"
            column += 1
        calls.append(f"f{k}_term({', '.join(own.get(name, name) for name in effect.arguments)})")
    lines.append(f"wanted += c_gain * ({' + '.join(calls)}) / c_K_t")
    return lines
