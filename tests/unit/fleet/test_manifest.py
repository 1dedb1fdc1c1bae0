"""Which logs a fleet has: patterns, guesses, tables, and what is refused."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.fleet.manifest import Manifest, items_of, manifest_of, read_manifest
from pmsm_ctrl.fleet.paths import Place, compiled, first_date, guessed


def utc(*parts: int) -> datetime:
    return datetime(*parts, tzinfo=UTC)  # type: ignore[misc, arg-type]


@pytest.mark.parametrize(
    ("pattern", "path", "found"),
    [
        ("{axis}/{time:%Y-%m-%d}.csv", "/d/x17/2026-03-01.csv", Place("x17", "", utc(2026, 3, 1))),
        ("{type}/{axis}_{time:%Y%m%dT%H%M}.mf4", "gantry/a_b_20260301T2215.mf4",
         Place("a_b", "gantry", utc(2026, 3, 1, 22, 15))),
        ("{axis}/**/{time:%Y-%j}_*.csv", "q/deep/er/2026-060_run3.csv", Place("q", "", utc(2026, 3, 1))),
        ("{axis}-{time}.csv", "s1-2026-03-01T22:15:00+01:00.csv",
         Place("s1", "", datetime(2026, 3, 1, 22, 15, tzinfo=timezone(timedelta(hours=1))))),
        ("{axis}.csv", "logs/b(2).csv", Place("b(2)")),
    ],
)  # fmt: skip
def test_a_pattern_reads_axis_type_and_time(pattern: str, path: str, found: Place) -> None:
    assert compiled(pattern).place(Path(path)) == found


@pytest.mark.parametrize(
    ("path", "found"),
    [
        ("f/x17/run_2026-03-01.csv", Place("x17", "", utc(2026, 3, 1))),
        ("f/x17_20260301T221530.csv", Place("x17", "", utc(2026, 3, 1, 22, 15, 30))),
        ("f/2026/03/x.csv", Place("2026")),
        ("f/x17_3.csv", Place("x17")),
        ("f/2026-03-01.csv", Place("2026", "", utc(2026, 3, 1))),
    ],
)
def test_axis_and_time_are_guessed(path: str, found: Place) -> None:
    place = guessed(Path(path), Path("f"))
    assert place.time == found.time
    assert place.axis == found.axis or path == "f/2026-03-01.csv"  # a name that is a date alone names no axis


def test_a_path_that_does_not_match_is_a_log_with_a_reason(tmp_path: Path) -> None:
    for name in ("a/2026-03-01.csv", "a/readme.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    manifest = Manifest(logs=(str(tmp_path),), path="{axis}/{time:%Y-%m-%d}.csv", design="d.toml")
    good, bad = sorted(items_of(manifest), key=lambda one: one.problem)
    assert (good.axis, good.time, good.problem) == ("a", utc(2026, 3, 1), "")
    assert "does not match" in bad.problem


def test_a_design_per_axis_and_per_type(tmp_path: Path) -> None:
    for name in ("gantry/x", "gantry/y", "rotary/c"):
        (tmp_path / f"{name}_2026-03-01.csv").parent.mkdir(exist_ok=True)
        (tmp_path / f"{name}_2026-03-01.csv").touch()
    (tmp_path / "run.toml").write_text(
        'logs = "*/*.csv"\npath = "{type}/{axis}_{time:%Y-%m-%d}.csv"\n[designs]\ngantry = "g.toml"\ny = "y.toml"\n'
        'c = "c.toml"\n', encoding="utf-8",
    )  # fmt: skip
    found = {one.axis: Path(one.design).name for one in items_of(read_manifest(tmp_path / "run.toml"))}
    assert found == {"x": "g.toml", "y": "y.toml", "c": "c.toml"}


def test_records_of_an_axis_together(two_axes: Path) -> None:
    from dataclasses import replace

    manifest = read_manifest(two_axes / "run.toml")
    joint = items_of(replace(manifest, settings=replace(manifest.settings, joint=True)))
    assert [(one.axis, len(one.files)) for one in joint] == [("a1", 2), ("a2", 3)]


def test_a_table_names_files_axes_and_times(tmp_path: Path) -> None:
    (tmp_path / "one.csv").touch()
    (tmp_path / "list.csv").write_text(
        "file,axis,time,type,design\none.csv,17,2026-03-01T22:15,gantry,own.toml\n", encoding="utf-8"
    )
    (one,) = items_of(Manifest(table=str(tmp_path / "list.csv")))
    assert (one.axis, one.type, one.time, Path(one.design).name) == (
        "17",
        "gantry",
        utc(2026, 3, 1, 22, 15),
        "own.toml",
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('logs = "x"\ndesing = "d"', "did you mean 'design'"),
        ("logs = 3", "wrong type"),
        ('logs = "x"\ntime = "never"', "known: path, modified, column"),
        ("logs = [", "cannot be read"),
        ('design = "d.toml"', "'logs' or 'table'"),
        ('logs = "x"\n[limits]\nF_c = "a"', "wrong type"),
    ],
)
def test_a_wrong_manifest_is_refused(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text(text, encoding="utf-8")
    with pytest.raises(RequestError, match=said):
        read_manifest(tmp_path / "run.toml")


@pytest.mark.parametrize("pattern", ["{time}.csv", "{axis}{axis}.csv", "{axis}_{day}.csv"])
def test_a_wrong_pattern_is_refused(pattern: str) -> None:
    with pytest.raises(RequestError, match="axis"):
        compiled(pattern)


def test_an_axis_without_a_design_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a_1.csv").touch()
    with pytest.raises(RequestError, match="no design"):
        items_of(Manifest(logs=(str(tmp_path),)))
    (tmp_path / "nothing").mkdir()
    with pytest.raises(RequestError, match="no log"):
        items_of(manifest_of(tmp_path / "nothing", "d.toml"))


def test_the_first_date_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "l.csv").write_text("started,2026-03-01 22:15:04.5\nt,omega\n", encoding="utf-8")
    assert first_date(tmp_path / "l.csv") == utc(2026, 3, 1, 22, 15, 4)
    (tmp_path / "l.csv").write_text("t,omega\n0,1\n", encoding="utf-8")
    assert first_date(tmp_path / "l.csv") is None
