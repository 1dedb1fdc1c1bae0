"""The methods that simulate, on a measured axis: EMPS, whose authors publish their figures and their controller."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.identify import identify
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def drive(designs: Path) -> Design:
    """The axis with its authors' controller, 1 kHz, and a machine of the same force constant with fast currents."""
    data = Design.read(designs / "emps.toml").to_dict()
    K_t = data["motor"]["K_t"]
    data["motor"] = {"J": data["motor"]["J"], "p": 1, "psi_f": K_t / 1.5, "R": 1.0, "L_d": 1e-3, "L_q": 1e-3}
    data["drive"] = {"f_control": 16000.0, "speed_divider": 16, "u_dc": 1e5, "i_max": 10.0}
    data["sensor"] = {"log_divider": 16}
    data["loops"] = {
        "current": {"K_p": 4.0, "T_n": 1e-3},
        "speed": {"K_p": 243.45, "T_n": 1e9},  # kv in V s/m, no integral
        "position": {"K_v": 160.18, "velocity_feedforward": 0.0},  # kp in 1/s
    }
    return Design.from_dict(data)


@pytest.fixture(scope="module")
def record(measured: Callable[[str], Path], designs: Path) -> Log:
    return read_log(measured("emps/DATA_EMPS.mat"), Design.read(designs / "emps.toml"))


def test_instrumental_variables_find_the_authors_figures(drive: Design, record: Log) -> None:
    result = identify(drive, record, method="iv")
    print(result.summary())
    # Janot, Gautier, Brunot (2019): 95.11 kg, 203.5 N s/m, 20.39 N, -3.16 N
    for name, published in (("J", 95.11), ("F_v", 203.5), ("F_c", 20.39), ("T_0", -3.16)):
        estimate = result.estimates[name]
        assert abs(estimate.value - published) < 1.5 * estimate.stderr, name
    assert result.estimates["J"].stderr < 0.3
    assert not result.unidentifiable


def test_output_error_is_near_the_authors_figures_although_its_current_loop_is_guessed(
    drive: Design, record: Log
) -> None:
    result = identify(drive, record, method="output_error")
    print(result.summary())
    assert result.estimates["F_c"].value == pytest.approx(20.39, abs=2.0 * result.estimates["F_c"].stderr)
    # 1.4 % low as long as the drive signal was taken for sampled with the position
    assert result.estimates["J"].value == pytest.approx(95.11, rel=0.01)
    assert result.timing.late < -0.1e-3  # the logged voltage is a command
