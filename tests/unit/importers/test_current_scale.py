"""A current in A, peak or rms: doubted where nothing tells, and not where the file, a mapping or the axis tells."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import open_table, propose, read_log
from pmsm_ctrl.section import Notice

J, K_T = 2e-4, 0.5
T = 1e-3 * np.arange(6000)
RATES, SIZES = (3.0, 7.0), (30.0, 12.0)
OMEGA = sum(a * np.sin(r * T) for a, r in zip(SIZES, RATES, strict=True))
ALPHA = sum(a * r * np.cos(r * T) for a, r in zip(SIZES, RATES, strict=True))
TORQUE = J * ALPHA + 0.02 * np.sign(OMEGA) + 2e-4 * OMEGA


def design(inertia: float | str = J, **log: object) -> Design:
    return Design.from_dict({"motor": {"J": inertia, "K_t": K_T}, "log": log})


def written(folder: Path, name: str, gain: float = 1.0, torque: float = 0.0) -> Path:
    """Write a log in the manner of a drive; the current is `gain` times its peak."""
    rng = np.random.default_rng(7)
    columns = [T, OMEGA, gain * TORQUE / K_T + rng.normal(0.0, 1e-3, T.size)]
    head = f"t [s],Speed [rad/s],{name}"
    if torque:
        columns.append(torque * TORQUE + rng.normal(0.0, 1e-3, T.size))
        head += ",Torque [N m]"
    path = folder / "a.csv"
    np.savetxt(path, np.column_stack(columns), fmt="%.7g", delimiter=",", header=head, comments="")
    return path


def doubt(notices: tuple[Notice, ...]) -> Notice | None:
    return next((one for one in notices if one.code == "peak_or_rms"), None)


@pytest.mark.parametrize("name", ["Iq [A]", "Iq (A)", "iq [mA]"])
def test_a_current_that_nothing_explains_is_doubted(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name)
    found = doubt(read_log(path).provenance.notices)
    assert found is not None
    assert "[A rms]" in found.text
    assert doubt(read_log(path, design("unknown")).provenance.notices) is not None


@pytest.mark.parametrize("name", ["i_q [A]", "Iq [A rms]", "Iq [Apk]", "Iq Spitze [A]", "I_q peak [A]"])
def test_a_file_that_says_it_is_not_doubted(tmp_path: Path, name: str) -> None:
    assert doubt(read_log(written(tmp_path, name), mapping={"i_q": "#3"}).provenance.notices) is None


@pytest.mark.parametrize("name", ["Iq rms [A]", "Iq_eff [A]", "Strom Iq Effektivwert [A]"])
def test_a_name_that_says_rms_is_heard(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, name)
    found = doubt(read_log(path, mapping={"i_q": "#3"}).provenance.notices)
    assert found is not None
    assert found.text.endswith("the name says rms")
    proposed = propose(open_table(path)).mapping
    assert proposed["i_q"].endswith("[A rms]")
    np.testing.assert_allclose(read_log(path, mapping=proposed)["i_q"], 2**0.5 * TORQUE / K_T, atol=0.01)


@pytest.mark.parametrize(
    ("stated", "mapping"),
    [
        (design("unknown", channels={"t": "t", "omega": "Speed", "i_q": "Iq [A]"}), None),
        (design("unknown", channels={"t": "t", "omega": "Speed", "i_q": "Iq"}, scale={"i_q": 1.0}), None),
        (None, {"i_q": "Iq [A rms]"}),
        (None, {"i_q": "1.4142 * Iq"}),
    ],
)
def test_a_mapping_that_says_it_is_not_doubted(
    tmp_path: Path, stated: Design | None, mapping: dict[str, str] | None
) -> None:
    assert doubt(read_log(written(tmp_path, "Iq [A]"), stated, mapping).provenance.notices) is None


def test_a_mapping_without_a_unit_says_nothing(tmp_path: Path) -> None:
    assert doubt(read_log(written(tmp_path, "Iq [A]"), mapping={"i_q": "Iq"}).provenance.notices) is not None


def test_the_inertia_of_the_design_tells(tmp_path: Path) -> None:
    assert doubt(read_log(written(tmp_path, "Iq [A]"), design()).provenance.notices) is None
    found = doubt(read_log(written(tmp_path, "Iq [A]", gain=math.sqrt(0.5)), design()).provenance.notices)
    assert found is not None
    assert found.text.endswith("in A rms the inertia would be that of the design")
    found = doubt(read_log(written(tmp_path, "Iq [A]"), design(0.6 * J)).provenance.notices)
    assert found is not None
    assert "inertia would be" not in found.text


@pytest.mark.parametrize(("gain", "factor"), [(1.0, None), (math.sqrt(0.5), math.sqrt(2.0))])
def test_a_torque_in_the_log_tells(tmp_path: Path, gain: float, factor: float | None) -> None:
    path = written(tmp_path, "Iq [A]", gain=gain, torque=1.0)
    notices = read_log(path, design("unknown")).provenance.notices
    assert doubt(notices) is None
    said = [one for one in notices if one.code == "torque_factor"]  # which says of what it is off by 1.41
    assert bool(said) == (factor is not None)
    if factor is not None:
        assert said[0].detail["factor"] == pytest.approx(factor, rel=0.02)
        assert "A rms read as A peak" in said[0].text


def test_a_proposal_states_the_doubt_that_taking_it_settles(tmp_path: Path) -> None:
    found = propose(open_table(written(tmp_path, "Strom Iq [A]")))
    assert doubt(found.notices) is not None
    assert doubt(read_log(tmp_path / "a.csv", mapping=found.mapping).provenance.notices) is None


@pytest.mark.parametrize("size", [1e300, 1.7e308, 5e-324])
def test_numbers_of_any_size_are_no_error(tmp_path: Path, size: float) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{k},{(k % 7 - 3) * 1e300},{(-1) ** k * size}\n" for k in range(200))
    path.write_text("t [s],Speed [rad/s],Iq [A]\n" + rows, encoding="utf-8")
    assert doubt(read_log(path, design()).provenance.notices) is not None
    path.write_text("t [s],omega [rad/s],i_q [A]\n" + rows, encoding="utf-8")
    assert doubt(read_log(path, design()).provenance.notices) is None


def test_a_proposal_that_takes_rms_by_the_name_does_not_doubt_it(tmp_path: Path) -> None:
    found = propose(open_table(written(tmp_path, "i_eff", 1.0 / math.sqrt(2.0))))
    assert found.mapping["i_q"] == "i_eff [A rms]"
    assert doubt(tuple(found.notices)) is None
