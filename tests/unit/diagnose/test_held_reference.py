"""An inertia that a torque in step with a held reference shows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from pmsm_ctrl.diagnose import held_reference
from pmsm_ctrl.diagnose.held_reference import inertia_doubted, shows_in_inertia
from pmsm_ctrl.diagnose.measures import Machine
from pmsm_ctrl.diagnose.policy import POLICY
from tests.unit.plausibility.drives import J, believed


def fit(rate: float = 1000.0, stated: bool = False) -> Any:
    prepared = SimpleNamespace(rate=rate)
    record = SimpleNamespace(
        sampling_stated=stated, prepared=prepared, period=1.0 / rate, drive="torque", design=believed()
    )
    nothing = SimpleNamespace(held={})
    return SimpleNamespace(record=record, estimate=nothing, model=SimpleNamespace(names=()), plain=None)


@pytest.mark.parametrize(("off", "doubted"), [(0.22, True), (-0.22, True), (0.25, False), (-0.60, False)])
def test_an_inertia_is_doubted_as_far_as_sampling_explains_it(off: float, doubted: bool) -> None:
    """Beyond a tolerance of 10 %: pi times 40 Hz times 1 ms are 12.6 %."""
    assert ("in step with a held reference" in inertia_doubted(fit(), off, 0.1, POLICY)) == doubted
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
