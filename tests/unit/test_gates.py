"""compare and diagnose in an automatic check: exit status 1 for a verdict or an error that is not accepted."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import typer

from pmsm_ctrl import Design, Log
from pmsm_ctrl.cli import app, main
from pmsm_ctrl.console import run
from pmsm_ctrl.gates import FailOn, require_accepted
from pmsm_ctrl.regression.record_result import RecordResult
from pmsm_ctrl.result import Verdict


def record(error: float, held_out: bool = False, after: float | None = None) -> RecordResult:
    fitted = {} if after is None else {"torque": {"relative": after}}
    return RecordResult("l.csv", held_out, 10.0, 1000.0, {"torque": {"relative": error}}, fitted)


@pytest.mark.parametrize(
    ("verdict", "fail_on", "fails"),
    [
        ("consistent", ["any"], False), ("effects_missing", ["missing"], True), ("effects_missing", ["any"], True),
        ("unexplained", ["missing"], False), ("unexplained", ["missing", "unexplained"], True),
        ("not_excited", ["any"], True), ("implausible", ["implausible"], True),
        ("inconclusive", ["unexplained"], False),
        ("inconclusive", ["inconclusive"], True), ("effects_missing", [], False),
    ],
)  # fmt: skip
def test_a_verdict_fails_where_it_was_asked_for(verdict: str, fail_on: list[str], fails: bool) -> None:
    words = [FailOn(word) for word in fail_on]
    if not fails:
        require_accepted(Verdict(verdict), (), words, None)
        return
    with pytest.raises(typer.Exit) as left:
        require_accepted(Verdict(verdict), (), words, None)
    assert left.value.exit_code == 1


def test_the_largest_error_counts_on_held_out_records_too(capsys: pytest.CaptureFixture[str]) -> None:
    require_accepted(Verdict.CONSISTENT, [record(0.5, after=0.02), record(0.02, held_out=True)], None, 0.03)
    with pytest.raises(typer.Exit):
        require_accepted(Verdict.CONSISTENT, [record(0.02), record(0.04, held_out=True)], None, 0.03)
    assert capsys.readouterr().err == (
        "pmsm-ctrl: failed: error of 4 % on the held-out record l.csv, --max-error 3 %\n"
    )
    with pytest.raises(typer.Exit):  # an error that is not known is not accepted
        require_accepted(Verdict.CONSISTENT, [record(float("nan"))], None, 0.03)


def test_on_the_command_line_json_goes_to_stdout_and_all_else_to_stderr(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    effects = [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 2e-4}]
    Design.from_dict({"name": "axis", "motor": {"J": 1e-4, "K_t": 1.0}, "effects": effects}).write("axis.toml")
    t = np.arange(0, 20, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    noise = np.random.default_rng(3).normal(0, 1e-3, t.size)
    torque = 1e-4 * alpha + 0.03 * np.sign(omega) + 2e-4 * omega + noise
    Log({"t": t, "omega": omega, "torque": torque}).write_csv("l.csv")

    def status(*words: str) -> int:
        with pytest.raises(SystemExit) as left:
            main(["compare", "l.csv", "--design", "axis.toml", *words])
        assert isinstance(left.value.code, int)
        return left.value.code

    assert status("--json", "-") == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["schema"].startswith("pmsm-ctrl/comparison/")
    assert "Comparison of axis with l.csv" in said.err
    # By hand: 0.01 N m of dry friction is missing.
    expected = 100.0 * 0.01 / float(np.sqrt(np.mean(torque**2)))
    assert status("--max-error", "50%") == 0
    assert status("--max-error", "0.05") == 1
    found = re.search(r"error of ([\d.]+) % on the record l.csv, --max-error 5 %", capsys.readouterr().err)
    assert found
    assert float(found[1]) == pytest.approx(expected, rel=0.03)
    assert status("--max-error", "-3%") == 2
    assert "such as 3% or 0.03" in capsys.readouterr().err
    for limit in ("3", "1", "inf", "nan"):  # 300 %: a check that never fails
        assert status("--max-error", limit) == 2
        assert "--max-error" in capsys.readouterr().err
    assert status("--max-error", "3") == 2
    assert "percent with its sign: 3%" in capsys.readouterr().err
    assert status("--max-error", "300%") == 0
    assert status("--fail-on", "any", "--fail-on", "missing") == 2
    said_of_missing = capsys.readouterr().err
    assert "accepted: unexplained, implausible, inconclusive, any; diagnose takes missing" in said_of_missing
    assert said_of_missing.count("\n") == 1
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["axis.toml", "l.csv"]


def test_an_unknown_condition_is_refused_without_the_words_of_a_library(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(app, ["diagnose", "a.csv", "--design", "a.toml", "--fail-on", "foo"]) == 2
    shown = capsys.readouterr().err
    assert "'foo' is not one of 'missing'" in shown
    assert "Value error" not in shown
