"""The log's experiment repeated: against the simulation that made the log."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, LogError
from pmsm_ctrl.identify import identify
from pmsm_ctrl.identify.replay import build_replay, plant_with
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.inverse_dynamics import build_problem
from pmsm_ctrl.section import Notice
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.simulate.motions import Scenario
from tests.effort import seeds

IDEAL = {"encoder_counts": 0, "current_noise": 0.0}


@pytest.fixture(scope="module")
def design(designs) -> Design:
    return Design.read(designs / "seed_motor.toml")


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


# (scenario, its parameters, error of the replayed current in A rms; the sensor's noise is 4 mA)
MOTIONS = [
    ("triangle", {"speed": 150.0, "period": 2.0}, 1e-9),  # the references in the log are all there is
    ("positioning", {"count": 2.0}, 1e-9),  # steps of the reference
    ("reversal", {"speed": 80.0}, 1e-4),  # acceleration feedforward, which no log holds
    ("s_curve", {"cycles": 1.0}, 3e-4),
    ("multisine", {"period": 1.0}, 3e-4),  # a test signal, which no log holds
    ("identification", {"duration": 12.0}, 6e-4),
]


@pytest.mark.parametrize(("name", "parameters", "error"), MOTIONS, ids=[m[0] for m in MOTIONS])
@pytest.mark.parametrize("divider", seeds(16, 1))
def test_a_noisy_log_is_repeated_without_its_noise(design, name, parameters, error, divider) -> None:
    sampled = design.replace(sensor={"log_divider": divider})
    motion = scenario(name, design, **parameters)
    noisy, clean = simulate(sampled, motion, seed=3), simulate(sampled.replace(sensor=IDEAL), motion)
    again = build_replay(sampled, noisy).run(sampled)
    assert len(again) == len(noisy)
    assert rms(again["i_q"] - clean["i_q"]) < error
    assert rms(noisy["i_q"] - clean["i_q"]) > 3e-3


def test_a_log_that_begins_while_the_axis_moves(design) -> None:
    motion = scenario("triangle", design, speed=150.0, period=2.0)
    noisy, clean = simulate(design, motion, seed=4), simulate(design.replace(sensor=IDEAL), motion)
    again = build_replay(design, noisy.slice(2200, 5200)).run(design)
    assert rms((again["i_q"] - clean["i_q"][2200:5200])[300:]) < 5e-4


def test_what_was_added_to_the_current_is_said(design) -> None:
    motion = scenario("multisine", design, amplitude=0.05, period=1.0)
    replay = build_replay(design, simulate(design, motion, seed=1))
    assert [note.code for note in replay.notes] == ["replayed_current"]
    added = replay.scenario.inputs(np.arange(1000) / 1000.0 + 2.0)[:, 3]
    assert rms(added) == pytest.approx(0.05, rel=0.02)


@pytest.mark.parametrize("name", ["hand_tuned", "seed_motor"])  # without and with a filter of the reference
def test_the_load_torque_of_the_log_is_applied(designs, name) -> None:
    design = Design.read(designs / f"{name}.toml")
    push = Scenario("push", 3.0, lambda t: {"omega_ref": np.full(t.shape, 20.0), "T_load": 0.05 * np.sin(9.0 * t)})
    clean = simulate(design.replace(sensor=IDEAL), push)
    again = build_replay(design, clean).run(design)
    assert rms(again["i_q"] - clean["i_q"]) < 1e-3 * rms(clean["i_q"])


# A recorder that interpolates between two samples of the drive rounds the corners of the motion, one that holds the
# values of the controller's last tick loses nothing. The speed's noise is 0.012 rad/s.
@pytest.mark.parametrize(("sampled", "divider", "error"), [("interpolated", 16, 2e-3), ("held", 1, 1e-9)])
def test_a_rate_that_does_not_divide_the_control_rate(design, sampled, divider, error) -> None:
    motion = scenario("triangle", design, speed=150.0, period=2.0)
    clean = simulate(design.replace(sensor={**IDEAL, "log_divider": divider}), motion)
    t = np.arange(0.0, clean.t[-1], 0.0013)
    last = np.floor(t / clean.period + 1e-6).astype(int)
    channels = {n: np.interp(t, clean.t, v) if sampled == "interpolated" else v[last]
                for n, v in clean.channels.items() if n != "t"}  # fmt: skip
    odd = Log({"t": t, **channels})
    replay = build_replay(design, odd)
    again = replay.run(design)
    assert replay.sampled == sampled
    assert len(again) == len(odd)
    assert rms(again["omega"] - odd["omega"]) < error


def staircase(t: np.ndarray) -> np.ndarray:
    """Return a profile that a PLC renews every 2 ms."""
    return 80.0 * np.sin(6.0 * np.floor(t / 2e-3 + 1e-6) * 2e-3)


def test_a_reference_that_is_held_between_the_samples(design) -> None:
    """Logged as often as it is renewed, a held reference looks like one that runs on."""
    slow = design.replace(sensor={**IDEAL, "log_divider": 32})
    for profile, straight in ((staircase, False), (lambda t: 80.0 * np.sin(6.0 * t), True)):
        clean = simulate(slow, Scenario("wave", 3.0, lambda t, f=profile: {"omega_ref": f(t)}))
        again = build_replay(slow, clean).run(slow)
        assert rms(again["i_q"] - clean["i_q"]) < (1e-3 if straight else 1e-9)


def test_without_reference_loops_or_motor(design) -> None:
    log = simulate(design, scenario("triangle", design, period=1.0, cycles=1.0))
    bare = Log({name: log[name] for name in ("t", "theta", "i_q")})
    with pytest.raises(LogError, match="1 sample; at least 100 were expected"):
        build_replay(design, log.slice(0, 1))
    with pytest.raises(LogError, match=r"no omega_ref and no theta_ref.*method = 'regression'"):
        build_replay(design, bare)
    plain = Design.from_dict({"motor": {"J": 0.01, "K_t": 1.0}})
    with pytest.raises(DesignError, match="add them, or use method = 'regression'"):
        build_replay(plain, log)


def test_a_current_at_its_limit_is_said(design) -> None:
    weak = design.replace(drive={"i_max": 0.05})
    log = simulate(weak, scenario("sweep", design, dwell=0.2, speed_step=50.0))
    assert [note.code for note in build_replay(weak, log).notes] == ["current_limit"]


def test_values_become_a_plant(design) -> None:
    problem = build_problem(design, simulate(design, scenario("triangle", design, period=1.0)))
    plant = plant_with(design, problem.columns, [8e-5, -0.1, 2e-4])
    assert pytest.approx(8e-5) == plant.J
    assert plant.parameters("coulomb")["F_c"] == 0.0  # moved to its bound
    assert plant.parameters("viscous")["F_v"] == 2e-4
    assumed = design.replace(assumed={"K_t": 1.0})
    assert plant_with(assumed, (), ()).K_t == pytest.approx(1.0)


def soft_and_held(designs, cycles: float) -> tuple[Design, Scenario, Scenario]:
    """Return a drive with loops set by hand, a triangle, and the same triangle held for a sample of the log."""
    soft = Design.read(designs / "hand_tuned.toml").replace(
        drive={"f_control": 8000.0, "speed_divider": 4}, sensor={"log_divider": 8}
    )
    smooth = scenario("triangle", soft, speed=150.0, period=1.0, cycles=cycles)
    return (
        soft,
        smooth,
        Scenario("held", smooth.duration, lambda t: smooth.references(np.floor(t / 1e-3 + 1e-9) * 1e-3)),
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", ["iv", "output_error"])
def test_a_reference_that_is_held_for_a_sample_leaves_the_inertia_right(designs, method: str) -> None:
    """The current answers each step of the reference alike, and the log meets it at the same place: no mean of it.

    Least squares by inverse dynamics takes the samples for means: 7 % too small here, with loops set by hand.
    """
    soft, _, held = soft_and_held(designs, 10.0)
    off = []
    for seed in range(900, 904):
        found = identify(soft, simulate(soft, held, seed=seed), method=method).estimates["J"]
        off.append((found.value - soft.J) / found.stderr)
        assert found.stderr < 0.003 * soft.J
    assert rms(np.array(off)) < 2.0


def test_an_inertia_that_the_simulated_drive_contradicts_is_said(designs) -> None:
    """Held references bias least squares by 7 %, and the log alone does not tell."""
    soft, smooth, held = soft_and_held(designs, 5.0)
    notices: list[Notice] = []
    for motion, said in (
        (held, ["few_degrees_of_freedom", "inertia_by_instruments"]),
        (smooth, ["few_degrees_of_freedom"]),
    ):
        found = identify(soft, simulate(soft, motion, seed=3), check_method=True)
        assert [one.code for one in found.notices] == said
        notices += [one for one in found.notices if one.code == "inertia_by_instruments"]
    (notice,) = notices
    assert "--method iv" in notice.text
    assert notice.detail["other"] == pytest.approx(soft.J, rel=0.004)
    assert notice.detail["value"] < 0.95 * soft.J
    without = soft.model_copy(update={"loops": None})  # which cannot be simulated
    alone = identify(without, simulate(soft, held, seed=3), check_method=True).notices
    assert [one.code for one in alone] == ["few_degrees_of_freedom"]
