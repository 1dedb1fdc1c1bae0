"""The axis for simulators: MuJoCo's MJCF, URDF, and the actuator of Isaac Lab, with what each cannot hold.

They know Coulomb and viscous friction, Isaac Lab a breakaway besides: level and slope are a line through the friction
over speed by least squares, and the file says what that line misses.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.export.blocks import identifier
from pmsm_ctrl.export.drives import friction_of, line_through
from pmsm_ctrl.export.on_log import LogErrors
from pmsm_ctrl.export.writers import plain

__all__ = ["JointFriction", "joint_friction", "simulator_files"]

Array = NDArray[np.float64]

ROUNDING = 1e-9  # share below which a line misses nothing but rounding
# Of MuJoCo, s. Its friction loss is a soft constraint that brings the speed to zero within `solreffriction`, for which
# two steps are the least: with the default of 20 ms the friction of an axis that brakes turns long before its speed.
STEP = 5e-4
IMPEDANCE = "0.99 0.999 0.001 0.5 2"  # at the default of 0.9 a joint at rest creeps ten times as fast
TINY = 1e-9  # kg and kg m^2: the body of a rotor whose inertia is the joint's armature; simulators refuse 0


@dataclass(frozen=True)
class JointFriction:
    """Friction of a joint as simulators hold it.

    Attributes
    ----------
    level : float
        Coulomb friction, N m (N).
    slope : float
        N m s/rad (N s/m).
    breakaway : float
        Of the full model, N m (N): the mean of both directions, since a constant load is no friction.
    missed : float
        Rms error of the line, as a share of the rms friction, evenly over the speeds.
    lost : tuple of str
        Effects that cannot be held, and are left out or only approximated by the line.
    """

    level: float
    slope: float
    breakaway: float
    missed: float
    lost: tuple[str, ...]


def joint_friction(design: Design, table: Array) -> JointFriction:
    """Return the friction of a joint for a simulator.

    Parameters
    ----------
    design : Design
    table : array, shape (n, 3)
        Speeds and the torque of both directions at them.

    Returns
    -------
    JointFriction
    """
    level, slope = line_through(table)
    speed = np.linspace(table[0, 0], table[-1, 0], 400)
    both = np.concatenate([-speed[::-1], speed])
    full = friction_of(design, both)
    error = full - (level * np.sign(both) + slope * both)
    size = float(np.sqrt(np.mean(full**2)))
    back, forth = friction_of(design, np.array([-1e-9, 1e-9])).tolist()
    lost = tuple(
        effect.id
        for effect, values in bound_effects(design)
        if effect.active(values) and effect.enters == "torque" and not _held(effect, values, both)
    )
    missed = float(np.sqrt(np.mean(error**2))) / size if size > 0.0 else 0.0
    return JointFriction(level, slope, 0.5 * (forth - back), missed if missed > ROUNDING else 0.0, lost)


def _held(effect: Effect, values: dict[str, float], speed: Array) -> bool:
    """Whether a torque is a Coulomb level and a slope over these speeds, alike in both directions."""
    if effect.has_state or not set(effect.signals) <= {"omega", "direction"}:
        return False
    torque = column(effect, {"omega": speed, "direction": np.sign(speed)}, values)
    basis = np.column_stack([np.sign(speed), speed])
    rest = torque - basis @ np.linalg.lstsq(basis, torque, rcond=None)[0]
    return bool(np.linalg.norm(rest) < 1e-6 * np.linalg.norm(torque))


def simulator_files(design: Design, found: JointFriction, errors: LogErrors | None = None) -> dict[str, str]:
    """Return the axis as files of simulators.

    Parameters
    ----------
    design : Design
    found : JointFriction
    errors : LogErrors, optional
        What the joint misses on a log.

    Returns
    -------
    dict of str to str
        File names to texts.
    """
    axis, remarks = identifier(design.name), _remarks(design, found, errors)
    return {
        f"{axis}_mujoco.xml": _mjcf(design, axis, found, remarks),
        f"{axis}.urdf": _urdf(design, axis, found, remarks),
        f"{axis}_isaaclab.toml": _isaac(design, axis, found, remarks),
    }


def _remarks(design: Design, found: JointFriction, errors: LogErrors | None) -> list[str]:
    lost = ", ".join(found.lost) or "none"
    where = "of the linear axis" if design.motion == "linear" else "at the motor's shaft"
    lines = [
        f"Friction of {plain(design.name)} by pmsm_ctrl; SI units, {where}.",
        f"Not held by this format: {lost}.",
        f"The line of Coulomb and viscous friction misses {100.0 * found.missed:.2g} % of the friction (rms, evenly "
        "over the speeds); the full model breaks away at "
        f"{found.breakaway:.6g}, this one at {found.level:.6g}.",
    ]
    if errors is not None:
        shares = [f"{100.0 * one:.3g} %" for one in (errors.joint, errors.full, errors.apart)]
        lines.append(
            f"On {plain(Path(errors.log).name)} the drive torque of this joint errs by {shares[0]} (rms, moving "
            f"samples), that of the full model by {shares[1]}; they differ by {shares[2]}."
        )
    return lines


def _comments(lines: list[str]) -> str:
    """Return lines as comments of XML, which hold no two hyphens in a row."""
    return "\n".join(f"  <!-- {re.sub('-(?=-)', '- ', line)} -->" for line in lines)


def _mjcf(design: Design, axis: str, found: JointFriction, lines: list[str]) -> str:
    linear = design.motion == "linear"
    load = max(design.load.at_motor, TINY)
    remarks = _comments(lines)
    top = design.K_t_assumed * design.drive.i_max
    limits = f' ctrllimited="true" ctrlrange="{-top:.9g} {top:.9g}"' if np.isfinite(top) else ""
    mass, inertia = (max(load, TINY), TINY) if linear else (max(load, 1e-3), load)
    return f"""<mujoco model="{axis}">
{remarks}
  <!-- MuJoCo's friction is a soft constraint. solreffriction is two time steps, its least: keep it so with another
       time step. With the defaults the friction of an axis that brakes turns early, and a joint at rest creeps. -->
  <option timestep="{STEP:g}" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body name="{axis}_rotor">
      <joint name="{axis}" type="{"slide" if linear else "hinge"}" axis="0 0 1" armature="{design.motor.J or TINY:.9g}"
             damping="{found.slope:.9g}" frictionloss="{found.level:.9g}"
             solreffriction="{2.0 * STEP:g} 1" solimpfriction="{IMPEDANCE}"/>
      <inertial pos="0 0 0" mass="{mass:.9g}" diaginertia="{inertia:.9g} {inertia:.9g} {inertia:.9g}"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="{axis}_motor" joint="{axis}" gear="1"{limits}/>
  </actuator>
