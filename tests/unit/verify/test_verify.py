"""Logs before and after a download, of drives that apply it in known ways: the gain is what the drive was given."""

from __future__ import annotations

import itertools
import json
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, read_log, simulate, verify
from pmsm_ctrl.cli import main
from pmsm_ctrl.compensate.motions import named_trial
from pmsm_ctrl.errors import LogError, RequestError
from pmsm_ctrl.simulate import Scenario, scenario
from pmsm_ctrl.simulate.fed_forward import fed_currents
from pmsm_ctrl.verify import notices as words
from pmsm_ctrl.verify.advice import advice_of
from pmsm_ctrl.verify.figures import added
from pmsm_ctrl.verify.law import Law, fit_law
from pmsm_ctrl.verify.record import Record, Sign
from pmsm_ctrl.verify.result import Outcome
from pmsm_ctrl.verify.rows import Rows
from tests.effort import amount, slow
from tests.unit.verify.downloads import WAYS, applied, logs_of, verified_design

VERDICTS = {
    "nothing": "not_applied", "half": "wrong_gain", "as designed": "applied", "reversed": "wrong_sign",
    "one and a half": "wrong_gain", "3 ms late": "late", "Coulomb alone": "partly_applied",
}  # fmt: skip
GAINS = {"nothing": 0.0, "half": 0.5, "as designed": 1.0, "reversed": -1.0, "one and a half": 1.5, "3 ms late": 1.0}


@pytest.fixture(scope="module")
def design(designs: Path) -> Design:
    return verified_design(Design.read(designs / "low_speed.toml"))


@pytest.fixture(scope="module")
def motion(design: Design) -> Scenario:
    return scenario("reversal", design, speed=10.0, frequency=1.0, cycles=4.0)


@pytest.fixture(scope="module")
def before(design: Design, motion: Scenario) -> Log:
    return simulate(design.replace(compensation={"gain": 0.0}), motion, seed=3)


@pytest.fixture(scope="module")
def after(design: Design, motion: Scenario) -> Callable[[str], Log]:
    """Return the log after a download by its name; only what is asked for is simulated, and once."""
    off = design.replace(compensation={"gain": 0.0})
    return cache(lambda name: simulate(off, applied(design, motion, *WAYS[name]), seed=4))


def without(log: Log, *names: str) -> Log:
    return Log({name: values for name, values in log.channels.items() if name not in names}, log.motion)


@pytest.mark.parametrize("way", [slow(way) if n % 2 else way for n, way in enumerate(VERDICTS)])
def test_a_drive_is_found_to_do_what_it_does(
    design: Design, before: Log, after: Callable[[str], Log], way: str
) -> None:
    found = verify(design, before, after(way))
    assert found.verdict.value == VERDICTS[way]
    assert found.explained > 0.99
    assert abs(found.before_gain.value) < 0.02
    if way in GAINS:
        low, high = found.interval
        assert low - 0.002 < GAINS[way] < high + 0.002
        assert high - low < (0.2 if way == "3 ms late" else 0.06)
    if way == "3 ms late":
        assert found.delay_interval[0] < 0.003 < found.delay_interval[1]


def test_the_simulated_drive_applies_its_own_compensator(design: Design, motion: Scenario, before: Log) -> None:
    """The compensator in the kernel, by its own speed and angle, is what `fed_currents` computes from the log."""
    log = simulate(design, motion, seed=5)
    found = verify(design, before, log)
    assert found.verdict.value == "applied"
    assert found.gain.value == pytest.approx(1.0, abs=0.01)
    # the error of the real drive falls as the simulated one promises: it is the same drive with other noise
    assert found.measured["rms"] == pytest.approx(found.promised["rms"], abs=0.05)
    assert found.promised["rms"] < -0.7


