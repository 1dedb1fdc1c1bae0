"""A load that another sensor measured tells the torque constant."""

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, diagnose, identify

J, F_c, F_v, K_t = 0.02, 0.4, 0.01, 0.31


@pytest.fixture(scope="module")
def bench() -> tuple[Design, Log]:
    """A test bench whose load machine brakes and drives in steps; the design's torque constant is 5 % too large."""
    rng = np.random.default_rng(4)
    t = 1e-3 * np.arange(20000)
    waves = ((14.0, 0.31, 0.2), (6.0, 1.13, 1.0), (2.0, 2.9, 2.2))
    theta = sum(a / (2.0 * np.pi * f) * np.sin(2.0 * np.pi * f * t + at) for a, f, at in waves)
    omega = sum(a * np.cos(2.0 * np.pi * f * t + at) for a, f, at in waves)
    alpha = -sum(2.0 * np.pi * f * a * np.sin(2.0 * np.pi * f * t + at) for a, f, at in waves)
    steps = np.repeat(rng.choice([0.0, 1.5, 3.0, -2.0], 10), 2000)
    load = np.convolve(np.pad(steps, 50, mode="edge"), np.ones(101) / 101, "valid")
    torque = J * alpha + F_c * np.sign(omega) + F_v * omega + load
    i_q = torque / K_t + rng.normal(0.0, 0.02, len(t))
    log = Log({"t": t, "theta": theta, "i_q": i_q, "T_load": load + rng.normal(0.0, 0.005, len(t))})
    design = Design.model_validate({"name": "bench", "motor": {"J": J, "K_t": 1.05 * K_t}})
    return design.with_effect("coulomb", {"F_c": F_c}).with_effect("viscous", {"F_v": F_v}), log


def test_a_wrong_torque_constant_beside_a_known_load_is_no_effect(bench: tuple[Design, Log]) -> None:
    found = diagnose(*bench, plan=False)
    assert found.verdict == "consistent"
    assert found.steps == ()
    (constant,) = (d for d in found.parameter_deviations if d.parameter == "K_t")
    assert constant.estimate == pytest.approx(K_t, rel=0.005)
    assert abs(constant.estimate - K_t) < 4.0 * constant.stderr


def test_nor_does_it_spoil_inertia_and_friction(bench: tuple[Design, Log]) -> None:
    found = identify(*bench)
    for name, true in (("J", J), ("F_c", F_c), ("F_v", F_v)):  # in units of the design's torque constant
        low, high = found.intervals[name]
        assert found.estimates[name].value == pytest.approx(1.05 * true, rel=0.02)
        assert low - 0.01 * true < 1.05 * true < high + 0.01 * true
