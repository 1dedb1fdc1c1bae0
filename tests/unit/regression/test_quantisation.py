"""Steps of a command are no quantisation: the drive makes them; steps of a converter are."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.weights import error_by_steps, quantisation_error
from tests.effort import seeds

RATE, COUNT = 1e3, 20000
Array = np.ndarray


def held(levels: Array, stay: float, rng: np.random.Generator, fixed: bool = False) -> Array:
    """Levels drawn at random, each for a time that is drawn, or always the same, s."""
    out = np.empty(COUNT)
    k = 0
    while k < COUNT:
        n = max(1, int((stay if fixed else rng.exponential(stay)) * RATE))
        out[k : k + n] = rng.choice(levels)
        k += n
    return out


COMMANDS = {
    "two levels": lambda rng: held(np.array([-0.1, 0.1]), 0.6, rng),
    "two levels in a few milliseconds": lambda rng: held(np.array([-0.1, 0.1]), 0.005, rng, fixed=True),
    "five levels": lambda rng: held(0.0075 * np.arange(-2, 3), 0.6, rng),
    "five levels in 10 ms": lambda rng: held(0.0075 * np.arange(-2, 3), 0.01, rng, fixed=True),
    "twenty levels": lambda rng: held(0.0075 * np.arange(-10, 11), 0.1, rng, fixed=True),
    "staircase": lambda rng: 0.01 * np.repeat(np.tile([*range(-10, 11), *range(9, -10, -1)], 4)[:80], COUNT // 80),
}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", COMMANDS)
def test_steps_of_a_command_are_no_error(name: str, seed: int) -> None:
    assert quantisation_error(COMMANDS[name](np.random.default_rng(seed)), RATE) == 0.0


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("noise", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("height", [1.3, 4.0, 30.0])
def test_steps_of_a_converter_are(height: float, noise: float, seed: int) -> None:
    rng, t = np.random.default_rng(seed), np.arange(COUNT) / RATE
    true = height * (np.sin(3.0 * t) + 0.5 * np.sign(np.cos(3.0 * t))) + noise * rng.standard_normal(COUNT)
    assert quantisation_error(0.06 * np.round(true), RATE) == pytest.approx(0.03)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_torque_steps_read_by_a_converter_are(seed: int) -> None:
    from scipy.signal import lfilter

    rng = np.random.default_rng(seed)
    levels = lfilter([0.3], [1.0, -0.7], held(rng.uniform(-6.0, 6.0, 10), 0.6, rng))
    assert quantisation_error(np.round(levels + 0.1 * rng.standard_normal(COUNT)), RATE) == pytest.approx(0.5)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_signal_without_noise_passes_through_many_levels(seed: int) -> None:
    t = np.arange(COUNT) / RATE
    assert quantisation_error(np.round(30.0 * np.sin(3.0 * t + seed)), RATE) == 0.5


def test_noise_beyond_the_step_smooths_it() -> None:
    rng = np.random.default_rng(1)
    assert quantisation_error(np.round(5.0 * rng.standard_normal(COUNT)), RATE) == 0.0


@pytest.mark.parametrize(("amplitude", "least"), [(60.0, 0.4), (600.0, 0.1)])
def test_what_passes_the_steps_faster_than_a_filter_forgets_has_less_of_their_error(
    amplitude: float, least: float
) -> None:
    """Half a step was asked of every effect; of a motion through hundreds of steps the filter leaves a third of it."""
    true = amplitude * np.sin(3.0 * np.arange(COUNT) / RATE)
    left = low_pass(np.round(true) - true, RATE, 40.0)
    found = error_by_steps(np.round(true), RATE, 40.0)
    assert float(np.sqrt(np.mean(left**2))) < found
    assert least * 0.5 < found < (least + 0.2) * 0.5


@pytest.mark.parametrize("rate", [1000.0, 4000.0])
@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_fast_log_that_is_thinned_shows_its_steps(rate: float, seed: int) -> None:
    """World 10000342: thinned to 1 kHz a drive signal has none, and a drag of half a step had a name.

    It stays on a level for more than 12.5 ms for three quarters of the time.
    """
    effects = [{"id": "coulomb", "F_c": 0.1}]
    design = Design.from_dict({"name": "axis", "motor": {"J": 1e-3, "K_t": 0.5}, "effects": effects})
    t = np.arange(0.0, 10.0, 1.0 / rate)
    omega, alpha = 20.0 * np.sin(t), 20.0 * np.cos(t)
    torque = 1e-3 * alpha + 0.1 * np.sign(omega) + 1e-3 * np.random.default_rng(seed).normal(size=len(t))
    log = Log({"t": t, "theta": -20.0 * np.cos(t), "torque": 0.01 * np.round(torque / 0.01)})
    assert make_record(design, log).coarse[0] == pytest.approx(0.005 * np.sqrt(0.75), rel=0.05)
