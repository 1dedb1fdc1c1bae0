"""A proposed mapping: the layouts of seven kinds of foreign file, with numbers of our own, and what is said of each."""

from __future__ import annotations

import json
import os
import pty
import re
import shlex
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import open_table, propose, read_log
from pmsm_ctrl.importers.vocabulary import meaning_of
from pmsm_ctrl.log import CHANNELS
from tests.effort import amount

J, K_T, F_C, F_V = 2.4e-4, 0.62, 0.03, 3e-4
PERIOD, N = 1e-3, 3600
RPM = 30.0 / np.pi


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.from_dict({"motor": {"J": J, "K_t": K_T}, "sensor": {"encoder_counts": 16384}})


@pytest.fixture(scope="module")
def axis() -> dict[str, np.ndarray]:
    """An axis under three sines, with a noisy speed and current and smooth references; closed form."""
    rng = np.random.default_rng(31)
    t = PERIOD * np.arange(N)
    rates, sizes = 2 * np.pi * np.array([0.4, 1.1, 2.3]), (9.0, 4.0, 1.5)
    theta = sum(-a * np.cos(r * t) for a, r in zip(sizes, rates, strict=True))
    omega = sum(a * r * np.sin(r * t) for a, r in zip(sizes, rates, strict=True))
    alpha = sum(a * r**2 * np.cos(r * t) for a, r in zip(sizes, rates, strict=True))
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega
    step = 2 * np.pi / 16384
    return {
        "t": t, "theta": np.round(theta / step) * step, "omega": omega + rng.normal(0, 0.05, N), "omega_ref": omega,
        "i_q": torque / K_T + rng.normal(0, 0.003, N), "torque": torque + rng.normal(0, 0.002, N),
    }  # fmt: skip


