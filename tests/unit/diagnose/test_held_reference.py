"""An inertia that a torque in step with a held reference shows."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import held_reference
from pmsm_ctrl.diagnose.held_reference import inertia_doubted, shows_in_inertia
from pmsm_ctrl.diagnose.measures import Machine
from pmsm_ctrl.diagnose.policy import POLICY
from tests.unit.plausibility.drives import K_T, J, R, believed


def fit(rate: float = 1000.0, stated: bool = False, design: Design | None = None, in_step: bool = False) -> Any:
    prepared = SimpleNamespace(rate=rate)
    record = SimpleNamespace(
        sampling_stated=stated, prepared=prepared, period=1.0 / rate, drive="torque", design=design or believed(),
        in_step=in_step,
    )  # fmt: skip
    nothing = SimpleNamespace(held={})
    return SimpleNamespace(record=record, estimate=nothing, model=SimpleNamespace(names=()), plain=None)


@pytest.mark.parametrize(("off", "doubted"), [(0.22, True), (-0.22, True), (0.25, False), (-0.60, False)])
def test_an_inertia_is_doubted_as_far_as_sampling_explains_it(off: float, doubted: bool) -> None:
    """Beyond a tolerance of 10 %: pi times 40 Hz times 1 ms are 12.6 %."""
    assert ("in step with a held reference" in inertia_doubted(fit(), off, 0.1, POLICY)) == doubted
    assert inertia_doubted(fit(stated=True), off, 0.1, POLICY) == ""


@pytest.mark.parametrize("off", [-0.95, 3.0])
def test_an_inertia_of_any_size_is_doubted_where_the_torque_was_sampled_in_step(off: float) -> None:
    assert "was sampled in step" in inertia_doubted(fit(in_step=True), off, 0.1, POLICY)


@pytest.mark.parametrize(("share", "doubted"), [(0.9, True), (1.1, False), (-3.0, False)])
@pytest.mark.parametrize("stated_loop", [True, False])
def test_an_inertia_is_doubted_as_far_as_a_command_that_the_back_emf_lowers_explains_it(
    share: float, doubted: bool, stated_loop: bool
) -> None:
    """A ramp of the back-emf, K_t / 1.5 times alpha, is what the integrator lets the current fall behind by."""
    integral = 5e3 if stated_loop else 2.0 * math.pi * 500.0 * R
    loops = {"current": {"K_p": 20.0, "T_n": 20.0 / integral}, "speed": {"K_p": 0.1, "T_n": 0.01}}
    design = Design.from_dict(believed().to_dict() | {"loops": loops}) if stated_loop else believed()
    commanded = K_T**2 / (1.5 * integral) / J
    assert commanded == pytest.approx(0.0972 if stated_loop else 0.0773, abs=1e-4)
    off = 0.1 + share * commanded
    at = 4000.0  # Hz: in step with a held reference 3 % are explained
    said = inertia_doubted(fit(at, design=design), off, 0.1, POLICY)
    assert ("back-emf" in said) == doubted
    assert inertia_doubted(fit(at, stated=True, design=design), off, 0.1, POLICY) == ""


@pytest.mark.parametrize(("off", "doubted"), [(0.45, True), (0.70, True), (0.80, False), (-0.40, False)])
def test_of_a_winding_that_is_not_stated_the_worst_is_assumed(off: float, doubted: bool) -> None:
    """A command of a motor of 0.58 ms in a loop of 540 Hz: J was 54 % too large, and flagged. Here 10 + 64 % may be."""
    bare = Design.from_dict({"name": "axis", "motor": {"J": J, "K_t": K_T}})
    said = inertia_doubted(fit(4000.0, design=bare), off, 0.1, POLICY)
    assert ("back-emf" in said) == doubted
    assert inertia_doubted(fit(4000.0, stated=True, design=bare), off, 0.1, POLICY) == ""


@pytest.mark.parametrize(("value", "stated", "shown"), [
    (0.82, False, True), (1.0, False, False), (0.905, False, False), (0.5, False, False), (0.82, True, False),
])  # fmt: skip
def test_it_shows_in_the_inertia(value: float, stated: bool, shown: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"J": Machine(value * J, 1e-3 * J, J, 0.1)}
    monkeypatch.setattr(held_reference, "machine_of", lambda *_: found)
    assert shows_in_inertia(fit(stated=stated), POLICY) == shown
    monkeypatch.setattr(held_reference, "machine_of", lambda *_: {})
    assert not shows_in_inertia(fit(), POLICY)
