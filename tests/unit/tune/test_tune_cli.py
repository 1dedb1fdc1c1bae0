"""`pmsm-ctrl tune`: the table, the files it writes, and answers to bad requests."""

from __future__ import annotations

import json
import re

import pytest

from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.design import Design


def test_tune_prints_the_table_and_writes_what_was_asked(designs, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("pmsm_ctrl.rendering.html.inline_svg", lambda *given: "<svg></svg>")  # seconds, not asked here
    files = {name: tmp_path / name for name in ("new.toml", "tuning.json", "tuning.html")}
    status = run(app, [
        "tune", str(designs / "seed_motor.toml"), "--no-prove", "--output", str(files["new.toml"]),
        "--json", str(files["tuning.json"]), "--report", str(files["tuning.html"]),
    ])  # fmt: skip
    out = capsys.readouterr().out
    assert status == 0
    assert "seed_motor: loops tuned; all margins are met" in out
    assert "Margins of the sampled loops; required: phase margin 30 deg, gain margin 6 dB" in " ".join(out.split())
    assert "the delays leave 45 deg to a loop of a longer reset time" in " ".join(out.split())
    written = Design.read(files["new.toml"])
    told = json.loads(files["tuning.json"].read_text())
    assert written.loops.speed.K_p == pytest.approx(told["loops"]["speed"]["K_p"])
    assert "Tuning of seed_motor" in files["tuning.html"].read_text()
    capsys.readouterr()
    assert run(app, ["tune", str(files["new.toml"]), "--keep", "--no-prove"]) == 0
    assert "seed_motor: loops judged as given; all margins are met" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--speed", "bandwidth", "--speed-bandwidth", "500"], "the highest bandwidth that keeps 60 deg"),
        (["--current", "bandwidth", "--current-bandwidth", "5000"], "93.75 us of delay"),
        (["--current", "optimum"], "unknown method 'optimum'"),
    ],
)
def test_a_bad_request_gets_an_answer(designs, capsys, options, message):
    assert run(app, ["tune", str(designs / "seed_motor.toml"), "--no-prove", *options]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_an_unstable_loop_is_named_and_shown(designs, tmp_path, capsys):
    hot = Design.read(designs / "seed_motor.toml").replace(loops={"speed": {"K_p": 1.0, "T_n": 0.01}})
    path, page = hot.write(tmp_path / "hot.toml"), tmp_path / "hot.html"
    assert run(app, ["tune", str(path), "--keep", "--report", str(page)]) == 2
    assert "speed loop: unstable with the gains given" in capsys.readouterr().err
    assert "An unstable loop" in page.read_text()
    assert "svg" in page.read_text()


def test_gains_whose_margins_are_missed_are_not_written(designs, tmp_path, capsys):
    """130 Hz leave the speed loop less than 30 deg: as `add` and `compensate`, only --force writes them."""
    new, told = tmp_path / "new.toml", tmp_path / "new.json"
    words = ["tune", str(designs / "seed_motor.toml"), "--no-prove", "--speed-bandwidth", "130"]
    assert run(app, [*words, "--output", str(new), "--json", str(told)]) == 1
    assert not new.exists()
    assert "design" not in json.loads(told.read_text())
    (line,) = [one for one in capsys.readouterr().err.splitlines() if "not written" in one]
    assert re.search(r"new.toml: not written: speed loop: phase margin .* < 30 deg; --force writes it$", line)
    assert run(app, [*words, "--output", str(new), "--force"]) == 1
    assert Design.read(new).loops is not None


def test_the_bandwidth_that_is_offered_keeps_the_margins(designs, capsys):
    """212 Hz were offered, with 10 deg."""
    words = ["tune", str(designs / "seed_motor.toml"), "--no-prove", "--speed-bandwidth"]
    assert run(app, [*words, "500"]) == 2
    offered = re.search(r"--speed-bandwidth (\d+) ", capsys.readouterr().err)
    assert offered is not None
    assert run(app, [*words, offered[1]]) == 0


def test_the_design_is_written_before_the_table_is_printed(designs, tmp_path, monkeypatch):
    """A reader such as `head -1` ends after the first line, and so did the command."""

    def closed(*_, **__):
        raise BrokenPipeError

    monkeypatch.setattr("pmsm_ctrl.console.say", closed)
    new = tmp_path / "new.toml"
    run(app, ["tune", str(designs / "seed_motor.toml"), "--no-prove", "--output", str(new)])
    assert Design.read(new).loops is not None
