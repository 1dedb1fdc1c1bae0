"""Friction as the fields of drives: a P-COMP list, the friction objects of the AX8000, pulses at reversals.

Fields are named as in the manuals. What was not confirmed with a manual stands in the file itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.simulate.feedforward import ramp_length

__all__ = ["ax8000_friction", "compensation_list", "friction_of", "pulses", "sinumerik_friction"]

Array = NDArray[np.float64]

TURN = 360.0 / (2.0 * math.pi)  # deg/rad
POSITION_DELAY = 10  # largest position_delay in the manual's table of parameters; its own example has 30
ACCELERATIONS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # of the pulses, as shares of that which passes the Stribeck range


def friction_of(design: Design, omega: Array) -> Array:
    """Return the torque of all effects that speed alone determines, N m (N), shape (n,).

    Parameters
    ----------
    design : Design
    omega : array, shape (n,)
        rad/s (m/s).

    Returns
    -------
    array, shape (n,)
    """
    known: dict[str, Any] = {"omega": omega, "direction": np.sign(omega), "p": float(design.motor.p or 0)}
    total = np.zeros_like(omega)
    for effect, values in bound_effects(design):
        if effect.enters == "torque" and not effect.has_state and set(effect.signals) <= set(known):
            total += column(effect, known, values)
    return total


def compensation_list(design: Design, table: Array) -> str:
    """Return the entries of a compensation list of TwinCAT CNC (TF5200), which holds one table for both directions.

    Source: Beckhoff Information System, TF5200, P-COMP-00041 to P-COMP-00047, P-COMP-00058, P-COMP-00062.

    Parameters
    ----------
    design : Design
    table : array, shape (n, 3)
        Speeds, and the torque of both directions at them.

    Returns
    -------
    str
    """
    linear = design.motion == "linear"
    speed = 1e6 if linear else 1e3 * TURN
    mean = table[:, 1:].mean(axis=1)
    apart = float(np.abs(table[:, 1] - table[:, 2]).max() / 2.0)
    # the friction turns over twice the ramp, from one direction to the other; the CNC builds it up from zero
    travel = round(2.0 * ramp_length(design) * (1e7 if linear else 1e4 * TURN))
    lines = [
        f"# Friction of {design.name} for frict_comp; speeds in {'um/s' if linear else '0.001 deg/s'}.",
        "# The currents are in uA peak: bring them to the unit of dig_drv.act_torque of your drive, or set",
        "# frict_comp.scaling_factor. One table serves both directions; each differs from it by at most",
        f"# {apart / design.K_t_assumed * 1e6:.4g} uA. Switch it on with lr_param.frict_comp 1 (P-AXIS-00522).",
        f"# position_delay is the travel over which the current builds up, in {'0.1 um' if linear else '0.0001 deg'}.",
    ]
    if travel > POSITION_DELAY:
        lines.append(f"# The manual gives 0 to {POSITION_DELAY} as its range and has 30 in its own example.")
    lines += [
        "# Not confirmed with a manual: '#' as the mark of a remark, the unit of the currents, what acts below the",
        "# first speed, and whether position_delay counts from the reversal.",
        "frict_comp.mode 3",
        f"frict_comp.table_entries {len(table)}",
        f"frict_comp.position_delay {travel}",
        "frict_comp.reversal_lookahead 0",
        "frict_comp.delay_cycles 0",
    ]
    for k, (w, torque) in enumerate(zip(table[:, 0].tolist(), mean.tolist(), strict=True)):
        lines.append(f"frict_comp.table[{k}].in {round(w * speed)}")
        lines.append(f"frict_comp.table[{k}].out {round(torque / design.K_t_assumed * 1e6)}")
    return "\n".join([*lines, ""])


def ax8000_friction(design: Design, table: Array) -> str:
    """Return the friction objects of Beckhoff's AX8000 and AMP8000: spring rate, static and dynamic friction.

    Two numbers hold what the table holds: static friction and slope are a line through it by least squares, evenly over
    the speeds. The spring rate is the static friction over the deflection at which a contact slips.

    Parameters
    ----------
    design : Design
    table : array, shape (n, 3)

    Returns
    -------
    str
    """
    static, slope = line_through(table)
    ramp = ramp_length(design)
    unit = "N" if design.motion == "linear" else "Nm"
    per = "m" if design.motion == "linear" else "rad"
    rows = [
        ("3144:01", "Static friction spring rate", f"{static / ramp:.9g}" if ramp > 0.0 else "",
         f"{unit}/{per}"),
        ("3144:02", "Static friction torque/force", f"{static:.9g}", unit),
        ("3144:03", "Dynamic friction factor", f"{slope:.9g}", f"{unit}/({per}/s)"),
    ]  # fmt: skip
    remark = (
        "# Units are the defaults of the objects; 3141:08 shows the sum. Not confirmed with a manual: whether an empty "
        "spring rate or which large one turns the friction at once, and the slip at which it ends"
    )
    return "\n".join(["object,name,value,unit", *(",".join(row) for row in rows), remark, ""])


def line_through(table: Array) -> tuple[float, float]:
    """Return Coulomb level and slope of the line that errs least over the speeds of a table, evenly over them."""
    speed = np.linspace(table[0, 0], table[-1, 0], 400)
    torque = np.interp(speed, table[:, 0], table[:, 1:].mean(axis=1))
    slope, level = np.polyfit(speed, torque, 1)
    if slope < 0.0 or level < 0.0:  # a field below zero is refused by drives and simulators
        return (float(torque.mean()), 0.0) if slope < 0.0 else (0.0, float(torque @ speed / (speed @ speed)))
    return float(level), float(slope)


def pulses(design: Design, accelerations: Iterable[float] | None = None) -> Array:
    """Return the pulse of the speed reference that turns the friction at a reversal, for each acceleration.

    A pulse n exp(-t/T) into a PI controller with the reset time T gives a step of its output, K_p n: it is the step of
    the friction's current at the reversal, its mean over the first T.

    Parameters
    ----------
    design : Design
        With loops.
    accelerations : iterable of float, optional
        rad/s^2 (m/s^2).

    Returns
    -------
    array, shape (n, 2)
        Acceleration, and the pulse in rad/s (m/s).
    """
    loop = design.require_loops().speed
    ramp, T = ramp_length(design), loop.T_n
    scale = _stribeck_speed(design) / T
    given = np.array(list(accelerations) if accelerations is not None else scale * np.array(ACCELERATIONS))
    t = np.linspace(0.0, T, 201)[1:]
    out = []
    for a in given.tolist():
        before = float(friction_of(design, np.array([-1e-9]))[0])
        turned = np.ones_like(t) if ramp == 0.0 else np.minimum(0.5 * a * t**2 / (2.0 * ramp), 1.0)
        torque = before + turned * (friction_of(design, a * t) - before)
        out.append(float(np.mean(torque - before)) / design.K_t_assumed / loop.K_p)
    return np.column_stack([given, out])


def _stribeck_speed(design: Design) -> float:
    """Return a speed on which the friction changes: where the Stribeck effect has passed, or 1 rad/s (10 mm/s)."""
    for effect, values in bound_effects(design):
        if effect.bends_over and effect.active(values):
            return 2.0 * values[effect.bends_over]
    return 0.01 if design.motion == "linear" else 1.0


def sinumerik_friction(design: Design) -> str:
    """Return the machine data of SINUMERIK's friction compensation with acceleration-dependent compensation value.

    Source: Siemens, SINUMERIK 840D sl/828D Function Manual Extended Functions, K3, section 4.6.4 (6FC5397-1BP40-3BA1).

    Parameters
    ----------
    design : Design
        With loops.

    Returns
    -------
    str
    """
    table = pulses(design)
    a1, a2, a3, high, low = characteristic(table)
    linear = design.motion == "linear"
    speed, acceleration = (6e4, 1.0) if linear else (30.0 / math.pi, 0.5 / math.pi)
    v, a = ("mm/min", "m/s^2") if linear else ("rev/min", "rev/s^2")
    adapted = int(high - low > 0.02 * high or a1 > table[0, 0])
    rows = [
        (32490, "FRICT_COMP_MODE", "1", ""),
        (32500, "FRICT_COMP_ENABLE", "1", ""),
        (32510, "FRICT_COMP_ADAPT_ENABLE", f"{adapted}", ""),
        (32520, "FRICT_COMP_CONST_MAX", f"{high * speed:.6g}", v),
        (32530, "FRICT_COMP_CONST_MIN", f"{low * speed:.6g}", v),
        (32540, "FRICT_COMP_TIME", f"{design.require_loops().speed.T_n:.6g}", "s"),
        (32550, "FRICT_COMP_ACCEL1", f"{a1 * acceleration:.6g}", a),
        (32560, "FRICT_COMP_ACCEL2", f"{a2 * acceleration:.6g}", a),
        (32570, "FRICT_COMP_ACCEL3", f"{a3 * acceleration:.6g}", a),
    ]
    lines = ["machine data,name,value,unit", *(f"MD{n},$MA_{name},{value},{unit}" for n, name, value, unit in rows)]
    lines += [
        "# A pulse into the speed reference at every reversal; with the time constant equal to the reset time of a PI",
        "# speed controller it is a step of its current. It assumes no filter between. Units and the form of the pulse",
        "# are not confirmed with a manual: start with a tenth and look at the circularity test.",
    ]
    return "\n".join([*lines, ""])


def characteristic(table: Array) -> tuple[float, float, float, float, float]:
    """Return a1, a2, a3, the largest and the smallest value of the adaptation characteristic that errs least.

    It rises from 0 to the largest value at a1, stays up to a2, and falls to the smallest one at a3.

    Parameters
    ----------
    table : array, shape (n, 2)
        Accelerations, rising, and values.

    Returns
    -------
    tuple of float
    """
    a, value = table.T
    high = float(value.max())
    top = np.flatnonzero(value >= 0.98 * high)
    a2 = float(a[top[-1]])
    # below a1 the value falls with the acceleration: the first one tells how
    a1 = float(min(a[0] * high / value[0], a[top[0]])) if value[0] > 0.0 else float(a[top[0]])
    if value[0] >= 0.98 * high:
        a1 = 0.5 * float(a[0])
    last, low = float(a[-1]), float(value[-1])
    a2 = min(a2, 0.99 * last)
    a3 = last if low < 0.98 * high else 1.01 * last
    return min(a1, 0.99 * a2), a2, a3, high, low
