"""Columns that no channel needs: they are left out with a word, and block no file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from pmsm_ctrl.cli import main
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import describe, open_table, propose, read_log

T = 1e-3 * np.arange(300)
THETA = 50.0 * np.sin(20.0 * T)
SPEED = np.gradient(THETA, T)
COMPLETE = {"t": "t [s]", "omega": "speed [rad/s]", "i_q": "iq [A peak]"}


def table(path: Path, header: str, cells: list[str]) -> Path:
    """Write a motion and a last column of these cells."""
    rows = [f"{t:.4f},{th:.5f},{-th:.5f},{cells[k]}\n" for k, (t, th) in enumerate(zip(T, THETA, strict=True))]
    path.write_text(f"Time [s],Position [rad],{header}\n" + "".join(rows))
    return path


def mat(path: Path, **content: np.ndarray) -> Path:
    scipy.io.savemat(path, content)
    return path


def codes(log: object) -> list[str]:
    return [notice.code for notice in log.provenance.notices]  # type: ignore[attr-defined]


def test_an_empty_cell_of_a_temperature_leaves_it_out(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "Iq [A peak],Temp [C]", ["25.1", "", *["25.2"] * 298])
    log = read_log(path)
    assert list(log) == ["t", "theta", "i_q"]
    (notice,) = (notice for notice in log.provenance.notices if notice.code == "channel_without_numbers")
    assert "temperature is left out: cells without a number: 1, first line 3, column 4" in notice.text
    with pytest.raises(LogError, match="line 3, column 4"):  # it was asked for
        read_log(path, mapping={"temperature": "Temp [C]"})


def test_an_empty_cell_of_a_measured_channel_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"line 5, column 4 .*empty or not a number"):
        read_log(table(tmp_path / "log.csv", "x,Iq [A peak]", ["1.0"] * 3 + [""] + ["1.0"] * 296))


@pytest.mark.parametrize("row", [0, 150])
def test_a_remark_among_empty_cells(tmp_path: Path, row: int) -> None:
    cells = [""] * 300
    cells[row] = "note, see sheet" if row else "start"
    path = table(tmp_path / "log.csv", "Iq [A peak],Remark", [f'"{cell}"' if cell else "" for cell in cells])
    log = read_log(path)
    assert len(log) == 300
    assert "text columns not used: 'Remark'" in log.provenance.notes


def test_a_word_far_down_in_a_column_of_numbers_that_is_not_used(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "denryu,Status word", ["7"] * 290 + ["n/a"] * 10)
    proposal = propose(open_table(path))
    assert ("Status word", "cells that hold no number") in proposal.unused
    assert len(read_log(path, mapping=proposal.mapping)) == 300
    with pytest.raises(LogError, match="line 292, column 4"):
        read_log(path, mapping={**proposal.mapping, "temperature": "Status word [degC]"})


@pytest.mark.parametrize("names", [("t", "t_slow"), ("fast_time", "time_slow")])
def test_two_time_bases_of_a_mat_file(tmp_path: Path, names: tuple[str, str]) -> None:
    vectors = {names[1]: T[::10], "temp": 20.0 + T[::10], names[0]: T, "pos_rad": THETA, "iq_A": -THETA}
    path = mat(tmp_path / "log.mat", **vectors)
    proposal = propose(open_table(path))
    assert proposal.mapping["t"] == f"{names[0]} [s]"
    log = read_log(path, mapping=proposal.mapping)
    np.testing.assert_allclose(log["temperature"], 20.0 + log.t)
    assert "not_readable" not in codes(log)


def test_a_vector_that_is_too_short(tmp_path: Path) -> None:
    path = mat(tmp_path / "log.mat", t=T, speed=SPEED, pos=THETA[:-5], iq=-THETA)
    with pytest.raises(LogError, match="'pos' has no time column of its own, and no other one has its 295 samples"):
        read_log(path)
    log = read_log(path, mapping=COMPLETE)
    assert "theta" not in log
    assert "channel_without_time" in codes(log)
    proposal = propose(open_table(path))
    assert ("pos", "295 samples, and no time has as many") in proposal.unused
    assert proposal.complete
    with pytest.raises(LogError, match="or a mapping without theta"):
        read_log(path, mapping=COMPLETE | {"theta": "pos [rad]"})


def test_cells_without_a_number_in_the_only_current_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    current = -THETA
    current[100:103] = np.nan
    path = mat(tmp_path / "log.mat", t_s=T, ichi=THETA, iq_A=current)
    (notice,) = (notice for notice in propose(open_table(path)).notices if notice.code == "column_with_gaps")
    assert "'iq_A' would be i_q, and cells of it hold no number: 3, first variable 'iq_A', sample 101" in notice.text
    with pytest.raises(SystemExit) as left:
        main(["import", str(path)])
    assert left.value.code == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert "sample 101" in last
    assert "COLUMN" not in last


def test_the_only_current_is_too_short(tmp_path: Path) -> None:
    path = mat(tmp_path / "log.mat", t_s=T, ichi=THETA, iq_A=-THETA[:-5])
    (notice,) = (notice for notice in propose(open_table(path)).notices if notice.code == "column_without_time")
    assert "'iq_A' would be i_q, and has 295 samples, as many as no time" in notice.text


def test_a_unit_behind_in_and_a_lage(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f"{1e6 * t:.0f};{th:.4f};{-th:.4f}\n" for t, th in zip(T, THETA, strict=True))
    path.write_text("Zeit in µs;Lage in °;I_q in A\n" + rows, encoding="utf-8")
    log = read_log(path)
    np.testing.assert_allclose(log.t, T)
    np.testing.assert_allclose(log["theta"], np.deg2rad(THETA), atol=1e-5)


def test_a_column_that_may_be_what_is_missing(tmp_path: Path) -> None:
    path = table(tmp_path / "log.csv", "Iq [A peak],Kaitensu [rpm],Sokudo [counts/s]", ["1.0,2.0,3.0"] * 300)
    said = " | ".join(describe(path).remarks)
    assert "Sokudo [counts/s]: may be omega, which the log does not have; --map omega='FACTOR * Sokudo [rad/s]'" in said
    assert "Kaitensu [rpm]: may be omega, which the log does not have; --map omega='Kaitensu [rpm]' reads it" in said
