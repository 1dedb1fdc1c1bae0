"""What a recording must hold for later commands is said before it is made, and of every file that is imported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Log
from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.recording import NEEDS, RECORD
from pmsm_ctrl.verify import verify

T = np.arange(4000) * 1e-3
SPEED = 20.0 * np.sin(2.0 * T)
PLAIN = {"t": T, "theta": 10.0 - 10.0 * np.cos(2.0 * T), "omega": SPEED, "i_q": 0.1 * np.sign(SPEED)}


def lacking(command: str, log: Log) -> list[str]:
    return [name for need in NEEDS if need.command == command for some in need.lacking(log) for name in some]


def test_what_verify_refuses_is_what_the_list_says_that_it_needs(designs: Path) -> None:
    design = Design.read(designs / "low_speed.toml")
    log = Log(PLAIN)
    assert lacking("verify", log) == ["omega_ref", "theta_ref"]
    with pytest.raises(LogError, match="neither omega_ref nor theta_ref"):
        verify(design, log, log)
    assert lacking("verify", Log({**PLAIN, "omega_ref": SPEED})) == []
    assert lacking("quadrants", log) == ["theta_ref"]
    assert lacking("identify, compare, diagnose, track", log) == []
    assert lacking("identify, compare, diagnose, track", Log({"t": T, "omega": SPEED})) == ["i_q", "torque"]


def test_the_sentence_for_the_recorder_names_every_channel_of_the_list() -> None:
    for need in NEEDS:
        for some in need.channels:
            assert any(name in RECORD for name in some), (need.command, some)


def test_import_says_what_a_file_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    Log(PLAIN).write_csv(tmp_path / "log.csv")
    assert run(app, ["import", str(tmp_path / "log.csv")]) == 0
    shown = capsys.readouterr().out.partition("What later commands need")[2].splitlines()
    rows = {line.split("  ")[0]: line for line in shown if line.strip()}
    assert rows["verify"].rstrip().endswith("omega_ref or theta_ref")
    assert rows["quadrants"].rstrip().endswith("theta_ref")


def test_init_says_what_to_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--machine", "plain", "--torque-constant", "0.5 N m/A peak", "--inertia", "2 kg cm2"]
    assert run(app, ["init", "axis", *given, "--output", str(tmp_path / "axis.toml")]) == 0
    assert "record: position and speed (theta, omega)" in " ".join(capsys.readouterr().out.split())
