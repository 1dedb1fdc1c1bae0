"""What was added to the current reference is found in a noisy log, whatever the controllers answer to the noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, simulate
from pmsm_ctrl.frf.excitation import excitation
from pmsm_ctrl.regression.timing import unwrapped
from pmsm_ctrl.simulate.motions import Scenario

AMPLITUDE, FREQUENCY = 0.05, 20.0  # A, Hz
SETTLED = 0.5  # s


@pytest.fixture(scope="module")
def seed(designs) -> Design:
    return Design.read(designs / "seed_motor.toml")


def sine(t):
    return AMPLITUDE * np.sin(2.0 * math.pi * FREQUENCY * t)


def motion(control: str) -> Scenario:
    """Turn at 20 rad/s, with a sine added to the current reference."""
    speed = 20.0

    def references(t):
        return {"omega_ref": np.full_like(t, speed), "theta_ref": speed * t, "i_q_add": sine(t)}

    return Scenario("added", 1.5, references, control=control, omega_0=speed)


def found_in(design: Design, log: Log, *without: str):
    channels = {name: log[name] for name in log if name not in without}
    if "theta" in channels:
        channels["theta"] = unwrapped(channels["theta"])
    return excitation(design, channels, log.period)


def left(log: Log, found):
    """Return the rms of what is found beside the sine, once settled; a constant does not count."""
    late = log["t"] > SETTLED
    return float(np.std(found[late] - sine(log["t"][late])))


def answered(log: Log) -> float:
    late = log["t"] > SETTLED
    return float(np.std(log["i_q_ref"][late] - sine(log["t"][late])))


@pytest.mark.parametrize("control", ["speed", "position"])
def test_the_added_current_is_found(seed: Design, control: str) -> None:
    log = simulate(seed, motion(control), seed=1)
    assert left(log, found_in(seed, log)) < 2e-4 < 0.01 * answered(log)


def test_filters_of_the_current_reference_are_known(seed: Design) -> None:
    """The sine passes the notch as well: by (1 - u^2) / (1 - u^2 + j u b), u = f / f_0, b = width / f_0."""
    loop = seed.loops.speed.model_dump(exclude={"filters"})
    notched = seed.replace(
        loops={"speed": {**loop, "filters": [{"kind": "notch", "frequency": 100.0, "width": 100.0}]}}
    )
    log = simulate(notched, motion("speed"), seed=1)
    u = FREQUENCY / 100.0
    passed = (1.0 - u**2) / (1.0 - u**2 + 1j * u)
    late = log["t"] > SETTLED
    turn = np.exp(2j * math.pi * FREQUENCY * log["t"][late])
    expected = AMPLITUDE * (passed * turn).imag
    assert np.std(found_in(notched, log)[late] - expected) < 0.03 * AMPLITUDE < 0.01 * answered(log)


def test_an_angle_or_a_speed_alone_is_enough(seed: Design) -> None:
    """Of the speed alone counts of the encoder fold back into the integral."""
    log = simulate(seed, motion("speed"), seed=1)
    for missing, share in (("theta", 0.15), ("omega", 0.03)):
        assert left(log, found_in(seed, log, missing)) < share * answered(log)


def test_what_does_not_tell_the_answer_is_left(seed: Design) -> None:
    log = simulate(seed, motion("speed"), seed=1)
    for missing in ("i_q_ref", "omega_ref"):
        assert found_in(seed, log, missing) is None
    assert found_in(seed.replace(loops=None), log) is None
    # in current control the speed has nothing to do with its reference
    free = Scenario("free", 1.5, lambda t: {"i_q_add": 0.0213 / seed.K_t + sine(t)}, control="current", omega_0=20.0)
    assert found_in(seed, simulate(seed, free, seed=1)) is None
