"""Behind a coarse encoder the slow part of the acceleration tells the inertia where the design's is a wrong one."""

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, diagnose, identify
from pmsm_ctrl.regression.timed_record import timed_record
from pmsm_ctrl.regression.worse_than_given import torque_error

J, F_c, F_v = 1.8e-4, 0.0136, 2.1e-4
COUNTS = 4096
WAVES = ((9.0, 0.35, 0.2), (6.0, 0.8, 1.0), (1.5, 4.1, 2.2), (0.6, 13.0, 0.4))  # rad/s, Hz, rad


def servo(stated: float) -> tuple[Design, Log]:
    """A small servo with an encoder of 12 bits, read about every 5 ms, and a design that states this inertia."""
    rng = np.random.default_rng(7)
    even = 5e-3 * np.arange(2400)
    t = even + 1.7e-3 * rng.random(2400)
    theta = sum(a / (2.0 * np.pi * f) * np.sin(2.0 * np.pi * f * t + at) for a, f, at in WAVES)
    omega = sum(a * np.cos(2.0 * np.pi * f * t + at) for a, f, at in WAVES)
    alpha = -sum(2.0 * np.pi * f * a * np.sin(2.0 * np.pi * f * t + at) for a, f, at in WAVES)
    torque = J * alpha + F_c * np.sign(omega) + F_v * omega + rng.normal(0.0, 3e-4, len(t))
    coarse = np.floor(theta * COUNTS / (2.0 * np.pi)) * 2.0 * np.pi / COUNTS
    design = Design.model_validate(
        {"name": "servo", "motor": {"J": stated, "K_t": 1.0}, "sensor": {"encoder_counts": COUNTS}}
    )
    design = design.with_effect("coulomb", {"F_c": F_c}).with_effect("viscous", {"F_v": F_v})
    return design, Log({"t": even, "theta": coarse, "torque": torque})


@pytest.mark.slow
def test_half_the_inertia_in_the_design_is_found_and_no_effect_is_named_for_it() -> None:
    found = diagnose(*servo(0.5 * J), plan=False)
    assert found.steps == ()
    assert found.base["J"].value == pytest.approx(J, rel=0.05)
    assert [d.parameter for d in found.parameter_deviations if d.outside] == ["J"]
    assert identify(*servo(0.5 * J)).estimates["J"].value == pytest.approx(J, rel=0.05)


def test_an_inertia_within_its_tolerance_is_not_replaced() -> None:
    found = diagnose(*servo(1.08 * J), plan=False)
    assert found.steps == ()
    assert found.base["J"].value == pytest.approx(1.08 * J, rel=0.02)


@pytest.mark.parametrize("stated", [0.5, 2.0])
def test_a_comparison_is_with_the_inertia_of_the_design(stated: float) -> None:
    t = np.linspace(0.0, 12.0, 12_001)
    missing = (stated - 1.0) * J * sum(2.0 * np.pi * f * a * np.sin(2.0 * np.pi * f * t + at) for a, f, at in WAVES)
    design, log = servo(stated * J)
    error, _ = torque_error(design, timed_record(design, log))  # as `compare` gives it
    assert error == pytest.approx(float(np.std(missing)), rel=0.25)  # timing takes a part of it
