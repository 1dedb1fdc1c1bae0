"""What may be named beside a presliding: bristles of other lengths are its rivals."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.diagnose.measures import with_rivals
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.effects.structures.bristle import SHARES_OF_REACH

PERIOD, SPEED, REACH = 1e-3, 2.0, 0.05  # s, rad/s, rad
SHAPE = {"z_s": REACH, "z_b": 0.5, "tau_z": 0.0}


def balances() -> Any:
    """A shaft that turns to and fro at one speed, for half a second each way, and a torque of rms 1."""
    omega = np.where(np.arange(2000) // 500 % 2 == 0, SPEED, -SPEED)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (omega[1:] + omega[:-1]))])
    torque = np.sign(omega)
    return SimpleNamespace(
        signals={"theta": theta, "omega": omega, "torque": torque, "direction": np.sign(omega), "alpha": 0.0 * omega},
        period=PERIOD, linear=True, design=SimpleNamespace(motor=SimpleNamespace(p=None)),
    )  # fmt: skip


def test_a_bristle_bends_over_twice_its_reach_after_a_reversal() -> None:
    """It lies the other way at first, by twice the dry friction, and this fades in proportion to the travel."""
    found = CATALOGUE["presliding"].structure.beside_shape(balances(), SHAPE)
    travel = SPEED * PERIOD * np.arange(500)
    for column, part in zip(found, SHARES_OF_REACH, strict=True):
        lag = np.maximum(2.0 - travel / (part * REACH), 0.0)
        assert column["torque"][500:1000] == pytest.approx(lag, abs=2.1 * SPEED * PERIOD / (part * REACH))


@pytest.mark.parametrize(
    ("name", "shape", "more"), [("rising_friction", {"w_r": 1.0}, 2), ("cogging", {"order": 24.0}, 0)]
)
def test_they_are_rivals_of_all_that_acts_on_the_torque_but_waves(
    name: str, shape: dict[str, float], more: int
) -> None:
    effect, record = CATALOGUE[name], balances()
    without_own = SimpleNamespace(enters="torque", order=effect.order, structure=SimpleNamespace(rivals=lambda *_: []))
    record.stack_all = lambda parts: tuple(part["torque"] for part in parts)
    model = SimpleNamespace(plus=lambda group, sigma: (group.symbols, sigma))
    trial: Any = SimpleNamespace(candidate=SimpleNamespace(effect=without_own), group=SimpleNamespace(shape=shape))
    bristle = SimpleNamespace(effect=CATALOGUE["presliding"], shape=SHAPE)
    viscous = SimpleNamespace(effect=CATALOGUE["viscous_power"], shape={"n": 0.5})

    def rivals(*accepted: Any) -> int:
        found: Any = with_rivals(SimpleNamespace(accepted=accepted, record=record, model=model), trial)  # type: ignore[arg-type]
        return 0 if found is None else len(found[0])

    assert rivals(viscous) == 0
    assert rivals(viscous, bristle) == more
