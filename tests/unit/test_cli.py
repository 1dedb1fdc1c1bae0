"""The command line as a user meets it: exit status, one line on stderr, and no half-written output."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import console
from pmsm_ctrl.cli import app, main
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.errors import NextCommand, PmsmCtrlError, RequestError
from pmsm_ctrl.next_steps import completed_beside, next_step
from pmsm_ctrl.report.catalogue import describe_effect

SEED_MOTOR = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"
PLAIN = (
    "[motor]\nJ = 1e-4\nK_t = 1.0\n[[effects]]\nid = 'coulomb'\nF_c = 0.02\n[[effects]]\nid = 'viscous'\nF_v = 2e-4\n"
)


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(a) for a in arguments])
    return int(left.value.code or 0)


@pytest.fixture
def design(tmp_path: Path) -> Path:
    path = tmp_path / "axis.toml"
    path.write_text(PLAIN, encoding="utf-8")
    return path


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """Torque of a known axis in closed form: J = 1e-4, F_c = 0.02, F_v = 2e-4, and white noise."""
    t = np.arange(0, 4, 1e-3)
    omega = 80 * np.sin(2 * np.pi * 0.5 * t) + 40 * np.sin(2 * np.pi * 1.3 * t + 1)
    alpha = 80 * np.pi * np.cos(2 * np.pi * 0.5 * t) + 40 * 2.6 * np.pi * np.cos(2 * np.pi * 1.3 * t + 1)
    noise = np.random.default_rng(5).normal(0, 1e-3, t.size)
    torque = 1e-4 * alpha + 0.02 * np.sign(omega) + 2e-4 * omega + noise
    path = tmp_path / "axis.csv"
    rows = "\n".join(f"{a!r},{b!r},{c!r}" for a, b, c in zip(t.tolist(), omega.tolist(), torque.tolist(), strict=True))
    path.write_text(f"t [s],omega [rad/s],torque [N m]\n{rows}\n", encoding="utf-8")
    return path


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """Run a command that must be refused: status 2, one line on stderr, nothing on stdout."""
    assert call(*arguments) == console.BAD_INPUT
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("pmsm-ctrl: ")
    assert shown.err.count("\n") == 1
    return shown.err


# ---- what works -------------------------------------------------------------------------------------------------


def test_help_names_every_verb_and_the_exit_status(capsys: pytest.CaptureFixture[str]) -> None:
    assert call() == 0
    without_words = capsys.readouterr().out
    assert call("--help") == 0
    text = capsys.readouterr().out
    for command in app.registered_commands:
        name = command.name or command.callback.__name__  # type: ignore[union-attr]
        assert f"  {name} " in text
    assert text == without_words
    assert "Exit status: 0 done, 1 the answer is negative, 2 bad input" in text


def test_help_answers_well_under_a_second() -> None:
    """In processor time: what other work of the machine takes is not the command's."""
    resource = pytest.importorskip("resource")

    def spent() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return float(used.ru_utime + used.ru_stime)

    best = float("inf")
    for _ in range(3):
        before = spent()
        subprocess.run([sys.executable, "-m", "pmsm_ctrl", "--help"], check=True, capture_output=True)
        best = min(best, spent() - before)
        if best < 0.6:
            return
    pytest.fail(f"{best:.2f} s")


