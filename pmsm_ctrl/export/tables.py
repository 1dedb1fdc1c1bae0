"""Tables that drives accept: friction over commanded speed, cogging as order, amplitude and phase or over the angle.

Every torque here is the one that a drive adds to what its controller asks for. Friction opposes the motion; a wave over
the angle has the same sign in both directions.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.export.backlash import backlash_files
from pmsm_ctrl.export.blocks import identifier
from pmsm_ctrl.export.drives import ax8000_friction, compensation_list, sinumerik_friction
from pmsm_ctrl.export.on_log import errors_on_log
from pmsm_ctrl.export.simulators import joint_friction, simulator_files
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import prepare
from pmsm_ctrl.units import axis_unit

__all__ = ["angle_table", "cogging_table", "friction_points", "friction_table", "table_files"]

Array = NDArray[np.float64]

POINTS = 20  # default size of a table of TwinCAT CNC (P-COMP-00062)
ANGLES = 4096  # values of a turn in a SINAMICS table (p5260)
HARMONICS = 10  # coefficients of an AX8000 (object 32CB)
ROUNDING = 1e-9  # share of the largest torque below which a straight line misses nothing but rounding
BETWEEN = 0.382  # of a step of the table
SAME = 1e-3  # share of the largest torque by which that of the next turn may differ: four digits of a stated period
SPEED_MAX = {"rotary": 300.0, "linear": 3.0}  # rad/s, m/s: where no limit follows from the design
BEYOND = 1.5  # times the fastest motion of a log, where no limit follows from the design


def friction_table(design: Design, speeds: Iterable[float]) -> Array:
    """Return the torque of every effect that depends on speed alone.

    Parameters
    ----------
    design : Design
    speeds : iterable of float
        n speeds, rad/s.

    Returns
    -------
    array, shape (n, 2)
        Speed, rad/s, and torque, N m.
    """
    omega = np.array(list(speeds), dtype=np.float64)
    total = _sum(design, {"omega": omega, "direction": np.sign(omega)}, "omega")
    return np.column_stack([omega, total])


def friction_points(design: Design, count: int = POINTS, speed_max: float | None = None) -> tuple[Array, float]:
    """Return the friction of both directions at the speeds that a drive can best interpolate between.

    Parameters
    ----------
    design : Design
    count : int
        Number of speeds.
    speed_max : float, optional
        Last speed, rad/s; by default that at which the back-EMF reaches the inverter's voltage.

    Returns
    -------
    table : array, shape (count, 3)
        Speed, torque at that speed, and at the same speed backwards, as a positive number.
    error : float
        Largest error of a straight line between two points, as a share of the largest torque.
    """
    last = speed_max or _speed_max(design)
    fine = np.geomspace(1e-4 * last, last, 600)
    both = np.column_stack([friction_table(design, fine)[:, 1], -friction_table(design, -fine)[:, 1]])
    chosen = [0, fine.size - 1]
    while True:
        lines = np.column_stack([np.interp(fine, fine[chosen], torque[chosen]) for torque in both.T])
        missed = np.abs(lines - both).max(axis=1)
        if len(chosen) >= count:
            break
        # once the lines fit everywhere, the widest gap is halved
        worst = int(missed.argmax()) if missed.max() > ROUNDING * np.abs(both).max() else _widest(fine, chosen)
        chosen = sorted({*chosen, worst})
    scale = float(np.abs(both).max())
    return np.column_stack([fine[chosen], both[chosen]]), float(missed.max()) / scale if scale else 0.0


def cogging_table(design: Design) -> list[tuple[float, float, float]]:
    """Return every wave of the angle alone, such as cogging, as ``amplitude sin(order theta + phase)``.

    Parameters
    ----------
    design : Design

    Returns
    -------
    list of tuple of float
        Order, amplitude (N m) and phase (rad).
    """
    rows = []
    for effect, values in bound_effects(design):
        if effect.order and effect.signals == ("theta",) and effect.active(values):
            order = values[effect.order]
            a_s, a_c = (effect.standing(values, theta=theta) for theta in (0.5 * math.pi / order, 0.0))
            rows.append((order, math.hypot(a_s, a_c), math.atan2(a_c, a_s)))
    return rows


def angle_table(design: Design, points: int = ANGLES) -> Array:
    """Return the torque of every effect that depends on the angle and repeats with the turn, over one turn.

    A wave behind a gear, which does not, would jump at the end of every turn.

    Parameters
    ----------
    design : Design
    points : int
        Number of angles.

    Returns
    -------
    array, shape (points, 3)
        Angle, rad, torque forwards and torque backwards, N m. Friction that changes over the turn has the sign of
        the direction.
    """
    theta = np.linspace(0.0, 2.0 * np.pi, points, endpoint=False)
    slower = set(_not_of_a_turn(design, points))
    sides = (_sum(design, _way(theta, sign), "theta", slower) for sign in (1.0, -1.0))
    return np.column_stack([theta, *sides])


def _way(theta: Array, sign: float) -> dict[str, Array]:
    return {"theta": theta, "direction": np.full(len(theta), sign)}


def _not_of_a_turn(design: Design, points: int = ANGLES) -> list[str]:
    """Return the effects of the angle that are not the same a turn later, in one direction at least."""
    # between the angles of the table: a step of a wave at one of them would fall to either side by rounding
    theta = 2.0 * np.pi * (np.arange(points) + BETWEEN) / points
    found = []
    for effect, values in bound_effects(design):
        if "theta" in effect.signals and effect.active(values) and _tabled(effect, {"theta", "direction", "p"}):
            for sign in (1.0, -1.0):
                first, second = (
                    column(effect, {**_way(angle, sign), "p": float(design.motor.p or 0)}, values)
                    for angle in (theta, theta + 2.0 * np.pi)
                )
                if np.abs(second - first).max() > SAME * np.abs(first).max():
                    found.append(effect.label(values))
                    break
    return found


def _tabled(effect: Effect, known: Iterable[str]) -> bool:
    """Whether these signals alone determine the torque of an effect."""
    return effect.enters == "torque" and not effect.has_state and set(effect.signals) <= set(known)


def table_files(design: Design, logs: Sequence[Log] = ()) -> dict[str, str]:
    """Return the tables as files.

    Parameters
    ----------
    design : Design
    logs : sequence of Log
        Of this axis. They show what simulators miss; with ``theta_load`` the backlash; and how fast the axis runs,
        where the design does not tell.

    Returns
    -------
    dict of str to str
        File names to texts; empty where there is nothing to tabulate.
    """
    axis = identifier(design.name)
    rotary = design.motion == "rotary"
    table, error = friction_points(design, speed_max=_fastest(design, logs))
    files = backlash_files(design, logs)
    if np.any(table[:, 1:]):
        files[f"{axis}_friction.csv"] = _friction_csv(design, table)
        files[f"{axis}_frict_comp.lis"] = compensation_list(design, table)
        files[f"{axis}_friction_ax8000.csv"] = ax8000_friction(design, table)
        if design.loops is not None and design.loops.speed.K_p > 0.0:
            files[f"{axis}_friction_sinumerik.csv"] = sinumerik_friction(design)
        joint = joint_friction(design, table)
        errors = errors_on_log(design, logs, joint.level, joint.slope) if logs else None
        files |= simulator_files(design, joint, errors)
    rows, angles = cogging_table(design), angle_table(design)
    slower = _not_of_a_turn(design) if rotary else []
    if rows:
        lines = [f"order,amplitude [{axis_unit('N m', design.motion)}],phase [rad],phase [deg]"]
        lines += [f"{k:.12g},{a:.12g},{phase:.12g},{_degrees(phase):.12g}" for k, a, phase in rows]
        theta = "mechanical angle of the logs, rad" if rotary else "position of the logs, m"
        lines.append(
            f"# {'T' if rotary else 'F'} = amplitude sin(order theta + phase) is to be added to the drive's own, in "
            f"both directions alike; theta: {theta}, from its zero. Sign, zero and "
            "sine or cosine of a drive may differ: turn the phase to its convention"
        )
        files[f"{axis}_cogging.csv"] = "\n".join([*lines, ""])
    if rotary and rows:  # the drive counts harmonics of a turn
        files[f"{axis}_cogging_ax8000.csv"] = _ax8000(rows)
    if rotary and np.any(angles[:, 1:]):
        lines = ["index,angle [rad],torque forwards [N m],torque backwards [N m]"]
        lines += [f"{k},{a:.9g},{f:.9g},{b:.9g}" for k, (a, f, b) in enumerate(angles.tolist())]
        lines.append(
            "# For SINAMICS p5260 one table per direction. Not confirmed with a manual: the parameter of the second "
            "table; the angle and the sign from which the drive counts"
        )
        if slower:
            lines.append(f"# Not held: {', '.join(slower)}, which does not repeat with the motor's turn")
        files[f"{axis}_torque_over_angle.csv"] = "\n".join([*lines, ""])
    if files:
        files[f"{axis}_tables.toml"] = _toml(design, table, error, rows, slower)
    return files


# -- forms ----------------------------------------------------------------------------------------------------------


def _friction_csv(design: Design, table: Array) -> str:
    """Both directions in one rising column, with the current that makes the torque."""
    whole = np.vstack([np.column_stack([-table[::-1, 0], -table[::-1, 2]]), table[:, :2]])
    rows = whole.tolist()
    if design.motion == "linear":
        lines = ["speed [m/s],force [N],current [A peak]"]
        lines += [f"{w:.9g},{T:.9g},{T / design.K_t_assumed:.9g}" for w, T in rows]
    else:
        lines = ["speed [rad/s],speed [rpm],torque [N m],current [A peak]"]
        lines += [f"{w:.9g},{w * 30.0 / np.pi:.9g},{T:.9g},{T / design.K_t_assumed:.9g}" for w, T in rows]
    return "\n".join([*lines, ""])


def _ax8000(rows: list[tuple[float, float, float]]) -> str:
    """Values of object 32CB of Beckhoff's AX8000: for each of ten harmonics its order, phase in degrees, amplitude."""
    # which angle phi counts from, its sign, and sine or cosine the manual leaves open (docs/export.md)
    lines = ["object,what,value,unit"]
    for k, (order, amplitude, phase) in enumerate(sorted(rows, key=lambda row: -row[1])[:HARMONICS]):
        first = 0x07 + 3 * k
        lines += [
            f"32CB:{first:02X},Coef {k} n,{round(order)},",
            f"32CB:{first + 1:02X},Coef {k} phi,{_degrees(phase):.6g},deg",
            f"32CB:{first + 2:02X},Coef {k} r,{amplitude:.6g},N m",
        ]
    lines.append(
        "# Written as r sin(n theta + phi) of the torque to be added to the drive's own. Not confirmed with a manual: "
        "the sign; the angle from which phi counts; sine or cosine: compare one harmonic on the axis before you use ten"
    )
    return "\n".join([*lines, ""])


