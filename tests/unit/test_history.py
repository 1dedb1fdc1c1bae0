"""The history of the identified parameters: kept, shown, and said where something changed."""

from __future__ import annotations

import json
import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, study
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Provenance
from pmsm_ctrl.report.history import Entry, add_entry, extended, read_history
from pmsm_ctrl.report.present import history_section
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Picture


def entry(log: str, F_c: float, stderr: float = 1e-4, version: str = "0.1.0") -> Entry:
    parameters = {"F_c": Estimate(F_c, "N m", stderr), "J": Estimate(1e-4, "kg m^2", math.nan)}
    return Entry(log, (log * 4, "design", version), parameters, 0.04)


def test_a_history_comes_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "axis.history.json"
    assert read_history(path) == ()
    entries = (entry("monday.csv", 0.02), entry("tuesday.csv", 0.021))
    for one in entries:
        again = add_entry(path, one)
    assert [e.key for e in again] == [e.key for e in read_history(path)]
    again = read_history(path)
    assert [e.log for e in again] == ["monday.csv", "tuesday.csv"]
    assert again[1].parameters["F_c"] == entries[1].parameters["F_c"]
    assert math.isnan(again[0].parameters["J"].stderr)
    before = path.read_bytes()
    add_entry(path, entries[1])
    assert path.read_bytes() == before


def test_studies_at_once_lose_no_entry(tmp_path: Path) -> None:
    path = tmp_path / "axis.history.json"
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda k: add_entry(path, entry(f"day_{k}.csv", 0.02)), range(40)))
    assert sorted(e.log for e in read_history(path)) == sorted(f"day_{k}.csv" for k in range(40))


def test_a_line_that_was_never_finished_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "axis.history.json"
    add_entry(path, entry("monday.csv", 0.02))
    with path.open("a", encoding="utf-8") as stream:
        stream.write('{"schema": "pmsm-ctrl/hist')
    assert [e.log for e in read_history(path)] == ["monday.csv"]
    add_entry(path, entry("tuesday.csv", 0.021))
    assert [e.log for e in read_history(path)] == ["monday.csv", "tuesday.csv"]


def test_the_same_study_again_replaces_its_entry_and_a_new_version_adds_one() -> None:
    entries = extended((entry("monday.csv", 0.02), entry("tuesday.csv", 0.021)), entry("monday.csv", 0.0205))
    assert [e.parameters["F_c"].value for e in entries] == [0.0205, 0.021]
    assert len(extended(entries, entry("monday.csv", 0.02, version="0.2.0"))) == 3


def test_a_change_is_said_only_beyond_its_standard_errors() -> None:
    small = history_section((entry("monday.csv", 0.0200), entry("tuesday.csv", 0.0203)))
    assert "No parameter has changed" in str(small.blocks[0])
    large = history_section((entry("monday.csv", 0.0200), entry("tuesday.csv", 0.0220)))
    # By hand: 0.002 over sqrt(2) 1e-4 is 14.1 standard errors, +10 %.
    assert "F_c changed from 0.02 (monday.csv) to 0.022 N m (tuesday.csv): +10.0 %, 14.1" in str(large.blocks[0])
    *_, table, picture = large.blocks
    assert [axes.get_ylabel() for axes in picture.draw().axes] == ["F_c [N m]", "J [kg m^2]"]
    assert table.rows[0][:3] == ("monday.csv", "0.1.0", "0.02000 ± 0.00010")
    assert not any(isinstance(block, Picture) for block in history_section((entry("monday.csv", 0.02),)).blocks)


@pytest.mark.parametrize(
    "content", ["{", "[]\n", '{"schema": "other"}\n', '{"schema": "pmsm-ctrl/history/1", "log": 1}\n', "3\n"]
)
def test_what_is_no_history_is_refused_and_kept(content: str, tmp_path: Path) -> None:
    path = tmp_path / "h.json"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(RequestError, match="not a history"):
        read_history(path)
    assert path.read_text(encoding="utf-8") == content


def axis_log(name: str, F_c: float) -> Log:
    t = np.arange(0, 20, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    noise = np.random.default_rng(3).normal(0, 1e-3, t.size)
    torque = 1e-4 * alpha + F_c * np.sign(omega) + 2e-4 * omega + noise
    return Log({"t": t, "omega": omega, "torque": torque}, provenance=Provenance(file=name, sha256=name * 8))


@pytest.mark.slow
def test_study_keeps_the_history(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    design = Design.from_dict(
        {"name": "axis", "motor": {"J": 1e-4, "K_t": 1.0},
         "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 2e-4}]}
    )  # fmt: skip
    for name, F_c in (("monday.csv", 0.02), ("june.csv", 0.03)):
        study(design, axis_log(name, F_c), output="axis.html", history="axis.history.json")
    entries = [json.loads(line) for line in Path("axis.history.json").read_text(encoding="utf-8").splitlines()]
    assert [e["log"] for e in entries] == ["monday.csv", "june.csv"]
    assert entries[1]["parameters"]["F_c"]["value"] == pytest.approx(0.03, rel=0.01)
    page = Path("axis.html").read_text(encoding="utf-8")
    assert "Parameters over time" in page
    assert "F_c changed from 0.0" in page
    before = (page, Path("axis.history.json").read_bytes())
    study(design, axis_log("june.csv", 0.03), output="axis.html", history="axis.history.json")
    assert (Path("axis.html").read_text(encoding="utf-8"), Path("axis.history.json").read_bytes()) == before
