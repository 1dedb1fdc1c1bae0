"""Friction that steps between two samples of the torque: motions that are prescribed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.reversals import as_sampled
from pmsm_ctrl.regression.timed_record import timed_record
from pmsm_ctrl.simulate import simulate
from tests.benchmarks.prescribed import bristle, drawn
from tests.effort import amount, seeds, slow

DESIGNS = Path(__file__).resolve().parents[3] / "designs"
J, F_C, F_V, TOP, FREQUENCY, RATE = 2.4e-4, 0.017, 9e-5, 13.0, 1.237, 1000.0
DESIGN = Design.from_dict({
    "motor": {"J": 1.05 * J, "K_t": 1.0},
    "effects": [{"id": "coulomb", "F_c": 1.3 * F_C}, {"id": "viscous", "F_v": 0.7 * F_V}],
})  # fmt: skip


def prescribed(seed: int, late: float, noise: float = 2e-4, rate: float = RATE, seconds: float = 20.0) -> Log:
    """A sine of the speed, the torque sampled at instants; the angle is this many periods older than the torque."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    w = 2.0 * np.pi * FREQUENCY
    omega = TOP * np.sin(w * t)
    torque = J * TOP * w * np.cos(w * t) + F_C * np.sign(omega) + F_V * omega
    theta = -TOP / w * np.cos(w * (t - late / rate))
    return Log({"t": t, "theta": theta, "torque": torque + noise * np.random.default_rng(seed).normal(size=t.size)})


# in time; a sum of speeds that begins before or after the sample; and fast logs, which are thinned
@pytest.mark.parametrize(
    ("late", "rate"),
    [slow(0.0, RATE), (0.5, RATE), slow(-0.5, RATE), slow(0.0, 2.0 * RATE), (0.5, 4.0 * RATE), slow(0.0, 8.0 * RATE)],
)
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_what_is_left_is_the_noise_and_nothing_is_named(late: float, rate: float, seed: int) -> None:
    noise = 2e-4
    log = prescribed(seed, late, noise, rate)
    found = diagnose(DESIGN, log, plan=False)
    assert [step.effect for step in found.steps] == []
    record = found.selection.fit.record
    assert record.timing.stepped == pytest.approx(-late, abs=0.1)
    expected = noise * np.sqrt(2.0 * record.cutoff / rate)
    assert found.errors["final"]["torque"]["rms"] < 1.15 * expected  # followed reversals leave 3 to 10 times that
    seen = compare(found.design, log).log.errors["torque"].rms
    assert seen == pytest.approx(found.errors["final"]["torque"]["rms"], rel=1e-3)


