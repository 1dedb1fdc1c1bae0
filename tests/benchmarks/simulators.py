"""What a simulator's joint misses: on logs, and of what the file says once MuJoCo has read it.

    python -m tests.benchmarks.simulators

The first table needs no simulator: error of the drive torque on simulated logs, of the full model and of Coulomb and
viscous friction alone. The second needs MuJoCo (`pip install -e '.[peers]'`): along the true motion of the same
axes its inverse dynamics are compared with J alpha + F_c sgn(omega) + F_v omega, with the file as it is exported and
with MuJoCo's defaults for the friction; and how fast the joint creeps under half of its friction.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.export.on_log import errors_on_log
from pmsm_ctrl.export.simulators import joint_friction
from pmsm_ctrl.export.tables import friction_points, table_files
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import scenario, simulate
from tests.benchmarks.drive_tables import design_of

__all__ = ["creep", "inverse_error", "mjcf", "without_settings"]

NAMES = ("seed_motor", "low_speed", "small_servo", "servo_2kw", "geared_resonant", "presliding")
MOTIONS = ("reversal", "identification")
MOVING = 0.01  # share of the largest speed below which the axis is at rest
HELD = 1.0  # s


def mjcf(design: Design) -> str:
    """Return the exported MJCF of a design."""
    return next(text for name, text in table_files(design).items() if name.endswith("_mujoco.xml"))


def without_settings(text: str) -> str:
    """Return the MJCF with MuJoCo's defaults for the friction."""
    return re.sub(r'\s+solreffriction="[^"]*" solimpfriction="[^"]*"', "", text)


def inverse_error(mujoco: Any, text: str, log: Log, friction: tuple[float, float], J: float) -> float:
    """Return the error of MuJoCo's inverse dynamics along the true motion of a log, over the torque, both rms."""
    model = mujoco.MjModel.from_xml_string(text)
    state = mujoco.MjData(model)
    omega = log["omega_true"]
    alpha = np.gradient(omega, log.period)
    wanted = J * alpha + friction[0] * np.sign(omega) + friction[1] * omega
    found = np.empty_like(wanted)
    for k, values in enumerate(zip(log["theta_true"], omega, alpha, strict=True)):
        state.qpos[0], state.qvel[0], state.qacc[0] = values
        mujoco.mj_inverse(model, state)
        found[k] = state.qfrc_inverse[0]
    moving = np.abs(omega) > MOVING * np.abs(omega).max()
    return _rms((found - wanted)[moving]) / _rms(wanted[moving])


def creep(mujoco: Any, text: str, torque: float) -> float:
    """Return the speed of a joint under a torque that its friction should hold, rad/s (m/s)."""
    model = mujoco.MjModel.from_xml_string(text)
    state = mujoco.MjData(model)
    state.ctrl[:] = torque
    for _ in range(round(HELD / model.opt.timestep)):
        mujoco.mj_step(model, state)
    return float(state.qvel[0])


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def main() -> None:
    """Print both tables."""
    print("| design, log | lost | full model errs | joint errs | they differ |\n|---|---|---|---|---|")
    for name in NAMES:
        design = design_of(name)
        joint = joint_friction(design, friction_points(design)[0])
        for motion in MOTIONS:
            found = errors_on_log(
                design, simulate(design, scenario(motion, design), seed=5), joint.level, joint.slope
            )  # fmt: skip
            shares = (f"{100.0 * one:.3g} %" for one in (found.full, found.joint, found.apart))
            print(f"| {name}, {motion} | {', '.join(joint.lost) or 'nothing'} | {' | '.join(shares)} |", flush=True)
    try:
        import mujoco
    except ImportError:
        print("\nMuJoCo is not installed: pip install -e '.[peers]'")
        return
    print(f"\nMuJoCo {mujoco.__version__}\n")
    print(
        "| design | torque errs: exported, defaults | creeps at half the friction: exported, defaults |\n|---|---|---|"
    )
    for name in NAMES:
        design = design_of(name).replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
        joint = joint_friction(design, friction_points(design)[0])
        log = simulate(design, scenario("reversal", design), keep_truth=True)
        texts = (mjcf(design), without_settings(mjcf(design)))
        errs = (inverse_error(mujoco, one, log, (joint.level, joint.slope), design.J) for one in texts)
        creeps = (creep(mujoco, one, 0.5 * joint.level) for one in texts)
        print(
            f"| {name} | {', '.join(f'{100.0 * one:.2g} %' for one in errs)} "
            f"| {', '.join(f'{1e3 * one:.2g} mrad/s' for one in creeps)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
