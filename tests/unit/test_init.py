"""From a datasheet to a design: units as sheets write them, nothing guessed, nothing overwritten."""

from __future__ import annotations

import io
import json
import math
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmsm_ctrl import Design, Log
from pmsm_ctrl.cli import main
from pmsm_ctrl.datasheet import (
    MACHINES,
    QUESTIONS,
    Question,
    answers_from,
    design_toml,
    machine_of,
    plausibility,
    read_answer,
)  # fmt: skip
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.init import _asking
from tests.characters import ANY_CHARACTER

ROOT = Path(__file__).resolve().parents[2]
BY_KEY = {question.key: question for question in QUESTIONS}
# An imagined sheet: 0.84 N m/A rms and 50.8 V rms line-to-line per 1000 rpm state the same flux.
SHEET = {
    "pole_pairs": "5", "torque_constant": "0.84 N m/A rms", "emf_constant": "50.8 V rms line/krpm",
    "resistance": "1.1 Ohm line", "inductance": "7.6 mH line", "inertia": "1.6 kg cm2", "current_limit": "9 A rms",
    "supply": "230 V ac", "load_inertia": "200 kg cm2", "gear": "10", "friction": "80 mN m",
    "viscous": "0.02 N m/krpm", "encoder": "2500 lines",
}  # fmt: skip


def options(sheet: dict[str, str]) -> list[str]:
    return [word for key, value in sheet.items() for word in (f"--{key.replace('_', '-')}", value)]


def call(*arguments: object) -> int:
    with pytest.raises(SystemExit) as left:
        main([str(a) for a in arguments])
    return int(left.value.code or 0)


@pytest.fixture(autouse=True)
def _nobody_at_the_keyboard(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("key", "text", "field", "value"),
    [
        ("torque_constant", "0.84 N m/A rms", "K_t_rms", 0.84),
        ("torque_constant", "0.84Nm/Arms", "K_t_rms", 0.84),
        ("torque_constant", "840 mNm/A (rms)", "K_t_rms", 0.84),
        ("torque_constant", "0.84 Nm/Apk", "K_t_peak", 0.84),
        ("emf_constant", "50.8 Vrms/krpm, line-to-line", "K_e_line_rms_per_krpm", 50.8),
        ("emf_constant", "50.8 V rms L-L / 1000 rpm", "K_e_line_rms_per_krpm", 50.8),
        ("emf_constant", "50.8 Veff line per 1000 min-1", "K_e_line_rms_per_krpm", 50.8),
        ("emf_constant", "0.4 V peak phase/(rad/s)", "K_e_phase_peak_per_rad_s", 0.4),
        ("resistance", "1.1 Ω phase-to-phase", "R_line_to_line", 1.1),
        ("resistance", "0.55 ohm phase", "R", 0.55),
        ("inertia", "1.6e-4 kg m²", "J", 1.6e-4),
        ("inertia", "1.6 kgcm^2", "J_kg_cm2", 1.6),
        ("inertia", "1600 g·cm²", "J_g_cm2", 1600.0),
        ("load_inertia", "200 kg cm2", "J", 0.02),
        ("supply", "400 V ac", "u_dc", 565.685),
        ("pwm", "16 kHz", "f_control", 16000.0),
        ("encoder", "17 bit", "encoder_counts", 131072.0),
        ("encoder", "2500 lines", "encoder_counts", 10000.0),
        ("friction", "80 mNm", "F_c", 0.08),
        ("viscous", "0.02 Nm/krpm", "F_v", 0.02 / (1000 * 2 * math.pi / 60)),
        ("viscous", "0.2 mN m/(rad/s)", "F_v", 2e-4),
        ("viscous", "20 mNm/krpm", "F_v", 0.02 / (1000 * 2 * math.pi / 60)),
    ],
)
def test_units_as_sheets_write_them(key: str, text: str, field: str, value: float) -> None:
    answer = read_answer(BY_KEY[key], text)
    assert answer.field == field
    assert answer.value == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize(
    ("key", "text", "said"),
    [
        ("torque_constant", "0.84", "the unit is missing"),
        ("torque_constant", "0.84 N m/A", "is ambiguous"),
        ("emf_constant", "50 V/krpm", "is ambiguous"),
        ("emf_constant", "50 V rms/krpm", "is ambiguous"),
        ("resistance", "1.1 Ohm", "is ambiguous"),
        ("resistance", "1.1 kOhm line", "'kOhm line' is unknown; accepted: Ohm line"),
        ("inductance", "7600 uH line", "'uH line' is unknown; accepted: mH line"),
        ("inductance", "7.6 mH", "'mH' is ambiguous"),
        ("torque_constant", "0.84 N m/A dc", "'N m/A dc' is unknown"),
        ("inertia", "1,6 kg cm2", "decimal mark"),
        ("inertia", "heavy", "a number with its unit"),
        ("inertia", "1e999 kg cm2", "a number with its unit"),
        ("gear", "10 turns", "a plain number"),
        ("encoder", "170 bit", "1 to 40 bit"),
    ],
)
def test_what_could_mean_two_things_is_refused(key: str, text: str, said: str) -> None:
    with pytest.raises(RequestError, match=said):
        read_answer(BY_KEY[key], text)


