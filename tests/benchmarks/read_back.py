"""Exported tables as the drive would read them: the current that each adds along a reference motion.

The text of the file is parsed, so that rounding, units and the drive's own interpolation count.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.simulate import Scenario

__all__ = ["Reading", "added_to", "read_ax8000", "read_cogging_ax8000", "read_compensation_list", "read_friction_csv",
           "read_sinumerik", "read_torque_over_angle"]  # fmt: skip

Array = NDArray[np.float64]
# reference position, reference speed, time -> current to add, A
Reading = Callable[[Array, Array, Array], Array]


def read_compensation_list(text: str, design: Design, cycle: float = 1e-3) -> Reading:
    """Read a compensation list of TwinCAT CNC: a table over the commanded speed, in steps of the CNC's cycle.

    The current builds up linearly over `position_delay` of travel after a reversal and decays over
    `reversal_lookahead` cycles before it; `delay_cycles` delay everything.

    Parameters
    ----------
    text : str
    design : Design
    cycle : float
        Of the CNC, s.

    Returns
    -------
    function of reference position, reference speed and time
    """
    linear = design.motion == "linear"
    fields = dict(line.split() for line in text.splitlines() if line and not line.startswith("#"))
    count = int(fields["frict_comp.table_entries"])
    table = np.array([[float(fields[f"frict_comp.table[{k}].{one}"]) for one in ("in", "out")] for k in range(count)])
    speed = table[:, 0] * (1e-6 if linear else math.pi / 180e3)
    current = 1e-6 * table[:, 1] * float(fields.get("frict_comp.scaling_factor", 1))
    travel = int(fields["frict_comp.position_delay"]) * (1e-7 if linear else math.pi / 180e4)
    ahead, late = (int(fields[f"frict_comp.{one}"]) for one in ("reversal_lookahead", "delay_cycles"))

    def read(position: Array, omega: Array, t: Array) -> Array:
        tick = np.floor(t / cycle * (1.0 + 1e-12)) * cycle - late * cycle
        at = np.clip(np.searchsorted(t, tick - 1e-12), 0, len(t) - 1)
        moved, sign = _since_reversal(position[at], omega[at])
        built = np.minimum(moved / travel, 1.0) if travel > 0.0 else np.ones_like(t)
        if ahead:
            left = _until_reversal(omega, t)[at]
            built = np.minimum(built, left / (ahead * cycle))
        value = np.interp(np.abs(omega[at]), speed, current)
        return np.where(omega[at] == 0.0, 0.0, sign * value * built)

    return read


def read_ax8000(text: str, design: Design) -> Reading:
    """Read the friction objects of an AX8000: a line over the fed-forward speed, and the spring at reversals.

    Parameters
    ----------
    text : str
    design : Design
        Its torque constant makes the torque a current.

    Returns
    -------
    function of reference position, reference speed and time
    """
    values = {row[0]: float(row[2] or math.inf) for row in csv.reader(text.splitlines()) if row[0].startswith("3144")}
    rate, static, slope = (values[f"3144:0{k}"] for k in (1, 2, 3))
    ramp = static / rate if math.isfinite(rate) and rate > 0.0 else 0.0

    def read(position: Array, omega: Array, t: Array) -> Array:
        moved, sign = _since_reversal(position, omega)
        # the spring is loaded the other way at a reversal, and not at all at the first start
        reversals = np.cumsum(np.append(False, (np.diff(sign) != 0.0) & (sign[:-1] != 0.0)))
        loaded = np.where(reversals > 0, 1.0, 0.0)
        swing = np.minimum(moved / ramp - loaded, 1.0) if ramp > 0.0 else np.ones_like(t)
        resting = np.where(omega == 0.0, 0.0, 1.0)
        return np.asarray((static * sign * swing * resting + slope * omega) / design.K_t_assumed)

    return read


def read_friction_csv(text: str, design: Design) -> Reading:
    """Read a plain table of current over speed, both directions, interpolated linearly.

    Parameters
    ----------
    text : str
    design : Design

    Returns
    -------
    function of reference position, reference speed and time
    """
    rows = np.array([[float(x) for x in row] for row in list(csv.reader(text.splitlines()))[1:]])

    def read(position: Array, omega: Array, t: Array) -> Array:
        # no straight line through zero speed: each direction has its own table
        sides = [rows[np.sign(rows[:, 0]) == one] for one in (-1.0, 1.0)]
        back, forth = (np.interp(omega, side[:, 0], side[:, -1]) for side in sides)
        return np.where(omega > 0.0, forth, np.where(omega < 0.0, back, 0.0))

    return read


def read_cogging_ax8000(text: str, design: Design) -> Reading:
    """Read object 32CB of an AX8000: waves of the angle, here that of the reference.

    Parameters
    ----------
    text : str
    design : Design

    Returns
    -------
    function of reference position, reference speed and time
    """
    values = [row[2] for row in csv.reader(text.splitlines()) if row[0].startswith("32CB")]
    waves = [(float(n), math.radians(float(phi)), float(r)) for n, phi, r in zip(*[iter(values)] * 3, strict=True)]

    def read(position: Array, omega: Array, t: Array) -> Array:
        parts = [r * np.sin(n * position + phi) for n, phi, r in waves]
        return np.asarray(np.sum(parts, axis=0) / design.K_t_assumed)

    return read


def read_torque_over_angle(text: str, design: Design) -> Reading:
    """Read a table of torque over the angle of a turn, one per direction, interpolated linearly.

    Parameters
    ----------
    text : str
    design : Design

    Returns
    -------
    function of reference position, reference speed and time
    """
    lines = [line for line in text.splitlines()[1:] if not line.startswith("#")]
    rows = np.array([[float(x) for x in row] for row in csv.reader(lines)])
    turn = 2.0 * math.pi

    def read(position: Array, omega: Array, t: Array) -> Array:
        angle = np.mod(position, turn)
        forth, back = (np.interp(angle, rows[:, 1], rows[:, column], period=turn) for column in (2, 3))
        return np.asarray(np.where(omega >= 0.0, forth, back) / design.K_t_assumed)

    return read


def read_sinumerik(text: str, design: Design) -> Reading:
    """Read SINUMERIK's friction compensation: pulses into the speed reference, as the PI controller answers them.

    Parameters
    ----------
    text : str
    design : Design
        Its speed controller.

    Returns
    -------
    function of reference position, reference speed and time
    """
    linear = design.motion == "linear"
    found = {m[1]: float(m[2]) for m in re.finditer(r"^MD(\d+),[^,]*,([-+.\deE]+),", text, flags=re.MULTILINE)}
    v, a = (1.0 / 6e4, 1.0) if linear else (math.pi / 30.0, 2.0 * math.pi)
    high, low, T = v * found["32520"], v * found["32530"], found["32540"]
    a1, a2, a3 = (a * found[name] for name in ("32550", "32560", "32570"))
    loop = design.require_loops().speed

    def amplitude(at: float) -> float:
        if found["32510"] == 0.0 or a1 <= at <= a2:
            return high
        return high * at / a1 if at < a1 else float(np.interp(at, [a2, a3], [high, low]))

    def read(position: Array, omega: Array, t: Array) -> Array:
        acceleration = np.gradient(omega, t)
        moving = np.flatnonzero(omega)
        turns = moving[1:][np.diff(np.sign(omega[moving])) != 0]
        out = np.zeros_like(t)
        for k in turns.tolist():
            after = np.maximum(t - t[k], 0.0)
            pulse = np.sign(omega[k]) * amplitude(abs(float(acceleration[k]))) * loop.K_p
            fading = np.exp(-after / T)
            out += np.where(t >= t[k], pulse * (fading + T / loop.T_n * (1.0 - fading)), 0.0)
        return out

    return read


def added_to(motion: Scenario, reading: Reading, period: float) -> Scenario:
    """Return a motion along which a drive adds what a reading says.

    Parameters
    ----------
    motion : Scenario
        Under position control.
    reading : function of reference position, reference speed and time
    period : float
        Of the drive's speed controller, s.

    Returns
    -------
    Scenario

    Raises
    ------
    RequestError
        When the motion has no reference position.
    """
    if motion.control != "position":
        raise RequestError(f"scenario '{motion.name}' is under {motion.control} control; position was expected")
    t = period * np.arange(math.ceil(motion.duration / period) + 2, dtype=np.float64)
    given = motion.references(t)
    current = reading(np.asarray(given["theta_ref"]), np.asarray(given["omega_ref"]), t)

    def references(at: Array) -> Mapping[str, Array]:
        places = np.clip(np.round(at / period).astype(int), 0, len(t) - 1)
        return {**motion.references(at), "i_q_add": current[places]}

    return replace(motion, references=references)


def _since_reversal(position: Array, omega: Array) -> tuple[Array, Array]:
    """Return the travel since the last reversal of a reference, and the direction of its motion."""
    sign = np.sign(omega)
    last = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), 0))
    sign = sign[last]
    turned = np.concatenate([[True], np.diff(sign) != 0.0])
    start = np.maximum.accumulate(np.where(turned, np.arange(len(sign)), 0))
    return np.abs(position - position[start]), sign


def _until_reversal(omega: Array, t: Array) -> Array:
    """Return the time until the reference reverses next, s; infinite where it does not."""
    sign = np.sign(omega)
    turns = np.flatnonzero((sign[1:] != sign[:-1]) & (sign[1:] != 0.0)) + 1
    following = np.searchsorted(turns, np.arange(len(t)), side="right")
    return np.where(following < len(turns), np.append(t[turns], np.inf)[following] - t, np.inf)
