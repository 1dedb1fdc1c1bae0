"""Tables of drives and simulators: read as the drive reads them they add what the compensator adds."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.export.drives import characteristic, line_through, pulses
from pmsm_ctrl.export.on_log import errors_on_log
from pmsm_ctrl.export.simulators import joint_friction
from pmsm_ctrl.export.tables import friction_points, table_files
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.simulate.fed_forward import fed_currents
from tests.benchmarks.read_back import (
    added_to,
    read_ax8000,
    read_cogging_ax8000,
    read_compensation_list,
    read_friction_csv,
    read_sinumerik,
    read_torque_over_angle,
)
from tests.linear_motors import linear_motor


@pytest.fixture(scope="module")
def design(designs: Path) -> Design:
    return Design.read(designs / "low_speed.toml")


@pytest.fixture(scope="module")
def files(design: Design) -> dict[str, str]:
    return table_files(design)


T = np.arange(0.0, 4.0, 2.5e-4)
POSITION = 10.0 / np.pi * (1.0 - np.cos(np.pi * T))
SPEED = 10.0 * np.sin(np.pi * T)


def wanted(design: Design, *names: str) -> np.ndarray:
    parts = fed_currents(design, {"theta": POSITION, "i_q": np.zeros_like(T)}, SPEED, 2.5e-4)
    return np.sum([parts[name] for name in names], axis=0)


def test_friction_over_speed_is_the_compensators(design: Design, files: dict[str, str]) -> None:
    exact = wanted(design, "coulomb", "viscous", "stribeck")
    moving = np.abs(SPEED) > 1e-3
    for reading in (
        read_friction_csv(files["low_speed_friction.csv"], design),
        read_compensation_list(files["low_speed_frict_comp.lis"], design, cycle=2.5e-4),
    ):
        found = reading(POSITION, SPEED, T)
        assert np.abs(found - exact)[moving].max() < 2e-3 * np.abs(exact).max()


def test_waves_of_the_angle_are_the_compensators(design: Design, files: dict[str, str]) -> None:
    exact = wanted(design, "cogging")
    for name, reader in (("cogging_ax8000", read_cogging_ax8000), ("torque_over_angle", read_torque_over_angle)):
        found = reader(files[f"low_speed_{name}.csv"], design)(POSITION, SPEED, T)
        np.testing.assert_allclose(found, exact, atol=1e-3 * np.abs(exact).max())


def test_a_cnc_reads_its_table_once_a_cycle_and_late(design: Design, files: dict[str, str]) -> None:
    text = files["low_speed_frict_comp.lis"]
    late = text.replace("delay_cycles 0", "delay_cycles 3")
    now, then = (read_compensation_list(one, design)(POSITION, SPEED, T) for one in (text, late))
    np.testing.assert_allclose(then[12:], now[:-12])
    assert len(set(now[:8])) <= 2


def test_presliding_becomes_a_travel(design: Design) -> None:
    """The friction turns over twice the deflection: in 0.0001 deg, and as a spring rate."""
    soft = design.with_effect("presliding", {"z_s": 5e-4})
    files = table_files(soft)
    assert f"position_delay {round(np.degrees(1e-3) * 1e4)}" in files["low_speed_frict_comp.lis"]
    assert "30 in its own example" in files["low_speed_frict_comp.lis"]
    rows = [line.split(",") for line in files["low_speed_friction_ax8000.csv"].splitlines()]
    spring, static = (float(rows[k][2]) for k in (1, 2))
    assert spring == pytest.approx(static / 5e-4, rel=1e-6)
    swing = read_ax8000(files["low_speed_friction_ax8000.csv"], soft)(POSITION, SPEED, T)
    turned = np.searchsorted(T, 1.0)
    assert swing[turned + 4] == pytest.approx(static / design.K_t, rel=0.15)
    assert swing[turned + 100] < 0.0


def test_a_pulse_with_the_reset_time_is_a_step_of_the_current(designs: Path) -> None:
    """Coulomb friction alone: 2 F_c/K_t at each reversal, whatever the acceleration."""
    seed = Design.read(designs / "seed_motor.toml").without_effect("viscous")
    loop = seed.require_loops().speed
    table = pulses(seed)
    np.testing.assert_allclose(table[:, 1] * loop.K_p, 2.0 * 0.0213 / seed.K_t, rtol=1e-6)
    reading = read_sinumerik(table_files(seed)["seed_motor_friction_sinumerik.csv"], seed)
    found = reading(POSITION, SPEED, T)
    between = (T > 1.001) & (T < 1.999)
    np.testing.assert_allclose(found[between], -2.0 * 0.0213 / seed.K_t, rtol=1e-3)


def test_the_characteristic_of_the_pulses() -> None:
    """The manual's four ranges: up to a_1, level, down to a_3, level."""
    a = np.array([0.5, 1.0, 2.0, 4.0, 8.0])
    found = characteristic(np.column_stack([a, [0.5, 1.0, 1.0, 0.8, 0.6]]))
    assert found == (1.0, 2.0, 8.0, 1.0, 0.6)
    a1, a2, a3, high, low = characteristic(np.column_stack([a, np.ones(5)]))
    assert a1 < a2 < a3
    assert high == low == 1.0


