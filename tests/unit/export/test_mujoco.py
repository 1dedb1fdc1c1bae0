"""The exported joints in MuJoCo's own parser and dynamics; skipped where MuJoCo is not installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.export.simulators import joint_friction
from pmsm_ctrl.export.tables import friction_points, table_files
from pmsm_ctrl.simulate import scenario, simulate
from tests.benchmarks.simulators import creep, inverse_error, mjcf, without_settings

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed (extra `peers`)")

NAMES = ("seed_motor", "low_speed", "servo_2kw", "geared_resonant", "emps")


@pytest.mark.parametrize("name", NAMES)
def test_mujoco_reads_both_files_as_the_axis_that_was_meant(designs: Path, name: str) -> None:
    design = Design.read(designs / f"{name}.toml")
    joint = joint_friction(design, friction_points(design)[0])
    files = table_files(design)
    texts = [text for file, text in files.items() if file.endswith(("_mujoco.xml", ".urdf"))]
    assert len(texts) == 2
    for text in texts:
        model = mujoco.MjModel.from_xml_string(text)
        state = mujoco.MjData(model)
        mujoco.mj_forward(model, state)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, state, full)
        assert full[0, 0] == pytest.approx(design.J, rel=1e-3)
        assert model.dof_frictionloss[0] == pytest.approx(joint.level, rel=1e-6)
        assert model.dof_damping[0] == pytest.approx(joint.slope, rel=1e-6)


def test_the_friction_of_a_braking_axis_turns_with_its_speed(designs: Path) -> None:
    """MuJoCo brings the speed to zero within a time constant; the default is longer than a servo axis brakes."""
    design = Design.read(designs / "seed_motor.toml").replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    log = simulate(design, scenario("s_curve", design), keep_truth=True)
    text, friction = mjcf(design), (0.0213, 0.000168)
    assert inverse_error(mujoco, text, log, friction, design.J) < 1e-3
    assert inverse_error(mujoco, without_settings(text), log, friction, design.J) > 0.02
    assert creep(mujoco, text, 0.5 * 0.0213) < 1e-3
    assert creep(mujoco, without_settings(text), 0.5 * 0.0213) > 0.05
