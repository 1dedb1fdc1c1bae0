"""A run over two axes: what is in the table, what is done again, and what fails."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pmsm_ctrl import Design, fleet, identify, read_log
from pmsm_ctrl.cli import main
from pmsm_ctrl.effects.loading import load_effects
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.fleet import Engine, FleetResult, Manifest, Row, Store, read_manifest
from pmsm_ctrl.fleet import evaluate as evaluation
from pmsm_ctrl.fleet.run import _require_parameters

pytest.importorskip("pyarrow")
ALONE = Engine(jobs=1)


@pytest.fixture(scope="module")
def ran(two_axes: Path) -> FleetResult:
    return fleet(two_axes / "run.toml", engine=ALONE)


def test_the_table_holds_what_identify_says(two_axes: Path, ran: FleetResult) -> None:
    assert (ran.axes, ran.logs, ran.evaluated, ran.reused) == (2, 5, 5, 0)
    rows = [one for one in Store(ran.results).read(("parameter",)) if one.source == "identify"]
    assert {one.axis for one in rows} == {"a1", "a2"}
    path = two_axes / "logs" / "a2" / "2026-03-02.csv"
    design = Design.read(read_manifest(two_axes / "run.toml").design)
    alone = identify(design, read_log(path, design)).estimates
    here = {one.name: one for one in rows if one.record == str(path)}
    assert set(here) == set(alone)
    for name, one in here.items():
        assert (one.value, one.stderr, one.unit, one.nominal) == (
            alone[name].value, alone[name].stderr, alone[name].unit, alone[name].nominal)  # fmt: skip
    assert f"{here['F_c'].time:%Y-%m-%d}" == "2026-03-02"


def test_a_log_that_fails_is_a_row_with_its_reason(ran: FleetResult) -> None:
    (lost,) = ran.lost
    assert lost.axis == "a2"
    assert "empty" in lost.reason
    assert "1 of 5 logs could not be evaluated" in ran.summary(width=1000)


def test_what_is_done_is_not_done_again(
    two_axes: Path, ran: FleetResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(
        "pmsm_ctrl.fleet.engine.evaluated", lambda job: asked.append(job.item.name) or evaluation.set_aside(job, "test")
    )
    folder = tmp_path / "copy"
    shutil.copytree(two_axes, folder)
    manifest = replace(read_manifest(two_axes / "run.toml"), results=str(folder / "results"))
    again = fleet(manifest, engine=ALONE)
    assert (again.evaluated, again.reused, asked) == (0, 5, [])
    assert [one.reason for one in again.lost] == [one.reason for one in ran.lost]
    fleet(replace(manifest, settings=replace(manifest.settings, compare=True)), engine=ALONE)
    assert len(asked) == 5, "other settings"
    asked.clear()
    design = folder / "other.toml"
    design.write_text(Path(manifest.design).read_text(encoding="utf-8") + "\n", encoding="utf-8")
    fleet(replace(manifest, design=str(design)), engine=ALONE)
    assert len(asked) == 5, "another design"


@pytest.mark.parametrize("name", ["F_x", "cogging 24.F_c", "nothing.F_c"])
def test_a_limit_of_no_parameter_is_refused_before_the_work(two_axes: Path, tmp_path: Path, name: str) -> None:
    manifest = replace(read_manifest(two_axes / "run.toml"), limits={name: 0.085}, results=str(tmp_path / "results"))
    with pytest.raises(RequestError, match=r"\[limits\] .*: no parameter has this name.*known: J, R, .*F_c, F_v"):
        fleet(manifest)
    assert not (tmp_path / "results").exists()


def test_a_fleet_of_which_no_log_can_be_evaluated_fails(
    tmp_path: Path, two_axes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "logs" / "a").mkdir(parents=True)
    (tmp_path / "logs" / "a" / "2026-03-01.csv").write_text("t,omega\n", encoding="utf-8")
    design = read_manifest(two_axes / "run.toml").design
    for _ in range(2):  # also when it is known from the first run
        words = ["fleet", str(tmp_path / "logs"), "-d", design, "-o", str(tmp_path / "r"), "-j", "1"]
        with pytest.raises(SystemExit) as left:
            main(words)
        assert left.value.code == 1
        assert "fleet: none of 1 log could be evaluated; the first: " in capsys.readouterr().err


def test_limits_of_own_effects_and_of_found_ones_are_known(own: Manifest) -> None:
    seal = load_effects(own.effects)
    names = ("J", "F_c", "F_c#2", "k_seal", "cogging 24.a_c", "seal_drag.k_seal")
    _require_parameters(dict.fromkeys(names, 1.0), [Design.read(own.design)], seal)


@pytest.mark.slow
def test_own_effects_are_known_and_part_of_the_key(own: Manifest) -> None:
    own = replace(own, logs=own.logs[:1])
    assert {one.text for one in _statuses(fleet(replace(own, effects=""), engine=ALONE))} != {""}
    found = fleet(own, engine=ALONE)
    assert (found.evaluated, len(found.lost)) == (5, 1), "the hash of the file is part of the key"
    assert sum(one.name == "k_seal" for one in Store(own.results).read(("parameter",))) == 4
    path = Path(own.effects)
    path.write_text(path.read_text(encoding="utf-8").replace("seal_drag", "coulomb"), encoding="utf-8")
    with pytest.raises(RequestError, match="already"):
        fleet(own, engine=ALONE)


def test_the_command_runs_the_file_of_own_effects_once(
    own: Manifest, two_axes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, marks = Path(own.effects), tmp_path / "marks"
    text = path.read_text(encoding="utf-8")
    path.write_text(f"{text}\nwith open({str(marks)!r}, 'a') as marks:\n    marks.write('x')\n", encoding="utf-8")
    monkeypatch.setattr("pmsm_ctrl.fleet.engine.evaluated", lambda job: evaluation.set_aside(job, "test"))
    words = ["fleet", str(two_axes / "run.toml"), "--effects", str(path), "-o", str(tmp_path / "r"), "-j", "1"]
    with pytest.raises(SystemExit):
        main(words)
    assert marks.read_text(encoding="utf-8") == "x"
    path.write_text(text.replace("seal_drag", "coulomb"), encoding="utf-8")
    words[5] = str(tmp_path / "refused")
    with pytest.raises(SystemExit) as left:
        main(words)
    assert left.value.code == 2
    assert not (tmp_path / "refused").exists()


def test_what_was_set_aside_is_tried_again_when_asked(
    two_axes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def ends(job: evaluation.Job) -> tuple[Row, ...]:
        return evaluation.set_aside(job, "test") if "a1" in job.item.name else evaluation.evaluated(job)

    manifest = replace(read_manifest(two_axes / "run.toml"), results=str(tmp_path / "r"))
    monkeypatch.setattr("pmsm_ctrl.fleet.engine.evaluated", ends)
    words = ["fleet", str(two_axes / "run.toml"), "-o", str(tmp_path / "r"), "--jobs", "1"]
    with pytest.raises(SystemExit):
        main(words)
    assert f"next: pmsm-ctrl fleet {words[1]} --output {words[3]} --retry" in capsys.readouterr().out
    monkeypatch.undo()
    assert fleet(manifest, engine=ALONE).evaluated == 0
    again = fleet(manifest, engine=ALONE, retry=True)
    assert (again.evaluated, [one.axis for one in again.lost]) == (2, ["a2"]), "not what failed"
    rows = [(one.key, one.row) for one in Store(tmp_path / "r").read()]
    assert len(rows) == len(set(rows))
    assert len(list(Store(tmp_path / "r").read(("status",)))) == 5
    assert fleet(manifest, engine=ALONE, retry=True).evaluated == 0


def _statuses(found: FleetResult) -> list[Row]:
    return list(Store(found.results).read(("status",)))


def test_a_log_that_has_changed_is_evaluated_again(tmp_path: Path) -> None:
    from pmsm_ctrl.fleet.keys import Hashes

    path = tmp_path / "l.csv"
    path.write_text("a", encoding="utf-8")
    hashes = Hashes()
    first = hashes(str(path))
    path.write_text("b", encoding="utf-8")  # as long, and perhaps within one tick of the clock of the file system
    assert hashes(str(path)) != first


def test_an_error_of_the_program_is_a_row(two_axes: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("pmsm_ctrl.identify.identify", lambda *_: 1 / 0)
    found = fleet(replace(read_manifest(two_axes / "run.toml"), results=str(tmp_path / "r")), engine=ALONE)
    assert len(found.lost) == 5
    assert sum("unexpected ZeroDivisionError" in one.reason for one in found.lost) == 4


def test_the_command(two_axes: Path, ran: FleetResult, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["fleet", str(two_axes / "run.toml"), "--jobs", "1", "--json", str(tmp_path / "f.json")])
    assert left.value.code in (0, None)
    assert "5 logs of 2 axes: 4 with an answer; 0 evaluated" in " ".join(capsys.readouterr().out.split())
    assert json.loads((tmp_path / "f.json").read_text(encoding="utf-8"))["reused"] == 5


def test_one_command_evaluates_and_writes_the_page(two_axes: Path, ran: FleetResult, tmp_path: Path) -> None:
    page = tmp_path / "fleet.html"
    with pytest.raises(SystemExit) as left:
        main(["fleet", str(two_axes / "run.toml"), "--jobs", "1", "--report", str(page)])
    assert left.value.code in (0, None)
    text = page.read_text(encoding="utf-8")
    links = set(re.findall(r'href="(fleet_axes/[^"]+)"', text))
    assert len(links) == 2
    assert all((tmp_path / link).exists() for link in links)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["logs"], "--design was expected"),
        (["run.toml", "--design", "d.toml"], "excludes a manifest"),
        (["watch", "run.toml", "--report", "p.html"], "not with watch"),
    ],
)
def test_what_the_command_refuses(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["fleet", *words])
    assert left.value.code == 2
    assert said in capsys.readouterr().err


def test_a_missing_design_ends_the_run_at_once(two_axes: Path, tmp_path: Path) -> None:
    from pmsm_ctrl.errors import DesignError

    with pytest.raises((DesignError, RequestError)):
        fleet(Manifest(logs=(str(two_axes / "logs"),), design="nowhere.toml", results=str(tmp_path / "r")))
