"""Columns whose names say which of two is measured and which is the reference, in words, glued, and by letters."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import describe, open_table, propose, read_log
from pmsm_ctrl.importers.names import guess_channel
from pmsm_ctrl.importers.vocabulary import meaning_of, says_measured, says_reference

T = 1e-3 * np.arange(6000)
ALPHA = 0.3 * 25.0 * np.cos(5.0 * T) + 0.1 * 121.0 * np.cos(11.0 * T)
OMEGA = 0.3 * 5.0 * np.sin(5.0 * T) + 0.1 * 11.0 * np.sin(11.0 * T)
THETA = -0.3 * np.cos(5.0 * T) - 0.1 * np.cos(11.0 * T)
CURRENT = (3.0 * ALPHA + 6.0 * np.sign(OMEGA)) / 40.0
MEASURED, REFERENCE = 1.001, 1.0  # marks which one is which


@pytest.fixture(scope="module")
def axes() -> dict[str, Design]:
    linear = {"motion": "linear", "motor": {"J": 3.0, "K_t": 40.0}}
    return {"linear": Design.from_dict(linear), "rotary": Design.from_dict({"motor": {"J": 3.0, "K_t": 40.0}})}


def written(path: Path, names: tuple[str, str, str, str], axis: str, current: str = "Iq [A peak]") -> Path:
    """Write a log with measured position and speed and their references; an empty name is left out."""
    units = ("mm", "mm/s") if axis == "linear" else ("rad", "rad/s")
    gain = 1e3 if axis == "linear" else 1.0
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, 1e-6, (2, T.size))
    motion = [MEASURED * THETA + noise[0], MEASURED * OMEGA + 100.0 * noise[1], REFERENCE * THETA, REFERENCE * OMEGA]
    head, columns = ["t [s]", current], [T, CURRENT + rng.normal(0.0, 1e-3, T.size)]
    for name, values, unit in zip(names, motion, units * 2, strict=True):
        if name:
            head.append(f"{name} [{unit}]")
            columns.append(gain * values)
    rows = [";".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([";".join(head), *rows]) + "\n", encoding="utf-8")
    return path


SPELLINGS = [
    ("x", "v", "x_soll", "v_soll"), ("x_ist", "v_ist", "x_soll", "v_soll"), ("x", "v", "xref", "vref"),
    ("x", "v", "x_cmd", "vcmd"), ("xact", "vact", "xset", "vset"), ("X", "V", "X_Ref", "V_Ref"),
    ("pos", "vel", "pos_cmd", "vel_cmd"), ("ActPos", "ActVel", "PosCmd", "VelCmd"),
    ("PosMeas", "VelMeas", "PosSP", "VelSP"),
    ("position", "speed", "position_target", "speed_target"), ("pos_fbk", "vel_fbk", "desired_pos", "desired_vel"),
    ("Istposition", "Istgeschwindigkeit", "Sollposition", "Sollgeschwindigkeit"),
    ("Lage_Ist", "Geschwindigkeit_Ist", "Lage_Soll", "Geschwindigkeit_Soll"),
    ("position mesurée", "vitesse mesurée", "consigne de position", "consigne de vitesse"),
    ("posizione attuale", "velocità attuale", "posizione riferimento", "velocità rif"),
    ("genzai ichi", "sokudo kenshutsu", "shirei ichi", "sokudo shirei"),
    ("Axis.Actual.Pos", "Axis.Actual.Vel", "Axis.Setpoint.Pos", "Axis.Setpoint.Vel"),
    ("x", "n1", "x_soll", "n1_soll"), ("foo_ist", "bar_ist", "foo_soll", "bar_soll"),
]  # fmt: skip


@pytest.mark.parametrize(("names", "axis"), list(product(SPELLINGS, ["linear", "rotary"])), ids=str)
def test_a_reference_is_never_measured(
    tmp_path: Path, axes: dict[str, Design], names: tuple[str, str, str, str], axis: str
) -> None:
    path = written(tmp_path / "a.csv", names, axis)
    proposal = propose(open_table(path), axes[axis])
    log = read_log(path, axes[axis], proposal.mapping)
    assert np.std(log["theta"]) == pytest.approx(MEASURED * np.std(THETA), rel=1e-4)
    assert np.std(log["omega"]) == pytest.approx(MEASURED * np.std(OMEGA), rel=1e-4)
    if "foo_ist" not in names:  # what a word nobody knows commands is not decided
        assert np.std(log["theta_ref"]) == pytest.approx(REFERENCE * np.std(THETA), rel=1e-4)
        assert np.std(log["omega_ref"]) == pytest.approx(REFERENCE * np.std(OMEGA), rel=1e-4)


@pytest.mark.parametrize("names", [names for names in SPELLINGS if guess_channel(names[2]) and guess_channel(names[3])])
def test_known_references_are_read_without_a_mapping(
    tmp_path: Path, axes: dict[str, Design], names: tuple[str, str, str, str]
) -> None:
    if meaning_of(names[0]) is None or guess_channel(names[0]) is None:
        names = ("position", "velocity", *names[2:])
    report = describe(written(tmp_path / "a.csv", names, "linear"), axes["linear"])
    assert {c.channel for c in report.channels} == {"t", "theta", "omega", "theta_ref", "omega_ref", "i_q"}
    assert not report.unused


def test_a_reference_without_its_measured_channel_stays_one(tmp_path: Path, axes: dict[str, Design]) -> None:
    path = written(tmp_path / "a.csv", ("", "v", "x_soll", "v_soll"), "linear")
    channels = {guess.channel: guess.label for guess in propose(open_table(path), axes["linear"]).guesses}
    assert channels["theta_ref"] == "x_soll [mm]"
    assert "theta" not in channels


def test_the_rougher_of_two_positions_without_names_is_measured(tmp_path: Path, axes: dict[str, Design]) -> None:
    for names in (("c1", "c2", "c3", "c4"), ("c3", "c4", "c1", "c2")):
        path = written(tmp_path / "a.csv", names, "linear")
        found = {guess.channel: guess.label for guess in propose(open_table(path), axes["linear"]).guesses}
        assert [found[channel].split()[0] for channel in ("theta", "omega", "theta_ref", "omega_ref")] == list(names)


def test_a_letter_needs_a_unit_of_the_axis(tmp_path: Path, axes: dict[str, Design]) -> None:
    path = written(tmp_path / "a.csv", ("x", "v", "x_soll", "v_soll"), "linear")  # of the table, beside the motor
    found = {guess.channel for guess in propose(open_table(path), axes["rotary"]).guesses if guess.label[:1] in "xv"}
    assert "theta_ref" not in found
    for name in ("mist", "list", "exist", "offset", "x_error", "v_max", "phase_a", "i_a", "x_y", "a", "b"):
        assert guess_channel(name) is None
        assert name == "mist" or meaning_of(name) is None


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("x", "theta"), ("n_soll", "omega_ref"), ("n_ist", "omega"), ("phi_soll", "theta_ref"), ("w_ref", "omega_ref"),
        ("target_v", "omega_ref"), ("cmd_x", "theta_ref"), ("a_soll", "alpha_ref"), ("i_q_cmd", "i_q_ref"),
        ("iqcmd", "i_q_ref"), ("i_d_soll", "i_d_ref"), ("i_q_ist", "i_q"), ("u_q_ist", "u_q"), ("i_soll", "i_q_ref"),
        ("M_ist", "torque"), ("F_ist", "torque"), ("M_soll", None), ("th_meas", "theta"), ("possp", "theta_ref"),
    ],
)  # fmt: skip
def test_letters_of_formulas(name: str, channel: str | None) -> None:
    found = meaning_of(name)
    assert (found.channel if found is not None else None) == channel


def test_what_a_name_says_of_its_kind() -> None:
    for name in (
        "xref",
        "x_soll",
        "PosCmd",
        "POSCMD",
        "vcmd",
        "vel_sp",
        "target speed",
        "consigne",
        "shirei ichi",
        "Set.Pos",
    ):
        assert says_reference(name), name
        assert not says_measured(name)
    for name in ("x_ist", "xact", "PosMeas", "vel_fbk", "position mesurée", "genzai ichi", "Cmd.ActPos"):
        assert says_measured(name), name
        assert not says_reference(name)
    for name in ("x", "speed", "offset", "asset"):
        assert not says_measured(name)
        assert not says_reference(name)


@pytest.mark.parametrize("spelling", ["A peak", "Apk", "A rms"])
def test_the_table_that_is_written_keeps_what_the_file_says_of_a_current(tmp_path: Path, spelling: str) -> None:
    path = written(tmp_path / "a.csv", ("position", "speed", "", ""), "rotary", f"Iq [{spelling}]")
    kept = "A rms" if "rms" in spelling else "A peak"
    assert f'i_q = "Iq [{kept}]"' in describe(path).table
    assert describe(path).log.unit("i_q") == "A"