# an inertia and a viscous friction make up for any delay on one sine
@pytest.mark.parametrize(
    ("delay", "rate", "verdict"),
    [
        (4.3e-3, 2.0 * RATE, "effects_missing"), slow(6.6e-3, RATE, "inconclusive"),
        slow(9.0e-3, 4.0 * RATE, "effects_missing"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_torque_that_is_later_than_sampling_makes_it_is_a_delay(
    delay: float, rate: float, verdict: str, seed: int, request: pytest.FixtureRequest
) -> None:
    if verdict == "inconclusive" and seed == 1:  # of one sine a filter may have made it
        named = "a delay of 7.2 +- 0.1 ms is named for 6.6, where a filter is as likely"
        request.applymarker(pytest.mark.xfail(strict=True, reason=named))
    on_time = prescribed(seed, 0.0, 0.0, rate, amount(8.0, 20.0))
    t, w = on_time.t, 2.0 * np.pi * FREQUENCY
    omega = TOP * np.sin(w * (t - delay))
    torque = J * TOP * w * np.cos(w * (t - delay)) + F_C * np.sign(omega) + F_V * omega
    noise = 2e-4 * np.random.default_rng(seed).normal(size=t.size)
    log = on_time.with_channels(torque=torque + noise)
    values = identify(DESIGN, log).estimates
    for symbol, true in (("J", J), ("F_c", F_C), ("F_v", F_V)):
        assert abs(values[symbol].value - true) < 4.0 * values[symbol].stderr  # F_v takes up the delay otherwise
        assert values[symbol].stderr < 0.03 * true
    found = diagnose(DESIGN, log, plan=False)
    assert str(found.verdict) == verdict
    assert [step.effect for step in found.steps] == ["delay"] * (verdict == "effects_missing")  # and no bristle
    (said,) = (notice.text for notice in found.notices if notice.code == "not_synchronous")
    assert float(said.split("about ")[1].split(" ms")[0]) == pytest.approx(1e3 * delay, rel=0.01)


def test_an_axis_that_a_current_turns_is_followed_through_its_reversals() -> None:
    design = Design.read(DESIGNS / "hand_tuned.toml")
    assert timed_record(design, simulate(design, "identification", seed=1)).timing.stepped is None


@pytest.mark.parametrize("seed", seeds(540, 605, 618))  # a step that is late explains nearly as much
def test_friction_that_bends_is_no_step_that_is_late(seed: int) -> None:
    case = drawn(seed, hidden=True)
    record = timed_record(case.design, case.log)
    assert case.effect == "presliding"
    assert abs(record.timing.late) <= record.sampling
    assert record.timing.stepped is None


def bent_staircase(seed: int) -> tuple[Design, Log]:
    """A staircase of the speed that reverses twice: the edges of the acceleration are in time."""
    fine = 4
    t = np.arange(0.0, 26.0, 1.0 / (fine * RATE))
    levels = (-72.0, -48.0, -24.0, 24.0, 48.0, 72.0, 48.0, 24.0, -24.0, -48.0, -24.0, -48.0, -24.0)
    omega = uniform_filter1d(np.repeat(levels, int(2.0 * fine * RATE)), int(0.11 * fine * RATE), mode="nearest")
    omega = uniform_filter1d(omega, int(0.004 * fine * RATE), mode="nearest")
    theta, inertia = np.cumsum(omega) / (fine * RATE), 3.8e-3
    torque = inertia * np.gradient(omega, t) + 0.93 * bristle(theta, 5.5e-3, dahl=True) + 0.002 * omega
    measured = torque[::fine] + 5e-3 * np.random.default_rng(seed).normal(size=t[::fine].size)
    log = Log({"t": t[::fine], "theta": theta[::fine], "torque": measured})
    dry = [{"id": "coulomb", "F_c": 0.85}, {"id": "viscous", "F_v": 0.0021}]
    return Design.from_dict({"motor": {"J": 4.0e-3, "K_t": 1.0}, "effects": dry}), log


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_friction_that_is_late_while_the_inertia_is_not_is_no_delay(seed: int) -> None:
    record = timed_record(*bent_staircase(seed))
    assert abs(record.timing.late) <= record.sampling  # 4 ms before
    assert record.timing.stepped is None


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_is_a_bristle(seed: int) -> None:
    found = diagnose(*bent_staircase(seed), plan=False)
    assert [step.effect for step in found.steps] == ["presliding"]
    assert not [notice for notice in found.notices if notice.code == "not_synchronous"]


@pytest.mark.parametrize(("finer", "moved", "place"), [(1, 0.0, 3.5), (2, 0.0, 3.25), (4, 0.0, 3.375), (1, 0.4, 3.1)])
def test_a_step_lies_between_two_samples_of_the_log(finer: int, moved: float, place: float) -> None:
    """The speed is zero 3.3 samples after the first: the log saw it between two of its own samples."""
    omega = 3.3 - np.arange(8.0)
    seen = as_sampled(np.sign(omega), omega, 0.0, finer, moved)
    assert float(np.sum(seen)) == pytest.approx(2.0 * place - 7.0)  # what lies before less what lies after
    assert np.all(np.abs(seen) <= 1.0)


def test_a_shaft_that_rests_keeps_what_its_friction_balances() -> None:
    omega = np.array([3.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, -2.0, 3.0, 4.0])
    followed = np.array([1.0, 1.0, 1.0, 0.5, 0.2, 0.0, -0.3, -0.8, -1.0, -0.4, 1.0, 1.0])
    assert as_sampled(followed, omega, None) is followed
    seen = as_sampled(followed, omega, 0.0)
    np.testing.assert_array_equal(seen[3:8], followed[3:8])
    np.testing.assert_array_equal(seen[[0, 1, 2, 8, 9, 10, 11]], [1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
