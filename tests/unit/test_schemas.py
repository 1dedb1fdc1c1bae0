"""What commands write with --json is what their schemas say; other tests' results are checked in conftest.py."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.cli import app, main
from pmsm_ctrl.schemas import SCHEMAS

jsonschema = pytest.importorskip("jsonschema")
ROOT = Path(__file__).resolve().parents[2]
SEED = str(ROOT / "designs" / "seed_motor.toml")


def run(*words: str) -> None:
    with pytest.raises(SystemExit) as left:
        main(list(words))
    assert left.value.code in (0, 1, None)


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("schemas")
    t = np.arange(0, 6, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    torque = 9e-5 * alpha + 0.02 * np.sign(omega) + 2e-4 * omega + np.random.default_rng(5).normal(0, 1e-3, t.size)
    np.savetxt(folder / "l.csv", np.column_stack((t, omega, torque)), fmt="%.9g", delimiter=",",
               header="t [s],omega [rad/s],torque [N m]", comments="")  # fmt: skip
    return folder


LINES = {
    "init": "init --example emps -o i.toml",
    "simulate": f"simulate {SEED} -s hold --set duration=0.1 -o s.csv",
    "tune": f"tune {SEED} --no-prove",
    "identify": f"identify l.csv -d {SEED}",
    "compare": f"compare l.csv -d {SEED} --holdout l.csv",
    "track": f"track l.csv -d {SEED}",
    "import": "import l.csv",
    "effects": "effects",
    "export": f"export {ROOT / 'designs' / 'emps.toml'} -l st -o a.st",
}


@pytest.mark.parametrize("verb", LINES)
def test_a_result_follows_its_schema(
    verb: str, here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(here)
    run(*LINES[verb].split(), "--json", f"{verb}.json", "--force")
    written = json.loads(Path(f"{verb}.json").read_text(encoding="utf-8"))
    capsys.readouterr()
    run("schema", verb)
    schema = json.loads(capsys.readouterr().out)
    jsonschema.Draft202012Validator(schema).validate(written)


@pytest.mark.parametrize("verb", SCHEMAS)
def test_a_schema_is_one_and_refuses_what_lacks_a_key(verb: str) -> None:
    schema = SCHEMAS[verb]
    jsonschema.Draft202012Validator.check_schema(schema)
    assert not jsonschema.Draft202012Validator(schema).is_valid({"schema": schema["title"]})
    assert not jsonschema.Draft202012Validator(schema).is_valid({})


def test_every_command_that_writes_json_has_a_schema() -> None:
    writing: dict[str, Any] = {
        c.name or c.callback.__name__: c.callback.__annotations__ for c in app.registered_commands if c.callback
    }
    others = {"import-proposal", "fleet-report"}  # a second answer of one command, and that of a group
    assert {verb for verb, options in writing.items() if "json_file" in options} | others == set(SCHEMAS)


def test_a_proposal_follows_its_schema(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was written with no schema that describes it."""
    monkeypatch.chdir(tmp_path)
    lines = ["Zeit [ms];Lage [deg];Drehzahl [rpm];Strom [%]", *(f"{k};{k};{k % 7};{k % 5}" for k in range(300))]
    (tmp_path / "l.csv").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(SystemExit):
        main(["import", "l.csv", "--json", "p.json"])
    written = json.loads((tmp_path / "p.json").read_text(encoding="utf-8"))
    assert written["schema"] == "pmsm-ctrl/proposal/1"
    jsonschema.Draft202012Validator(SCHEMAS["import-proposal"]).validate(written)


def test_an_unknown_command_has_none(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["schema", "diagnos"])
    assert left.value.code == 2
    assert "did you mean 'diagnose'" in capsys.readouterr().err
