"""A complete study: the chain to its end, in one page, with the files for the PLC beside it."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.report import drive_parts as room
from pmsm_ctrl.report import study
from pmsm_ctrl.simulate import scenario, simulate
from tests.linear_motors import linear_motor

VERBS = {"tune", "sweep", "identify", "compare", "compensate", "track", "export"}


@pytest.mark.slow
def test_parts_of_the_drive_are_told_or_done(designs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the minutes of the compensation, whose own tests are elsewhere."""

    def refused(*_: object, **__: object) -> None:
        raise DesignError("axis.toml: effects: no friction to compensate")

    monkeypatch.setattr(room, "compensate", refused)
    design = Design.read(designs / "low_speed.toml")
    log = simulate(design, scenario("reversal", design, speed=20.0, cycles=2.0))
    results, left_out = room.drive_parts(design, log, tmp_path / "page.html")
    assert set(results) == {"track", "export"}
    assert [notice.text for notice in left_out] == [
        "not done: the compensation, because axis.toml: effects: no friction to compensate"
    ]
    files = {path.name for path in (tmp_path / "page").iterdir()}
    assert {"low_speed_compensation.c", "low_speed_compensation.h", "FB_low_speed_compensation.st"} <= files
    assert set(results["export"].to_dict()["files"]) == files
    assert "page/low_speed_compensation.c" in results["export"].summary(width=120)
    assert '<a href="page/low_speed_compensation.c">' in results["export"]._repr_html_()


@pytest.mark.slow
def test_a_complete_study_runs_every_verb(designs: Path, tmp_path: Path) -> None:
    done = study(Design.read(designs / "servo_2kw.toml"), output=tmp_path / "all.html", complete=True)
    assert set(done.results) | {"export"} >= VERBS
    assert "--complete" not in done.summary()
    page = (tmp_path / "all.html").read_text(encoding="utf-8")
    assert "Friction compensation of servo_2kw" in page


def test_a_study_of_a_linear_motor_with_windings(tmp_path: Path) -> None:
    """Its identification run asked for a turn of 6.28 m, and no study was written."""
    axis = linear_motor()
    done = study(axis.design, output=tmp_path / "slide.html")
    swept, found = done.results["sweep"].estimates, done.results["identify"].estimates
    assert swept["F_c"].value == pytest.approx(axis.F_c, rel=0.01)
    assert swept["F_v"].value == pytest.approx(axis.F_v, rel=0.03)
    assert found["J"].value == pytest.approx(axis.design.J, rel=0.02)
    page = (tmp_path / "slide.html").read_text(encoding="utf-8")
    assert "averaged force" in page
    assert "averaged torque" not in page
