"""The commands of the loops with designs, logs and options that cannot be: one line of error, nothing written."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import main
from tests.effort import amount

SEED_MOTOR = (Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml").read_text(encoding="utf-8")
COMMANDS = {
    "tune": ["tune", "some.toml", "--output", "new.toml", "--json", "out.json"],
    "simulate": ["simulate", "some.toml", "--scenario", "triangle", "--set", "cycles=1", "--output", "new.csv"],
    "compensate": ["compensate", "some.toml", "--json", "out.json", "--report", "out.html"],
    "track": ["track", "some.csv", "--design", "some.toml", "--json", "out.json"],
    "export": ["export", "some.toml", "--language", "c", "--output", "new.c"],
}


def changed(section: str, line: str) -> str:
    """Return the design with a line of a section replaced."""
    head, name, rest = SEED_MOTOR.partition(f"\n{section}\n")
    body, *tail = re.split(r"\n(?=\[)", rest, maxsplit=1)
    key = line.split(" ")[0]
    assert re.search(rf"(?m)^{key}\b", body), key
    return "\n".join([head + name + re.sub(rf"(?m)^{key} .*$", line, body), *tail])


def compensation(*lines: str) -> str:
    return "\n".join([SEED_MOTOR, "[compensation]", *lines])


def spring(J_load: float, k: float) -> str:
    return f"{SEED_MOTOR}\n[[effects]]\nid = 'compliance'\nJ_load = {J_load}\nk = {k}\nd = 0.01\n"


IMPOSSIBLE = [  # whatever is asked
    ("", "empty"),
    (SEED_MOTOR.replace("[motor]", "[motors]"), "motor"),
    (changed("[drive]", "f_control = nan"), "f_control"),
    (changed("[drive]", "f_control = -16000.0"), "f_control"),
    (changed("[drive]", "f_control = 1e-15"), "f_control"),
    (changed("[drive]", "f_control = 1e12"), "f_control"),
    (changed("[drive]", "u_dc = 0.0"), "u_dc"),
    (changed("[drive]", "i_max = nan"), "i_max"),
    (changed("[drive]", "speed_divider = 1.5"), "speed_divider"),
    (changed("[drive]", "delay_periods = 50"), "delay_periods"),
    (changed("[motor]", "R = inf"), r"motor\.R"),
    (changed("[motor]", "L_q = 0.0"), "L_q"),
    (changed("[motor]", "J_kg_cm2 = -0.9"), r"motor\.J"),
    (changed("[motor]", "p = 0"), r"motor\.p"),
    (changed("[motor]", "psi_f = 0.0"), "psi_f"),
    (changed("[sensor]", "encoder_counts = -1"), "encoder_counts"),
    (changed("[sensor]", "current_noise = nan"), "current_noise"),
    (changed("[sensor]", "log_divider = 0"), "log_divider"),
    (changed("[loops.current]", "K_p = 0.0"), r"current\.K_p"),
    (changed("[loops.current]", "T_n = nan"), r"current\.T_n"),
    (changed("[loops.speed]", "K_p = -0.04"), r"speed\.K_p"),
    (changed("[loops.position]", "K_v = -1.0"), "K_v"),
    (changed("[[effects]]", "F_c = nan"), "F_c"),
    (SEED_MOTOR.replace("[loops.speed]", "[loops.fast]"), "loops"),
    (compensation("gain = nan"), "gain"),
    (compensation("gain = -1.0"), "gain"),
    (compensation("source = 'speed'"), "source"),
    (compensation("limit = 0.0"), "limit"),
    (compensation("smoothing = -1.0"), "smoothing"),
    (SEED_MOTOR + "\n[[loops.speed.filters]]\nkind = 'notch'\nfrequency = 1e6\nwidth = 1.0\n", "filters"),
    (spring(4e-5, 0.0), "compliance.k"),
]
OF_ONE = [
    ("tune", changed("[drive]", "f_control = 10.0"), "symmetrical optimum"),
    ("tune", changed("[drive]", "u_dc = 1e-3"), "dc link"),
    ("tune", changed("[drive]", "i_max = 1e-6"), "i_max"),
    ("tune", changed("[[effects]]", "F_c = 1e9"), "i_max"),
    ("tune", spring(4e-3, 10.0), "J_load"),
    ("simulate", spring(4e-5, 1e15), "so stiff"),
    ("simulate", spring(4e-3, 10.0), "J_load"),
    ("compensate", changed("[drive]", "f_control = 10.0"), "limit cycle cannot be seen"),
    ("compensate", compensation("effects = ['cogging']"), "compensation.effects: 'cogging'"),
    ("compensate", SEED_MOTOR.replace("[loops.", "[scenarios."), "loops|scenario"),
    ("compensate", spring(4e-3, 10.0), "J_load"),
    ("export", changed("[drive]", "f_control = 10.0"), "limit cycle cannot be seen"),
    ("export", compensation("gain = 1.0", "effects = ['cogging']"), "compensation.effects: 'cogging'"),
    ("export", spring(4e-3, 10.0), "not safe.*J_load"),
    ("export", spring(4e-5, 1e15), "not safe.*so stiff"),
    ("export", compensation("source = 'observer'", "gain = 1.0"), "bandwidth"),
    ("track", changed("[[effects]]", "F_c = 0.0"), "F_c is 0"),
]


def rows(**columns: object) -> str:
    units = {"t": "s", "theta": "rad", "i_q": "A"}
    head = ",".join(f"{name} [{units[name]}]" for name in columns)
    lines = zip(*(np.asarray(part).tolist() for part in columns.values()), strict=True)  # type: ignore[call-overload]
    return "\n".join([head, *(",".join(map(repr, line)) for line in lines)]) + "\n"


T = 1e-3 * np.arange(1500)
THETA = -100.0 / (2.0 * np.pi) * np.cos(2.0 * np.pi * T)
I_Q = 0.0548 * np.cos(2.0 * np.pi * T) + 0.0206 * np.sign(np.sin(2.0 * np.pi * T)) + 0.001 * np.sin(997.0 * T)
GOOD = rows(t=T, theta=THETA, i_q=I_Q)
LOGS = [
    ("", "empty"),
    ("t [s],theta [rad],i_q [A]\n", "no row"),
    (rows(theta=THETA, i_q=I_Q), "no channel 't'"),
    (rows(t=T, theta=THETA), "i_q"),
    (rows(t=T, i_q=I_Q), "theta"),
    (rows(t=T[:1], theta=THETA[:1], i_q=I_Q[:1]), "at least 3"),
    (rows(t=T, theta=THETA, i_q=np.where(T[50] == T, np.nan, I_Q)), "line 52"),
    (rows(t=T, theta=np.where(T[5] == T, np.inf, THETA), i_q=I_Q), "line 7"),
    (rows(t=T[::-1], theta=THETA, i_q=I_Q), "backwards"),
    (rows(t=0.0 * T, theta=THETA, i_q=I_Q), "same time stamp"),
    (rows(t=1e-9 * T, theta=THETA, i_q=I_Q), "sampling period"),
    (rows(t=T, theta=1e15 * THETA, i_q=I_Q), "numbers up to"),
    (rows(t=T, theta=THETA, i_q=1e12 * I_Q), "inertia"),
    (rows(t=T, theta=-THETA, i_q=I_Q), "sign"),
    (rows(t=T, theta=50.0 * T, i_q=0.0 * T + 0.03), "constant"),
    (GOOD.replace("[A]", "[banana]"), "banana"),
]
OPTIONS = [
    ("tune", "--current-bandwidth nan", "finite"),
    ("tune", "--current bandwidth --current-bandwidth 1e9", "highest bandwidth"),
    ("tune", "--speed bandwidth --speed-bandwidth -5", "positive"),
    ("tune", "--speed nonsense", "nonsense"),
    ("tune", "--phase-margin 200 --speed bandwidth --speed-bandwidth 20", "85 deg"),
    ("simulate", "--set period=nan", "period"),
    ("simulate", "--set speed=-1", "speed"),
    ("simulate", "--set cycles=1e9", "cycles"),
    ("simulate", "--scenario nonsense", "nonsense"),
    ("simulate", "--output none/new.csv", "no folder"),
    ("tune", "--current-bandwidth -5", "Invalid value for '--current-bandwidth': -5: a positive"),
    ("compensate", "--step 0", "--step"),
    ("compensate", "--truth none.toml", "none.toml"),
    ("track", "--estimate F_c", "estimate"),
    ("track", "--map i_q=nonsense", "nonsense"),
    ("track", "--json some.csv", "overwritten"),
    ("export", "--part nonsense", "part"),
    ("export", "--precision half", "precision"),
    ("export", "--flavour br", "flavour"),
]


def refused(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str, design: str, log: str = GOOD
) -> None:
    """Run a command: status 2, one line of error that says why, and no file beside the given ones."""
    given = {"some.toml": design, "some.csv": log}
    for name, text in given.items():
        (folder / name).write_text(text, encoding="utf-8")
    with pytest.raises(SystemExit) as left:
        main(words)
    shown = capsys.readouterr()
    assert left.value.code == 2, shown.err
    assert shown.out == ""
    lines = [line for line in shown.err.splitlines() if ": warning: " not in line]  # of the import, before it
    assert len(lines) == 1
    assert re.match(f"pmsm-ctrl: .*({says})", lines[0]), lines[0]
    assert {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()} == given


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
def test_an_impossible_design(here: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    for design, says in IMPOSSIBLE[list(COMMANDS).index(command) :: amount(len(COMMANDS), 1)]:
        refused(here, capsys, COMMANDS[command], says, design)


@pytest.mark.parametrize(("command", "design", "says"), OF_ONE)
def test_a_design_with_which_a_command_can_do_nothing(
    here: Path, capsys: pytest.CaptureFixture[str], command: str, design: str, says: str
) -> None:
    refused(here, capsys, COMMANDS[command], says, design)


@pytest.mark.parametrize(("log", "says"), LOGS)
def test_a_log_that_cannot_be_tracked(here: Path, capsys: pytest.CaptureFixture[str], log: str, says: str) -> None:
    refused(here, capsys, COMMANDS["track"], says, SEED_MOTOR, log)


@pytest.mark.parametrize(("command", "options", "says"), OPTIONS)
def test_options_that_cannot_be(
    here: Path, capsys: pytest.CaptureFixture[str], command: str, options: str, says: str
) -> None:
    refused(here, capsys, [*COMMANDS[command], *options.split()], says, SEED_MOTOR)