</mujoco>
"""


def _urdf(design: Design, axis: str, found: JointFriction, remarked: list[str]) -> str:
    linear = design.motion == "linear"
    remarks = _comments(remarked)
    whole = design.J if design.motor.J else TINY
    mass, inertia = (whole, TINY) if linear else (1e-3, whole)
    tensor = f'ixx="{inertia:.9g}" iyy="{inertia:.9g}" izz="{inertia:.9g}" ixy="0" ixz="0" iyz="0"'
    # a prismatic joint must state limits
    limit = '\n    <limit lower="-1e9" upper="1e9" effort="1e9" velocity="1e9"/>' if linear else ""
    return f"""<robot name="{axis}">
{remarks}
  <!-- URDF knows no rotor inertia: that of motor and load is in the link. -->
  <link name="{axis}_stator"/>
  <link name="{axis}_rotor">
    <inertial>
      <mass value="{mass:.9g}"/>
      <inertia {tensor}/>
    </inertial>
  </link>
  <joint name="{axis}" type="{"prismatic" if linear else "continuous"}">
    <parent link="{axis}_stator"/>
    <child link="{axis}_rotor"/>
    <axis xyz="0 0 1"/>{limit}
    <dynamics damping="{found.slope:.9g}" friction="{found.level:.9g}"/>
  </joint>
</robot>
"""


def _isaac(design: Design, axis: str, found: JointFriction, remarks: list[str]) -> str:
    lines = [f"# {line}" for line in remarks]
    lines += [
        "# Fields of isaaclab.actuators.ActuatorBaseCfg. Friction is an effort from PhysX 5.6 on (static and dynamic",
        "# friction effort, viscous coefficient); in older releases `friction` was a coefficient without unit.",
        f'joint_names_expr = ["{axis}"]',
        f"armature = {design.motor.J or TINY:.9g}",
        f"friction = {max(found.breakaway, found.level):.9g}",
        f"dynamic_friction = {found.level:.9g}",
        f"viscous_friction = {found.slope:.9g}",
    ]
    return "\n".join([*lines, ""])