def test_simulators_hold_coulomb_and_viscous_friction_exactly(designs: Path) -> None:
    seed = Design.read(designs / "seed_motor.toml")
    files = table_files(seed)
    joint = ElementTree.fromstring(files["seed_motor_mujoco.xml"]).find("worldbody/body/joint")
    dynamics = ElementTree.fromstring(files["seed_motor.urdf"]).find("joint/dynamics")
    assert joint is not None
    assert dynamics is not None
    isaac = tomllib.loads(files["seed_motor_isaaclab.toml"])
    for level, slope in (
        (joint.get("frictionloss"), joint.get("damping")),
        (dynamics.get("friction"), dynamics.get("damping")),
        (isaac["dynamic_friction"], isaac["viscous_friction"]),
    ):
        assert float(level or 0) == pytest.approx(0.0213, rel=1e-6)
        assert float(slope or 0) == pytest.approx(0.000168, rel=1e-6)
    assert float(joint.get("armature") or 0) == pytest.approx(9e-5)
    assert isaac["friction"] == pytest.approx(0.0213)


def test_what_a_simulator_loses_is_named(design: Design, files: dict[str, str]) -> None:
    found = joint_friction(design, friction_points(design)[0])
    assert found.lost == ("stribeck", "cogging")
    assert found.breakaway == pytest.approx(0.0313, rel=1e-6)
    assert 0.001 < found.missed < 0.05
    for name in ("low_speed_mujoco.xml", "low_speed.urdf", "low_speed_isaaclab.toml"):
        assert "Not held by this format: stribeck, cogging." in files[name]


def test_a_name_with_two_hyphens_stays_a_comment(designs: Path) -> None:
    """XML ends a comment at two hyphens, and a parser refuses them anywhere else in it."""
    files = table_files(Design.read(designs / "seed_motor.toml").replace(name="axis--1-"))
    for name in [name for name in files if name.endswith((".xml", ".urdf"))]:
        assert ElementTree.fromstring(files[name]).tag in ("mujoco", "robot")
        assert "axis- -1-" in files[name]


def test_a_constant_load_is_no_breakaway(designs: Path) -> None:
    """EMPS pulls with -3.16 N: its friction breaks away at 20.39 N in both directions."""
    emps = Design.read(designs / "emps.toml")
    table, _ = friction_points(emps)
    found = joint_friction(emps, table)
    assert found.breakaway == pytest.approx(20.39, rel=1e-6)
    assert found.lost == ("constant_load",)
    assert tomllib.loads(table_files(emps)["emps_isaaclab.toml"])["friction"] == pytest.approx(20.39, rel=1e-6)
    assert table[-1, 0] == 3.0  # m/s: nothing in the design limits its speed


def test_what_no_manual_has_confirmed_stands_in_the_file(files: dict[str, str]) -> None:
    for ending in ("frict_comp.lis", "friction_ax8000.csv", "cogging_ax8000.csv", "torque_over_angle.csv"):
        assert "Not confirmed with a manual" in files[f"low_speed_{ending}"].replace("\n# ", " ")
    assert "are not confirmed with a manual" in files["low_speed_friction_sinumerik.csv"].replace("\n# ", " ")


