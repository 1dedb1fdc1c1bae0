"""Of two columns of one quantity one is measured: names decide, then noise and time; where nothing does, it is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import open_table, propose, read_log
from pmsm_ctrl.importers.proposal import Proposal
from pmsm_ctrl.importers.rivals import measured_one
from pmsm_ctrl.importers.vocabulary import meaning_of, says_reference

N, PERIOD = 6000, 1e-3
T = PERIOD * np.arange(N)
LATE = 4  # samples by which the axis follows


def ramps(t: np.ndarray) -> np.ndarray:
    """Plateaus joined by ramps, rad/s: without noise, with corners."""
    steps = [0.0, 40.0, 40.0, -30.0, -30.0, 80.0, 80.0, 0.0, 0.0, -60.0, -60.0, 20.0, 20.0]
    return np.interp(t, np.arange(len(steps)) * 0.5, steps)


@pytest.fixture(scope="module")
def axis() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(5)
    omega = np.convolve(ramps(np.concatenate((T, T[-1] + T[1:40])) - LATE * PERIOD), np.ones(9) / 9, "same")[:N]
    theta = np.concatenate(([0.0], np.cumsum(0.5 * PERIOD * (omega[1:] + omega[:-1]))))
    i_q = 0.01 * np.gradient(omega, PERIOD) + 0.1 * np.sign(omega) + 0.001 * omega
    noise = rng.normal(0.0, 1.0, (2, N))
    return {"ref": ramps(T), "omega": omega + 0.02 * noise[0], "theta": theta, "i_q": i_q + 0.01 * noise[1]}


def proposed(path: Path, head: str, *columns: np.ndarray) -> Proposal:
    rows = [",".join(f"{value:.6f}" for value in row) for row in zip(T, *columns, strict=True)]
    path.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    return propose(open_table(path))


def test_a_reference_of_ramps_is_no_measured_speed(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    head = "t [s],CH1 [rad/s],CH2 [rad/s],CH3 [A peak]"
    found = proposed(tmp_path / "a.csv", head, axis["ref"], axis["omega"], axis["i_q"])
    assert (found.mapping["omega"], found.mapping["omega_ref"]) == ("CH2 [rad/s]", "CH1 [rad/s]")
    head = "t [s],CH1 [rad/s],CH2 [rad/s],CH3 [rad],CH4 [A peak]"
    found = proposed(tmp_path / "b.csv", head, axis["omega"], axis["ref"], axis["theta"], axis["i_q"])
    assert (found.mapping["omega"], found.mapping["omega_ref"]) == ("CH1 [rad/s]", "CH2 [rad/s]")


def test_a_filtered_copy_fits_as_well_and_is_named(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    filtered = np.convolve(axis["omega"], np.ones(12) / 12)[:N]
    head = "t [s],CH1 [rad/s],CH2 [rad/s],CH3 [A peak]"
    found = proposed(tmp_path / "a.csv", head, filtered, axis["omega"], axis["i_q"])
    assert found.mapping["omega"] == "CH2 [rad/s]"
    assert "omega_ref" not in found.mapping
    (doubt,) = [notice for notice in found.notices if notice.code == "two_columns_fit"]
    assert "--map omega='CH1 [rad/s]'" in doubt.text


def test_of_two_columns_of_one_name_the_first_may_be_the_reference(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    head = "t [s],Speed Actual [rad/s],Position Actual [rad],Iq [A peak],Speed Actual [rad/s]"
    found = proposed(tmp_path / "a.csv", head, axis["ref"], axis["theta"], axis["i_q"], axis["omega"])
    assert (found.mapping["omega"], found.mapping["omega_ref"]) == ("#5 [rad/s]", "#2 [rad/s]")
    assert "several_columns" in [notice.code for notice in found.notices]
    with pytest.raises(LogError, match="'omega'; name it by its number: #2 or #5"):
        read_log(tmp_path / "a.csv")


def test_a_speed_that_leads_the_position_is_doubted(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    head = "t [s],omega [rad/s],theta [rad],i_q [A]"
    for speed, doubted in (("ref", True), ("omega", False)):
        proposed(tmp_path / "a.csv", head, axis[speed], axis["theta"], axis["i_q"])
        codes = [notice.code for notice in read_log(tmp_path / "a.csv").provenance.notices]
        assert ("speed_leads" in codes) == doubted


def test_what_nothing_tells_apart_has_no_reason(axis: dict[str, np.ndarray]) -> None:
    other = axis["omega"] + np.random.default_rng(6).normal(0.0, 0.02, N)
    assert measured_one((axis["omega"], other)).reason == ""
    assert measured_one((axis["ref"], axis["omega"])).measured == 1
    assert measured_one((axis["omega"], axis["ref"])).measured == 0


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("速度", "omega"), ("速度指令", "omega_ref"), ("速度指令値", "omega_ref"), ("位置", "theta"),
        ("q軸電流", "i_q"), ("時間", "t"), ("トルク", "torque"), ("位置偏差", None),
        ("速度フィードバック", "omega"), ("回転数", "omega"),
    ],
)  # fmt: skip
def test_written_japanese(name: str, channel: str | None) -> None:
    found = meaning_of(name)
    assert (found.channel if found is not None else None) == channel
    assert says_reference(name) == ("指令" in name)


def test_of_two_currents_the_one_that_accelerates_the_axis(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    ripple, head = 0.01 * np.sin(np.arange(N)), "Time [s],Speed [rad/s],Current 1 [A],Current 2 [A]"
    found = proposed(tmp_path / "a.csv", head, axis["omega"], ripple, axis["i_q"])
    assert found.mapping["i_q"] == "Current 2 [A]"
    assert dict(found.unused)["Current 1 [A]"].startswith("i_q as well; acceleration and friction explain")
    (doubt,) = [notice for notice in found.notices if notice.code == "unsure_name"]
    assert doubt.detail["column"] == "Current 2 [A]"
    found = proposed(tmp_path / "b.csv", head, axis["omega"], axis["i_q"], ripple)
    assert found.mapping["i_q"] == "Current 1 [A]"
    again = axis["i_q"] + np.random.default_rng(9).normal(0.0, 0.01, N)
    found = proposed(tmp_path / "c.csv", head, axis["omega"], axis["i_q"], again)
    assert "two_columns_fit" in [notice.code for notice in found.notices]