@pytest.mark.parametrize("verb", ["identify", "diagnose", "import"])
def test_help_of_a_verb_names_what_its_answer_names(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    """An answer ends with "--verbose shows ...", which no verb's help knew."""
    assert call(verb, "--help") == 0
    assert "--verbose prints all of a result" in capsys.readouterr().out


def test_help_of_simulate_names_every_motion(capsys: pytest.CaptureFixture[str]) -> None:
    from pmsm_ctrl.simulate.scenarios import SCENARIOS

    assert call("simulate", "--help") == 0
    said = " ".join(capsys.readouterr().out.split())
    *names, last = SCENARIOS
    assert f"the motion: {', '.join(names)} or {last}" in said


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    import pmsm_ctrl

    assert call("--version") == 0
    assert capsys.readouterr().out == f"pmsm-ctrl {pmsm_ctrl.__version__}\n"


def test_every_verb_writes_json() -> None:
    for command in app.registered_commands:
        callback = command.callback
        assert callback is not None
        if callback.__name__ not in ("workbench", "schema"):  # a page that stays open; JSON itself
            assert "json_file" in callback.__annotations__, f"{callback.__name__} has no --json"


def test_identify_finds_the_axis_and_writes_what_was_asked(
    tmp_path: Path, design: Path, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, new, page = tmp_path / "r.json", tmp_path / "new.toml", tmp_path / "r.html"
    status = call("identify", log, "--design", design, "--json", result, "--output", new, "--report", page)
    assert status == 0
    assert "F_c" in capsys.readouterr().out
    data = json.loads(result.read_text(encoding="utf-8"))
    assert data["schema"].startswith("pmsm-ctrl/")
    for name, value in {"J": 1e-4, "F_c": 0.02, "F_v": 2e-4}.items():
        found = data["parameters"][name]
        assert found["value"] == pytest.approx(value, rel=0.01)
        assert abs(found["value"] - value) < 4 * found["stderr"]
    from pmsm_ctrl import Design

    assert Design.read(new).parameters("coulomb")["F_c"] == data["parameters"]["F_c"]["value"]
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert not list(tmp_path.glob(".*"))


def test_add_shows_the_errors_before_and_after(
    tmp_path: Path, design: Path, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The log with a constant torque of 5 mN m; the hold-out is the same motion with other noise."""
    rows = np.loadtxt(log, delimiter=",", skiprows=1)
    rows[:, 2] += 0.005
    other = rows + np.random.default_rng(8).normal(0, 1e-3, len(rows))[:, None] * [0.0, 0.0, 1.0]
    paths = [tmp_path / "pushed.csv", tmp_path / "other.csv"]
    for path, values in zip(paths, (rows, other), strict=True):
        np.savetxt(path, values, fmt="%.17g", delimiter=",", header="t [s],omega [rad/s],torque [N m]", comments="")
    new, data, page = tmp_path / "new.toml", tmp_path / "a.json", tmp_path / "a.html"
    words = ["add", "constant_load", "-d", design, "--log", paths[0], "--holdout", paths[1]]
    assert call(*words, "-o", new, "--json", data, "--report", page) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert re.search(r"The log supports Constant [^:]+ with it\.", out)
    assert re.search(r"T_0 0\.00[45]\d+ ± \S+ N m -", out)
    told = json.loads(data.read_text(encoding="utf-8"))
    assert told["supported"]
    for errors in (told["errors"], told["holdout"]):
        before, after = (errors[which]["torque"]["relative"] for which in ("base", "final"))
        assert after < 0.5 * before
    T_0 = told["parameters"]["T_0"]
    assert abs(T_0["value"] - 0.005) < 4 * T_0["stderr"]
    assert told["design"] == Design.read(new).to_dict()
    assert "The log supports Constant" in page.read_text(encoding="utf-8")


def test_add_refuses_what_the_log_does_not_support(
    tmp_path: Path, design: Path, log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An effect-free log got a backlash of 0.038 rad with a load of 1e-12, and status 0."""
    new, data = tmp_path / "new.toml", tmp_path / "a.json"
    words = ["add", "constant_load", "--design", design, "--log", log, "--output", new, "--json", data]
    assert call(*words) == 1
    assert not new.exists()
    shown = capsys.readouterr()
    assert re.search(r"does not support Constant [^:.]+: not significant", " ".join(shown.out.split()))
    assert "--force writes it" in shown.err
    told = json.loads(data.read_text(encoding="utf-8"))
    assert not told["supported"]
    assert "not significant" in told["against"][0]
    assert call(*words, "--force") == 0
    assert Design.read(new).parameters("constant_load")


def test_track(tmp_path: Path, design: Path, log: Path) -> None:
    result = tmp_path / "t.json"
    assert call("track", log, "--design", design, "--json", result) == 0
    data = json.loads(result.read_text(encoding="utf-8"))
    assert data["estimates"]["F_c"]["value"] == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize(("names", "more"), [("none", set()), ("T_load", {"T_load"}), ("T_load, J", {"T_load", "J"})])
def test_track_estimates_what_is_asked_for(tmp_path: Path, design: Path, log: Path, names: str, more: set[str]) -> None:
    result = tmp_path / "t.json"
    assert call("track", log, "--design", design, "--estimate", names, "--json", result) == 0
    assert set(json.loads(result.read_text(encoding="utf-8"))["estimates"]) == {"F_c", "F_v"} | more


def test_track_refuses_to_estimate_what_it_cannot(capsys: pytest.CaptureFixture[str], design: Path, log: Path) -> None:
    assert "found 'mass'; accepted: T_load, J" in refused(
        capsys, "track", log, "--design", design, "--estimate", "mass"
    )


def test_map_names_foreign_columns(tmp_path: Path, design: Path, capsys: pytest.CaptureFixture[str]) -> None:
    foreign = tmp_path / "foreign.csv"
    t = np.arange(0, 5, 0.01)
    rows = "\n".join(f"{a},{b},{c}" for a, b, c in zip(t, 600 * np.sin(t), np.cos(t), strict=True))
    foreign.write_text(f"zeit,drehzahl,moment\n{rows}\n", encoding="utf-8")
    result = tmp_path / "i.json"
    maps = ["--map", "t=zeit [s]", "-m", "omega=drehzahl [rpm]", "-m", "torque=moment [Nm]"]
    assert call("import", foreign, *maps, "--json", result, "--output", tmp_path / "canonical.csv") == 0
    found = json.loads(result.read_text())["channels"]
    assert {name: channel["unit"] for name, channel in found.items()} == {"t": "s", "omega": "rad/s", "torque": "N m"}
    assert 'omega = "drehzahl [rpm]"' in (tmp_path / "canonical.log.toml").read_text()
    assert (tmp_path / "canonical.csv").read_text().startswith("t [s],omega [rad/s],torque [N m]\n")
    # 600 rpm is 20 pi rad/s
    assert f"{-20 * np.pi:.3g}"[:5] in capsys.readouterr().out


def test_effects_lists_the_whole_catalogue(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("effects", "--json", tmp_path / "e.json") == 0
    out = capsys.readouterr().out
    data = json.loads((tmp_path / "e.json").read_text(encoding="utf-8"))
    assert data["schema"] == "pmsm-ctrl/effects/1"
    assert [row["id"] for row in data["effects"]] == list(CATALOGUE)
    for effect in CATALOGUE.values():
        assert f"\n{effect.id} " in out
        assert all(word in out for word in effect.needs.split()), "the cells are wrapped at their blanks"


# ---- what is refused --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "empty"),
        (b"t [s],omega [rad/s],torque [N m]\n", "axis2.csv"),
        (b"t [s],omega [rad/s],torque [N m]\n0,1,nan\n1,2,3\n2,3,4\n", "axis2.csv"),
        (b"t [s],omega [rad/s],torque [N m]\n0,1,1\n2,2,3\n1,3,4\n", "backwards"),
        (b"t [s],omega [rad/s],torque [N m]\n0,1,1\n0,2,3\n1,3,4\n", "same time stamp"),
        (b"t [s],omega [furlong/s],torque [N m]\n0,1,1\n1,2,3\n2,3,4\n", "furlong"),
        (b"t [s],omega [rad/s]\n0,1\n1,2\n2,3\n", "torque"),
        (b"\x00\x01\x02\x03" * 40, "axis2.csv"),
    ],
)
def test_bad_log_is_one_line(
    tmp_path: Path, design: Path, content: bytes, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "axis2.csv"
    path.write_bytes(content)
    outputs = ["--json", tmp_path / "r.json", "--output", tmp_path / "n.toml", "--report", tmp_path / "r.html"]
    before = sorted(tmp_path.iterdir())
    assert expected in refused(capsys, "identify", path, "--design", design, *outputs)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[motor]\nJ = 'heavy'\nK_t = 1.0\n", "motor.J"),
        ("[motor]\nJ = -1e-4\nK_t = 1.0\n", "motor.J"),
        ("[motor\n", "not valid TOML"),
        ("", "empty"),
        (PLAIN.replace("coulomb", "coulom"), "did you mean 'coulomb'"),
        (PLAIN.replace("F_c = 0.02", "F_c = -0.02"), "F_c"),
    ],
)
def test_bad_design_is_one_line(
    tmp_path: Path, log: Path, text: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text, encoding="utf-8")
    message = refused(capsys, "identify", log, "--design", path, "--json", tmp_path / "r.json")
    assert expected in message
    assert str(path) in message
    assert not (tmp_path / "r.json").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["identfy"], "identify"),
        (["identify", "x.csv"], "--design"),
        (["identify", "none.csv", "--design", str(SEED_MOTOR)], "none.csv: no such file"),
        (["identify", "none.csv", "--design", "none.toml"], "none.toml: no such file"),
        (["study", "none.toml"], "none.toml: no such file"),
        (["study", str(SEED_MOTOR), "--seed", "x"], "--seed"),
        (["study", str(SEED_MOTOR), "--seed", "-1"], "--seed"),
        (["simulate", str(SEED_MOTOR), "--scenario", "sweeep", "--output", "x.csv"], "did you mean 'sweep'"),
        (["simulate", str(SEED_MOTOR)], "--output"),
        (["effects", "coulom"], "did you mean 'coulomb'"),
        (["import", "none.csv", "--map", "omega"], "--map 'omega'"),
        (["sweep", str(SEED_MOTOR), "--paper", "--output", "x.toml"], "--paper: excludes"),
        (["tune", str(SEED_MOTOR), "--keep", "--robust"], "--keep: excludes"),
        (["tune", str(SEED_MOTOR), "--keep", "--speed", "bandwidth"], "--keep: excludes"),
    ],
)
def test_wrong_request_is_one_line(
    arguments: list[str],
    expected: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert expected in refused(capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_output_in_a_missing_folder(
    design: Path, log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("identify", log, "--design", design, "--json", tmp_path / "none" / "r.json") == 2
    assert "cannot write here" in capsys.readouterr().err


# ---- the frame around every verb --------------------------------------------------------------------------------


def outcome_of(error: BaseException | None, *words: str) -> int:
    def command(**_: object) -> None:
        if error is not None:
            raise error

    return console.run(command, words)


@pytest.mark.parametrize(
    ("error", "status", "expected"),
    [
        (None, 0, ""),
        (PmsmCtrlError("axis.toml: two\nlines"), 2, "axis.toml: two lines"),
        (FileNotFoundError(2, "No such file", "x.csv"), 2, "x.csv: No such file"),
        (MemoryError(), 2, "not enough memory"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (ZeroDivisionError("float division"), 70, "unexpected ZeroDivisionError: float division. Please report it"),
    ],
)
def test_every_exception_is_one_line(
    error: BaseException | None, status: int, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert outcome_of(error) == status
    shown = capsys.readouterr().err
    assert expected in shown
    assert shown.count("\n") == (1 if error is not None else 0)
    assert "Traceback" not in shown


def test_debug_shows_the_traceback(capsys: pytest.CaptureFixture[str]) -> None:
    assert outcome_of(ZeroDivisionError("x"), "--debug") == 70
    assert "Traceback" in capsys.readouterr().err


def test_map_entries() -> None:
    assert console.parse_map(["omega=speed [rpm]", "t = a=b"]) == {"omega": "speed [rpm]", "t": "a=b"}
    for wrong in (["omega"], ["=x"], ["omega="], ["t=a", "t=b"]):
        with pytest.raises(RequestError):
            console.parse_map(wrong)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals and pipes")
def test_reader_that_leaves_early_is_no_error() -> None:
    command = f"{sys.executable} -m pmsm_ctrl effects | true; exit ${{PIPESTATUS[0]}}"
    run = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert run.returncode in (0, console.BROKEN_PIPE)
    assert run.stderr == ""


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals and pipes")
def test_an_interrupt_while_the_command_line_is_loaded_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import builtins

    from pmsm_ctrl.__main__ import main as start

    real = builtins.__import__

    def interrupted(name: str, *words: object, **named: object) -> object:
        if name == "pmsm_ctrl.cli":
            raise KeyboardInterrupt
        return real(name, *words, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", interrupted)
    with pytest.raises(SystemExit) as left:
        start()
    assert left.value.code == 130
    assert capsys.readouterr().err == "pmsm-ctrl: interrupted; no incomplete file was written\n"


@pytest.mark.parametrize(("sent", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_command_leaves_nothing_behind(tmp_path: Path, sent: signal.Signals, status: int) -> None:
    # The probe is killed while it writes; the file it would have replaced must be whole.
    target = tmp_path / "out.txt"
    target.write_text("old", encoding="utf-8")
    # Tests that were started in the background of a shell inherit that the interrupt is ignored.
    probe = (
        "import signal, sys, time\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from pmsm_ctrl.console import run\n"
        "from pmsm_ctrl.files import atomic_path\n"
        "def command(**_):\n"
        f"    with atomic_path({str(target)!r}) as path:\n"
        "        path.write_text('half')\n"
        "        print('writing', flush=True)\n"
        "        for _ in range(3000):\n"  # a signal that another thread takes ends no sleep of the main one
        "            time.sleep(0.01)\n"
        "sys.exit(run(command, []))\n"
    )
    process = subprocess.Popen([sys.executable, "-c", probe], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "writing\n"
    process.send_signal(sent)
    _, shown = process.communicate(timeout=20)
    assert process.returncode == status
    assert "Traceback" not in shown
    assert target.read_text(encoding="utf-8") == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["out.txt"]


def test_an_interrupted_verb_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Newer typer takes the interrupt and returns its status: the line was lost, and only there."""
    import pmsm_ctrl.effects

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pmsm_ctrl.effects, "lookup", interrupted)
    assert console.run(app, ["effects", "stribeck"]) == 130
    assert capsys.readouterr().err == "pmsm-ctrl: interrupted; no incomplete file was written\n"


def test_one_effect_of_a_design_has_its_units_and_needs_no_loops() -> None:
    """Detent force of a linear axis was listed in N m and rad; without loops nothing was."""
    axis = Design.from_toml('name = "lin"\nmotion = "linear"\n[motor]\nJ = 10.0\nK_t = 50.0\n')
    entry = describe_effect(CATALOGUE["detent_force"], axis)
    assert [row["unit"] for row in entry.to_dict()["parameters"]] == ["N", "N", "m"]
    assert "N m" not in entry.summary()
    assert [one.code for one in entry.notices] == ["no_signature"]


def test_a_complete_study_is_followed_by_the_drive(tmp_path: Path, designs: Path) -> None:
    """It had compensated and exported, and proposed to compensate."""
    Design.read(designs / "servo_2kw.toml").write(completed_beside(tmp_path / "page.html"))
    given = {"design": "d.toml", "log": ["l.csv"], "output": tmp_path / "page.html"}
    assert next_step("study", given).startswith("pmsm-ctrl compensate ")
    assert next_step("study", given | {"complete": True}).startswith("pmsm-ctrl verify BEFORE AFTER --design ")


def test_one_effect_in_full_with_its_signature(
    tmp_path: Path, designs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "cogging.svg"
    assert call("effects", "cogging", "--design", designs / "seed_motor.toml", "--output", picture) == 0
    shown = capsys.readouterr().out
    assert "A_k sin (kθ + φ_k)" in shown
    assert "mechanical order k" in shown
    assert picture.read_text(encoding="utf-8").startswith("<?xml")


def test_a_signature_of_a_design_without_loops_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    axis, picture = tmp_path / "lin.toml", tmp_path / "x.png"
    axis.write_text('name = "lin"\nmotion = "linear"\n[motor]\nJ = 10.0\nK_t = 50.0\n', encoding="utf-8")
    said = refused(capsys, "effects", "coulomb", "--design", str(axis), "--output", str(picture))
    assert "lin.toml: loops: missing" in said
    assert not picture.exists()
    assert call("effects", "coulomb", "--design", axis) == 0  # only the picture needs them


def test_simulate_takes_parameters_of_the_motion(tmp_path: Path, designs: Path) -> None:
    log = tmp_path / "short.csv"
    words = ("--set", "speed_max=20", "--set", "speed_step=20", "--set", "dwell=0.2")
    assert call("simulate", designs / "seed_motor.toml", "--scenario", "sweep", "--output", log, *words) == 0
    omega_ref = np.genfromtxt(log, delimiter=",", skip_header=1)[:, 9]
    assert np.abs(omega_ref).max() == 20.0


@pytest.mark.parametrize(("speed", "limited"), [("1e6", True), ("40", False)])
def test_a_motion_that_the_drive_cannot_follow_is_told(
    tmp_path: Path, designs: Path, speed: str, limited: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--scenario", "triangle", "--set", f"speed={speed}", "--set", "cycles=1", "--json", tmp_path / "x.json")
    assert call("simulate", designs / "seed_motor.toml", "--output", tmp_path / "x.csv", *words) == 0
    said = capsys.readouterr().err
    assert ("the drive does not follow this motion" in said and "[at_current_limit]" in said) is limited
    found = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert found["warning_codes"] == ["at_current_limit"] * limited


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--set", "speed_max"], "NAME=NUMBER was expected"),
        (["--set", "speed_mx=3"], "did you mean 'speed_max'"),
    ],
)
def test_bad_motion_parameters(
    tmp_path: Path, designs: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("simulate", designs / "seed_motor.toml", "--output", tmp_path / "x.csv", *words) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["effects", "--output", "x.svg"], "need the name of one effect"),
        (["effects", "cogging", "--output", "x.svg"], "needs --design"),
        (["effects", "cogging", "--design", "DESIGN", "--output", "x.bmp"], "pictures are written as"),
    ],
)
def test_bad_requests_to_effects(
    designs: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(*(str(designs / "seed_motor.toml") if word == "DESIGN" else word for word in words)) == 2
    assert said in capsys.readouterr().err


# ---- the way on -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "next_command"),
    [
        (["tune", "nowhere.toml"], "pmsm-ctrl init"),
        (["identify", "LOG", "--design", "DESIGN"], "pmsm-ctrl import LOG proposes a mapping"),
        (["effects", "cogginf"], "pmsm-ctrl effects"),
        (["import", "LOG", "--map", "omega=nothing"], ""),
        (["import", "LOG", "--map", "omega=drehzahl [parsec]"], ""),  # not the command that has just failed
    ],
)
def test_an_error_names_the_next_command(
    tmp_path: Path, design: Path, words: list[str], next_command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "foreign.csv"
    log.write_text("zeit;drehzahl\n0;1\n1;2\n2;3\n3;2\n", encoding="utf-8")
    message = refused(capsys, *({"LOG": str(log), "DESIGN": str(design)}.get(word, word) for word in words))
    if next_command:
        assert f"next: {next_command}" in message
    else:
        assert "next:" not in message


def test_every_next_command_exists() -> None:
    verbs = {c.name or c.callback.__name__ for c in app.registered_commands if c.callback is not None}
    named = [member.value.split()[1] for member in NextCommand if member.value.startswith("pmsm-ctrl ")]
    assert named
    assert set(named) <= verbs


def test_a_pipe_without_greek_letters_gets_the_answer_all_the_same() -> None:
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    command = [sys.executable, "-m", "pmsm_ctrl", "effects", "cogging"]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "sin (k?" in run.stdout


def shell_asks(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], **variables: str) -> str:
    """Return what the command line answers to the script of a shell's completion."""
    monkeypatch.setattr(sys, "argv", ["pmsm-ctrl"])
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SystemExit) as left:
        main()
    assert not left.value.code
    return capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("pmsm-ctrl in", ["init"]),
        ("pmsm-ctrl tune --cur", ["--current", "--current-bandwidth"]),
        ("pmsm-ctrl effects cog", ["cogging"]),
        ("pmsm-ctrl simulate x --scenario tri", ["triangle"]),
    ],
)
def test_the_shell_completes_verbs_options_effects_and_scenarios(
    words: str, offered: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    last = str(len(words.split(" ")) - 1)
    said = shell_asks(
        monkeypatch, capsys, _PMSM_CTRL_COMPLETE="complete_bash", COMP_WORDS=words, COMP_CWORD=last
    )  # fmt: skip
    assert said.split() == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_script_is_shown(
    shell: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = shell_asks(monkeypatch, capsys, _PMSM_CTRL_COMPLETE=f"source_{shell}")
    assert "pmsm-ctrl" in said
    assert f"complete_{shell}" in said


OWN_EFFECT = """
import math

from pmsm_ctrl.effects import Effect, Parameter, kernel
from pmsm_ctrl.effects.stribeck import effect as stribeck
from seal_shape import shape


@kernel
def drag(omega, direction, k_seal):
    return k_seal * shape(omega) * direction


seal = Effect(
    id="seal_drag", title="Wiper seal", equation="k sqrt(w)", source="a user", enters="torque",
    parameters=(Parameter("k_seal", "N m", 0.0, 0.0, math.inf, "drag at 1 rad/s", linear=True),),
    term=drag, needs="several speeds",
)
"""
SHAPE = "import math\nfrom pmsm_ctrl.effects import kernel\n\n\n@kernel\ndef shape(w):\n    return math.sqrt(abs(w))\n"


@pytest.fixture
def own(tmp_path: Path) -> Path:
    path = tmp_path / "seal.py"
    path.write_text(OWN_EFFECT, encoding="utf-8")
    (tmp_path / "seal_shape.py").write_text(SHAPE, encoding="utf-8")
    return path


def test_own_effects_of_a_file_are_known_to_the_verbs(
    design: Path, log: Path, own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    design.write_text(PLAIN + "[[effects]]\nid = 'seal_drag'\nk_seal = 0.0\n", encoding="utf-8")
    assert "unknown effect 'seal_drag'" in refused(capsys, "identify", log, "--design", design)
    found = tmp_path / "found.json"
    assert call("identify", log, "--design", design, "--effects", own, "--json", found) == console.DONE
    parameters = json.loads(found.read_text(encoding="utf-8"))["parameters"]
    assert abs(parameters["k_seal"]["value"]) < 1e-4  # the log has none of it
    assert call("effects", "seal_drag", "--effects", own) == console.DONE
    assert "Wiper seal" in capsys.readouterr().out
    assert call("effects", "--effects", own) == console.DONE
    assert "seal_drag" in capsys.readouterr().out


@pytest.mark.parametrize("code", ["__import__('os').system('true')", "seal.py"])
def test_a_design_file_never_names_code(design: Path, code: str, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("own_effects", "_own_effects"):
        design.write_text(f"{name} = [{code!r}]\n" + PLAIN, encoding="utf-8")
        assert name in refused(capsys, "identify", "none.csv", "--design", design)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "no such file"),
        ("x = 1\n", "defines no effect"),
        ("x = 1\n1 / 0\n", "line 2: cannot be run: ZeroDivisionError"),
        ("def broken(:\n", "line 1: cannot be run: SyntaxError"),
        ("import sys\nsys.exit(0)\n", "line 2: cannot be run: SystemExit"),
        ("import nowhere_to_be_found\n", "line 1: cannot be run: ModuleNotFoundError"),
        (OWN_EFFECT.replace('id="seal_drag"', 'id="coulomb"'), "already"),
        (OWN_EFFECT + "import dataclasses\nother = dataclasses.replace(seal)\n", "two effects have the id 'seal_drag'"),
    ],
)
def test_a_file_of_effects_that_is_of_no_use_is_one_line(
    text: str | None, said: str, design: Path, log: Path, own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if text is None:
        own.unlink()
    else:
        own.write_text(text, encoding="utf-8")
    assert said in refused(capsys, "identify", log, "--design", design, "--effects", own)


def test_every_verb_with_a_design_takes_own_effects_and_says_that_the_file_is_run() -> None:
    import typer

    for name, verb in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        options = {option.name: option for option in verb.params}
        if "design" in options and name not in ("import", "workbench"):  # see their own options and docs
            found = [option for option in verb.params if "--effects" in option.opts]
            assert found, name
            assert "RUNS" in found[0].help


# ---- several logs -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_several_logs_by_name_pattern_and_folder(
    tmp_path: Path, design: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from tests.unit.several import record

    folder = tmp_path / "logs"
    folder.mkdir()
    for k in (1, 2, 10):
        record(k, 2.0).write_csv(folder / f"run_{k}.csv")
    page = tmp_path / "found.json"
    files = [folder / f"run_{k}.csv" for k in (1, 2, 10)]
    for logs in (files, [folder], [folder / "run_*.csv"]):
        assert call("identify", *logs, "--design", design, "--json", page, "--force") == 0
        names = [row["name"] for row in json.loads(page.read_text("utf-8"))["records"]]
        assert names == [str(path) for path in files]
        capsys.readouterr()
    assert "run_3.csv: no such file" in refused(capsys, "compare", *files, folder / "run_3.csv", "--design", design)
    assert "no file matches" in refused(capsys, "track", folder / "*.mat", "--design", design)
    assert "given twice" in refused(capsys, "diagnose", files[0], files[0], "--design", design)
    (folder / "empty.csv").touch()
    assert "empty.csv: empty" in refused(capsys, "identify", folder, "--design", design)


@pytest.mark.parametrize(
    ("header", "factor", "said"),
    [
        ("t [s],theta [m],torque [N m]", 1.0, 'unit [m] does not fit \'theta\' in rad'),
        ("t [s],theta [rad],torque [N]", 1.0, "unit [N] does not fit 'torque' in N m"),
        ("t [s],theta [furlong],torque [N m]", 1.0, "unknown unit [furlong]"),
        ("t [s],theta [rad],torque [N m]", 1e3, "times the design's J"),
        ("t [s],theta [rad],torque [N m]", 0.0, "no row of numbers"),
        ("", 0.0, "empty"),
    ],
    ids=["linear axis", "force", "unknown unit", "unit not said", "no rows", "empty"],
)  # fmt: skip
@pytest.mark.parametrize("verb", ["identify", "study"])
def test_one_bad_record_among_good_ones_is_named_in_one_line(
    verb: str, header: str, factor: float, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from tests.unit.several import DESIGN, record

    axis, good, bad = tmp_path / "axis.toml", tmp_path / "good.csv", tmp_path / "bad.csv"
    axis.write_text(DESIGN.to_toml(), encoding="utf-8")
    record(1, 2.0).write_csv(good)
    log = record(2, 2.0)
    rows = [f"{t:.4f},{th:.9g},{factor * u:.9g}" for t, th, u in zip(log.t, log["theta"], log["torque"], strict=True)]
    bad.write_text("\n".join([header, *(rows if factor else [])] if header else []), encoding="utf-8")
    page = tmp_path / "page.html"
    given = (
        [good, bad, "--design", axis] if verb == "identify" else [axis, "--log", good, "--log", bad, "--output", page]
    )
    line = refused(capsys, verb, *given)
    assert "bad.csv: " in line
    assert said in line
    assert not page.exists()


def test_a_study_of_two_logs_has_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from tests.unit.several import DESIGN, record

    monkeypatch.setattr("pmsm_ctrl.rendering.html.inline_svg", lambda *given: "<svg></svg>")  # seconds, not asked here
    monkeypatch.setattr("pmsm_ctrl.rendering.live.available", lambda: False)
    axis, page = tmp_path / "axis.toml", tmp_path / "page.html"
    axis.write_text(DESIGN.to_toml(), encoding="utf-8")
    files = [tmp_path / f"run_{k}.csv" for k in (1, 2)]
    for k, path in enumerate(files, start=1):
        record(k, 2.0).write_csv(path)
    given = [item for path in files for item in ("--log", path)]
    assert call("study", axis, *given, "--output", page, "--json", tmp_path / "page.json") == 0
    assert "diagnosed from 2 records" in capsys.readouterr().out
    found = json.loads((tmp_path / "page.json").read_text("utf-8"))
    assert [row["name"] for row in found["identify"]["records"]] == [str(path) for path in files]
    assert all(path.name in page.read_text("utf-8") for path in files)
