"""Friction compensation in the drive: the terms of the compensated effects, evaluated once per speed period.

This is the one definition of the compensator: the simulated drive runs `core_lines`, and the code export prints them.
Their parameters are further columns of the references, so that a changed gain or parameter needs no new kernel, and
parameters may change with time (adaptive compensation).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.units import encoder_span

__all__ = [
    "FIRST", "TRUSTED", "Feedforward", "compensation_lines", "core_lines", "estimate_lines", "largest_current",
    "limit_lines", "observer_inertia", "observer_lines", "observer_share", "observer_values",
    "ramp_length", "require_present", "smoothing_width",
]  # fmt: skip

Array = NDArray[Any]

FIRST = 6  # columns of references, before those of the compensation
HEAD = 7  # gain, smoothing width, number of the source, K_t, p, dead zone, limit
UNLIMITED = 1e6  # A, the limit of a drive without one
COUNTS = 5.0  # of the encoder, over which the sign of a commanded speed is smoothed
UNSTATED = 1 << 20  # counts of an encoder that is assumed where none is stated
TRUSTED = 0.1  # standard error of a tracked value, as a share of it, below which it is fed forward
# Speed of the feedforward: measured; of the reference; of the reference plus the position controller's output.
SOURCES = {"measured": 0.0, "reference": 1.0, "adaptive": 1.0, "commanded": 2.0, "observer": 3.0}
# Signals that a compensator in the drive can read. `torque` is the controller's demand without compensation.
READABLE = ("omega", "direction", "theta", "torque", "i_q", "i_d", "p")


@dataclass(frozen=True, eq=False)
class Feedforward:
    """The effects that a design compensates, and the numbers that go with them.

    Attributes
    ----------
    effects : tuple of Effect
    values : array, shape (m,)
        Gain, smoothing width in rad/s, the source's number, K_t, p, dead zone in rad/s, limit in A, then the parameters
        in order.
    names : tuple of str
        Names of the values: ``gain``, ``smoothing``, ``source``, ``K_t``, ``p``, ``dead_zone``, ``limit``,
        ``coulomb.F_c``, ...
    left_out : tuple of str
        Ids of the effects that a drive cannot evaluate from its own signals.

    Where the friction turns over a ramp, the speed period over the ramp (s/rad) is the last value.

    A disturbance observer has no effects; its bandwidth (rad/s), its share per speed period and its inertia follow the
    first seven values.
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
        if chosen.share == 0.0:
            return None
        require_present(design)
        head = (chosen.share, smoothing_width(design), SOURCES[chosen.source], design.K_t_assumed)
        values = [*head, float(design.motor.p or 0), chosen.dead_zone, largest_current(design)]
        names = ["gain", "smoothing", "source", "K_t", "p", "dead_zone", "limit"]
        if chosen.source == "observer":
            own = observer_values(design)
            return cls((), np.array([*values, *own.values()]), (*names, *own))
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
        ramp = ramp_length(design)
        if ramp > 0.0:
            values, names = [*values, design.drive.speed_period / ramp], [*names, "turning"]
        return cls(tuple(effects), np.array(values), tuple(names), tuple(left_out)) if effects else None

    @property
    def observes(self) -> bool:
        """Whether this is a disturbance observer, which has a memory, and no effects."""
        return bool(self.values[2] == SOURCES["observer"])

    @property
    def turns(self) -> bool:
        """Whether the friction turns over a ramp, which has a memory."""
        return self.names[-1] == "turning"

    @property
    def start(self) -> tuple[float, float]:
        """The observer's memory per speed of the shaft, N m s/rad, and its last current, A."""
        return float(self.values[HEAD] * self.values[HEAD + 2]), 0.0

    def widen(self, inputs: Array) -> Array:
        """Return the references with the compensation's values beside them, shape (n, 6 + m)."""
        return np.hstack([inputs, np.broadcast_to(self.values, (inputs.shape[0], self.values.size))])


def require_present(design: Design) -> None:
    """Refuse a compensation of an effect that the design does not have; without friction there is none to compensate.

    Parameters
    ----------
    design : Design

    Raises
    ------
    DesignError
        With the effects of the design.
    """
    present = {entry.id for entry in design.effects}
    for name in design.compensation.effects:
        if name not in present and name not in ("coulomb", "viscous"):
            raise DesignError(
                f"{design.source or design.name}: compensation.effects: '{name}' is not among the design's effects"
                f" ({', '.join(sorted(present)) or 'none'})"
            )


def observer_values(design: Design) -> dict[str, float]:
    """Return the numbers of a design's disturbance observer: bandwidth, share per speed period, inertia.

    Parameters
    ----------
    design : Design

    Raises
    ------
    DesignError
        When the design states no bandwidth.
    """
    chosen, where = design.compensation, design.source or design.name
    if chosen.bandwidth is None:
        raise DesignError(
            f"{where}: compensation.bandwidth: missing; a disturbance observer needs it, in rad/s "
            "(`pmsm-ctrl compensate` prints the highest one that the margins allow)"
        )
    return {
        "bandwidth": chosen.bandwidth,
        "share": observer_share(design, chosen.bandwidth),
        "inertia": observer_inertia(design),
    }


def observer_share(design: Design, bandwidth: float) -> float:
    """Return the share by which an observer's first-order filter of this bandwidth follows in one speed period.

    Parameters
    ----------
    design : Design
    bandwidth : float
        rad/s.
    """
    return 1.0 - math.exp(-bandwidth * design.drive.speed_period)


def observer_inertia(design: Design) -> float:
    """Return the inertia that an observer assumes, kg m^2 (kg).

    Parameters
    ----------
    design : Design
    """
    return design.compensation.inertia or design.assumed.J or design.J


