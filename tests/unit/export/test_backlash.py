"""Backlash from the encoders of motor and load: against the gap that was simulated."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design, Log
from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.export.backlash import Backlash, backlash_files, measured_backlash
from pmsm_ctrl.simulate import Scenario, scenario, simulate

GAP, COUNTS = 0.01, 2**17
PLAY = {"gap": GAP, "J_load": 4e-5, "k": 100.0, "d": 0.02}


@pytest.fixture(scope="module")
def seed(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


def with_friction(motion: Scenario, torque: float) -> Scenario:
    """Return a motion under dry friction of the load: the flank is then that of the direction of motion."""

    def references(t: np.ndarray) -> Mapping[str, np.ndarray]:
        given = motion.references(t)
        return {**given, "T_load": torque * np.sign(given["omega_ref"])}

    return replace(motion, references=references)


def measured(log: Log) -> Log:
    """Return a log as an encoder of the load would have it, in place of the true angle."""
    step = 2.0 * np.pi / COUNTS
    channels = {name: log[name] for name in ("t", "theta", "omega", "i_q")}
    return Log(channels | {"theta_load": step * np.floor(log["theta_load"] / step + 0.5)})


@pytest.fixture(scope="module")
def dragged(seed: Design) -> Log:
    motion = with_friction(scenario("reversal", seed, speed=4.0, cycles=4.0), 0.02)
    return measured(simulate(seed, motion, truth=seed.with_effect("backlash", PLAY), seed=1, keep_truth=True))


@pytest.fixture(scope="module")
def pushed(seed: Design) -> Log:
    motion = scenario("reversal", seed, speed=20.0, cycles=4.0)
    return measured(simulate(seed, motion, truth=seed.with_effect("backlash", PLAY), seed=2, keep_truth=True))


def test_a_load_with_friction_lies_on_the_flank_of_its_direction(dragged: Log) -> None:
    found = measured_backlash([dragged])
    assert isinstance(found, Backlash)
    # the contact gives way under the friction of the load: 2 F/k
    assert found.width == pytest.approx(GAP + 2.0 * 0.02 / 100.0, rel=0.02)
    assert abs(found.width - GAP - 2.0 * 0.02 / 100.0) < 3.0 * found.stderr < 0.02 * GAP
    assert found.leading > 0.95
    assert found.follows_direction
    assert found.changes >= 7


def test_a_load_without_friction_lies_on_the_flank_of_its_acceleration(pushed: Log) -> None:
    found = measured_backlash([pushed])
    assert isinstance(found, Backlash)
    assert found.width == pytest.approx(GAP, rel=0.05)
    assert not found.follows_direction


def test_the_fields_are_those_of_the_manuals(seed: Design, dragged: Log, pushed: Log) -> None:
    """In degrees at the load, and in 0.0001 deg: MD32450 and P-AXIS-00103."""
    geared = seed.replace(load={"gear": 5.0})
    found = measured_backlash([dragged])
    assert isinstance(found, Backlash)
    text = backlash_files(geared, [dragged])["seed_motor_backlash.csv"]
    rows = {row[0]: row for row in csv.reader(text.splitlines()) if not row[0].startswith("#")}
    degrees = np.degrees(found.width) / 5.0
    assert float(rows["MD32450"][2]) == pytest.approx(degrees, rel=1e-5)
    assert rows["MD32450"][3] == "deg"
    assert int(rows["P-AXIS-00103"][2]) == round(1e4 * degrees)
    assert "5 motor turns a turn" in text
    assert "Not confirmed with a manual" in text
    assert "follows" not in text
    assert "here the flank follows the torque" in backlash_files(seed, [pushed])["seed_motor_backlash.csv"].replace(
        "\n# ", " "
    )


def test_a_spring_without_play_has_no_flanks(seed: Design) -> None:
    spring = seed.with_effect("compliance", {"J_load": 4e-5, "k": 15.0, "d": 0.002})
    log = simulate(seed, scenario("reversal", seed, speed=20.0, cycles=4.0), truth=spring, seed=1, keep_truth=True)
    assert "within 3 of their steps" in str(measured_backlash([measured(log)]))
    assert "within 3 of" in backlash_files(seed, [measured(log)])["seed_motor_backlash_not_exported.txt"]


def test_noise_between_the_encoders_has_no_flanks(dragged: Log, rng: np.random.Generator) -> None:
    """Cut into halves, noise has two means as well; the samples between them tell it from flanks."""
    noisy = dragged.with_channels(theta_load=dragged["theta"] + rng.normal(0.0, 2e-3, len(dragged)))
    assert "no two flanks" in str(measured_backlash([noisy]))


def test_a_single_direction_does_not_tell(seed: Design, dragged: Log) -> None:
    half = dragged.slice(100, 900)
    assert "within 3 of their steps" in str(measured_backlash([half]))
    assert "no log has theta and theta_load" in str(
        measured_backlash([Log({k: half[k] for k in ("t", "theta", "i_q")})])
    )
    assert backlash_files(seed, [Log({k: half[k] for k in ("t", "theta", "i_q")})]) == {}


def test_a_position_loop_that_knows_the_backlash_moves_the_load(seed: Design) -> None:
    """The exported value read back: half of it is added to the reference in the direction of motion."""
    truth = seed.with_effect("backlash", PLAY)
    motion = with_friction(scenario("reversal", seed, speed=4.0, cycles=4.0), 0.02)
    plain = simulate(seed, motion, truth=truth, seed=1, keep_truth=True)
    text = backlash_files(seed, [measured(plain)])["seed_motor_backlash.csv"]
    value = next(float(row[2]) for row in csv.reader(text.splitlines()) if row[0] == "MD32450")

    def references(t: np.ndarray) -> Mapping[str, np.ndarray]:
        given = motion.references(t)
        return {**given, "theta_ref": given["theta_ref"] + 0.5 * np.radians(value) * np.sign(given["omega_ref"])}

    moved = simulate(seed, replace(motion, references=references), truth=truth, seed=1, keep_truth=True)
    wanted = motion.references(plain.t)["theta_ref"]
    moving = np.abs(motion.references(plain.t)["omega_ref"]) > 1.0
    before, after = (float(np.sqrt(np.mean((wanted - log["theta_load"])[moving] ** 2))) for log in (plain, moved))
    assert before == pytest.approx(0.5 * np.radians(value), rel=0.1)
    assert after < 0.2 * before


def test_the_command_takes_logs_for_the_tables(
    seed: Design, dragged: Log, designs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, folder = tmp_path / "log.csv", tmp_path / "axis"
    dragged.write_csv(log)
    design = str(designs / "seed_motor.toml")
    assert run(app, ["export", design, "-l", "c", "--log", str(log), "-o", str(tmp_path / "x.c")]) == 2
    assert "the tables need a folder" in capsys.readouterr().err
    assert run(app, ["export", design, "-l", "c", "--log", str(log), "-o", str(folder)]) == 0
    assert (folder / "seed_motor_backlash.csv").exists()
    assert "On log.csv the drive torque of this joint errs by" in (folder / "seed_motor.urdf").read_text()