def _toml(design: Design, table: Array, error: float, rows: list[tuple[float, float, float]], slower: list[str]) -> str:
    import tomli_w

    friction = {
        "speed": table[:, 0].tolist(), "forwards": table[:, 1].tolist(), "backwards": table[:, 2].tolist(),
        "unit_of_speed": axis_unit("rad/s", design.motion), "unit_of_torque": axis_unit("N m", design.motion),
        "largest_error_of_a_straight_line": error,
    }  # fmt: skip
    cogging = [{"order": k, "amplitude": a, "phase": phase} for k, a, phase in rows]
    return tomli_w.dumps({"axis": design.name, "torque_constant": design.K_t_assumed, "friction": friction}
                         | ({"cogging": cogging} if cogging else {})
                         | ({"not_held_over_a_turn": slower} if slower else {}))  # fmt: skip


# -- helpers ----------------------------------------------------------------------------------------------------------


def _sum(design: Design, signals: dict[str, Array], reads: str, left_out: Collection[str] = ()) -> Array:
    """Return the torque of the effects that these signals alone determine; position effects read the angle."""
    known: dict[str, Any] = {**signals, "p": float(design.motor.p or 0)}
    total = np.zeros_like(signals["direction"])
    for effect, values in bound_effects(design):
        if not _tabled(effect, known) or effect.label(values) in left_out:
            continue
        # an effect of neither angle nor speed (F_c, a constant load) belongs to the table over speed
        if reads == "omega" or "theta" in effect.signals:
            total += column(effect, known, values)
    return total


