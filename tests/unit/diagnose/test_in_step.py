"""A torque that was sampled in step with a held position reference: it falls with the speed, and no friction does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.in_step import sampled_in_step
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from tests.effort import seeds

J, F_C, F_V = 2e-3, 0.12, 4e-4
DESIGN: dict[str, Any] = {
    "name": "axis",
    "motor": {"J": J, "K_t": 0.8},
    "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}],
}


def cascade(seed: int, hold: float, period: float = 4e-3, extra: Any = None) -> Log:
    """Simulate a position loop (P and PI) whose reference is held, by Euler steps of 50 us, sampled every `period`.

    Dry friction is exact: what would turn the axis within a step holds it.
    """
    rng = np.random.default_rng(seed)
    h, duration, K_v, K_p, T_n = 5e-5, 24.0, 60.0, J * 300.0, 0.02
    t = np.arange(0.0, duration, h)
    omega_0 = 2.0 * np.pi * np.array([0.21, 0.37])
    size, phase = np.array([70.0, 40.0]) * rng.uniform(0.8, 1.2, 2), rng.uniform(0.0, 2.0 * np.pi, 2)
    wave = (size / omega_0) @ np.sin(np.outer(omega_0, t) + phase[:, None])
    wanted = wave[0] + (wave - wave[0]) * np.minimum(t, 1.0) ** 2
    count = max(1, round(hold / h))
    held = wanted[(np.arange(t.size) // count) * count]
    theta, omega, integral = held[0], 0.0, 0.0
    angle, torque = np.empty(t.size), np.empty(t.size)
    for k in range(t.size):
        error = K_v * (held[k] - theta) - omega
        integral += h * error / T_n
        drive = K_p * (error + integral)
        angle[k], torque[k] = theta, drive
        friction = F_C + (0.0 if extra is None else extra(abs(omega)))
        free = omega + h / J * (drive - F_V * omega)
        omega = np.sign(free) * max(abs(free) - h / J * friction, 0.0)
        theta += h * omega
    step = round(period / h)
    at = slice(count - 1, None, step)  # just before the next step of the reference
    noise = 2e-3 * rng.standard_normal(torque[at].size)
    grain = 2.0 * np.pi / 2**22
    return Log({"t": t[at] - t[count - 1], "theta": grain * np.round(angle[at] / grain), "torque": torque[at] + noise})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_it_is_taken_for_sampling_and_friction_stays_right(seed: int) -> None:
    """With F_v held at zero the model missed most of the torque: F_c came out too small, and structure was left."""
    log = cascade(seed, hold=1e-3)
    found = diagnose(Design.from_dict(DESIGN), log, plan=False)
    assert [notice.code for notice in found.notices if notice.code == "sampled_in_step"]
    assert found.verdict == "inconclusive"
    assert found.steps == ()
    assert found.design.parameters("coulomb")["F_c"] == pytest.approx(F_C, rel=0.02)
    compared = compare(found.design, log).log.errors["torque"].relative
    assert compared == pytest.approx(found.errors["final"]["torque"]["relative"], rel=1e-3)


def test_a_log_that_is_conditioned_again_stays_one() -> None:
    """It is conditioned with the first effect that is found, and in other bands."""
    design, log = Design.from_dict(DESIGN), cascade(1, hold=1e-3)
    case = condition(design, log, (), {}, POLICY)
    held = sampled_in_step(case, case.fit(()))
    assert held is not None
    assert held.conditioned_with is not None
    assert held.in_band is not None
    for again in (held.conditioned_with(design, held), held.in_band(band=20.0, first=held)):
        assert again.record.in_step
        assert [note.code for note in again.record.notes].count("sampled_in_step") == 1
    assert not case.conditioned_with(design, case).record.in_step  # type: ignore[misc]


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_identify_reads_the_log_in_the_same_way(seed: int) -> None:
    """It took F_c for 0, and the viscous friction, which no such log tells, for known."""
    log = cascade(seed, hold=1e-3)
    found = identify(Design.from_dict(DESIGN), log)
    assert found.relative_error < 0.05  # and not 97 %
    assert compare(found.design, log).log.errors["torque"].relative == pytest.approx(found.relative_error, rel=1e-6)
    assert found.estimates["F_c"].value == pytest.approx(F_C, rel=0.02)
    assert "F_v" in found.unidentifiable
    assert "sampled_in_step" in [notice.code for notice in found.notices]


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_a_reference_that_is_not_held_shows_nothing_of_it(seed: int) -> None:
    found = diagnose(Design.from_dict(DESIGN), cascade(seed, hold=5e-5), plan=False)
    assert "sampled_in_step" not in [notice.code for notice in found.notices]
    assert found.steps == ()