def test_the_feedforward_is_the_friction_of_the_design(design: Design) -> None:
    speed = np.array([-5.0, -0.5, 0.0, 0.5, 5.0])
    parts = fed_currents(design, {"theta": np.zeros(5), "i_q": np.zeros(5)}, speed, 1e-3)
    sign, K_t = np.sign(speed), 1.5 * 4 * 0.172
    np.testing.assert_allclose(parts["coulomb"], 0.0213 * sign / K_t, rtol=1e-12)
    np.testing.assert_allclose(parts["viscous"], 0.000168 * speed / K_t, rtol=1e-12)
    np.testing.assert_allclose(parts["stribeck"], 0.01 * np.exp(-((speed / 2.0) ** 2)) * sign / K_t, rtol=1e-12)


@pytest.mark.parametrize(
    ("way", "left_out"),
    [
        ("as designed", ("i_q_ref",)),
        ("nothing", ("omega_ref", "omega")),
        slow("nothing", ("i_q_ref",)),
        slow("as designed", ("omega_ref", "omega")),
    ],
)
def test_fewer_channels_tell_the_same(
    design: Design, before: Log, after: Callable[[str], Log], way: str, left_out: tuple[str, ...]
) -> None:
    found = verify(design, without(before, *left_out), without(after(way), *left_out))
    assert found.verdict.value == VERDICTS[way]


