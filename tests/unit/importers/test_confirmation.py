"""A doubted unit or sign is refused until the mapping states the unit; a minus turns the sign; angles unwrap."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import read_log, require_confirmed
from pmsm_ctrl.importers.confirmation import of_written
from pmsm_ctrl.importers.wraps import unwrapped, wrap_period
from pmsm_ctrl.log import Log
from tests.effort import seeds
from tests.unit.plausibility.drives import believed, drawn


def written(folder: Path, log: Log, **changed: np.ndarray) -> str:
    return str(log.with_channels(**changed).write_csv(folder / "log.csv"))


def refused(path: str, **mapping: str) -> str:
    log = read_log(path, believed(), mapping)
    try:
        require_confirmed(log, believed(), mapping)
    except LogError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("seed", seeds(3, 4))
def test_a_speed_in_rpm_has_to_be_stated(tmp_path: Path, seed: int) -> None:
    log = drawn(seed)
    speed = np.gradient(log["theta"], log.t)
    path = written(tmp_path, log, omega=speed * 30.0 / math.pi)
    assert "omega looks like rpm read as rad/s" in refused(path)
    assert refused(path, omega="omega [rpm]") == ""
    np.testing.assert_allclose(read_log(path, believed(), {"omega": "omega [rpm]"})["omega"], speed, rtol=1e-9)
    assert refused(path, omega="omega [rad/s]") == ""  # confirmed
    assert refused(written(tmp_path, log, omega=speed)) == ""


@pytest.mark.parametrize("seed", seeds(3, 4))
def test_a_minus_turns_the_sign_of_a_current(tmp_path: Path, seed: int) -> None:
    log = drawn(seed)
    path = written(tmp_path, log, i_q=-log["i_q"])
    assert "--map i_q='-COLUMN [A]' turns its sign" in refused(path)
    assert refused(path, i_q="-i_q [A]") == ""
    np.testing.assert_array_equal(read_log(path, believed(), {"i_q": "-i_q [A]"})["i_q"], log["i_q"])


@pytest.mark.parametrize("factor", ["0.5", "-2", "1e-1", "1.5E+1"])
def test_a_factor_may_stand_before_a_column(tmp_path: Path, factor: str) -> None:
    log = drawn(3, seconds=2.0)
    path = written(tmp_path, log)
    found = read_log(path, believed(), {"u_q": f"{factor} * u_q [V]", "u_d": f"{factor}*u_d"})
    np.testing.assert_allclose(found["u_q"], float(factor) * log["u_q"], rtol=1e-12)
    np.testing.assert_allclose(found["u_d"], float(factor) * log["u_d"], rtol=1e-12)


def test_a_column_may_begin_with_a_minus(tmp_path: Path) -> None:
    log = drawn(3, seconds=2.0)
    rows = np.column_stack([log.t, log["theta"], log["i_q"]])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t [s],theta [rad],-I [A]", comments="")
    found = read_log(tmp_path / "log.csv", believed(), {"i_q": "-I [A]"})
    np.testing.assert_allclose(found["i_q"], log["i_q"], rtol=1e-12)


@pytest.mark.parametrize("period", [25.0, 2.0 * math.pi / 5.0, 1.0, 2.0 * math.pi])
@pytest.mark.parametrize("seed", [3, 4, 5])
def test_an_angle_is_unwrapped_by_its_own_period(period: float, seed: int) -> None:
    theta = drawn(seed)["theta"] / 10.0 * max(period, 1.0)
    wrapped = np.mod(theta, period)
    found = wrap_period(wrapped, 5)
    assert found == pytest.approx(period, rel=1e-6)
    np.testing.assert_allclose(unwrapped(wrapped, found) - wrapped[0], theta - theta[0], atol=1e-6 * np.ptp(theta))


def test_what_does_not_wrap_is_left_alone(tmp_path: Path) -> None:
    theta = drawn(3)["theta"]
    assert wrap_period(theta) == 0.0
    assert wrap_period(theta + 40.0 * (np.arange(theta.size) > 5000)) == 0.0  # one jump is a reset
    assert wrap_period(np.zeros(100)) == 0.0
    assert wrap_period(np.random.default_rng(1).standard_normal(1000)) == 0.0
    found = read_log(written(tmp_path, drawn(3), theta=np.mod(theta, 25.0)), believed())
    np.testing.assert_allclose(np.diff(found["theta"]), np.diff(theta), atol=1e-9)
    assert [notice.code for notice in found.provenance.notices] == ["angle_unwrapped"]


@pytest.mark.parametrize(("gain", "unit"), [(1e3, "ms"), (1e6, "us")])
def test_a_wrong_unit_of_time_is_told_as_that(tmp_path: Path, gain: float, unit: str) -> None:
    log = drawn(3)
    path = written(tmp_path, log, t=gain * log.t, omega=np.gradient(log["theta"], log.t))
    said = refused(path)
    assert f"t looks like {unit} read as s; --map t='COLUMN [{unit}]' corrects the unit" in said
    assert refused(path, t=f"t [{unit}]") == ""


def test_what_is_written_is_read_as_it_was_confirmed(tmp_path: Path) -> None:
    log = drawn(3)
    path = written(tmp_path, log, i_q=-log["i_q"])
    doubted = read_log(path, believed())
    assert of_written(doubted, believed(), {}) == ("", ["i_q=-i_q [A]"])
    assert of_written(doubted, believed(), {"i_q": "i_q [A]"}) == ("", ["i_q=i_q [A]"])
    speed = np.gradient(log["theta"], log.t)
    doubted = read_log(written(tmp_path, log, omega=speed * 30.0 / math.pi), believed())
    assert of_written(doubted, believed(), {})[0] == "omega"
    assert of_written(doubted, believed(), {"omega": "omega [rad/s]"}) == ("", ["omega=omega [rad/s]"])
    assert of_written(read_log(written(tmp_path, log, omega=speed), believed()), believed(), {}) == ("", [])


def test_the_command_after_an_import_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log = drawn(3, seconds=4.0)
    monkeypatch.chdir(tmp_path)
    believed().write("d.toml")
    written(tmp_path, log, i_q=-log["i_q"])
    assert run(app, ["import", "log.csv", "--design", "d.toml", "--output", "new.csv"]) == 0
    follows = capsys.readouterr().out.strip().splitlines()[-1].removeprefix("next: pmsm-ctrl ")
    assert follows == "compare new.csv --design d.toml --map 'i_q=-i_q [A]'"
    assert refused("new.csv") != ""
    assert refused("new.csv", i_q="-i_q [A]") == ""
