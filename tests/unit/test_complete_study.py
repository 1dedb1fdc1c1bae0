"""A complete study: the chain to its end, in one page, with the files for the PLC beside it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pmsm_ctrl.compensate import CompensationStudy
from pmsm_ctrl.compensate.recommendation import Recommendation
from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import Compensation
from pmsm_ctrl.diagnose import Diagnosis, Verdict
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.log import Log
from pmsm_ctrl.next_steps import exported_design
from pmsm_ctrl.report import drive_parts as room
from pmsm_ctrl.report import study
from pmsm_ctrl.simulate import scenario, simulate
from tests.linear_motors import linear_motor

PLAIN = Design.from_dict(
    {"name": "axis", "motor": {"J": 1e-4, "K_t": 1.0},
     "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 2e-4}]}
)  # fmt: skip
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
    files = {path.name for path in (tmp_path / "page").iterdir()} - {"page.design.toml"}
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


def record_with_a_load(load: float) -> Log:
    t = np.arange(0, 4, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    torque = 1e-4 * alpha + 0.02 * np.sign(omega) + 2e-4 * omega + load
    return Log({"t": t, "omega": omega, "torque": torque + np.random.default_rng(0).normal(0, 1e-3, t.size)})


def test_the_design_that_the_diagnosis_completed_is_tracked_and_exported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was that of `identify`, which lacks the effects that the same page names."""
    monkeypatch.setattr("pmsm_ctrl.rendering.html.inline_svg", lambda *given: "<svg></svg>")
    done = study(PLAIN, record_with_a_load(0.01), output=tmp_path / "page.html", complete=True)
    assert done.results["diagnose"].to_dict()["verdict"] == "effects_missing"
    said = "The design is the one that the diagnosis completed: coulomb, viscous, constant_load."
    assert (tmp_path / "page.html").read_text(encoding="utf-8").count(said) == len({"track", "export"})
    beside = Design.read(exported_design(tmp_path / "page"))
    assert beside.parameters("constant_load") == done.completed.parameters("constant_load") != {}
    assert done.results["export"].to_dict()["why_not_recommended"] == "no compensation was judged"
    (tmp_path / "study.json").write_text(json.dumps(done.to_dict()), encoding="utf-8")
    assert Design.read(tmp_path / "study.json").effects == done.completed.effects


@pytest.mark.parametrize(
    ("change", "why"),
    [({"verdict": Verdict.IMPLAUSIBLE}, "its verdict is "), ({"improved": False}, "the given design leaves less")],
)
def test_a_diagnosis_that_is_not_supported_leaves_the_identified_design(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, object], why: str
) -> None:
    monkeypatch.setattr("pmsm_ctrl.rendering.html.inline_svg", lambda *given: "<svg></svg>")
    done = study(PLAIN, record_with_a_load(0.01), output=tmp_path / "page.html", complete=True)
    found = done.results["diagnose"]
    assert isinstance(found, Diagnosis)
    other = replace(done, results=done.results | {"diagnose": replace(found, **change)})  # type: ignore[arg-type]
    assert other.completed is done.design
    assert f"That of the diagnosis is not taken: {why}" in " ".join(other.summary(brief=False).split())


@pytest.mark.parametrize("found", [Compensation(source="commanded", gain=0.5, effects=("coulomb",)), None])
def test_the_recommended_compensation_is_exported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, found: Compensation | None
) -> None:
    """It was the design's own, all of the friction by reference speed, whatever the page recommended."""
    best = None if found is None else Recommendation(found, 0.5, {})
    judged = CompensationStudy(PLAIN, (), {}, recommendation=best)
    monkeypatch.setattr(room, "compensate", lambda *given, **more: judged)
    monkeypatch.setattr(room, "track", lambda *given: SimpleNamespace())
    written: list[Design] = []
    monkeypatch.setattr(room, "export_files", lambda design, language: written.append(design) or {language: "text"})
    results, left_out = room.drive_parts(PLAIN, record_with_a_load(0.0), tmp_path / "page.html")
    assert left_out == []
    wanted = found or Compensation(gain=0.0)
    assert {design.compensation for design in written} == {wanted}
    assert Design.read(exported_design(tmp_path / "page")).compensation == wanted
    said = results["export"].summary(width=200)
    assert ("commanded speed, gain 50 %, as recommended." if found else "gain 0 %, not a recommended one: ") in said