def test_every_unit_of_every_question_is_read_back_as_itself() -> None:
    for question in (question for asked in MACHINES.values() for question in asked):
        for unit, (field, _) in question.units.items():
            answer = read_answer(question, f"4 {unit}")
            assert answer.unit == unit
            assert answer.field in (field, "encoder_counts")


def test_design_of_the_sheet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init", "geared", *options(SHEET), "--json", "d.json") == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    design = Design.read("geared.toml")
    # By hand: star resistance half of the terminals', K_t per peak = per rms / sqrt 2, psi = K_t / (1.5 p).
    assert pytest.approx(0.55) == design.motor.R
    assert design.motor.L_d == design.motor.L_q == pytest.approx(3.8e-3)
    assert design.motor.psi_f == pytest.approx(0.84 / math.sqrt(2) / 7.5)
    assert pytest.approx(1.6e-4 + 0.02 / 100) == design.J
    assert design.drive.i_max == pytest.approx(9 * math.sqrt(2))
    assert design.drive.u_dc == pytest.approx(325.27, abs=0.01)
    assert design.drive.speed_divider == 4
    assert design.sensor.encoder_counts == 10000
    assert design.parameters("coulomb") == {"F_c": 0.08}
    assert design.parameters("viscous")["F_v"] == pytest.approx(0.02 * 60 / (2000 * math.pi))
    text = Path("geared.toml").read_text(encoding="utf-8")
    assert "K_t_rms = 0.84 " in text
    assert "K_e" not in text, "two names for one flux"
    assert "next: pmsm-ctrl study geared.toml" in shown.out
    assert json.loads(Path("d.json").read_text())["schema"] == "pmsm-ctrl/init/1"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["d.json", "geared.toml"]


LINEAR = {
    "torque_constant": "35.15 N/A dc", "inertia": "95.11 kg", "encoder": "0.5 um", "friction": "20.39 N",
    "viscous": "203.5 N s/m",
}  # fmt: skip
PLAIN = {"torque_constant": "0.0318 N m/A peak", "inertia": "61.4 g cm2", "encoder": "20000 counts"}


