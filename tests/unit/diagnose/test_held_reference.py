"""An inertia that a command, or a torque in step with a held reference, shows: against a simulated current loop."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lti

from pmsm_ctrl.diagnose import held_reference
from pmsm_ctrl.diagnose.held_reference import inertia_doubted, shows_in_inertia
from pmsm_ctrl.diagnose.measures import Machine
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.regression.drive_timing import CURRENT_LOOP, emf_as_inertia
from tests.unit.plausibility.drives import K_T, PSI, J, L, P, R, believed


def test_a_command_holds_more_than_the_current_where_nothing_compensates_the_emf() -> None:
    """A PI controller with its zero on the winding's pole, at constant acceleration: the current that it lacks."""
    alpha, t = 800.0, np.linspace(0.0, 0.05, 2001)
    answer = lti([1.0, 0.0], np.polymul([L, R], [1.0, 1.0 / CURRENT_LOOP]))
    lacking = answer.output(P * PSI * alpha * t, t)[1][-1]
    assert emf_as_inertia(believed()) == pytest.approx(K_T * lacking / (J * alpha), rel=1e-3)


def test_without_a_winding_nothing_is_known_of_it() -> None:
    assert emf_as_inertia(believed(R=None, L_d=None, L_q=None, psi_f=None, p=None, K_t=K_T)) == 0.0


def fit(rate: float = 1000.0, stated: bool = False) -> Any:
    prepared = SimpleNamespace(rate=rate)
    record = SimpleNamespace(
        sampling_stated=stated, prepared=prepared, period=1.0 / rate, drive="torque", design=believed()
    )
    nothing = SimpleNamespace(held={})
    return SimpleNamespace(record=record, estimate=nothing, model=SimpleNamespace(names=()), plain=None)


@pytest.mark.parametrize(("off", "said"), [
    (0.30, "in step with a held reference"),  # 20 % beyond, pi * 40 Hz * 1 ms are 13 %; the emf makes 24 %
    (0.22, "in step with a held reference"),
    (-0.22, "in step with a held reference"),
    (-0.30, ""),  # a command says too much, never too little
    (0.60, ""),
])  # fmt: skip
def test_an_inertia_is_doubted_as_far_as_sampling_or_a_command_explain_it(off: float, said: str) -> None:
    beyond = abs(off) - 0.1
    if off == 0.30:
        assert math.pi * 40.0 * 1e-3 < beyond < emf_as_inertia(believed())
        said = "by the back-emf"
    assert said in (found := inertia_doubted(fit(), off, 0.1, POLICY))
    assert bool(said) == bool(found)
    assert inertia_doubted(fit(stated=True), off, 0.1, POLICY) == ""


@pytest.mark.parametrize(("value", "stated", "shown"), [
    (0.82, False, True), (1.0, False, False), (0.905, False, False), (0.5, False, False), (0.82, True, False),
])  # fmt: skip
def test_it_shows_in_the_inertia(value: float, stated: bool, shown: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"J": Machine(value * J, 1e-3 * J, J, 0.1)}
    monkeypatch.setattr(held_reference, "machine_of", lambda *_: found)
    assert shows_in_inertia(fit(stated=stated), POLICY) == shown
    monkeypatch.setattr(held_reference, "machine_of", lambda *_: {})
    assert not shows_in_inertia(fit(), POLICY)
