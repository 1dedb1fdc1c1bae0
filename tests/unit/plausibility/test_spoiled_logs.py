"""Spoiled logs are named for what was done to them; sound logs raise nothing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine
from pmsm_ctrl.plausibility.recorder import recorded
from tests.benchmarks.spoiled_logs import SPOILED
from tests.effort import seeds, slow
from tests.unit.plausibility.drives import F_C, K_T, PSI, L, believed, drawn
from tests.unit.plausibility.drives import R as RESISTANCE

CONTRADICTIONS = {
    "i_q, wrong sign": "current_sign",
    "i_d and i_q, wrong sign": "current_sign",
    "voltages, wrong sign": "voltage_sign",
    "voltages times sqrt(3)": "voltage_factor",
    "voltages over sqrt(3)": "voltage_factor",
    "voltages over sqrt(2)": "voltage_factor",
    "voltages per unit": "voltage_factor",
    "u_d and u_q swapped": "voltages_swapped",
    "i_d and i_q swapped": "currents_swapped",
    "3 pole pairs in the design": "pole_pairs",
    "8 pole pairs in the design": "pole_pairs",
    "encoder counted backwards": "motion_sign",
    "angle wrapped electrically": "motion_factor",
    "angle in degrees": "motion_factor",
    "angle in turns, no speed": "motion_factor",
    "rpm for rad/s, no angle": "motion_factor",
    "current in per cent of rated": "current_factor",
    "torque in per cent of rated": "inertia_factor",
    "ms taken for s": "time_factor",
    "time doubled": "time_factor",
    "abs(i_q)": "magnitude_channel",
    "abs(omega), no angle": "magnitude_channel",
    "alpha-beta currents": "stationary_currents",
    "reference for speed": "reference_as_measured",
    "white noise for current": "unrelated_torque",
    "current of another axis": "unrelated_torque",
    "speed of a load behind 10": "motion_factor",
    "5 % of samples lost": "lost_samples",
    "current clipped": "clipped_channel",
}
DOUBTS = {
    "current late by 5 ms": "not_synchronous",
    "current late by 10 ms": "not_synchronous",
    "current late by 50 ms": "not_synchronous",
    "current filtered, 5 ms": "not_synchronous",
    "current filtered, 20 ms": "current_filtered",
    "current held for 10 ms": "held_channel",
    "6 s cut out": "cut_in_time",
    "angle jumps by a turn": "cut_in_time",
}
REPAIRS = {
    "angle wraps at 25": "angle_unwrapped",
    "stamps jitter by 0.6 periods": "even_stamps",
    "stamps jitter by 3 periods": "even_stamps",
}
SEEDS = (3, 4, 5)


def spoiled(name: str, seed: int):
    log, design = drawn(seed), believed()
    made = SPOILED[name].change(log, design, np.random.default_rng(seed))
    changed, other = made if isinstance(made, tuple) else (made, design)
    return examine(other, changed)


@pytest.mark.parametrize("seed", seeds(*SEEDS))
@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_what_does_not_belong_together_is_named(name: str, seed: int) -> None:
    found = spoiled(name, seed)
    assert not found.plausible
    assert found.contradictions[0].code == CONTRADICTIONS[name]


@pytest.mark.parametrize("seed", seeds(*SEEDS))
@pytest.mark.parametrize("name", DOUBTS)
def test_what_the_recorder_did_is_a_doubt(name: str, seed: int) -> None:
    found = spoiled(name, seed)
    assert found.plausible, found.contradictions
    assert DOUBTS[name] in [notice.code for notice in found.doubts]


@pytest.mark.parametrize("seed", seeds(*SEEDS))
@pytest.mark.parametrize("name", REPAIRS)
def test_what_can_be_put_right_is_no_doubt(name: str, seed: int) -> None:
    found = spoiled(name, seed)
    assert [notice.code for notice in found.notices] == [REPAIRS[name]]
    # what is evaluated is the log as it was, up to the angle at the begin
    clean = drawn(seed)
    theta = found.log["theta"] - found.log["theta"][0] + clean["theta"][0]
    np.testing.assert_allclose(theta, clean["theta"], atol=1e-9)
    np.testing.assert_allclose(np.diff(found.log.t), clean.period, rtol=2e-3)


@pytest.mark.parametrize("seed", [20, 21, 22, *map(slow, range(23, 26))])
def test_a_sound_log_raises_nothing(seed: int) -> None:
    log = drawn(seed)
    speed = np.gradient(log["theta"], log.t)
    sound = {
        "all channels": log,
        "with a speed": log.with_channels(omega=speed),
        "a speed alone": Log({n: log[n] for n in ("t", "i_q")} | {"omega": speed}),
        "no voltages": Log({n: log[n] for n in ("t", "theta", "i_q")}),
        "a torque": Log({"t": log.t, "theta": log["theta"], "torque": K_T * log["i_q"]}),
        "250 Hz": Log({n: v[::4] for n, v in log.channels.items()}),
        "a coarse angle": log.with_channels(theta=np.round(log["theta"] * 81.5) / 81.5),
        "noise": drawn(seed, noise=0.1),
        "within a turn": log.with_channels(theta=np.mod(log["theta"], 2.0 * math.pi)),
    }
    for name, made in sound.items():
        assert examine(believed(), made).notices == (), name


@pytest.mark.parametrize("spread", [0.75, 1.0])
def test_samples_that_are_taken_unevenly_are_not_lost(spread: float) -> None:
    # a drive samples at some tick of its control within each period of the log; the stamps are even
    for seed in SEEDS:
        log = drawn(seed)
        ticks = 0.25 * log.period * np.random.default_rng(seed).integers(0, round(4.0 * spread) + 1, len(log))
        theta = np.interp(log.t + ticks, log.t, log["theta"])
        codes = [notice.code for notice in examine(believed(), log.with_channels(theta=theta)).notices]
        assert "lost_samples" not in codes


def test_the_top_of_a_short_move_is_no_lost_sample() -> None:
    # moves of five samples: 0.1, 1, 1.9, 1 and 0.1 of a step, beside long ones at an even speed
    moves = [0.0, 0.1, 1.0, 1.9, 1.0, 0.1, 0.0, *np.linspace(0.0, 1.0, 20), *[1.0] * 60, *np.linspace(1.0, 0.0, 20)]
    step = 0.2 * np.tile([*moves, *(-v for v in moves)], 30)
    log = Log({"t": 5e-3 * np.arange(step.size), "theta": np.cumsum(step), "i_q": np.gradient(step)})
    assert "lost_samples" not in [notice.code for notice in recorded(believed(), log).notices]
    keep = np.random.default_rng(1).random(step.size) >= 0.05
    lost = Log({name: values[: keep.sum()] if name == "t" else values[keep] for name, values in log.channels.items()})
    assert [notice.code for notice in recorded(believed(), lost).notices] == ["lost_samples"]


@pytest.mark.parametrize(
    "motor", [{"R": RESISTANCE / 2.0}, {"R": 1.3 * RESISTANCE}, {"J": 4e-4 / 1.5}, {"psi_f": 1.12 * PSI}, {"L_q": 9e-3}]
)
def test_tolerances_of_a_datasheet_are_no_contradiction(motor: dict[str, float]) -> None:
    for seed in SEEDS:
        assert examine(believed(**motor), drawn(seed)).notices == ()


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_nobody_knows_friction_before(factor: float) -> None:
    design = believed().with_effect("coulomb", {"F_c": factor * F_C})
    for seed in SEEDS:
        assert examine(design, drawn(seed)).notices == ()


@pytest.mark.parametrize("late", [-2e-3, 1e-3, 3e-3])
@pytest.mark.parametrize("seed", seeds(3))
def test_currents_and_voltages_that_are_late_together_are_no_other_motor(seed: int, late: float) -> None:
    """With a late back-emf the acceleration in the current looks like a resistance, even a negative one."""
    log = drawn(seed)
    moved = {name: np.interp(log.t - late, log.t, log[name]) for name in ("i_d", "i_q", "u_d", "u_q")}
    assert "parameter_factor" not in {notice.code for notice in examine(believed(), log.with_channels(**moved)).notices}


@pytest.mark.parametrize(("name", "factor", "words"), [
    ("voltages times sqrt(3)", math.sqrt(3.0), "line-to-line for phase"),
    ("voltages over sqrt(2)", math.sqrt(0.5), "rms for peak"),
    ("voltages per unit", math.sqrt(3.0) / 320.0, "per unit of the dc-link voltage over sqrt(3)"),
    ("rpm for rad/s, no angle", 30.0 / math.pi, "rpm for rad/s"),
    ("angle in turns, no speed", 0.5 / math.pi, "turns for radians"),
    ("speed of a load behind 10", 0.1, "gear of 10"),
    ("current in per cent of rated", 12.5, "per cent of i_max"),
    ("ms taken for s", 1000.0, "ms for s"),
    ("angle wrapped electrically", 4.0, "electrical angle, 4 pole pairs"),
])  # fmt: skip
def test_a_factor_is_said_with_what_it_looks_like(name: str, factor: float, words: str) -> None:
    notice = spoiled(name, 3).contradictions[0]
    assert notice.detail["factor"] == pytest.approx(factor, rel=0.05)
    assert words in notice.text


def test_another_number_of_pole_pairs_is_inferred() -> None:
    for p in (1, 2, 3, 8):
        notice = examine(believed(p=p), drawn(3)).contradictions[0]
        assert (notice.code, notice.detail["found"]) == ("pole_pairs", 4)


@pytest.mark.parametrize("seed", seeds(*SEEDS))
@pytest.mark.parametrize("lost", [0.77, 0.8, 0.85])
def test_a_magnet_that_lost_a_fifth_is_no_other_number_of_pole_pairs(lost: float, seed: int) -> None:
    # the inductance of the datasheet is off by as much: voltages and torque are those of 3 pole pairs, nearly
    design = believed(psi_f=PSI / lost, L_d=L / lost, L_q=L / lost)
    assert examine(design, drawn(seed)).notices == ()


@pytest.mark.parametrize("seed", seeds(*SEEDS))
def test_no_magnet_gains_a_third(seed: int) -> None:
    for p in (2, 3):
        assert examine(believed(p=p), drawn(seed)).contradictions[0].code == "pole_pairs"


@pytest.mark.parametrize("milliseconds", [8.0, 20.0, 80.0])
def test_the_lag_of_a_late_current_is_stated(milliseconds: float) -> None:
    log = drawn(3)
    late = log.with_channels(i_q=np.interp(log.t - 1e-3 * milliseconds, log.t, log["i_q"]))
    notice = next(n for n in examine(believed(), late).doubts if n.code == "not_synchronous")
    assert notice.detail["lag_ms"] == pytest.approx(milliseconds, rel=0.15)


def test_a_constant_current_is_refused_in_one_line_about_the_log() -> None:
    log = drawn(3)
    with pytest.raises(LogError, match=r"i_q is constant \(0.1 A\) throughout the log"):
        examine(believed(), log.with_channels(i_q=np.full(len(log), 0.1)))


def test_few_samples_and_missing_channels_say_nothing() -> None:
    log = drawn(3)
    assert examine(believed(), log.slice(0, 50)).notices == ()
    assert examine(believed(), Log({"t": log.t, "omega_ref": log["omega_ref"]})).notices == ()
    still = log.with_channels(theta=1e-5 * np.random.default_rng(1).standard_normal(len(log)))
    assert examine(believed(), still).contradictions == ()


def test_a_linear_axis_known_by_its_force() -> None:
    log = drawn(3)
    force = Log({"t": log.t, "theta": log["theta"], "torque": K_T * log["i_q"]}, motion="linear")
    from pmsm_ctrl.design import Design

    design = Design.from_dict({"motion": "linear", "motor": {"J": 4e-4, "K_t": 1.0}})
    assert examine(design, force).notices == ()
    turned = force.with_channels(torque=-force["torque"])
    assert [n.code for n in examine(design, turned).contradictions] == ["current_sign"]


@pytest.mark.parametrize("seed", seeds(*SEEDS))
def test_a_lag_beyond_every_correction_is_taken_out(seed: int) -> None:
    log = drawn(seed, noise=1e-3)
    for name, code in (("current late by 50 ms", "not_synchronous"), ("current filtered, 20 ms", "current_filtered")):
        changed = SPOILED[name].change(log, believed(), np.random.default_rng(seed))
        found = examine(believed(), changed)
        assert [notice.code for notice in found.doubts] == [code]
        inside = slice(500, -500)
        slow = np.ones(20) / 20.0
        error = np.convolve(found.log["i_q"] - log["i_q"], slow, "same")[inside]
        assert np.std(error) < 0.15 * np.std(log["i_q"][inside])


@pytest.mark.parametrize("seed", seeds(*SEEDS))
def test_clipped_samples_are_left_out_and_counted(seed: int) -> None:
    log = drawn(seed)
    limit = float(np.quantile(np.abs(log["i_q"]), 0.955))
    found = examine(believed(), log.with_channels(i_q=np.clip(log["i_q"], -limit, limit)))
    (reason,) = found.notices
    assert reason.code == "clipped_channel"
    assert reason.detail["percent"] == pytest.approx(4.5, rel=0.02)
    assert np.max(np.abs(found.log["i_q"])) < limit
    assert found.excluded
    assert all(stretch.reason is reason and stretch.stop > stretch.start for stretch in found.excluded)


@pytest.mark.parametrize("seed", seeds(*SEEDS))
def test_an_offset_by_hand_is_told_from_a_load(seed: int) -> None:
    log = drawn(seed)
    found = examine(believed(), log.with_channels(i_q=log["i_q"] + 0.1))
    (notice,) = found.contradictions
    assert notice.code == "current_offset_dc"
    assert notice.detail["offset"] == pytest.approx(0.1, rel=0.1)
    loaded = log.with_channels(i_q=log["i_q"] + 0.1, u_q=log["u_q"] + 0.1 * RESISTANCE)
    assert examine(believed(), loaded).contradictions == ()


@pytest.mark.parametrize("seed", seeds(*SEEDS))
def test_the_limit_of_the_drive_clips_nothing(seed: int) -> None:
    log = drawn(seed)
    limit = float(np.quantile(np.abs(log["i_q"]), 0.955))
    limited = log.with_channels(i_q=np.clip(log["i_q"], -limit, limit))
    drive = believed().drive.model_copy(update={"i_max": limit})
    assert not examine(believed().model_copy(update={"drive": drive}), limited).notices
