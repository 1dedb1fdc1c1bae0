"""Numbers no engineer means: every verb gives a sensible answer or one line that says what is wrong, never a nan.

Warnings are errors here (``--debug`` leaves Python's filters alone), so that none of numpy's can leak either.
"""

from __future__ import annotations

import copy
import json
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from pmsm_ctrl import Design
from pmsm_ctrl.cli import main
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.log import Log
from tests import effort
from tests.effort import seeds, slow

SEED_MOTOR = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"
N = 3000
T = np.arange(N) * 1e-3
W = 80 * np.sin(2 * np.pi * 0.7 * T) + 30 * np.sin(2 * np.pi * 2.1 * T + 1)
TH = -80 / (1.4 * np.pi) * np.cos(2 * np.pi * 0.7 * T) - 30 / (4.2 * np.pi) * np.cos(2 * np.pi * 2.1 * T + 1)
ALPHA = 80 * 1.4 * np.pi * np.cos(2 * np.pi * 0.7 * T) + 30 * 4.2 * np.pi * np.cos(2 * np.pi * 2.1 * T + 1)
IQ = (9e-5 * ALPHA + 0.0213 * np.sign(W) + 1.68e-4 * W + np.random.default_rng(3).normal(0, 2e-3, N)) / 1.032
NOISE = np.random.default_rng(4).normal(0, 1.0, N)
U_D, U_Q = -4 * 49e-3 * W * IQ, 19 * IQ + 4 * 0.172 * W
ZERO = np.zeros(N)


def log(**changed: Any) -> dict[str, Any]:
    """A good log with channels changed; None takes one out."""
    channels = {"t": T, "theta": TH, "omega": W, "i_q": IQ} | changed
    return {name: values for name, values in channels.items() if values is not None}


def first(count: int) -> dict[str, Any]:
    return {name: values[:count] for name, values in log().items()}


