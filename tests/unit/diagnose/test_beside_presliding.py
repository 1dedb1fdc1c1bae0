"""Where a presliding is searched, and what may be named beside it: bristles of other lengths are its rivals."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.measures import with_rivals
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.effects.structures.bristle import SHARES_OF_REACH
from pmsm_ctrl.simulate import scenario, simulate
from tests.effort import slow

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


@pytest.mark.parametrize(
    ("step", "travel", "finest"),
    [(1e-12, 0.0, 1e-5), (2.0 * np.pi / 2**18, 0.0, 9.6e-5), (2.0 * np.pi / 2**12, 0.0, 2e-4), (1e-12, 0.5, 5e-8)],
)
def test_the_least_deflection_is_some_steps_of_the_encoder(step: float, travel: float, finest: float) -> None:
    seen = SimpleNamespace(angle=True, linear=travel > 0.0, step=step)
    presliding = CATALOGUE["presliding"]
    found = presliding.structure.search(presliding, SimpleNamespace(balances=seen, travel=travel))  # type: ignore[arg-type]
    deflections = [shape["z_s"] for shape in found.shapes]
    assert deflections[0] == pytest.approx(finest, rel=0.01)
    assert deflections[-1] == pytest.approx(0.2 * (travel / 100.0 or 1.0))
    assert np.all(np.diff(np.log(deflections)) < np.log(1.31))


@pytest.mark.parametrize(("speed", "z_s"), [(5.0, 1e-4), slow(2.0, 5e-5)])
def test_a_bearing_that_rolls_is_a_presliding(designs: Path, speed: float, z_s: float) -> None:
    """A deflection below the search was a friction that rises, or refused at the bound of the search."""
    fine = Design.read(designs / "seed_motor.toml").replace(sensor={"encoder_counts": 2**23})
    truth = fine.with_effect("presliding", {"z_s": z_s, "z_b": 0.5, "tau_z": 1e-3})
    motion = scenario("triangle", fine, speed=speed, period=4.0, cycles=8.0)
    found = diagnose(fine, simulate(fine, motion, truth=truth, seed=3), plan=False)
    assert [step.effect for step in found.steps] == ["presliding"]
    assert found.steps[0].parameters["z_s"].value == pytest.approx(z_s, rel=0.3)


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
