"""A sampling period or rate above the numbers is the rate of a file that has no time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.importers import open_table, propose, read_log
from pmsm_ctrl.importers.header_rate import header_period

K = np.arange(2000)


def written(path: Path, *above: str, head: str = "Speed [rpm];Torque [N m]", first: np.ndarray | None = None) -> Path:
    columns = [500.0 * np.sin(0.003 * K) + 0.1 * (K % 7), 0.3 * np.cos(0.003 * K) + 0.001 * (K % 5)]
    columns = columns if first is None else [first, *columns]
    rows = [";".join(f"{value:.6g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join(["Device;X", *above, head, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("line", "seconds", "assumed"),
    [
        ("SamplePeriod;0.0005", 5e-4, "s"), ("SamplePeriod;0.5", 5e-4, "ms"), ("Sampling time,1.000 ms", 1e-3, ""),
        ("Sample rate: 8 kHz", 1.25e-4, ""), ("SamplingFrequency;2000", 5e-4, ""),
        ("Abtastzeit [µs];62,5", 6.25e-5, ""), ("Abtastrate = 4000 Hz", 2.5e-4, ""),
        ('"Sample Interval","0.25","ms"', 2.5e-4, ""),
        ("# sample_time [s]: 1e-3", 1e-3, ""), ("Période d'échantillonnage : 2 ms", 2e-3, ""),
        ("Tempo di campionamento;1;ms", 1e-3, ""), ("SampleTime[ms]\t2.0", 2e-3, ""),
    ],
)  # fmt: skip
def test_a_line_that_states_it(line: str, seconds: float, assumed: str) -> None:
    found = header_period(["Device X", line])
    assert found is not None
    assert found.seconds == pytest.approx(seconds, rel=1e-12)
    assert found.assumed == assumed


@pytest.mark.parametrize(
    "line",
    ["Samples;2000", "SampleTime[ms];Speed [rpm]", "Sampling time", "Sample period: 0 ms", "Sampling rate: 5 V", "",
     "Resampling time 3 ms", "Sample period: 5 rad", "Cycle time 0.125 ms", "No sample rate"],
)  # fmt: skip
def test_a_line_that_states_none(line: str) -> None:
    assert header_period([line]) is None


def test_a_stated_period_is_the_time_of_a_file_without_one(tmp_path: Path) -> None:
    log = read_log(written(tmp_path / "a.csv", "Sampling time;0.5 ms"))
    np.testing.assert_allclose(log.t, 5e-4 * K, rtol=1e-12)
    assert any("the header says 'Sampling time;0.5 ms'" in note for note in log.provenance.notes)
    assert "header_period" not in [one.code for one in log.provenance.notices]


def test_a_period_without_a_unit_is_proposed_with_a_doubt(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path / "a.csv", "SamplePeriod;0.0005")
    found = propose(open_table(path))
    assert found.complete
    assert found.mapping["t"] == "every 0.5 ms"
    assert next(one for one in found.notices if one.code == "unit_assumed").detail["channels"] == ["t"]
    assert run(app, ["import", str(path)]) == 2
    assert "SamplePeriod" in capsys.readouterr().out
    assert run(app, ["import", str(path), "--yes", "--output", str(tmp_path / "si.csv")]) == 0
    np.testing.assert_allclose(read_log(tmp_path / "si.csv").t, 5e-4 * K, rtol=1e-9)


def test_it_is_the_period_of_a_count_of_samples(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "Abtastrate: 2 kHz", head="tick;Speed [rpm];Torque [N m]", first=K)
    np.testing.assert_allclose(read_log(path, mapping=propose(open_table(path)).mapping).t, 5e-4 * K, rtol=1e-9)


@pytest.mark.parametrize(("step", "doubted"), [(5e-4, False), (1e-3, True)])
def test_a_time_column_that_contradicts_it_is_doubted(tmp_path: Path, step: float, doubted: bool) -> None:
    head = "Time [s];Speed [rpm];Torque [N m]"
    path = written(tmp_path / "a.csv", "Sampling time;0.5 ms", head=head, first=step * K)
    log = read_log(path)
    np.testing.assert_allclose(log.t, step * K, rtol=1e-6)
    said = [one.text for one in log.provenance.notices if one.code == "header_period"]
    assert said == ["the header says 'Sampling time;0.5 ms', and the time of the log has steps of 1 ms"] * doubted


def test_what_a_person_states_comes_first(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "Sampling time;0.5 ms")
    np.testing.assert_allclose(read_log(path, mapping={"t": "every 2 ms"}).t, 2e-3 * K, rtol=1e-12)