def test_what_is_not_applied_has_no_sign_of_the_speed(
    design: Design, before: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log beside itself: the gain was 0.000, and its sign smoothed over 1.73 +- 0.38 rad/s."""

    def smoothed_law(before: Record, after: Record, progress: Callable[[float], None]) -> Law:
        return replace(fit_law(before, after, progress), sign=Sign(1.73), width_low=1.3, width_high=2.79)

    monkeypatch.setattr(sys.modules["pmsm_ctrl.verify.verify"], "fit_law", smoothed_law)
    found = verify(design, before, before)
    assert found.verdict.value == "not_applied"
    assert found.smoothing is None
    assert "verify_smoothed_sign" not in {notice.code for notice in found.notices}


def test_feedforward_behind_the_logged_reference_is_found_in_the_current(
    design: Design, before: Log, after: Callable[[str], Log]
) -> None:
    log = after("as designed")
    parts = fed_currents(design, dict(log.channels), log["omega_ref"], log.period)
    hidden = log.with_channels(i_q_ref=log["i_q_ref"] - np.sum(list(parts.values()), axis=0))
    found = verify(design, before, hidden)
    assert found.verdict.value == "applied"
    assert found.channel == "i_q"
    assert "verify_behind_reference" in [notice.code for notice in found.notices]


@pytest.mark.slow
def test_unchanged_drives_are_not_called_changed(design: Design, motion: Scenario) -> None:
    """Noise of another seed, a friction that fell by a third: the law of the controller is one."""
    warm = design.with_effect("coulomb", {"F_c": 0.014})
    for seed in range(80020, 80020 + amount(1, 8)):
        logs = logs_of(design, motion, WAYS["nothing"], seed, plant=warm)
        assert verify(design, *logs).verdict.value == "not_applied"


@pytest.mark.slow
def test_intervals_of_the_gain_hold(design: Design) -> None:
    count = 20
    held = 0
    for seed in range(80040, 80040 + count):
        low, high = verify(design, *logs_of(design, "reversal 2 rad/s", WAYS["as designed"], seed)).interval
        held += low <= 1.0 <= high
    assert held >= 0.9 * count


@pytest.mark.parametrize(
    ("name", "counts", "divider", "gain"),
    [
        ("servo_2kw", 65536, 16, 1.0), ("servo_2kw", 65536, 16, 0.5), ("servo_2kw", 65536, 16, 0.0),
        slow("seed_motor", 8192, 32, 1.0), slow("seed_motor", 8192, 32, 0.5), ("seed_motor", 8192, 32, 0.0),
    ],
)  # fmt: skip
def test_a_coarse_encoder_in_a_slow_log_takes_nothing_off_the_gain(
    designs: Path, name: str, counts: int, divider: int, gain: float
) -> None:
    """The sum of rounded errors at 500 Hz is not the controller's: 0.48 +- 0.04 was found, and 35 % before it."""
    off = Design.read(designs / f"{name}.toml").replace(
        sensor={"encoder_counts": counts, "log_divider": divider}, compensation={"gain": 0.0, "source": "reference"}
    )
    drive = off.replace(compensation={"gain": gain})
    logs = [simulate(one, "reversal", seed=seed) for one, seed in ((off, 5), (drive, 6))]
    found = verify(off.replace(compensation={"gain": 1.0}), *logs)
    assert found.verdict.value == {1.0: "applied", 0.5: "wrong_gain", 0.0: "not_applied"}[gain]
    low, high = found.interval
    assert low < gain < high < low + 0.05
    assert abs(found.before_gain.value) < 0.01
    assert "verify_acts_before" not in [notice.code for notice in found.notices]


@pytest.mark.parametrize("gain", [0.3, slow(0.7)])
def test_rounded_samples_do_not_hide_a_feedforward_that_is_in_time(designs: Path, gain: float) -> None:
    """A place 3 to 4 ms late was all that was looked at, where a feedforward of 0.3 was -0.31 +- 0.05: wrong sign."""
    off = Design.read(designs / "servo_2kw.toml").replace(
        sensor={"encoder_counts": 65536, "log_divider": 16}, compensation={"gain": 0.0, "source": "reference"}
    )
    logs = [simulate(off.replace(compensation={"gain": g}), "identification", seed=s) for g, s in ((0.0, 5), (gain, 6))]
    found = verify(off.replace(compensation={"gain": 1.0}), *logs)
    assert found.verdict.value == "wrong_gain"
    assert found.interval[0] < gain < found.interval[1] < found.interval[0] + 0.06


@pytest.mark.parametrize("channel", ["i_q_ref", "i_q"])
def test_where_the_integral_is_not_known_no_factor_is_advised(designs: Path, channel: str) -> None:
    """The measured current of such a log has errors of both kinds: 0.02 +- 0.01 was found of 1."""
    off = Design.read(designs / "servo_2kw.toml").replace(
        sensor={"encoder_counts": 8192, "log_divider": 16}, compensation={"gain": 0.0, "source": "reference"}
    )
    drive = off.replace(compensation={"gain": 1.0})
    logs = [simulate(one, "reversal", seed=seed) for one, seed in ((off, 5), (drive, 6))]
    found = verify(drive, *(one if channel == "i_q_ref" else without(one, "i_q_ref") for one in logs))
    assert found.verdict.value == "inconclusive"
    assert found.interval[0] < 1.0 < found.interval[1]
    assert "verify_rounded_error" in [notice.code for notice in found.notices]
    assert "rate of the speed loop" in found.advice
    assert found.implausible == ()


@pytest.mark.parametrize(
    ("name", "counts", "divider", "seed"),
    [
        ("servo_2kw", 1 << 20, 16, 5), slow("servo_2kw", 1 << 20, 8, 7), ("servo_2kw", 1 << 22, 16, 7),
        slow("seed_motor", 0, 16, 7),
    ],
)  # fmt: skip
def test_a_slow_log_of_speed_control_leaves_the_integral_in_doubt(
    designs: Path, name: str, counts: int, divider: int, seed: int
) -> None:
    """Gains of 0.54 to 0.89 were stated of 1, with factors to multiply by or a delay; the rest was found before."""
    off = Design.read(designs / f"{name}.toml").replace(
        sensor={"encoder_counts": counts, "log_divider": divider}, compensation={"gain": 0.0, "source": "reference"}
    )
    drive = off.replace(compensation={"gain": 1.0})
    logs = [simulate(one, "identification", seed=s) for one, s in ((off, seed), (drive, seed + 1))]
    found = verify(drive, *logs)
    assert found.verdict.value == "inconclusive"
    assert found.interval[0] < 1.0 < found.interval[1]
    assert "verify_rounded_error" in [notice.code for notice in found.notices]


@pytest.mark.parametrize(("divider", "cycles"), [(2, 1.0), slow(1, 3.0)])
def test_a_log_as_fast_as_the_speed_loop_holds_the_integral(
    designs: Path, divider: int, cycles: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its rows were turned all the same: 1.008 [1.004, 1.013] was found of 1."""
    off = Design.read(designs / "servo_2kw.toml").replace(
        sensor={"encoder_counts": 1 << 20, "log_divider": divider}, compensation={"gain": 0.0, "source": "reference"}
    )
    drive = off.replace(compensation={"gain": 1.0})
    motion = scenario("triangle", off, cycles=cycles)
    logs = [simulate(one, motion, seed=seed) for one, seed in ((off, 9), (drive, 10))]
    monkeypatch.delattr(Rows, "turned")
    found = verify(drive, *logs)
    assert found.verdict.value == "applied"
    assert found.interval[0] < 1.0 < found.interval[1] < found.interval[0] + 0.15
    assert "verify_rounded_error" not in [notice.code for notice in found.notices]


def test_what_a_measured_current_finds_before_is_an_error_of_the_change(design: Design, motion: Scenario) -> None:
    """A coarse scale at the rate of the speed loop: 0.84 +- 0.03 was found of 1, 0.16 of it before the download."""
    coarse = design.replace(sensor={"encoder_counts": 4096, "log_divider": 2})
    off = coarse.replace(compensation={"gain": 0.0})
    logs = [simulate(one, motion, seed=seed) for one, seed in ((off, 5), (coarse, 6))]
    found = verify(coarse, *(without(one, "i_q_ref") for one in logs))
    low, high = found.interval
    assert low < 1.0 < high
    assert found.gain.stderr >= abs(found.before_gain.value)
    assert found.verdict.value == "applied"


@pytest.mark.parametrize(
    ("codes", "wanted"),
    [
        ("ROUNDED", "at the rate of the speed loop"),
        ("BEFORE_NOT_TOLD", "with the current reference beside the measured current"),
        ("ROUNDED BEFORE_NOT_TOLD OTHER_CHANNEL", "at the rate of the speed loop"),
        ("ROUNDED BEFORE_NOT_TOLD",
         "at the rate of the speed loop and with the current reference beside the measured current"),
    ],
)  # fmt: skip
def test_what_to_log_is_what_was_missing(
    design: Design, before: Log, after: Callable[[str], Log], codes: str, wanted: str
) -> None:
    """Fast logs of measured currents were to be logged at the rate of the speed loop."""
    values = {"rate": 1000.0, "gain": -0.12}
    said = tuple(getattr(words, code)(**(values if code != "OTHER_CHANNEL" else {})) for code in codes.split())
    found = replace(verify(design, before, after("half")), verdict=Outcome.INCONCLUSIVE, notices=said)
    assert advice_of(found, []).advice == f"Log the same motion again {wanted}: these logs advise no factor."
    assert not any("-12%" in one.text for one in said)


def test_the_integral_of_the_speed_is_the_angle_turned(designs: Path) -> None:
    """Under speed control: rounded speeds of one cycle in eight were summed up, 0.07 +- 0.02 was found of 1."""
    off = Design.read(designs / "servo_2kw.toml").replace(
        sensor={"encoder_counts": 8192, "log_divider": 16}, compensation={"gain": 0.0, "source": "reference"}
    )
    drive = off.replace(compensation={"gain": 1.0})
    logs = [simulate(one, "triangle", seed=seed) for one, seed in ((off, 5), (drive, 6))]
    found = verify(drive, *logs)
    assert found.verdict.value == "applied"
    assert found.gain.value == pytest.approx(1.0, abs=0.01)


def test_a_controller_with_other_gains_is_noticed(design: Design, motion: Scenario, before: Log) -> None:
    loops = design.require_loops()
    softer = loops.model_copy(update={"speed": loops.speed.model_copy(update={"K_p": 0.5 * loops.speed.K_p})})
    retuned = design.model_copy(update={"loops": softer})
    log = simulate(retuned, motion, seed=6)
    found = verify(design, before, log)
    assert "verify_retuned" in [notice.code for notice in found.notices]
    assert found.gain.value == pytest.approx(1.0, abs=0.1)


def test_a_limit_cycle_comes_first(designs: Path) -> None:
    """Measured speed at a gain of 1 cycles after a push (docs/compensation.md); by the reference it does not."""
    design = verified_design(Design.read(designs / "seed_motor.toml"))
    motion = named_trial(design, "push").motions[0]
    off = design.replace(compensation={"gain": 0.0})
    measured = design.replace(compensation={"source": "measured"})
    found = verify(measured, simulate(off, motion, seed=1), simulate(measured, motion, seed=2))
    assert found.verdict.value == "limit_cycle"
    assert found.after.cycle_frequency > 1.0
    assert found.before.cycle_amplitude == 0.0
    assert "Lower the gain" in found.advice


def test_noise_for_a_current_is_no_law(design: Design, before: Log, after: Callable[[str], Log]) -> None:
    shuffled = np.random.default_rng(1).permutation(before["i_q_ref"])
    found = verify(design, without(before, "i_q").with_channels(i_q_ref=shuffled), without(after("nothing"), "i_q"))
    assert found.verdict.value == "inconclusive"
    assert "verify_unexplained_law" in [notice.code for notice in found.notices]


def test_what_is_missing_is_named(design: Design, before: Log) -> None:
    with pytest.raises(LogError, match="neither omega_ref nor theta_ref"):
        verify(design, without(before, "omega_ref", "theta_ref"), before)
    with pytest.raises(LogError, match="i_q_ref, i_q or torque"):
        verify(design, without(before, "i_q_ref", "i_q"), before)
    with pytest.raises(RequestError, match="observer"):
        verify(design.replace(compensation={"source": "observer", "bandwidth": 100.0}), before, before)
    with pytest.raises(RequestError, match="none of"):
        verify(design.replace(compensation={"effects": ["unbalance"]}).with_effect("unbalance", {}), before, before)


@pytest.mark.slow
def test_the_command(
    design: Design, before: Log, after: Callable[[str], Log], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    design.write("d.toml")
    before.write_csv("before.csv")
    after("half").write_csv("after.csv")
    words = ["verify", "before.csv", "after.csv", "--design", "d.toml"]
    with pytest.raises(SystemExit) as left:
        main([*words, "--fail-on", "wrong_gain", "--json", "r.json", "--report", "r.html"])
    assert left.value.code == 1
    said = capsys.readouterr()
    assert "Gain 0.5" in said.out
    assert "Multiply the drive's values by 2" in said.out
    assert "the verdict is wrong_gain" in said.err
    data = json.loads(Path("r.json").read_text(encoding="utf-8"))
    assert data["schema"] == "pmsm-ctrl/verification/1"
    assert data["verdict"] == "wrong_gain"
    assert "<svg" in Path("r.html").read_text(encoding="utf-8")
    with pytest.raises(SystemExit) as left:
        main([*words, "--fail-on", "late"])
    assert left.value.code in (0, None)


def test_a_real_drive_that_was_not_changed(designs: Path, measured: Callable[[str], Path]) -> None:
    """Two parts of one record of EMPS, whose controller is P over P: its law is found, and nothing beside it."""
    design = Design.read(designs / "emps.toml")
    log = read_log(measured("emps/DATA_EMPS.mat"), design)
    quarter = len(log) // 4
    found = verify(design, log.slice(0, quarter), log.slice(quarter, 2 * quarter))
    assert found.verdict.value == "not_applied"
    assert found.explained > 0.999
    assert found.interval[0] < 0.0 < found.interval[1]


def smoothed(width: float, shape: str) -> Callable[[np.ndarray], np.ndarray]:
    """Return what a drive takes for the sign of the speed."""
    shapes: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "tanh": np.tanh, "line": lambda x: np.clip(x, -1.0, 1.0), "hard": np.sign,
        "root": lambda x: x / np.sqrt(1.0 + x * x),
    }  # fmt: skip
    return lambda speed: shapes[shape](speed / width)


@pytest.mark.parametrize("reference", [True, slow(False)])
@pytest.mark.parametrize(
    ("gain", "width", "shape", "late"),
    [
        (1.0, 0.3, "tanh", 0.0), slow(1.0, 0.1, "tanh", 0.0), slow(1.0, 0.5, "line", 0.004),
        (0.6, 0.3, "tanh", 0.004), slow(1.3, 0.3, "tanh", 0.0), slow(1.0, 0.3, "root", 0.0),
        slow(1.0, 1.0, "hard", 0.004),
    ],
)  # fmt: skip
def test_a_drive_that_smooths_the_sign_applies_its_gain(
    design: Design, motion: Scenario, before: Log, gain: float, width: float, shape: str, late: float, reference: bool
) -> None:
    """Edges in the wrong place were paid for by the gain: 0.56, and "multiply by 1.8", of a drive that applied 1.00."""
    off = design.replace(compensation={"gain": 0.0})
    log = simulate(off, applied(design, motion, {"all": gain}, late, smoothed(width, shape)), seed=8)
    left_out = () if reference else ("i_q_ref",)
    found = verify(design, without(before, *left_out), without(log, *left_out))
    low, high = found.interval
    assert low - 0.005 < gain < high + 0.005
    assert high - low < (0.25 if reference else 0.5)
    assert found.verdict.value == ("wrong_gain" if gain != 1.0 else "late" if late else "applied")
    assert found.delay_interval[0] <= late <= found.delay_interval[1]
    if reference and shape in ("tanh", "line"):
        assert found.smoothing is not None
        assert found.smoothing_shape == shape
        assert found.smoothing.value == pytest.approx(width, rel=0.05)
        assert "verify_smoothed_sign" in [notice.code for notice in found.notices]
    if shape == "hard":
        assert found.smoothing is None


def test_a_stated_smoothing_is_no_notice(design: Design, motion: Scenario, before: Log) -> None:
    stated = design.replace(compensation={"smoothing": 0.5})
    log = simulate(stated, motion, seed=9)
    found = verify(stated, before, log)
    assert found.verdict.value == "applied"
    assert found.gain.value == pytest.approx(1.0, abs=0.01)
    assert found.smoothing is None


@pytest.mark.parametrize(("width", "code"), [(5.0, "verify_smoothing_not_told"), slow(30.0, "verify_part_implausible")])
def test_a_motion_within_the_smoothing_tells_no_gain(
    design: Design, motion: Scenario, before: Log, width: float, code: str
) -> None:
    """Where the drive never leaves the smoothing its friction is proportional to the speed: no factor is advised."""
    off = design.replace(compensation={"gain": 0.0})
    log = simulate(off, applied(design, motion, {"all": 1.0}, 0.0, smoothed(width, "line")), seed=8)
    found = verify(design, before, log)
    assert found.verdict.value == "inconclusive"
    assert code in [notice.code for notice in found.notices]
    assert "Multiply" not in found.advice


def test_a_part_of_another_unit_is_an_alarm(design: Design, motion: Scenario, before: Log) -> None:
    """Viscous friction 60 times as strong as the rest is no gain of a download: it is named, and no number."""
    off = design.replace(compensation={"gain": 0.0})
    log = simulate(off, applied(design, motion, {"viscous": 60.0, "all": 1.0}), seed=8)
    found = verify(design, before, log)
    assert found.implausible == ("viscous",)
    assert "verify_part_implausible" in [notice.code for notice in found.notices]
    assert "Multiply" not in found.advice
    assert "implausible" in found.summary()


def test_delay_of_a_log_is_known_to_half_a_period(design: Design, motion: Scenario, before: Log) -> None:
    """A row may hold the current of its own reference, or of the one before: that is in the interval."""
    off = design.replace(compensation={"gain": 0.0})
    log = simulate(off, applied(design, motion, {"all": 1.0}, 0.0, np.sign), seed=8)
    found = verify(design, before, log)
    low, high = found.delay_interval
    assert low <= 0.0 <= high
    assert found.delay is not None
    assert low <= found.delay.value - 0.5 * log.period + 1e-12
    assert high >= found.delay.value + 0.5 * log.period - 1e-12


def test_logs_with_other_channels_share_a_law(design: Design, before: Log, after: Callable[[str], Log]) -> None:
    found = verify(design, without(before, "theta_ref"), after("as designed"))
    assert found.verdict.value in ("applied", "inconclusive")


def of_another_drive(seed: int, gain: float) -> Log:
    """Return the log of a position cascade at 4 kHz with hard ramps; its current lags by 0.4 ms.

    The feedforward is `gain` times the dry friction of 0.11 N m, over 0.2 rad/s; K_t is 0.424 N m/A.
    """
    J, F_c, F_v, K_t, T, steps = 6.5e-4, 0.11, 6e-4, 0.424, 2.5e-4, 5
    rng, motion = np.random.default_rng(seed), np.random.default_rng(1)
    t = np.arange(40_000) * T
    wanted, speed = 0.0, np.zeros(len(t))
    for k in range(1, len(t)):
        if k % 3000 == 0:
            wanted, rate = motion.choice([1.0, 5.0, 25.0, 60.0]) * motion.choice([-1, 1]), motion.choice([800, 2500])
        speed[k] = speed[k - 1] + (np.clip(wanted - speed[k - 1], -rate * T, rate * T) if k >= 3000 else 0.0)
    speed = np.convolve(speed, np.ones(32) / 32, "same")
    place = np.cumsum(speed) * T
    theta = omega = seen = current = integral = last = 0.0
    rows = np.zeros((len(t), 3))
    for k in range(len(t)):
        seen += 0.3 * ((theta - last) / T - seen)
        last = theta
        rows[k] = theta, seen, current
        error = speed[k] + 30.0 * (place[k] - theta) - seen
        integral += 30.0 * error * T
        asked = 0.6 * error + integral + gain * F_c / K_t * np.tanh(speed[k] / 0.2)
        for _ in range(steps):
            h = T / steps
            current += (asked - current) * h / 0.4e-3
            free = omega + h / J * (K_t * current - F_v * omega)
            omega = float(np.sign(free) * max(abs(free) - h / J * F_c, 0.0))
            theta += h * omega
    theta, omega, current = rows[::4].T
    noisy = current + 0.01 * rng.standard_normal(len(current))
    asked = {"theta_ref": place[::4], "omega_ref": speed[::4]}
    return Log({"t": t[::4], "theta": theta, "omega": omega, "i_q": noisy, **asked})


@pytest.mark.parametrize("gain", [1.0, slow(0.5)])
def test_the_lag_of_a_current_loop_is_no_feedforward(gain: float) -> None:
    """Where the acceleration steps the current lacks more than the whole dry friction: a gain of 1.35 was found."""
    given = Design.from_toml(
        "name = 'axis'\n[motor]\nJ = 6.5e-4\nK_t = 0.424\n[[effects]]\nid = 'coulomb'\nF_c = 0.11\n"
        "[compensation]\neffects = ['coulomb']\nsource = 'reference'\ngain = 1.0\n"
    )
    found = verify(given, of_another_drive(1, 0.0), of_another_drive(2, gain))
    assert found.gain.value == pytest.approx(gain, abs=0.05)
    assert found.interval[0] < gain < found.interval[1]
    assert abs(found.before_gain.value) < 0.05


def test_the_numbers_of_an_axis_do_not_overlap(design: Design, before: Log, after: Callable[[str], Log]) -> None:
    """Of a current of 0.05 A, five ticks of three decimals ran into one another."""
    found = verify(design, before, after("as designed"))
    scaled = replace(found, predicted=0.05 * found.predicted / np.abs(found.predicted).max())
    figure = added(scaled)
    figure.draw_without_rendering()
    labels = [label.get_window_extent() for label in figure.axes[1].get_xticklabels() if label.get_text()]
    inside = [
        one for one in labels if figure.axes[1].bbox.x0 - 5 <= 0.5 * (one.x0 + one.x1) <= figure.axes[1].bbox.x1 + 5
    ]
    assert len(inside) >= 3
    assert all(left.x1 < right.x0 for left, right in itertools.pairwise(inside))
