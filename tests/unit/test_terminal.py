"""What a terminal of 80 columns shows: the verdict, a table, and the command that follows."""

from __future__ import annotations

import io
import json
import re
import shlex
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from typer.main import get_command

from pmsm_ctrl import console
from pmsm_ctrl.cli import app, main
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.next_steps import next_step
from pmsm_ctrl.rendering import to_text
from pmsm_ctrl.section import Notice, Section, Table

COMMANDS: dict[str, Any] = get_command(app).commands  # type: ignore[attr-defined]
PLAIN = (
    "[motor]\nJ = 1.1e-4\nK_t = 1.0\n[[effects]]\nid = 'coulomb'\nF_c = 0.03\n[[effects]]\nid = 'viscous'\nF_v = 2e-4\n"
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Torque of a known axis in closed form, with white noise; the design is somewhat wrong."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    t = np.arange(0, 4, 1e-3)
    omega = 80 * np.sin(2 * np.pi * 0.5 * t) + 40 * np.sin(2 * np.pi * 1.3 * t + 1)
    alpha = 80 * np.pi * np.cos(2 * np.pi * 0.5 * t) + 40 * 2.6 * np.pi * np.cos(2 * np.pi * 1.3 * t + 1)
    torque = 1e-4 * alpha + 0.02 * np.sign(omega) + 2e-4 * omega + np.random.default_rng(5).normal(0.0, 1e-3, t.size)
    np.savetxt("my log.csv", np.column_stack((t, omega, torque)), fmt="%.9g", delimiter=",",
               header="t [s],omega [rad/s],torque [N m]", comments="")  # fmt: skip
    Path("d.toml").write_text(PLAIN, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("verb", ["identify", "compare", "track"])
def test_80_columns_verdict_first_and_the_next_command_last(
    verb: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main([verb, "my log.csv", "-d", "d.toml", "--json", "r.json"])
    assert not left.value.code
    brief = capsys.readouterr().out.splitlines()
    assert len(brief) < 40
    assert all(len(line) <= 80 for line in brief[:-1])  # a command is one line, to be pasted
    assert brief[-1].startswith("next: pmsm-ctrl ")
    assert (verb == "track") or "'my log.csv'" in brief[-1]
    with pytest.raises(SystemExit):
        main([verb, "my log.csv", "-d", "d.toml", "--verbose"])
    whole = capsys.readouterr().out.splitlines()
    assert len(whole) >= len(brief) - 2
    assert not any(line.startswith("--verbose") for line in whole)


def test_a_simulation_says_in_80_columns_what_it_wrote(
    here: Path, designs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["simulate", str(designs / "seed_motor.toml"), "-s", "reversal", "--set", "cycles=1", "-o", "l.csv"])
    assert not left.value.code
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in lines[:-1])
    assert lines[0].startswith("l.csv: ")
    assert "u_q" in lines[1]
    assert "theta_ref" in lines[2]


@pytest.mark.slow
def test_a_study_is_its_verdict_three_numbers_and_the_next_command(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["study", "d.toml", "--log", "my log.csv", "-o", "a page.html"])
    assert not left.value.code
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) < 30
    assert all(len(line) <= 80 for line in lines[:-1])
    assert any(line.startswith("No missing effect") for line in lines[:6])
    assert sum("not significant" in line for line in lines) == 0
    assert len(re.findall(r"^ *[-\d.]+ %  ", "\n".join(lines), re.MULTILINE)) == 3
    # a design without winding data cannot be simulated, and its compensation not be studied
    assert lines[-1] == "next: pmsm-ctrl track 'my log.csv' --design 'a page.design.toml'"


def test_a_study_of_a_log_writes_the_completed_design_beside_its_page(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The study itself is tested elsewhere: here its answer is a design with one effect more."""
    from pmsm_ctrl import report

    def answer(design: Any, *_: Any, **settings: Any) -> Any:
        Path(settings["output"]).write_text("page", encoding="utf-8")
        completed = design.with_effect("constant_load", {"T_0": 0.01})
        return SimpleNamespace(summary=lambda brief: "Study", completed=completed, to_dict=dict)

    monkeypatch.setattr(report, "study", answer)
    for more, status in ([], 0), ([], 2), (["--force"], 0):
        with pytest.raises(SystemExit) as left:
            main(["study", "d.toml", "--log", "my log.csv", "-o", "d.html", *more])
        assert (left.value.code or 0) == status
    assert 'id = "constant_load"' in Path("d.design.toml").read_text(encoding="utf-8")
    assert Path("d.toml").read_text(encoding="utf-8") == PLAIN
    said = capsys.readouterr().out
    assert "design: d.design.toml" in said
    assert said.splitlines()[-1] == "next: pmsm-ctrl track 'my log.csv' --design d.design.toml"  # and not as it was


GIVEN: dict[str, dict[str, Any]] = {
    "simulate": {"design": Path("a.toml"), "output": Path("l.csv")}, "tune": {"design": Path("a.toml")},
    "sweep": {"design": Path("a.toml"), "output": Path("b.toml")}, "compensate": {"design": Path("a.toml")},
    "identify": {"design": Path("a.toml"), "log": [Path("l.csv")]},
    "add": {"design": Path("a.toml"), "log": [Path("l.csv")], "output": Path("b.toml"), "holdout": [Path("h.csv")]},
    "compare": {"design": Path("a.toml"), "log": [Path("l.csv"), Path("m.csv")]},
    "diagnose": {"design": Path("a.toml"), "log": [Path("l.csv")], "holdout": None},
    "frf": {"design": Path("a.toml"), "log": [Path("l.csv")]},
    "quadrants": {"design": Path("a.toml"), "x": Path("x.csv"), "y": Path("y.csv")},
    "verify": {"design": Path("a.toml"), "before": Path("b.csv"), "after": Path("a.csv")},
    "track": {"design": Path("a.toml"), "log": [Path("l.csv")]}, "export": {"design": Path("a.toml")},
    "study": {"design": Path("a.toml"), "log": None}, "import": {"file": Path("l.csv")}, "effects": {},
    "fleet": {"words": ["logs"], "output": None},
}  # fmt: skip


TYPED = {"tune": ["tune", "a.toml"], "frf": ["frf", "l.csv", "--design", "a.toml"]}
TYPED |= {"diagnose": ["diagnose", "l.csv", "--design", "a.toml"]}


@pytest.mark.parametrize(("verdict", "follows"), [
    ("applied", "track a.csv"), ("wrong_sign", "verify b.csv AFTER"), ("not_applied", "verify b.csv AFTER"),
    ("limit_cycle", "compensate a.toml"),
])  # fmt: skip
def test_a_drive_that_is_to_be_changed_is_verified_again(verdict: str, follows: str) -> None:
    assert next_step("verify", GIVEN["verify"], verdict, ["verify"]).startswith(f"pmsm-ctrl {follows}")


@pytest.mark.parametrize("verdict", ["consistent", "effects_missing", "inconclusive", "implausible"])
@pytest.mark.parametrize("verb", GIVEN)
def test_the_next_command_exists(verb: str, verdict: str) -> None:
    words = shlex.split(next_step(verb, GIVEN[verb], verdict, TYPED.get(verb, [verb])))
    assert words[0] == "pmsm-ctrl"
    command = COMMANDS[words[1]]
    known = {name for option in command.params for name in option.opts}
    assert [word for word in words if word.startswith("-") and word not in known] == []
    named = {name for option in command.params if option.param_type_name == "option" and option.required
             for name in option.opts}  # fmt: skip
    assert not named or named & set(words)


def test_what_was_computed_is_not_computed_again(
    designs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The design stands in the JSON of the command that found it, which is read like a design."""
    monkeypatch.chdir(tmp_path)
    axis = Design.read(designs / "seed_motor.toml")
    Path("r.json").write_text(json.dumps({"schema": "pmsm-ctrl/diagnosis/1", "design": axis.to_dict()}))
    assert Design.read("r.json").to_dict() == axis.to_dict()
    told = {"json_file": Path("r.json"), "design": Path("a.toml"), "log": [Path("l.csv")]}
    for verb, verdict, follows in (
        ("diagnose", "effects_missing", "compensate r.json"),
        ("diagnose", "consistent", "compensate r.json"),
        ("add", "", "compensate r.json"),
        ("tune", "", "study r.json"),
        ("sweep", "", "compensate r.json"),
        ("frf", "trusted", "tune r.json --output new.toml"),
        ("identify", "", "diagnose l.csv --design r.json --output new.toml"),
    ):
        assert next_step(verb, told, verdict, TYPED.get(verb, [verb])) == f"pmsm-ctrl {follows}", verb
    # JSON on standard output is no file
    assert "--output new.toml" in next_step("tune", told | {"json_file": Path("-")}, "", ["tune", "a.toml"])
    # of what cannot be simulated `compare` says where it still fails
    Path("plain.toml").write_text(PLAIN)
    after = next_step("add", {"output": Path("plain.toml"), "log": [Path("l.csv")]}, "", [])
    assert after == "pmsm-ctrl compare l.csv --design plain.toml"


@pytest.mark.parametrize("content", ["{}", "[]", "no", '{"design": "text"}', '{"design": {}}'])
def test_json_without_a_design_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    path.write_text(content)
    with pytest.raises(DesignError, match=r"r\.json"):
        Design.read(path)


def test_after_compensate_what_is_recommended_is_exported_and_then_verified(
    designs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The gain of the design itself, or the full one that an export takes for it, may be one that is refused."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("pmsm_ctrl.export.code._require_safe", lambda design: "")  # asked in test_safe_export.py
    axis = Design.read(designs / "seed_motor.toml").replace(compensation={"gain": 1.0, "source": "measured"})
    axis.write("axis.toml")
    best = axis.replace(compensation={"gain": 0.5, "source": "commanded"})
    given: dict[str, Any] = {"design": Path("axis.toml"), "step": 50.0}
    words = shlex.split(next_step("compensate", given, "", ["compensate"], best))
    stated = ["--source", "commanded", "--gain", "0.5", "--feed", "coulomb,viscous"]
    assert words == ["pmsm-ctrl", "export", "axis.toml", *stated, "--language", "st", "--output", "axis"]
    with pytest.raises(SystemExit) as left:
        main(words[1:])
    assert not left.value.code
    last = capsys.readouterr().out.splitlines()[-1]
    assert last == "next: pmsm-ctrl verify BEFORE AFTER --design axis/axis.design.toml"
    assert Design.read("axis/axis.design.toml").compensation == best.compensation
    # what a file states needs no options, and a folder that exists is not written into
    best.write("best.toml")
    written = next_step("compensate", given | {"output": Path("best.toml")}, "", ["compensate"], best)
    assert written == "pmsm-ctrl export best.toml --language st --output axis-2"
    own = next_step("compensate", given | {"design": Path("best.toml")}, "", ["compensate"], best)
    assert own == "pmsm-ctrl export best.toml --language st --output best"
    # nothing to recommend: a finer sweep is offered where it may find a gain, and nothing where no gain can help
    assert next_step("compensate", given, "finer_step", ["compensate"]) == "pmsm-ctrl compensate axis.toml --step 2"
    tuned = "pmsm-ctrl tune axis.toml --output new.toml"
    assert next_step("compensate", given | {"step": 2.0}, "finer_step", ["compensate"]) == tuned
    assert next_step("compensate", given, "not_lowered", ["compensate"]) == tuned
    assert next_step("compensate", given, "not_resolved", ["compensate"]) == ""


@pytest.mark.parametrize("scenario", ["multisine", "chirp", "noise", "prbs"])
def test_a_log_with_excitation_goes_to_frf(scenario: str) -> None:
    given = {"design": Path("a.toml"), "output": Path("l.csv"), "scenario": scenario}
    assert next_step("simulate", given) == "pmsm-ctrl frf l.csv --design a.toml --output new.toml"


def test_a_log_in_doubt_is_imported_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`compare` was the next command, which refused the log for the same doubt."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text("name = 'a'\n[motor]\nJ = 1e-4\nK_t = 0.5\n", encoding="utf-8")
    t = np.arange(4000) * 1e-3
    speed = 100.0 * np.sin(3.0 * t)
    columns = np.column_stack([t, np.cumsum(speed) * 1e-3, speed * 9.549, 0.06 * np.cos(3.0 * t)])
    np.savetxt("l.csv", columns, delimiter=",", header="t,theta,omega,i_q", comments="", fmt="%.9g")
    for words, follows in ([], "import"), (["--map", "omega=omega [rpm]"], "compare"):
        with pytest.raises(SystemExit):
            main(["import", "l.csv", "--design", "a.toml", *words])
        line = shlex.split(capsys.readouterr().out.splitlines()[-1])
        assert line[:3] == ["next:", "pmsm-ctrl", follows]
    assert next_step("import", {"file": "l.csv"}, "omega") == "pmsm-ctrl import l.csv --map 'omega=COLUMN [UNIT]'"


def test_the_next_command_keeps_the_held_out_logs() -> None:
    logs = {"design": Path("a.toml"), "log": [Path("l.csv")], "holdout": [Path("h.csv")]}
    for verb in "compare", "study":
        words = shlex.split(next_step(verb, logs, "effects_missing"))
        assert words[1:3] == ["diagnose", "l.csv"]
        assert words[words.index("--holdout") + 1] == "h.csv"


@pytest.mark.parametrize("verb", ["identify", "compare", "diagnose", "add", "track", "study"])
def test_the_next_command_keeps_the_mapping_and_own_effects(verb: str) -> None:
    """Without them it would refuse the log, or the design."""
    more = {"mapping": ["omega=n [rpm]"], "effects": SimpleNamespace(path="own.py"), "log": [Path("l.csv")]}
    words = shlex.split(next_step(verb, GIVEN[verb] | more | {"output": Path("b.toml")}, "effects_missing"))
    assert words[words.index("--map") + 1] == "omega=n [rpm]"
    assert words[words.index("--effects") + 1] == "own.py"


@pytest.mark.parametrize("verdict", ["consistent", "effects_missing"])
def test_what_a_diagnosis_fitted_is_written_before_it_is_used(verdict: str) -> None:
    """Not a compensation by the design as it was given: its parameters are others."""
    given = GIVEN["diagnose"]
    typed = ["diagnose", "l.csv", "--design", "a.toml", "--holdout", "h.csv"]
    assert next_step("diagnose", given, verdict, typed) == f"pmsm-ctrl {shlex.join(typed)} --output new.toml"
    after = next_step("diagnose", given | {"output": Path("b.toml")}, "consistent")
    assert after == "pmsm-ctrl compensate b.toml"


def test_a_command_that_is_to_be_repeated_keeps_its_options(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What a tuning by other options would write is not what was shown."""
    (here / "m.toml").write_text("[motor]\nJ = 9e-5\np = 4\npsi_f = 0.172\nR = 19.0\nL_d = 0.049\nL_q = 0.049\n")
    line = ["tune", "m.toml", "--no-prove", "--phase-margin", "55", "--speed", "pole_placement"]
    with pytest.raises(SystemExit):
        main([*line, "--no-filters"])
    said = capsys.readouterr().out.splitlines()[-1]
    found = shlex.split(said)
    assert found[:4] == ["next:", "pmsm-ctrl", "tune", "m.toml"]
    assert sorted(found[4:]) == sorted(["--no-prove", "--no-filters", "--phase-margin", "55.0", "--speed",
                                        "pole_placement", "--output", "new.toml"])  # fmt: skip


def test_after_a_confirmed_proposal_the_log_is_read_in_the_same_way(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = Path("my log.csv").read_text(encoding="utf-8").splitlines()
    Path("foreign.csv").write_text("\n".join(["n;speed act [rpm];M", *(
        f"{k};{float(line.split(',')[1]) * 30 / np.pi:.9g};{line.split(',')[2]}" for k, line in enumerate(lines[1:])
    )]), encoding="utf-8")  # fmt: skip
    line = ["import", "foreign.csv", "-d", "d.toml", "--rate", "1000", "-m", "omega=speed act [rpm]", "-m",
            "torque=M [N m]"]  # fmt: skip
    with pytest.raises(SystemExit) as left:
        main(line)
    assert not left.value.code
    words = shlex.split(capsys.readouterr().out.splitlines()[-1])
    assert words[:5] == ["next:", "pmsm-ctrl", "compare", "foreign.csv", "--design"]
    with pytest.raises(SystemExit) as left:
        main(words[2:])
    assert not left.value.code


def test_no_bound_is_a_number_to_be_counted_out() -> None:
    """``[1e-06<=x<=1000000000.0]`` stood in the help of ``import``."""
    for name, command in COMMANDS.items():
        text = command.get_help(command.context_class(command, info_name=name))
        assert not re.search(r"\d{7}", text), name


def test_an_import_without_a_design_leads_to_one() -> None:
    assert next_step("import", {"file": Path("l.csv")}) == "pmsm-ctrl init axis"
    given = {"file": Path("l.csv"), "design": Path("a.toml")}
    assert next_step("import", given) == "pmsm-ctrl compare l.csv --design a.toml"


def test_every_command_has_a_next_one() -> None:
    """init and workbench say it themselves, a schema is no step of an evaluation."""
    assert set(COMMANDS) - set(GIVEN) <= {"init", "workbench", "schema"}


def test_a_page_that_exists_is_not_offered_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    given = {"words": ["logs"], "output": "r"}
    assert next_step("fleet", given) == "pmsm-ctrl fleet report r --output fleet.html"
    Path("fleet.html").touch()
    assert next_step("fleet", given) == "pmsm-ctrl fleet report r --output fleet-2.html"


def test_a_page_of_a_fleet_leads_to_the_log_of_an_axis() -> None:
    given = {"words": ["report", "results"], "output": "fleet.html"}
    assert next_step("fleet", given) == "pmsm-ctrl diagnose LOG --design DESIGN --output new.toml"
    for words in ["logs"], ["example", "night"]:  # the page is written already; the same again would evaluate nothing
        given = {"words": words, "report": Path("night.html"), "design": Path("a.toml")}
        assert next_step("fleet", given) == "pmsm-ctrl diagnose LOG --design a.toml --output new.toml"
    given = {"words": ["logs"], "report": Path("p.html"), "odd": ("logs/c.csv", "c.toml"), "effects": Path("own.py")}
    follows = "pmsm-ctrl diagnose logs/c.csv --design c.toml --output new.toml --effects own.py"
    assert next_step("fleet", given) == follows
    assert next_step("fleet", {"words": ["example", "night"]}) == "pmsm-ctrl fleet night/run.toml"


def test_a_brief_section_keeps_what_is_essential() -> None:
    found = Table(("effect",), (("cogging",),))
    long = Table(("n",), tuple((str(k),) for k in range(40)))
    notices = tuple(Notice(f"code_{k}", f"doubt {k}") for k in range(5))
    section = Section("Title", ("The verdict.", *notices, long, "A detail.", found, long), essential=(found,))
    text = to_text(section.brief(), 80)
    assert "The verdict." in text
    assert re.findall(r"doubt \d", text) == ["doubt 0", "doubt 1", "doubt 2"]
    assert "cogging" in text
    assert "A detail" not in text
    assert "... 29 more" in text
    assert "--verbose shows 2 more warnings and everything else." in text
    assert "shows 1 more warning and" in to_text(Section("Title", (*notices[:4], long, found)).brief())
    short = Section("Title", ("The verdict.", found))
    assert to_text(short.brief()) == to_text(short)


def test_json_on_a_console_of_another_encoding_keeps_its_letters(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A Windows console of code page 1252, or LC_ALL=C: a question mark would be another value."""
    raw = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(raw, encoding="ascii", errors="replace", write_through=True))
    with console.json_to_stdout():
        console.write_json(console.STDOUT, "compare", {"unit": "°C", "name": "ψ_f"})
    assert json.loads(raw.getvalue())["name"] == "ψ_f"