def text(path: Path, head: Sequence[str], columns: Sequence[np.ndarray], separator: str, digits: int = 6) -> Path:
    rows = [separator.join(f"{value:.{digits}f}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
    return path


def codes(proposal: object) -> list[str]:
    return [notice.code for notice in proposal.notices]  # type: ignore[attr-defined]


def epos(path: Path, axis: dict[str, np.ndarray]) -> Path:
    head = ["Time;Velocity actual value averaged;Torque actual value averaged;Velocity demand value", "ms;rpm;%;rpm"]
    columns = (1e3 * axis["t"], axis["omega"] * RPM, axis["torque"] / 0.48 * 100.0, axis["omega_ref"] * RPM)
    return text(path, head, columns, ";", 4)


def test_epos_trace(tmp_path: Path, axis: dict[str, np.ndarray], design: Design) -> None:
    path = epos(tmp_path / "trace.csv", axis)
    without = propose(open_table(path))
    assert not without.complete
    assert codes(without) == ["rated_unknown"]
    assert "RATED" in without.mapping["torque"]
    found = propose(open_table(path), design)
    assert found.complete
    assert found.notices[0].code == "rated_from_inertia"
    rated = float(found.mapping["torque"].split("of ")[1].split()[0])
    assert rated == pytest.approx(0.48, rel=0.03)
    log = read_log(path, mapping={**found.mapping, "torque": "Torque actual value averaged [% of 0.48 N m]"})
    np.testing.assert_allclose(log["torque"], axis["torque"], atol=1e-5)
    np.testing.assert_allclose(log["omega"], axis["omega"], atol=1e-4)
    np.testing.assert_allclose(log["omega_ref"], axis["omega_ref"], atol=1e-4)


def test_per_mille_of_rated_current(tmp_path: Path, axis: dict[str, np.ndarray], design: Design) -> None:
    columns = (axis["t"], axis["omega"], axis["i_q"] / 1.3 * 1000.0)
    path = text(tmp_path / "a.csv", ["Zeit [s];Drehzahlistwert [rad/s];Querstrom [‰]"], columns, ";")
    mapping = propose(open_table(path), design).mapping
    assert mapping["i_q"].startswith("Querstrom [‰ of ")
    log = read_log(path, mapping={**mapping, "i_q": "Querstrom [‰ of 1.3 A]"})
    np.testing.assert_allclose(log["i_q"], axis["i_q"], atol=1e-6)


def test_a_share_of_a_rated_value_is_no_ampere(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    """It was taken for amperes: only the word behind the sign was not understood."""
    columns = (axis["t"], axis["omega"], axis["i_q"] / 1.3 * 100.0)
    for head in "Torque current (% rated)", "Torque current [% of nominal]":
        path = text(tmp_path / "a.csv", [f"t [s],speed [rad/s],{head}"], columns, ",")
        found = propose(open_table(path))
        assert "rated_unknown" in codes(found)
        assert found.mapping["i_q"] == "Torque current [% of RATED A]"
        assert not found.complete


def test_a_tab_is_visible_in_the_table_that_is_proposed(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    path = text(tmp_path / "a.txt", [], (axis["t"], axis["theta"], axis["omega"], axis["i_q"]), "\t")
    table = propose(open_table(path)).table
    assert 'separator = "\\t"' in table
    assert tomllib.loads(table)["log"]["separator"] == "\t"


@pytest.mark.parametrize("named", [True, False])
def test_numpy_arrays(tmp_path: Path, axis: dict[str, np.ndarray], design: Design, named: bool) -> None:
    path = tmp_path / "a.npz"
    columns = (axis["t"], axis["theta"], axis["omega"], axis["i_q"])
    if named:
        np.savez(path, **dict(zip(("jikan", "ichi", "sokudo", "denryu"), columns, strict=True)))
    else:
        np.savez(path, data=np.column_stack(columns))
    found = propose(open_table(path), design)
    log = read_log(path, mapping=found.mapping)
    for name, values in zip(("t", "theta", "omega", "i_q"), columns, strict=True):
        np.testing.assert_allclose(log[name], values, rtol=1e-12, atol=1e-12)
    assert "unit_assumed" in codes(found)
    assert ("from_physics" in codes(found)) is not named


def test_twincat_with_blanks(tmp_path: Path, axis: dict[str, np.ndarray], design: Design) -> None:
    degrees = np.degrees(axis["theta"]), np.degrees(axis["omega"])
    columns = (1e3 * axis["t"], *degrees, axis["i_q"])
    for head in (["Time [ms]  Axis1.ActPos [deg]  Axis1.ActVelo [deg/s]  Axis1.Strom Iq [A]"],
                 ["Time  Axis1.ActPos  Axis1.ActVelo  Axis1.Iq", "ms deg deg/s A"]):  # fmt: skip
        path = text(tmp_path / "scope.txt", head, columns, "  ")
        found = propose(open_table(path), design)
        log = read_log(path, mapping=found.mapping)
        np.testing.assert_allclose(log["theta"], axis["theta"], atol=1e-7)
        np.testing.assert_allclose(log["omega"], axis["omega"], atol=1e-7)
        np.testing.assert_allclose(log["i_q"], axis["i_q"], atol=1e-6)


def mitsubishi(path: Path, axis: dict[str, np.ndarray]) -> Path:
    head = ["[Graph data]", "Sampling time,1.000 ms", "", "Time(ms),Motor speed,Torque,Droop pulses"]
    columns = (1e3 * axis["t"], np.round(axis["omega"] * RPM), axis["torque"] / 1.27 * 100.0, 3 * axis["omega"])
    return text(path, head, columns, ",", 3)


def test_mitsubishi_trace_says_that_its_units_are_assumed(
    tmp_path: Path, axis: dict[str, np.ndarray], design: Design
) -> None:
    path = mitsubishi(tmp_path / "graph.csv", axis)
    found = propose(open_table(path), design)
    assert found.mapping["omega"] == "Motor speed [rpm]"
    assert codes(found) == ["rated_from_inertia", "unit_assumed"]
    assert "rpm for omega" in found.notices[1].text
    rated = float(found.mapping["torque"].split("of ")[1].split()[0])
    assert rated == pytest.approx(1.27, rel=0.03)
    assert ("Droop pulses", "not recognised") in found.unused


@pytest.mark.parametrize(
    ("units", "gains"),
    [(("rad", "rad/s"), (1.0, 1.0)), (("deg", "rpm"), (180 / np.pi, RPM)), (("rad", "rpm"), (1.0, RPM)),
     (("rev", "rpm"), (0.5 / np.pi, RPM)), (("deg", "deg/s"), (180 / np.pi, 180 / np.pi))],
)  # fmt: skip
def test_headerless_text(
    tmp_path: Path, axis: dict[str, np.ndarray], design: Design, units: tuple[str, str], gains: tuple[float, float]
) -> None:
    columns = (axis["i_q"], gains[1] * axis["omega"], axis["t"], gains[0] * axis["theta"])
    path = text(tmp_path / "plain.txt", [], columns, " ", 9)
    found = propose(open_table(path), design)
    assert found.mapping == {
        "t": "#3 [s]", "theta": f"#4 [{units[0]}]", "omega": f"#2 [{units[1]}]", "i_q": "#1 [A]",
    }  # fmt: skip
    log = read_log(path, mapping=found.mapping)
    np.testing.assert_allclose(log["omega"], axis["omega"], atol=1e-6)


COUNTED = ["Inc", "Incr.", "inc", "increments", "Inkremente", "counts", "cts", "enc counts"]


@pytest.mark.parametrize("unit", COUNTED)
def test_a_unit_of_encoder_counts_is_read_by_the_design(
    tmp_path: Path, axis: dict[str, np.ndarray], design: Design, unit: str
) -> None:
    """The file says counts, the design how many make a turn: nothing is left to guess, with a speed or without."""
    counts = np.round(axis["theta"] / (2 * np.pi) * 16384)
    head = [f"Time [s];Position actual value [{unit}];Torque [Nm]"]
    path = text(tmp_path / "a.csv", head, (axis["t"], counts, axis["torque"]), ";")
    log = read_log(path, design)
    np.testing.assert_allclose(log["theta"], axis["theta"], atol=1e-9)
    assert "unit_assumed" not in {notice.code for notice in log.provenance.notices}
    mapping = {"t": "Time [s]", "theta": f"-Position actual value [{unit}]", "torque": "Torque [Nm]"}
    np.testing.assert_allclose(read_log(path, design, mapping)["theta"], -axis["theta"], atol=1e-9)
    unknown = design.replace(sensor={"encoder_counts": 0})
    with pytest.raises(
        LogError, match=r"encoder counts, and nothing states how many make a turn .*: encoder_counts in"
    ):
        read_log(path, unknown, mapping)
    open_question = propose(open_table(path), unknown)
    assert not open_question.complete
    assert open_question.mapping["theta"] == "FACTOR * Position actual value [rad]"
    head = [f"Time [s];Pos ({unit});Speed [{unit}/s];Torque [Nm]"]
    rate = np.gradient(counts, PERIOD)
    both = read_log(text(tmp_path / "b.csv", head, (axis["t"], counts, rate, axis["torque"]), ";"), design)
    np.testing.assert_allclose(both["omega"], rate * 2 * np.pi / 16384, atol=1e-6)


@pytest.mark.parametrize("number", [16384, 20000 * 7])
def test_counts_beside_a_speed_and_a_share_of_the_rated_torque(
    tmp_path: Path, axis: dict[str, np.ndarray], design: Design, number: int
) -> None:
    """The counts of the design are tried first, usual ones or not."""
    counts = np.round(axis["theta"] / (2 * np.pi) * number)
    head = ["Time [s];Position actual value [Inc];Velocity actual value [rpm];Torque actual value [‰]"]
    columns = (axis["t"], counts, axis["omega"] * RPM, axis["torque"] / 0.48 * 1000.0)
    found = propose(
        open_table(text(tmp_path / "a.csv", head, columns, ";")), design.replace(sensor={"encoder_counts": number})
    )
    assert found.complete
    factor = float(found.mapping["theta"].split(" *")[0])
    assert factor == pytest.approx(2 * np.pi / number)
    assert codes(found) == ["rated_from_inertia"]


def test_whole_numbers_without_a_speed_are_counts_of_the_design(
    tmp_path: Path, axis: dict[str, np.ndarray], design: Design
) -> None:
    counts = np.round(axis["theta"] / (2 * np.pi) * 16384)
    head = ["Time [s],Position actual value,Torque [Nm]"]
    path = text(tmp_path / "a.csv", head, (axis["t"], counts, axis["torque"]), ",")
    found = propose(open_table(path), design)
    assert codes(found) == ["unit_assumed"]
    assert any("whole numbers: 16384 counts a turn, as the design states" in g.reasons for g in found.guesses)
    np.testing.assert_allclose(read_log(path, design, found.mapping)["theta"], axis["theta"], atol=1e-9)
    angle = text(tmp_path / "b.csv", head, (axis["t"], axis["theta"], axis["torque"]), ",")
    assert propose(open_table(angle), design).mapping["theta"] == "Position actual value [rad]"


@pytest.mark.parametrize(("sign", "stated"), [("%", ""), ("‰", "‰"), ("%", "%")])
def test_a_share_of_the_rated_torque_asks_for_the_rated_value(
    tmp_path: Path, axis: dict[str, np.ndarray], sign: str, stated: str
) -> None:
    path = text(
        tmp_path / "a.csv", [f"t [s];speed [rpm];Torque [{sign}]"], (axis["t"], axis["omega"], axis["i_q"]), ";"
    )
    mapping = {"torque": f"Torque [{stated}]"} if stated else None
    with pytest.raises(LogError, match=rf"--map torque='Torque \[{sign} of 2\.4 N m\]', with that of the data sheet"):
        read_log(path, mapping=mapping)


def test_an_angle_in_counts(tmp_path: Path, axis: dict[str, np.ndarray], design: Design) -> None:
    counts = np.round(axis["theta"] / (2 * np.pi) * 16384)
    path = text(tmp_path / "a.csv", ["a;b;c;d"], (axis["t"], counts, axis["omega"] * RPM, axis["i_q"]), ";")
    found = propose(open_table(path), design)
    np.testing.assert_allclose(read_log(path, mapping=found.mapping)["theta"], axis["theta"], atol=1e-9)
    assert any("16384 counts a turn" in reason for guess in found.guesses for reason in guess.reasons)


@pytest.mark.parametrize("ticks", [True, False])
def test_time_in_ticks_or_none(tmp_path: Path, axis: dict[str, np.ndarray], ticks: bool) -> None:
    columns = (np.degrees(axis["theta"]), axis["omega"] * RPM, axis["i_q"])
    head = "pos [deg],speed [rpm],iq [A]"
    if ticks:
        path = text(tmp_path / "a.csv", [f"tick,{head}"], (np.arange(N), *columns), ",")
    else:
        path = text(tmp_path / "a.csv", [head], columns, ",")
    found = propose(open_table(path))
    assert found.notices[0].code == "rate_from_motion"
    np.testing.assert_allclose(read_log(path, mapping=found.mapping).t, axis["t"], atol=1e-12)
    channels = {"theta": "pos [deg]", "i_q": "iq [A]", **({"t": "tick"} if ticks else {})}
    rated = Design.from_dict({"motor": {"J": J, "K_t": K_T}, "log": {"rate": 500.0, "channels": channels}})
    np.testing.assert_allclose(read_log(path, rated).t, 2.0 * axis["t"], atol=1e-12)


def test_without_units_nothing_tells_a_rate(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    path = text(tmp_path / "a.csv", ["pos,speed,iq"], (axis["theta"], axis["omega"], axis["i_q"]), ",")
    found = propose(open_table(path))
    assert not found.complete
    assert found.mapping["t"] == "every PERIOD ms"
    assert "no_rate" in codes(found)


def test_a_rate_on_the_command_line_makes_the_time(
    tmp_path: Path, axis: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    path = text(tmp_path / "a.csv", ["pos,speed,iq"], (axis["theta"], axis["omega"], axis["i_q"]), ",", 9)
    assert run(app, ["import", str(path)]) == 2
    assert "--rate HZ" in capsys.readouterr().err
    canonical = str(tmp_path / "si.csv")
    rate = f"{1.0 / (axis['t'][1] - axis['t'][0]):.9g}"
    assert run(app, ["import", str(path), "--rate", rate, "--yes", "--output", canonical]) == 0
    assert capsys.readouterr().out.count("[log.channels]") == 1  # of the report, not of the proposal as well
    np.testing.assert_allclose(read_log(canonical).t, axis["t"], atol=1e-9)


def test_ticks_without_a_rate_lead_to_a_command_that_can_be_completed(
    tmp_path: Path, axis: dict[str, np.ndarray], design: Design, capsys: pytest.CaptureFixture[str]
) -> None:
    """'RATE * Tick' was proposed for what is a period, and the printed command was refused with the rate filled in."""
    columns = (np.arange(N), axis["omega"] * RPM, axis["torque"] / 0.48 * 1e3)
    path = text(tmp_path / "a.csv", ["Tick,Actual velocity [rpm],Torque actual value [‰]"], columns, ",")
    given = tmp_path / "d.toml"
    design.write(given)
    assert run(app, ["import", str(path), "--design", str(given)]) == 2
    shown = capsys.readouterr()
    assert "PERIOD * Tick [s]" in shown.out
    command = shlex.split(shown.err.split("the rate of t: ")[1])[1:]
    rate = f"{1.0 / (axis['t'][1] - axis['t'][0]):.9g}"
    assert run(app, [rate if word == "HZ" else word for word in command]) == 2  # the whole of it, to be confirmed
    command = shlex.split(capsys.readouterr().err.split("--yes takes it, or: ")[1])[1:]
    assert any("‰ of 0.4" in word for word in command)
    assert run(app, command) == 0


def test_the_smoother_of_two_speeds_is_the_reference(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    columns = (axis["t"], axis["omega_ref"], axis["theta"], axis["omega"], axis["i_q"])
    path = text(tmp_path / "a.csv", [], columns, "\t", 9)
    mapping = propose(open_table(path)).mapping
    assert (mapping["omega_ref"], mapping["omega"]) == ("#2 [rad/s]", "#4 [rad/s]")


def test_a_position_and_its_force_without_names(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    path = text(tmp_path / "a.csv", [], (axis["i_q"], axis["t"], axis["theta"], 0 * axis["t"]), ";", 9)
    found = propose(open_table(path))
    assert (found.mapping["theta"], found.mapping["i_q"]) == ("#3 [rad]", "#1 [A]")
    assert found.unused == (("#4", "constant, 0"),)


def test_a_speed_that_is_mis_scaled_is_still_found(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    columns = (axis["t"], axis["theta"], axis["omega"] / 1.99, axis["i_q"])
    path = text(tmp_path / "a.csv", ["t [s],pos [rad],vel [rad/s],iq [A]"], columns, ",")
    notice = next(notice for notice in propose(open_table(path)).notices if notice.code == "speed_factor")
    assert notice.detail["factor"] == pytest.approx(1.99, rel=0.01)


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("Velocity actual value averaged", "omega"), ("Drehzahl-Sollwert", "omega_ref"), ("Lageistwert", "theta"),
        ("Winkelgeschwindigkeit", "omega"), ("Querstrom Sollwert", "i_q_ref"), ("vitesse mesurée", "omega"),
        ("Consigne de vitesse", "omega_ref"), ("couple moteur", "torque"), ("Velocità reale", "omega"),
        ("Coppia motore", "torque"), ("Posizione attuale", "theta"), ("Sokudo shirei", "omega_ref"),
        ("Toruku", "torque"), ("denryu", "i_q"), ("MAIN.fbAxis.fActVelo", "omega"), ("torque current", "i_q"),
        ("Zwischenkreisspannung", "u_dc"), ("load torque", "T_load"), ("speedRef", "omega_ref"),
        ("Following error", None), ("Schleppfehler", None), ("Droop pulses", None), ("Speed limit", None),
        ("Phase current u", None), ("Vsupply", None), ("Function Activated", None), ("Wort 1", None),
    ],
)  # fmt: skip
def test_words_of_five_languages(name: str, channel: str | None) -> None:
    found = meaning_of(name)
    assert (found.channel if found is not None else None) == channel


@pytest.mark.parametrize(
    ("name", "channel"),
    [("CurrentPosition", "theta"), ("current_vel", "omega"), ("Current Torque", "torque"), ("Motor Current", "i_q"),
     ("torque current", "i_q"), ("CurrentPosition error", None)],
)  # fmt: skip
def test_current_before_another_quantity_means_present(name: str, channel: str | None) -> None:
    found = meaning_of(name)
    assert (found.channel if found is not None else None) == channel


def test_a_stated_wrap_and_a_window(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    # a joint that reports -12.5 to 12.5 rad
    wrapped = (axis["theta"] * 3.0 + 12.5) % 25.0 - 12.5
    path = text(tmp_path / "a.csv", ["t [s],pos [rad],iq [A]"], (axis["t"], wrapped, axis["i_q"]), ",", 9)
    stated = {"wrap": 25.0, "window": [1.0, 3.5], "channels": {"t": "t", "theta": "pos", "i_q": "iq"}}
    log = read_log(path, Design.from_dict({"motor": {"J": J, "K_t": K_T}, "log": stated}))
    inside = slice(1000, 3501)
    np.testing.assert_allclose(log.t, axis["t"][inside], atol=1e-9)
    np.testing.assert_allclose(np.diff(log["theta"]), np.diff(3.0 * axis["theta"][inside]), atol=1e-8)
    assert "angle_unwrapped" not in [notice.code for notice in log.provenance.notices]


# -- the command ----


def test_import_leaves_with_the_exact_command(
    tmp_path: Path, axis: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import shlex

    path = text(tmp_path / "plain.txt", [], (axis["t"], axis["theta"], axis["omega"], axis["i_q"]), " ", 9)
    monkeypatch.setattr("sys.stdin", open(os.devnull))  # noqa: SIM115
    assert run(app, ["import", str(path)]) == 2
    shown = capsys.readouterr()
    assert shown.out.index("warning") < shown.out.index("The mapping")
    command = shown.err.partition("pmsm-ctrl import")[2].strip()
    assert run(app, ["import", *shlex.split(command)]) == 0
    assert "Import of" in capsys.readouterr().out
    told = tmp_path / "import.json"
    assert run(app, ["import", str(path), "--yes", "--output", str(tmp_path / "si.csv"), "--json", str(told)]) == 0
    np.testing.assert_allclose(read_log(tmp_path / "si.csv")["omega"], axis["omega"], atol=1e-8)
    # a doubt that was accepted unasked is a warning of the import, not "no warnings" below it
    proposal, _, report = capsys.readouterr().out.partition("Import of")
    assert "warning: " in proposal
    assert "no warnings" not in report
    assert re.search(r"Plausibility checks: \d+ warnings?,( \d of them)? accepted with the mapping\.", report)
    codes = json.loads(told.read_text(encoding="utf-8"))["warning_codes"]
    assert codes
    assert all(f"[{code}]" in proposal for code in codes)


@pytest.mark.parametrize(("answer", "status"), [(b"y\n", 0), (b"\n", 2), (b"n\n", 2)])
def test_on_a_terminal_it_asks_once(
    tmp_path: Path, axis: dict[str, np.ndarray], monkeypatch: pytest.MonkeyPatch, answer: bytes, status: int
) -> None:
    path = text(tmp_path / "a.txt", [], (axis["t"], axis["theta"], axis["omega"], axis["i_q"]), " ", 9)
    inner, outer = pty.openpty()
    os.write(inner, answer)
    with os.fdopen(outer, "r") as terminal:
        monkeypatch.setattr("sys.stdin", terminal)
        assert run(app, ["import", str(path)]) == status
    os.close(inner)


def test_an_incomplete_proposal_is_not_taken(
    tmp_path: Path, axis: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    path = epos(tmp_path / "trace.csv", axis)
    assert run(app, ["import", str(path), "--yes"]) == 2
    assert "to be filled in: the rated value of torque" in capsys.readouterr().err


def test_names_with_units_need_no_confirmation(tmp_path: Path, axis: dict[str, np.ndarray]) -> None:
    path = text(
        tmp_path / "a.csv", ["Zeit;Drehzahl;Iq", "ms;1/min;A"], (1e3 * axis["t"], axis["omega"], axis["i_q"]), ";"
    )
    assert run(app, ["import", str(path)]) == 0


def test_an_assumed_unit_of_a_speed_is_confirmed_before_a_log_is_evaluated(
    tmp_path: Path, axis: dict[str, np.ndarray], capsys: pytest.CaptureFixture[str]
) -> None:
    path = mitsubishi(tmp_path / "graph.csv", axis)
    (tmp_path / "axis.toml").write_text(f"[motor]\nJ = {J}\nK_t = {K_T}\n", encoding="utf-8")
    words = ["track", str(path), "--design", str(tmp_path / "axis.toml")]
    assert run(app, words) == 2
    assert "units that the file does not state were assumed: rad/s for omega, N m for torque" in capsys.readouterr().err


@pytest.mark.parametrize("seed", range(amount(6, 12)))
def test_any_numbers_have_a_proposal(tmp_path: Path, design: Design, seed: int) -> None:
    rng = np.random.default_rng(seed)
    names = ["t", "Time", "tick", "pos", "speed", "Strom", "Torque [%]", "couple [‰]", "x", "Vel [m/s]", "Iq [bananas]"]
    for _ in range(6):
        n, k = int(rng.choice([2, 3, 40, 300, 1000])), int(rng.integers(2, 7))
        ramp = np.arange(n) * 1.0
        kinds = [ramp, 1e-3 * ramp, np.sin(0.01 * ramp), rng.normal(size=n), np.zeros(n), 1e300 * rng.normal(size=n),
                 np.round(1e3 * np.sin(0.01 * ramp)), (0.05 * ramp) % (2 * np.pi), 1e-310 * ramp]  # fmt: skip
        columns = [kinds[rng.integers(len(kinds))] for _ in range(k)]
        head = [";".join(rng.choice(names, k))] if rng.random() < 0.7 else []
        rows = [";".join(repr(float(value)) for value in row) for row in zip(*columns, strict=True)]
        path = tmp_path / "any.csv"
        path.write_text("\n".join([*head, *rows]) + "\n", encoding="utf-8")
        found = propose(open_table(path), design if rng.random() < 0.5 else None)
        assert found.summary()
        assert set(found.mapping) <= set(CHANNELS)
