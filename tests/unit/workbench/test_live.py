"""Friction while the axis runs, in the page: what it is told, and a growing file as Chromium shows it."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.cli import main
from pmsm_ctrl.track import Alarm, Reading
from pmsm_ctrl.workbench.live import ENDED, MOST, Live
from tests.effort import seeds
from tests.unit.track.ads_server import StandIn
from tests.unit.track.test_ads import HOST, MAPPING, SOURCE, SYMBOLS, samples
from tests.unit.workbench.harness import DESIGN, TOKEN, Bench, Page

WAIT = 60.0  # s; a fresh process imports the tracker


def reading(k: int) -> Reading:
    return Reading(0.2 * k, 10.0, 0.02 + 1e-6 * k, 1e-4, 2e-4, 3e-6, "updated", 1.0)


def test_the_course_is_thinned_and_its_ends_are_kept() -> None:
    live = Live(Design.from_toml(DESIGN), "axis.csv")
    assert live.shown()["t"] == []
    for k in range(3 * MOST):
        live.take("reading", reading(k))
    alarm = {"parameter": "F_c", "kind": "step", "t": 7.0, "earliest": 6.0, "latest": 8.0, "told": 9.0, "before": 0.02,
             "after": 0.03, "stderr": 1e-4, "p_value": 1e-9}  # fmt: skip
    live.take("alarm", Alarm(**alarm))
    shown = json.loads(json.dumps(live.shown()))
    assert MOST / 2 < len(shown["t"]) <= MOST
    assert shown["t"][0] == 0.0
    assert shown["t"][-1] == pytest.approx(0.2 * (3 * MOST - 1), abs=0.2 * 4)
    assert shown["now"]["t"] == 0.2 * (3 * MOST - 1)
    assert (shown["now"]["F_c"], shown["now"]["stderr_F_c"]) == (0.02 + 1e-6 * (3 * MOST - 1), 2e-4)
    assert shown["F_c"] == [0.02 + 1e-6 * round(t / 0.2) for t in shown["t"]]
    assert shown["alarms"] == [alarm]
    assert shown["units"] == {"F_c": "N m", "F_v": "N m s/rad"}
    assert shown["stated"] == {"F_c": 0.02, "F_v": 1e-4}


def test_only_a_server_with_a_source_answers(bench: Bench, page: Page) -> None:
    assert page.get("live").status_code == 404
    assert page.get("about").json()["live"] is False
    bench.desk.live = Live(Design.from_toml(DESIGN), "<script>alert(1)</script>.csv")
    assert page.get("about").json()["live"] is True
    assert page.get("live").json()["source"] == "<script>alert(1)</script>.csv"
    assert page.client.get(f"/{TOKEN[:-1]}x/s/aaaaaaaaaaaa/live").status_code == 404


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--live", "x.csv"], "--live needs DESIGN"),
        (["seed_motor.toml", "--map", "t=a"], "which is not given"),
        (["seed_motor.toml", "--live", "x.csv", "--estimate", "B"], "accepted: T_load, J"),
    ],
)
def test_what_is_missing_is_said(
    words: list[str], said: str, designs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(designs / word) if word.endswith(".toml") else word for word in words]
    with pytest.raises(SystemExit) as raised:
        main(["workbench", "--no-browser", *given])
    assert raised.value.code == 2
    assert said in " ".join(capsys.readouterr().err.split())


def ended(live: Live) -> str:
    begin = time.monotonic()
    while not (end := live.shown()["end"]):
        assert time.monotonic() - begin < WAIT
        time.sleep(0.02)
    return str(end)


@pytest.mark.slow
def test_a_process_that_ends_says_why(tmp_path: Path) -> None:
    path = tmp_path / "axis.csv"
    path.write_text("t [s],colour,theta [rad]\n0,1,2\n")
    live = Live(Design.from_toml(DESIGN), str(path))
    live.start()
    assert "i_q or torque were expected" in ended(live)
    path.unlink()
    live = Live(Design.from_toml(DESIGN), str(path))  # a file that does not exist is waited for
    process = live.start()
    process.kill()
    assert ended(live) == ENDED


def tracked(live: Live) -> dict[str, Any]:
    """Return what is shown when the friction of the recorded axis, F_c = 0.02 N m, is known."""
    begin = time.monotonic()
    while (shown := live.shown())["now"] is None or shown["now"]["t"] < 1.7:
        assert not shown["end"], shown["end"]
        assert time.monotonic() - begin < WAIT
        time.sleep(0.02)
    return shown


@pytest.mark.parametrize("ending", seeds("0.5,0.1", ""))
def test_standard_input_is_followed(ending: str, designs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Through the server, in pieces that end anywhere; the last line may lack its end."""
    begun, given = os.pipe()
    with open(begun, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        live = Live(Design.read(designs / "seed_motor.toml"), "-", {"omega": "speed [rpm]", "i_q": "current [A]"}, ())
        assert live.shown()["source"] == "standard input"
        process = live.start()
        text = "t [s],speed [rpm],current [A]\n" + "".join(f"{t!r},{a!r},{b!r}\n" for t, (a, b) in samples(2000))
        data = (text + ending).encode()
        for start in range(0, len(data), 7001):
            os.write(given, data[start : start + 7001])
        assert tracked(live)["F_c"][-1] == pytest.approx(0.02, rel=0.05)
        os.close(given)
        assert ended(live) == "The source has ended."
        process.join(WAIT)


@pytest.mark.slow  # its connection is tested in track/test_ads.py, the process above
def test_a_plc_is_followed_and_a_lost_connection_is_opened_again(designs: Path) -> None:
    pytest.importorskip("pyads")
    plc = StandIn(HOST, SYMBOLS, samples(2000), cut=700)
    plc.start()
    live = Live(Design.read(designs / "seed_motor.toml"), SOURCE, MAPPING, ())
    process = live.start()
    try:
        assert tracked(live)["F_c"][-1] == pytest.approx(0.02, rel=0.05)
        assert live.shown()["source"] == SOURCE
    finally:
        process.kill()
        plc.close()
