"""What is doubtful about a log reaches every result that uses it: text, JSON, page and verdict."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log, Provenance
from pmsm_ctrl.plausibility import Plausibility
from pmsm_ctrl.rendering import to_html
from pmsm_ctrl.report import chain, study
from pmsm_ctrl.result import Result, Verdict
from pmsm_ctrl.section import Notice
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.track import track
from tests.effort import slow

DOUBT = Notice("speed_factor", "dtheta/dt is 1.99 times omega, seen at the import")
FEW = ("stribeck", "constant_load")  # what is searched has no part in what is said of a doubt
VERBS: dict[str, Callable[..., Result]] = {
    "identify": identify, "compare": compare,
    "diagnose": lambda d, log, **more: diagnose(d, log, candidates=FEW, plan=False, **more), "track": track,
}  # fmt: skip


@pytest.fixture(scope="module")
def design(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


@pytest.fixture(scope="module")
def clean(design: Design) -> Log:
    return simulate(design, scenario("triangle", design, cycles=2.0), seed=1)


@pytest.fixture(scope="module")
def doubted(clean: Log) -> Log:
    return replace(clean, provenance=Provenance("axis.csv", "", "text", (), (DOUBT,)))


@pytest.fixture(scope="module")
def reversed_current(clean: Log) -> Log:
    return clean.with_channels(i_q=-clean["i_q"], i_d=-clean["i_d"])


@pytest.fixture(scope="module")
def noise(clean: Log) -> Log:
    return clean.with_channels(i_q=np.random.default_rng(1).normal(0.0, 0.3, len(clean)))


@pytest.mark.parametrize("verb", [verb if verb == "diagnose" else slow(verb) for verb in VERBS])
def test_a_doubt_of_the_import_is_in_text_json_and_page(verb: str, design: Design, doubted: Log) -> None:
    found = VERBS[verb](design, doubted)
    data = found.to_dict()
    assert DOUBT.text in data["warnings"]
    assert DOUBT.code in data["warning_codes"]
    assert DOUBT.text in " ".join(found.summary(width=1000).split())
    assert DOUBT.text in to_html(found.section())


def test_an_open_doubt_forbids_consistent(design: Design, clean: Log, doubted: Log) -> None:
    assert compare(design, clean).verdict == "consistent"
    assert compare(design, doubted).to_dict()["verdict"] == "inconclusive"
    assert VERBS["diagnose"](design, clean).verdict == "consistent"
    found = VERBS["diagnose"](design, doubted)
    assert (found.verdict, found.to_dict()["reason_codes"]) == ("inconclusive", [DOUBT.code])


@pytest.mark.parametrize("verb", ["compare", "diagnose"])
def test_a_doubt_about_the_held_out_record_is_said_of_that(verb: str, design: Design, clean: Log, doubted: Log) -> None:
    found = VERBS[verb](design, clean, holdout=doubted)
    assert f"hold-out record: {DOUBT.text}" in found.warnings
    assert found.verdict == "consistent"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what is not asked of a study here: the parts that are simulated, and the next experiment."""
    monkeypatch.setattr(chain, "_simulated_parts", lambda *given: ({}, []))
    monkeypatch.setattr(chain, "diagnose", lambda *given, **more: diagnose(*given, candidates=FEW, plan=False, **more))


@pytest.mark.slow
@pytest.mark.usefixtures("quick")
def test_a_study_says_it_once_and_is_not_green(
    design: Design, clean: Log, doubted: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as unseen:
        unseen.setattr(chain, "render", lambda *given, **more: "")  # its figures take seconds
        assert study(design, clean, output=tmp_path / "clean.html").headline.good is True
    found = study(design, doubted, output=tmp_path / "page.html")
    assert found.headline.good is None
    assert found.warnings.count(DOUBT.text) == 1
    assert DOUBT.code in found.to_dict()["warning_codes"]
    page = (tmp_path / "page.html").read_text()
    assert page.count(f'data-code="{DOUBT.code}"') == 1


@pytest.mark.usefixtures("quick")
def test_a_study_is_not_green_above_a_comparison_that_finds_structure(
    design: Design, clean: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def structured(*given: Any, **more: Any) -> Any:
        reason = Notice("residual_structure", "57 % of it")
        return replace(compare(*given, **more), verdict=Verdict.UNEXPLAINED, reasons=(reason,))

    monkeypatch.setattr(chain, "compare", structured)
    monkeypatch.setattr(chain, "render", lambda *given, **more: "")  # the headline is asked, not the page
    found = study(design, clean, output=tmp_path / "page.html")
    assert found.headline.good is None
    assert "57 % of it" in found.headline.verdict
    assert "no effect is missing" not in found.headline.verdict.lower()


@pytest.mark.parametrize("verb", ["compare", "diagnose", "identify"])
def test_a_current_of_the_wrong_sign_is_implausible(verb: str, design: Design, reversed_current: Log) -> None:
    found = VERBS[verb](design, reversed_current)
    data, first = found.to_dict(), found.summary(width=1000)
    assert first.splitlines()[3].startswith("Implausible")
    assert (data["plausible"] is False) if verb == "identify" else data["verdict"] == "implausible"
    if verb == "diagnose":
        assert data["steps"] == []
        assert found.design == design  # no parameter of such a log is written


def test_an_inertia_below_zero_is_implausible_where_nothing_else_is_left(
    design: Design, monkeypatch: pytest.MonkeyPatch
) -> None:
    # friction and inertia of this log all end at their bounds
    log = simulate(design, scenario("identification", design, duration=6.0), seed=1)
    module = importlib.import_module("pmsm_ctrl.identify.identification")  # the verb hides its room
    monkeypatch.setattr(module, "doubts_about", lambda design, log: Plausibility(log))
    found = identify(design, log.with_channels(i_q=-log["i_q"]))
    assert [notice.code for notice in found.contradictions] == ["inertia_negative"]
    assert found.to_dict()["plausible"] is False
    assert "large_error" in {notice.code for notice in found.notices}


def test_white_noise_for_a_current_is_never_consistent(design: Design, noise: Log) -> None:
    assert diagnose(design, noise, plan=False).verdict in ("implausible", "inconclusive")
    assert compare(design, noise).verdict in ("implausible", "inconclusive", "unexplained")
    found = identify(design, noise)
    assert found.relative_error > 0.4
    assert {"large_error"} & {notice.code for notice in found.notices} or found.contradictions
    assert not found.summary(width=1000).splitlines()[2].startswith("Inverse-dynamics")


@pytest.mark.slow
def test_a_comparison_of_another_motor_has_something_to_say(design: Design, clean: Log) -> None:
    other = design.with_parameters(J=2.0 * design.J).with_effect("coulomb", {"F_c": 0.1})
    found = compare(other, clean)
    assert found.log.errors["torque"].relative > 1.0
    assert found.verdict != "consistent"
    assert found.reasons