def observer_lines() -> list[str]:
    """Return the lines that a disturbance observer has in the speed controller."""
    first = f"reference[{FIRST + HEAD}], reference[{FIRST + HEAD + 1}], reference[{FIRST + HEAD + 2}]"
    return [
        "gain, K_t, limit = reference[6], reference[9], reference[12]",
        f"bandwidth, share, inertia = {first}",
        "omega = omega_hat",
        *estimate_lines(),
        *limit_lines(),
        "wanted += i_q_add",
    ]


def compensation_lines(effects: Sequence[Effect], turns: bool = False) -> list[str]:
    """Return the lines of the speed controller that add the feedforward to the current it wants.

    `turns` says whether the friction turns over a ramp.
    """
    if not effects:
        return []
    lines = [
        "gain, smoothing, source, K_t, p = reference[6], reference[7], reference[8], reference[9], reference[10]",
        "dead_zone, limit = reference[11], reference[12]",
        "omega = reference[1] if source == 1.0 else (omega_ref if source == 2.0 else omega_hat)",
        "theta, i_d, i_q = theta_m, reference[4], wanted",
    ]
    column = FIRST + HEAD
    calls = []
    for k, effect in enumerate(effects):
        own = {}
        for parameter in effect.parameters:
            own[parameter.symbol] = f"reference[{column}]"
            column += 1
        calls.append(f"f{k}_term({', '.join(own.get(name, name) for name in effect.arguments)})")
    if turns:
        lines.append(f"turning = reference[{column}]")
    return [*lines, *core_lines([f"feedforward = {' + '.join(calls)}"], turns), "wanted += i_q_add"]


def core_lines(terms: Sequence[str], turns: bool = False) -> list[str]:
    """Return the lines that turn a speed into the current to add, `i_q_add`.

    They read `omega`, `i_q` (the current asked for without compensation) and the constants `gain`, `smoothing`,
    `dead_zone`, `limit` and `K_t`. The sign of the speed is exact for a width of 0, else a straight line through zero
    over +- the width.

    Parameters
    ----------
    terms : sequence of str
        Lines that set `feedforward` to the sum of the terms in N m, from `direction`, `torque` and the signals.
    turns : bool
        Whether the direction is not the sign of the speed but turns over a ramp: the memory `swing` follows the travel,
        `turning` (speed period over the ramp) times the speed in a period, between -1 and 1. The friction of elastic
        contacts turns so, over their deflection.
    """
    if turns:
        return [
            "swing = min(max(swing + (0.0 if abs(omega) <= dead_zone else turning * omega), -1.0), 1.0)",
            "direction = swing",
            "torque = K_t * i_q",
            *terms,
            *limit_lines(),
        ]
    return [
        "direction = (1.0 if omega > 0.0 else -1.0) if smoothing == 0.0 else min(max(omega / smoothing, -1.0), 1.0)",
        "direction = 0.0 if abs(omega) <= dead_zone else direction",
        "torque = K_t * i_q",
        *terms,
        *limit_lines(),
    ]


def limit_lines() -> list[str]:
    """Return the lines that turn the torque `feedforward` into the limited current `i_q_add`."""
    return ["i_q_add = min(gain * feedforward / K_t, limit)", "i_q_add = -min(-i_q_add, limit)"]


def estimate_lines() -> list[str]:
    """Return the lines of the disturbance observer: its memory `observed`, and its estimate `feedforward` in N m.

    The estimate is the torque that the current `applied` in the last period makes, less the inertia times the
    acceleration, through a first-order filter of the observer's bandwidth g; written so that the speed is not
    differentiated: filter(K_t i_q + g J omega) - g J omega. It opposes the motion, as the terms do.

    Source: K. Ohnishi, M. Shibata, T. Murakami, Motion control for advanced mechatronics, IEEE/ASME Trans.
    Mechatronics 1 (1996) 56.
    """
    return [
        "observed = observed + share * (K_t * applied + bandwidth * inertia * omega - observed)",
        "feedforward = observed - bandwidth * inertia * omega",
    ]


def smoothing_width(design: Design) -> float:
    """Return the half width of the line that stands for the sign of the speed, rad/s (m/s).

    The commanded speed follows the measured angle, so that a hard sign would shake the axis by counts of its encoder:
    unless the design states a width it is what five counts make of the speed.

    Parameters
    ----------
    design : Design
    """
    chosen = design.compensation
    if chosen.smoothing is not None:
        return chosen.smoothing
    if chosen.source != "commanded" or design.loops is None:
        return 0.0
    counts = design.sensor.encoder_counts or UNSTATED
    return COUNTS * design.loops.position.K_v * encoder_span(design.motion) / counts


def ramp_length(design: Design) -> float:
    """Return the travel over which the fed-forward friction turns at a reversal, rad (m); 0 for a sign of the speed.

    Unless the design states it, it is the deflection of its presliding: friction that turns at once, fed forward to a
    contact that turns over its deflection, pushes the axis further than no compensation does.

    Parameters
    ----------
    design : Design
    """
    if design.compensation.ramp is not None:
        return design.compensation.ramp
    for effect, values in bound_effects(design):
        if effect.active(values) and effect.structure.replaces_direction:
            return values[effect.amplitudes[0]]
    return 0.0


def largest_current(design: Design) -> float:
    """Return the largest current that the compensation adds, A peak.

    Parameters
    ----------
    design : Design
    """
    stated = design.compensation.limit
    return min(design.drive.i_max if stated is None else stated, UNLIMITED)