def _speed_max(design: Design) -> float:
    """Return the speed at which the back-EMF reaches the inverter's voltage."""
    motor, motion = design.motor, design.motion
    if motor.p is None or design.drive.u_dc <= 0.0:
        return SPEED_MAX[motion]
    return design.drive.u_dc / math.sqrt(3.0) / (design.K_t_assumed / 1.5)


def _fastest(design: Design, logs: Sequence[Log]) -> float | None:
    """Return the last speed of the tables by the logs, where the design has no voltage limit; else None."""
    if not logs or (design.motor.p is not None and design.drive.u_dc > 0.0):
        return None
    speeds = (prepare(design, log).signals["omega"] for log in logs)
    return BEYOND * max(float(np.quantile(np.abs(omega), 0.999)) for omega in speeds) or None


def _widest(speeds: Array, chosen: list[int]) -> int:
    """Return the speed nearest to the middle of the widest gap that has one."""
    order: list[int] = np.argsort(-np.diff(speeds[chosen]), kind="stable").tolist()
    for k in order:
        low, high = chosen[k], chosen[k + 1]
        if high - low > 1:
            middle = 0.5 * (speeds[low] + speeds[high])
            return low + 1 + int(np.abs(speeds[low + 1 : high] - middle).argmin())
    raise AssertionError("more points than speeds")


def _degrees(phase: float) -> float:
    return math.degrees(phase) % 360.0