def test_a_linear_axis_has_a_mass_and_a_force_constant(designs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The numbers of designs/emps.toml, whose force constant is per volt: what init cannot know is its log."""
    assert call("init", "emps", "--machine", "linear", *options(LINEAR)) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    assert "K_t = 35.15 N/A\n" in shown.out
    assert "study emps.toml " in shown.out
    assert shown.out.count("pmsm-ctrl ") == 2, "without winding data nothing is simulated"
    made, known = Design.read("emps.toml"), Design.read(designs / "emps.toml")
    assert (made.motion, made.J, made.K_t) == (known.motion, known.J, known.K_t)
    for effect in ("coulomb", "viscous"):
        assert made.parameters(effect) == known.parameters(effect)
    assert made.sensor.encoder_counts == 2_000_000
    assert "# counts per metre" in Path("emps.toml").read_text(encoding="utf-8")


WOUND = {
    "pole_pitch": "16 mm", "torque_constant": "120.2 N/A rms", "resistance": "3.2 Ohm line",
    "inductance": "14 mH line", "inertia": "28 kg", "current_limit": "10 A rms", "supply": "400 V ac",
}  # fmt: skip


def test_a_linear_motor_with_windings(capsys: pytest.CaptureFixture[str]) -> None:
    """The motor of the README: `init` is what `tune` of a plain linear axis points to."""
    assert call("init", "slide", *options({**WOUND, "emf_constant": "69.4 V rms line/(m/s)"})) == 0
    shown = capsys.readouterr()
    assert shown.err == "", "the EMF constant is that of the force constant"
    design, text = Design.read("slide.toml"), Path("slide.toml").read_text(encoding="utf-8")
    assert design.motor.electrical
    assert design.motor.p == pytest.approx(math.pi / 0.016)
    assert pytest.approx(120.2 / math.sqrt(2.0)) == design.K_t
    assert pytest.approx(1.6) == design.motor.R
    assert design.drive.u_dc == pytest.approx(565.7, abs=0.1)
    # by hand: u_dc / sqrt(3) over the EMF of a phase, K_t / 1.5 per m/s
    assert f"no-load speed: {565.685 / math.sqrt(3.0) / (120.2 / math.sqrt(2.0) / 1.5):.4g} m/s" in shown.out
    assert "rpm" not in shown.out
    assert "K_t_rms = 120.2               # N per A rms" in text
    assert "pi over the pole pitch of 0.016 m" in text
    assert "tunes and simulates" in shown.out


def test_the_flux_of_a_linear_motor_follows_from_its_emf_constant() -> None:
    given = {key: text for key, text in WOUND.items() if key != "torque_constant"}
    assert call("init", "slide", *options({**given, "emf_constant": "69.4 V rms line/(m/s)"})) == 0
    assert pytest.approx(120.2 / math.sqrt(2.0), rel=1e-3) == Design.read("slide.toml").K_t


def test_a_plain_axis_is_identified_from_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init", "--machine", "plain", *options({**PLAIN, "current_limit": "5 A peak"})) == 0
    # by hand: 0.0318 N m/A times 5 A over 6.14e-6 kg m^2
    assert "0.159 N m, 2.59e+04 rad/s^2" in capsys.readouterr().out
    t = np.arange(0, 20, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    torque = 6.14e-6 * alpha + 2.67e-3 * np.sign(omega) + 3.66e-6 * omega
    noise = np.random.default_rng(2).normal(0, 1e-3, t.size)
    Log({"t": t, "omega": omega, "i_q": torque / 0.0318 + noise}).write_csv("axis.csv")
    assert call("identify", "axis.csv", "--design", "axis.toml", "--output", "found.toml") == 0
    found = Design.read("found.toml")
    assert pytest.approx(6.14e-6, rel=0.01) == found.J
    assert found.parameters("coulomb")["F_c"] == pytest.approx(2.67e-3, rel=0.01)
    assert found.parameters("viscous")["F_v"] == pytest.approx(3.66e-6, rel=0.05)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--machine", "plane", *options(PLAIN)], "did you mean 'plain'?"),
        (
            ["--machine", "plain", *options(PLAIN), "--resistance", "1 Ohm line"],
            "--resistance does not apply",
        ),
        (["--machine", "linear", *options({**LINEAR, "encoder": "0 um"})], "a step of 0.1 nm to 10 mm"),
        (["--machine", "linear", *options({**LINEAR, "inertia": "1.6 kg cm2"})], "accepted: kg, g"),
        (["--machine", "linear", *options(PLAIN)], "accepted: N/A peak"),
        (["--machine", "linear", *options(LINEAR), "--resistance", "1 Ohm line"], "--resistance needs --pole-pitch"),
        (options({**WOUND, "torque_constant": "85 N/A dc"}), "N/A peak or N/A rms was expected beside --pole-pitch"),
        (options({**WOUND, "pole_pitch": "0 mm"}), "a pole pitch above 0 was expected"),
        (["--machine", "linear", "--inertia", "3 kg"], "missing --torque-constant (N/A peak, N/A rms, N/A dc)"),
    ],
)
def test_what_a_machine_does_not_have_is_refused(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("init", *words) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_interior_magnets_have_two_inductances() -> None:
    sheet = {**SHEET, "inductance_q": "9 mH line"}
    design = Design.from_dict(tomllib.loads(design_toml("x", answers_from(sheet))))
    assert design.motor.L_d == pytest.approx(3.8e-3)
    assert design.motor.L_q == pytest.approx(4.5e-3)


def test_nothing_is_overwritten_without_force(capsys: pytest.CaptureFixture[str]) -> None:
    Path("axis.toml").write_text("mine", encoding="utf-8")
    assert call("init", *options(SHEET)) == 2
    assert "--force" in capsys.readouterr().err
    assert Path("axis.toml").read_text() == "mine"
    assert call("init", *options(SHEET), "--force") == 0
    assert Design.read("axis.toml").name == "axis"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"inertia": ""}, "--inertia (kg cm2, g cm2, kg m2)"),
        ({"torque_constant": "", "emf_constant": ""}, "one of --torque-constant and --emf-constant"),
        ({"speed_loop": "3 kHz"}, "nearest that does is 3200 Hz"),
        ({"pole_pairs": "2.5"}, "whole number"),
        ({"pole_pairs": "-4"}, "pole pairs"),
        ({"inertia": "-1 kg cm2"}, "--inertia '-1 kg cm2': a number above zero was expected: rotor inertia"),
        ({"friction": "-1 N m"}, "--friction '-1 N m': a number of at least zero was expected: friction torque"),
    ],
)
def test_a_bad_sheet_writes_nothing(
    change: dict[str, str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call("init", *options({**SHEET, **change})) == 2
    shown = capsys.readouterr()
    assert said in shown.err
    assert shown.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_the_next_command_can_be_pasted(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init", "press 2", *options(SHEET)) == 0
    assert "next: pmsm-ctrl study 'press 2.toml' " in capsys.readouterr().out


@pytest.mark.parametrize("name", ["../up", ""])
def test_a_name_is_no_path(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init", name, *options(SHEET)) == 2
    assert "a name without" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("emf", "said"),
    [
        ("50.8 V rms line/krpm", ""),
        ("71.8 V rms line/krpm", "rms read as peak"),
        ("88 V rms line/krpm", "line-to-line read as phase"),
        ("101.6 V rms line/krpm", "poles read as pole pairs"),
        ("20 V rms line/krpm", "0.394 times the flux"),
    ],
)
def test_the_two_constants_of_a_sheet_are_held_against_each_other(emf: str, said: str) -> None:
    answers = answers_from({**SHEET, "emf_constant": emf})
    design = Design.from_dict(tomllib.loads(design_toml("x", answers)))
    facts, doubts = plausibility(design, answers)
    assert (said in doubts[0].text) if said else doubts == []
    # No-load speed by hand: 325.27 V / sqrt 3 over 5 pole pairs times 0.0792 Wb, 4529 rpm.
    assert any("4529 rpm" in fact for fact in facts)


def test_a_misread_unit_is_doubted() -> None:
    answers = answers_from({**SHEET, "inductance": "7600 mH line"})
    design = Design.from_dict(tomllib.loads(design_toml("x", answers)))
    assert any("L/R" in doubt.text for doubt in plausibility(design, answers)[1])


def test_a_person_is_asked_again_until_the_answer_can_be_read(capsys: pytest.CaptureFixture[str]) -> None:
    typed = iter(["0,84", "0.84", "1"])
    ask = _asking(lambda prompt: next(typed))
    assert ask(BY_KEY["torque_constant"]) == "0.84 N m/A rms"
    assert "decimal mark" in capsys.readouterr().err
    typed = iter([""])
    assert ask(BY_KEY["gear"]) == ""
    typed = iter(["0.08"])
    assert _asking(lambda prompt: next(typed, "2"))(BY_KEY["friction"]) == "0.08 mN m"


def test_the_kind_of_machine_is_not_asked_for_where_the_values_tell() -> None:
    """The tutorial's command gives a winding, and asked at a terminal whether it is known."""
    assert machine_of({"resistance": "2.8 Ohm line", "inertia": "1.4 kg cm2", "gear": None}) == "motor"
    assert machine_of({"torque_constant": "0.5 N m/A rms", "inertia": "1.4 kg cm2"}) == ""
    assert machine_of({}) == ""


def test_no_question_is_wider_than_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 80 columns, an answer included; units are not broken."""
    monkeypatch.setenv("COLUMNS", "80")
    prompts: list[str] = []

    def read(prompt: str) -> str:
        prompts.append(prompt)
        raise EOFError

    for question in {one.key: one for kind in MACHINES.values() for one in kind}.values():
        with pytest.raises(RequestError):
            _asking(read)(question)
        lines = prompts[-1].splitlines()
        assert max(map(len, lines)) <= 80 - 16, question.key
        assert all(any(unit in line for line in lines) for unit in question.units), question.key


def test_input_that_ends_writes_nothing() -> None:
    def ended(prompt: str) -> str:
        raise EOFError

    with pytest.raises(RequestError, match="nothing was written"):
        answers_from({}, _asking(ended))


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="NO PSEUDO-TERMINAL: the dialogue was not typed")
def test_dialogue_at_a_terminal(tmp_path: Path) -> None:
    """Typed line by line at a pseudo-terminal, as a new user would."""
    typed = [
        "motr",
        "",
        "5",
        "0.84",
        "1",
        "",
        "1.1",
        "1",
        "7.6",
        "1",
        "",
        "1.6",
        "1",
        "",
        "",
        "9",
        "1",
        "",
        "",
        "",
        "",
        "",
        "",
    ]
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "pmsm_ctrl", "init", "typed"], stdin=theirs, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, cwd=tmp_path,
    )  # fmt: skip
    os.write(ours, ("\n".join(typed) + "\n").encode())
    out, err = process.communicate(timeout=60)
    os.close(theirs)
    os.close(ours)
    assert process.returncode == 0, err
    assert "design: typed.toml" in out
    design = Design.read(tmp_path / "typed.toml")
    assert design.K_t == pytest.approx(0.84 / math.sqrt(2))
    assert pytest.approx(1.6e-4) == design.motor.J


def test_the_written_design_runs(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init", "geared", *options(SHEET)) == 0
    assert call("tune", "geared.toml", "--no-prove", "--output", "tuned.toml") == 0
    assert Design.read("tuned.toml").loops is not None


def test_a_heavy_load_leaves_a_motion_to_identify_it() -> None:
    """The default motion lasts 30 s whatever the axis: its top speed gives way, an asked one is refused."""
    from pmsm_ctrl.simulate import scenario

    heavy = Design.from_dict(tomllib.loads(design_toml("x", answers_from({**SHEET, "load_inertia": "2000 kg cm2"}))))
    motion = scenario("identification", heavy)
    assert motion.duration == 30.0
    with pytest.raises(RequestError, match="ramps leave too little"):
        scenario("identification", heavy, speed_max=400.0)


LIKE_AN_ANSWER = st.from_regex(r"-?\d{1,4}(\.\d)?(e-?\d{1,3})? ?[A-Za-z/²Ω ]*", alphabet=ANY_CHARACTER)


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(QUESTIONS), st.text(ANY_CHARACTER, max_size=30) | LIKE_AN_ANSWER)
def test_any_text_is_read_or_refused(question: Question, text: str) -> None:
    try:
        value = read_answer(question, text).value
    except RequestError as error:
        said = str(error)
    else:
        said = question.option if math.isfinite(value) else "not finite"
    assert question.option in said


@settings(max_examples=60, deadline=None)
@given(st.dictionaries(st.sampled_from(sorted(set(SHEET) - {"emf_constant"})), st.floats(1e-300, 1e300), max_size=4))
def test_any_numbers_make_a_design_or_are_refused_in_one_line(numbers: dict[str, float]) -> None:
    sheet = SHEET | {key: f"{value!r} {SHEET[key].partition(' ')[2]}" for key, value in numbers.items()}
    try:
        answers = answers_from(sheet)
        design = Design.from_dict(tomllib.loads(design_toml("x", answers)))
        said = " ".join(plausibility(design, answers)[0])
    except (RequestError, DesignError) as error:
        said = str(error)
    assert "\n" not in said
    assert "nan" not in said


@pytest.mark.parametrize("name", sorted(path.stem for path in (ROOT / "designs").glob("*.toml")))
def test_a_shipped_design_is_written_as_it_is(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init", "--example", name) == 0
    assert Path(f"{name}.toml").read_text(encoding="utf-8") == (ROOT / "designs" / f"{name}.toml").read_text("utf-8")
    assert f"design: {name}.toml" in capsys.readouterr().out
    assert call("init", "--example", name) == 2
    assert "exists; --force overwrites it" in capsys.readouterr().err


def test_the_name_given_is_that_of_the_example(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init", "my axis", "--example", "hunting") == 0
    assert Design.read("my axis.toml").name == "my axis"
    example = (ROOT / "designs" / "hunting.toml").read_text("utf-8")
    assert Path("my axis.toml").read_text("utf-8") == example.replace('"hunting"', '"my axis"')
    assert "study 'my axis.toml'" in capsys.readouterr().out
    assert call("init", "sub/foo", "--example", "emps") == 2
    assert "a name without /" in capsys.readouterr().err
    assert call("init", "other", "--example", "emps", "--machine", "plain", "--gear", "3") == 2
    assert "init --example: excludes --machine, --gear; change the values in the file" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["my axis.toml"]


def test_what_nobody_stated_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    words = options({key: text for key, text in PLAIN.items() if key != "encoder"})
    assert call("init", "--machine", "plain", *words, "--gear", "10") == 0
    said = capsys.readouterr()
    assert "not stated, so assumed: --encoder '20 bit'\n" in said.out
    assert "a gear ratio of 10 without a load inertia changes nothing" in said.err
    assert "# counts per turn; assumed, since nothing was stated" in Path("axis.toml").read_text("utf-8")
    assert call("init", "whole", "--machine", "plain", *words, "--encoder", "17 bit") == 0
    assert "assumed" not in capsys.readouterr().out + Path("whole.toml").read_text("utf-8")


def test_an_example_that_does_not_exist_names_those_that_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("init", "--example", "seed_moter") == 2
    said = capsys.readouterr().err
    assert "did you mean 'seed_motor'? (known: adaptive, emps" in said
    assert list(Path.cwd().iterdir()) == []


def test_the_form_of_a_page_asks_for_windings_beside_a_pole_pitch_alone() -> None:
    from pmsm_ctrl.workbench.sheet import FormError, form, from_form

    asked = {q["key"]: q["needed"] for kind in form() if kind["machine"] == "linear" for q in kind["questions"]}
    assert not asked["resistance"]
    assert not from_form("screw", "linear", LINEAR)[0].motor.electrical
    assert from_form("slide", "linear", WOUND)[0].motor.electrical
    for wrong, field in (
        ({**LINEAR, "resistance": "3.2 Ohm line"}, "pole_pitch"),
        ({**WOUND, "resistance": ""}, "resistance"),
        ({**LINEAR, "torque_constant": ""}, "torque_constant"),
    ):
        with pytest.raises(FormError) as raised:
            from_form("slide", "linear", wrong)
        assert set(raised.value.fields) == {field}