def test_the_phase_convention_of_cogging_stands_in_its_file(files: dict[str, str], design: Design) -> None:
    """The rows by the formula that the file states are the torque that the simulated drive has at every angle."""
    text = files["low_speed_cogging.csv"]
    assert "= amplitude sin(order theta + phase) is to be added to the drive's own, in both directions alike" in text
    assert not any("opposes the motion" in one for name, one in files.items() if "cogging" in name)
    rows = np.loadtxt(text.splitlines()[1:], delimiter=",", ndmin=2)
    theta = np.linspace(0.0, 2.0 * math.pi, 50)
    written = sum(a * np.sin(k * theta + phase) for k, a, phase, _ in rows)
    for angle, torque in zip(theta, written, strict=True):
        parts = (e.standing(v, theta=angle) for e, v in bound_effects(design) if e.id == "cogging")
        assert sum(parts) == pytest.approx(torque, abs=1e-12)
    assert "r sin(n theta + phi)" in files["low_speed_cogging_ax8000.csv"]


def test_a_simulators_joint_says_what_it_misses_on_a_log(design: Design) -> None:
    """Inverse dynamics of a log: the Stribeck effect and the cogging are in the error of the joint alone."""
    log = simulate(design, scenario("reversal", design, speed=10.0, cycles=4.0), seed=3)
    table, _ = friction_points(design)
    joint = joint_friction(design, table)
    found = errors_on_log(design, log, joint.level, joint.slope)
    assert found.full < 0.1
    assert found.joint == pytest.approx(np.hypot(found.full, found.apart), rel=0.05)
    own = compare(design, log).log.errors["torque"].relative
    assert found.full == pytest.approx(own, rel=1e-6)
    for name, text in table_files(design, [log]).items():
        if name.endswith(("_mujoco.xml", ".urdf", "_isaaclab.toml")):
            assert f"this joint errs by {100.0 * found.joint:.3g} %" in text
            assert f"that of the full model by {100.0 * found.full:.3g} %" in text
    plain = design.without_effect("stribeck").without_effect("cogging")
    same = errors_on_log(plain, log, *line_through(friction_points(plain)[0]))
    assert same.apart < 1e-4
    assert same.joint == pytest.approx(same.full, rel=1e-3)


def test_a_linear_axis_slides(designs: Path) -> None:
    files = table_files(Design.read(designs / "emps.toml"))
    (urdf,) = (text for name, text in files.items() if name.endswith(".urdf"))
    (mjcf,) = (text for name, text in files.items() if name.endswith("_mujoco.xml"))
    assert 'type="prismatic"' in ElementTree.tostring(ElementTree.fromstring(urdf), encoding="unicode")
    assert ElementTree.fromstring(mjcf).find("worldbody/body/joint[@type='slide']") is not None


def test_a_table_read_back_compensates_as_the_compensator_does(design: Design, files: dict[str, str]) -> None:
    motion = scenario("reversal", design, speed=2.0, frequency=1.0, cycles=1.0)
    readings = [read_friction_csv(files["low_speed_friction.csv"], design),
                read_torque_over_angle(files["low_speed_torque_over_angle.csv"], design)]  # fmt: skip
    fed = added_to(motion, lambda *given: np.sum([one(*given) for one in readings], axis=0), 2.5e-4)
    off = design.replace(compensation={"gain": 0.0})
    plain, table, own = (
        float(np.sqrt(np.mean((log["theta_ref"] - log["theta"]) ** 2)))
        for log in (simulate(off, motion), simulate(off, fed), simulate(design, motion))
    )
    assert table < 0.4 * plain
    assert table == pytest.approx(own, rel=0.1)


def test_waves_of_a_linear_axis_are_forces_and_no_harmonics_of_a_turn() -> None:
    design = linear_motor().design.with_effect("cogging", {"a_s": 3.0, "a_c": 4.0, "order": 196.35})
    files = table_files(design)
    header, first, *_ = files["slide_cogging.csv"].splitlines()
    assert header.startswith("order,amplitude [N],")
    assert [float(value) for value in first.split(",")[:2]] == pytest.approx([196.35, 5.0])
    assert not [name for name in files if "cogging_ax8000" in name or "over_angle" in name]
    assert "shaft" not in files["slide.urdf"]
