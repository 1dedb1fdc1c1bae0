"""The command of a slow current loop is ahead of what acts: no delay, unless the log says that it was measured."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from pmsm_ctrl import Design, Log
from pmsm_ctrl.compare import compare
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.bands import conditioned_in
from pmsm_ctrl.diagnose.candidates import offered_effects
from pmsm_ctrl.diagnose.diagnosis import searched
from pmsm_ctrl.diagnose.late import not_ahead
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.effects.catalogue import catalogue_of
from tests.effort import seeds

J, F_C, F_V, K_T, LAG = 1e-4, 0.02, 1e-4, 0.6, 1.0 / (2.0 * np.pi * 40.0)
DESIGN = Design.from_dict(
    {
        "motor": {"J": J, "K_t": K_T},
        "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
    }
)


@cache
def commanded(seed: int, drag: float = 0.0) -> Log:
    """Return the log of a speed loop of 8 Hz at 10 kHz whose current follows its command by a lag of 40 Hz."""
    T, steps = 1e-4, 200_000
    t = np.arange(steps) * T
    wanted = 30.0 * np.sin(2.0 * np.pi * 0.5 * t) + 15.0 * np.sin(2.0 * np.pi * 1.7 * t)
    gain = J * 2.0 * np.pi * 8.0 / K_T
    omega = theta = integral = current = 0.0
    rows = []
    for k in range(steps):
        error = wanted[k] - omega
        asked = gain * error + integral
        integral += 20.0 * gain * error * T
        current += (asked - current) * T / LAG
        free = omega + T / J * (K_T * current - F_V * omega - drag * omega * abs(omega))
        omega = float(np.sign(free) * max(abs(free) - T / J * F_C, 0.0))
        theta += T * omega
        if k % 10 == 0:
            rows.append((t[k], theta, asked))
    made, noise = np.array(rows).T, np.random.default_rng(seed)
    made[1] += 1e-6 * noise.standard_normal(made.shape[1])
    made[2] += 1e-3 * noise.standard_normal(made.shape[1])
    return Log(dict(zip(("t", "theta", "i_q"), made, strict=True)))


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_said_and_corrected_and_has_no_name(seed: int) -> None:
    """It was a delay of -3.8 ms with p < 1e-12."""
    found = diagnose(DESIGN, commanded(seed), plan=False)
    assert not found.steps
    assert found.verdict.value == "inconclusive"
    (said,) = [notice for notice in found.notices if notice.code == "drive_signal_ahead"]
    assert 1e-3 * said.detail["ahead"] == pytest.approx(LAG, rel=0.1)
    assert found.errors["final"]["torque"]["relative"] < 0.05


def test_what_the_log_states_to_be_measured_is_late_or_early() -> None:
    stated = DESIGN.replace(log={"sampling": "instant"})
    found = diagnose(stated, commanded(1), plan=False)
    assert [step.effect for step in found.steps] == ["delay"]
    assert found.steps[0].parameters["tau"].value == pytest.approx(-LAG, rel=0.1)


def test_an_effect_beside_it_is_named_and_compare_reads_the_log_alike() -> None:
    log = commanded(1, 2e-5)
    found = diagnose(DESIGN, log, plan=False)
    assert [step.effect for step in found.steps] == ["quadratic_drag"]
    assert found.steps[0].parameters["k_2"].value == pytest.approx(2e-5, rel=0.05)
    error = compare(found.design, log).log.errors["torque"].relative
    assert error == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-2)


def test_what_may_be_named_is_the_same_in_every_band_and_however_the_log_is_conditioned() -> None:
    """A name in half of the band is as much what the current loop leaves as one in the whole."""
    begun = condition(DESIGN, (commanded(1),), (), offered_effects(catalogue_of(DESIGN), None), POLICY)
    later = not_ahead(searched(begun, False, lambda share: None))
    assert later is not None
    assert later.nameable == frozenset()
    half = conditioned_in(0.5 * later.record.cutoff, later)
    assert half is not None
    assert later.conditioned_with is not None
    again = later.conditioned_with(DESIGN.add_effect("quadratic_drag", {"k_2": 2e-5}), later)
    for one in (half, again):
        assert one.nameable == frozenset()
        assert one.record.timing.late == later.record.timing.late < -1e-3