LOGS: dict[str, dict[str, Any]] = {
    "one sample": first(1),
    "two samples": first(2),
    "three samples": first(3),
    "forty samples": first(40),
    "all zero": log(theta=ZERO, omega=ZERO, i_q=ZERO),
    "constant": log(theta=100 * T, omega=100 + ZERO, i_q=0.03 + ZERO),
    "constant with noise": log(theta=100 * T, omega=100 + ZERO, i_q=0.03 + 1e-3 * NOISE),
    "standstill": log(theta=ZERO, omega=ZERO, i_q=0.01 * NOISE),
    "standstill with a noisy speed": log(theta=None, omega=1e-3 * np.roll(NOISE, 9), i_q=0.01 * NOISE),
    "no current": log(i_q=ZERO),
    "denormal": log(theta=TH * 5e-324, omega=W * 5e-324, i_q=IQ * 1e-322),
    "denormal current": log(i_q=IQ * 1e-322),
    "denormal speed": log(theta=None, omega=W * 1e-322),
    "1e-300": log(theta=TH * 1e-300, omega=W * 1e-300, i_q=IQ * 1e-300),
    "1e300": log(theta=TH * 1e300, omega=W * 1e300, i_q=IQ * 1e300),
    "1e300 speed": log(theta=None, omega=W * 1e300),
    "1e300 current": log(i_q=IQ * 1e300),
    "one speed of 1e300": log(omega=np.where(np.arange(N) == 1500, 1e300, W)),
    "one current of 1e300": log(i_q=np.where(np.arange(N) == 1500, 1e300, IQ)),
    "one speed of 1e6": log(theta=None, omega=np.where(np.arange(N) == 1500, 1e6, W)),
    "position jumps": log(theta=TH + 1e4 * (T > 1.5), omega=None),
    "position wraps": log(theta=np.mod(TH, 2 * np.pi), omega=None),
    "position wraps symmetrically": log(theta=np.mod(TH + np.pi, 2 * np.pi) - np.pi),
    "position wraps at an electrical turn": log(theta=np.mod(TH, np.pi / 2)),
    "position far away": log(theta=TH + 1e11, omega=None),
    "position of few steps": log(theta=np.round(TH / 5) * 5, omega=None),
    "time since 1970": log(t=T + 1.7e9),
    "time of 1e300": log(t=T * 1e300),
    "time of 1e-300": log(t=T * 1e-300),
    "denormal time": log(t=np.arange(N) * 5e-324),
    "a gap of a year": log(t=T + 3.15e7 * (T > 1.5)),
    "a gap of seconds": log(t=T + 5 * (T > 1.5)),
    "time stamps that jitter": log(t=np.sort(T + np.random.default_rng(5).uniform(0, 9e-4, N))),
    "a second per sample": log(t=T * 1000),
    "a microsecond per sample": log(t=T / 1000),
    "one direction": log(theta=None, omega=np.abs(W) + 1),
    "voltages": log(i_d=ZERO, u_d=U_D, u_q=U_Q),
    "voltages of zero": log(i_d=ZERO, u_d=ZERO, u_q=ZERO),
    "voltages of 1e300": log(i_d=ZERO, u_d=U_D * 1e300, u_q=U_Q * 1e300),
    "a constant temperature": log(temperature=20 + ZERO),
    "a reference of 1e300": log(omega_ref=W * 1e300),
    "a load of 1e300": log(T_load=1e300 + ZERO),
    "a speed that alternates": log(theta=None, omega=np.where(np.arange(N) % 2, 50.0, -50.0)),
}
# What must be refused, by whom, and the words that say why.
EVALUATIONS = ("identify", "compare", "diagnose", "add")
SHORT = (*EVALUATIONS, "track")
REFUSED: dict[str, tuple[tuple[str, ...], str]] = {
    "one sample": (SHORT, "1 sample"),
    "two samples": (SHORT, "2 samples"),
    "three samples": (EVALUATIONS, "3 samples"),
    "forty samples": (EVALUATIONS, "at least 100"),
    "all zero": (EVALUATIONS, "stands still throughout"),
    "standstill": (EVALUATIONS, "stands still throughout"),
    "no current": (EVALUATIONS, "no torque throughout"),
    "denormal": (EVALUATIONS, "stands still throughout"),
    "denormal current": (EVALUATIONS, "no torque throughout"),
    "denormal speed": (EVALUATIONS, "stands still throughout"),
    "1e-300": (EVALUATIONS, "stands still throughout"),
    "1e300": (SHORT, "channel 'theta', sample"),
    "1e300 speed": (SHORT, "channel 'omega', sample"),
    "1e300 current": (SHORT, "channel 'i_q', sample"),
    "one speed of 1e300": (SHORT, "channel 'omega', sample 1500: 1e+300 rad/s"),
    "one current of 1e300": (SHORT, "channel 'i_q', sample 1500: 1e+300 A"),
    "time of 1e300": (SHORT, "unit of time"),
    "time of 1e-300": (SHORT, "unit of time"),
    "denormal time": (SHORT, "unit of time"),
    "a gap of a year": (EVALUATIONS, "a gap of 3.15e+07 s after t = 1.5 s"),
    "voltages of 1e300": (SHORT, "channel 'u_d', sample"),
    "a reference of 1e300": (SHORT, "channel 'omega_ref', sample"),
    "a load of 1e300": (SHORT, "channel 'T_load', sample"),
    "a microsecond per sample": (SHORT, "dtheta/dt is 1000 times omega"),
    "a second per sample": (SHORT, "dtheta/dt is 0.001 times omega"),
    "constant": (SHORT, "i_q is constant"),
    "standstill with a noisy speed": (EVALUATIONS, "samples are usable below 40 Hz"),
    "a speed that alternates": (EVALUATIONS, "moves for too short a time"),
}
# What is answered, but must be doubted: the code of the notice.
DOUBTED = {
    "one sample": "[few_samples]",
    "one speed of 1e6": "[speed_spikes]",
    "position jumps": "[position_jumps]",
    "position wraps at an electrical turn": "[angle_unwrapped]",
    "position of few steps": "[quantised_channel]",
    "constant": "[constant_channel]",
    "standstill": "[constant_channel]",
    "a gap of seconds": "[time_gaps]",
    "time stamps that jitter": "[irregular_time]",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def attempt(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Run a command with warnings as errors; check what holds for every outcome; return status and both streams."""
    before = set(Path().iterdir())
    with pytest.raises(SystemExit) as left:
        main([*map(str, words), "--debug"])
    status = int(left.value.code or 0)
    shown = capsys.readouterr()
    said = [line for line in shown.err.splitlines() if line.startswith("pmsm-ctrl: ")]
    assert status in (0, 1, 2), said[-1:]
    if status == 2:
        assert shown.out == ""
        assert set(Path().iterdir()) == before, "a refused command leaves nothing behind"
        return status, shown.out, said[-1]
    assert not re.search(r"\b(nan|inf)\b", shown.out, re.IGNORECASE), shown.out
    if Path("r.json").exists():
        json.loads(Path("r.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    if Path("n.toml").exists():
        Design.read("n.toml")
    return status, shown.out, "\n".join(said)


# A page is asked of these every time, of all others with --slow: its figures take longer than all the rest.
ON_A_PAGE = {"constant with noise", "one speed of 1e6", "position far away", "voltages of zero"}


def words_for(verb: str, path: Path, case: str) -> list[object]:
    design = ["--design", SEED_MOTOR]
    if verb == "add":
        return ["add", "unbalance", *design, "--log", path, "--output", "n.toml", "--json", "r.json"]
    page = ["--report", "r.html"] if effort.WHOLE or case in ON_A_PAGE else []
    outputs = {"import": ["--output", "c.csv"], "identify": ["--output", "n.toml", *page]}
    return [verb, path, *design, "--json", "r.json", *outputs.get(verb, [])]


def judge(capsys: pytest.CaptureFixture[str], folder: Path, verb: str, case: str) -> None:
    path = Log(LOGS[case]).write_csv(folder / "some log.csv")
    status, out, said = attempt(capsys, *words_for(verb, path, case))
    verbs, reason = REFUSED.get(case, ((), ""))
    if verb in verbs:
        assert status == 2, out
        assert "some log.csv" in said
        assert reason in said
        return
    assert status in (0, 1), said
    if case in DOUBTED:
        assert DOUBTED[case] in out + said


@pytest.mark.parametrize("case", [slow(case) if n % 3 else case for n, case in enumerate(LOGS)])
@pytest.mark.parametrize("verb", ["identify", slow("import"), slow("compare"), slow("track")])
def test_any_log(capsys: pytest.CaptureFixture[str], folder: Path, verb: str, case: str) -> None:
    judge(capsys, folder, verb, case)


SEARCHED = ["one sample", "three samples", "constant", "no current", "denormal", "1e300 current", "position jumps",
            "time of 1e-300", "one direction", "voltages of zero", "a load of 1e300"]  # fmt: skip


@pytest.mark.parametrize("verb", ["diagnose", "add"])
@pytest.mark.parametrize(
    "case", [case if case in SEARCHED else pytest.param(case, marks=pytest.mark.slow) for case in LOGS]
)
def test_any_log_is_searched(capsys: pytest.CaptureFixture[str], folder: Path, verb: str, case: str) -> None:
    judge(capsys, folder, verb, case)


# ---- designs ----------------------------------------------------------------------------------------------------

SEED: dict[str, Any] = tomllib.loads(SEED_MOTOR.read_text(encoding="utf-8"))
SHIP = {
    "name": "ship", "motor": {"R": 0.01, "L_d": 1e-3, "L_q": 1e-3, "J": 1e6, "p": 20, "psi_f": 20.0},
    "drive": {"u_dc": 3000.0, "i_max": 3000.0, "f_control": 2000.0},
    "effects": [{"id": "coulomb", "F_c": 2000.0}, {"id": "viscous", "F_v": 500.0}],
}  # fmt: skip
WATCH = {
    "name": "watch", "motor": {"R": 500.0, "L_d": 0.2, "L_q": 0.2, "J": 1e-11, "p": 1, "psi_f": 1e-3},
    "drive": {"u_dc": 1.5, "i_max": 0.003},
    "effects": [{"id": "coulomb", "F_c": 1e-8}, {"id": "viscous", "F_v": 1e-11}],
}  # fmt: skip
TUGBOAT = SEED | {"name": "tugboat", "motor": SEED["motor"] | {"J_kg_cm2": 1e10}}  # a ship's shaft on a 3 A servo


def changed(place: str, value: object) -> dict[str, Any]:
    data = copy.deepcopy(SEED)
    part = data
    *tables, field = place.split(".")
    for table in tables:
        part = part.setdefault(table, {})
    part[field] = value
    if place == "motor.J":
        del data["motor"]["J_kg_cm2"]
    return data


POSITIVE = ["motor.J", "motor.R", "motor.L_d", "motor.L_q", "motor.psi_f", "load.gear", "drive.u_dc", "drive.f_control",
            "loops.current.K_p", "loops.current.T_n", "loops.speed.T_n", "assumed.J", "assumed.K_t"]  # fmt: skip
OTHERS = ["load.J", "sensor.current_noise", "sensor.speed_filter", "loops.speed.K_p", "loops.position.K_v",
          "compensation.gain"]  # fmt: skip


@pytest.mark.parametrize("place", [*POSITIVE, *OTHERS])
@pytest.mark.parametrize("value", [5e-324, 1e-300, 1e300, -1.0, 0.0, float("nan"), float("inf"), "1", True, None])
def test_a_number_no_drive_has_is_refused_with_its_place(tmp_path: Path, place: str, value: object) -> None:
    path = tmp_path / "axis.toml"
    if value is None:
        value = []
    path.write_text(tomli_w.dumps(changed(place, value)), encoding="utf-8")
    if place in OTHERS and isinstance(value, float) and 0.0 <= value < 1.0:
        assert Design.read(path)  # a noise of nothing is no noise
        return
    with pytest.raises(DesignError, match=rf"axis\.toml: {re.escape(place)}: ") as caught:
        Design.read(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("place", "value"),
    [("motor.p", -4), ("motor.p", 0), ("motor.p", 1.5), ("motor.p", 10**30), ("sensor.log_divider", 10**9),
     ("sensor.log_divider", 0), ("drive.speed_divider", 10**9), ("drive.speed_divider", -1),
     ("sensor.encoder_counts", 10**18), ("sensor.encoder_counts", -1), ("drive.plant_steps", 10**6)],
)  # fmt: skip
def test_a_count_no_drive_has_is_refused(tmp_path: Path, place: str, value: float) -> None:
    path = tmp_path / "axis.toml"
    path.write_text(tomli_w.dumps(changed(place, value)), encoding="utf-8")
    with pytest.raises(DesignError, match=re.escape(f"axis.toml: {place}: found {value}")):
        Design.read(path)


@pytest.mark.slow
@pytest.mark.parametrize("design", seeds(WATCH, SHIP, TUGBOAT), ids=lambda d: d["name"])
def test_the_largest_and_the_smallest_axis(capsys: pytest.CaptureFixture[str], folder: Path, design: dict) -> None:
    Path("axis.toml").write_text(tomli_w.dumps(design), encoding="utf-8")
    assert attempt(capsys, "tune", "axis.toml", "--no-prove", "--output", "n.toml", "--json", "r.json")[0] in (0, 1)
    assert attempt(capsys, "export", "n.toml", "--language", "st", "--output", "x.st")[0] == 0
    few = ["--set", "speed_max=0.2", "--set", "speed_step=0.1", "--set", "dwell=0.2"]
    status, _, said = attempt(capsys, "simulate", "n.toml", *few, "--output", "l.csv")
    assert status == 0, said
    log_path = Log(log()).write_csv(folder / "other.csv")
    for verb in ("identify", "compare", "track"):
        status, out, said = attempt(capsys, verb, log_path, "--design", "axis.toml")
        assert status == 2, out
        assert "times the design's J" in said
        if verb != "identify" and not effort.WHOLE:
            continue
        confirmed = attempt(capsys, verb, log_path, "--design", "axis.toml", "--map", "i_q=i_q [A]")
        assert confirmed[0] == 0, confirmed[2]
        assert "times the design's J" in confirmed[2]


def test_an_axis_that_weighs_nothing_is_not_tuned(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    data = {name: part for name, part in changed("motor.J", 1e-11).items() if name != "loops"}
    Path("axis.toml").write_text(tomli_w.dumps(data), encoding="utf-8")
    status, _, said = attempt(capsys, "tune", "axis.toml", "--no-prove")
    assert status == 2
    assert "axis.toml: speed loop: its gain never crosses 1" in said


@pytest.mark.parametrize("J", seeds(9e-6, 9e-5, 1.0, 1e6))
def test_noise_of_the_axis_agrees_with_its_frequency_response(J: float) -> None:
    """Parseval: the rms factor of white noise is the mean of the squared response over the unit circle."""
    from pmsm_ctrl.tune import tune
    from pmsm_ctrl.tune.noise import h2_norm
    from pmsm_ctrl.tune.sampled import Cascade, responses

    data = {name: part for name, part in changed("motor.J", J).items() if name != "loops"}
    design = tune(Design.from_dict(data), prove=False).design
    assert design.loops is not None
    cascade = Cascade.of(design, design.loops.current, design.loops.speed, at=1e-3)
    system = cascade.system(("angle_noise",), ("i_q_ref",))
    omega = np.concatenate(([0.0], np.logspace(-9, np.log10(np.pi), 20_000)))
    squared = np.abs(responses(system, omega / system.dt)) ** 2
    assert h2_norm(system) == pytest.approx(np.sqrt(np.trapezoid(squared.ravel(), omega) / np.pi), rel=1e-3)
