"""The first two models of a diagnosis: the design as given, and the base model with the parameters that it needed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, compare, diagnose
from tests.effort import slow

SHEET = {"motor": {"J": 1.1e-4, "K_t": 1.0}}
J, F_C, F_V = 1e-4, 0.02, 2e-4


@pytest.fixture(scope="module")
def log() -> Log:
    """Torque of a known axis in closed form, with white noise."""
    t = np.arange(0, 12, 1e-3)
    omega = 80 * np.sin(2 * np.pi * 0.5 * t) + 40 * np.sin(2 * np.pi * 1.3 * t + 1)
    alpha = 80 * np.pi * np.cos(2 * np.pi * 0.5 * t) + 40 * 2.6 * np.pi * np.cos(2 * np.pi * 1.3 * t + 1)
    noise = np.random.default_rng(5).normal(0, 1e-3, t.size)
    return Log({"t": t, "omega": omega, "torque": J * alpha + F_C * np.sign(omega) + F_V * omega + noise})


@pytest.mark.parametrize("F_c", [None, slow(0.001), slow(0.02)])
def test_the_design_as_given_and_the_base_model(log: Log, F_c: float | None) -> None:
    """A datasheet states no friction; it was fitted silently, and the first error was that of another design."""
    design = Design.from_dict(SHEET)
    if F_c is not None:
        design = design.with_effect("coulomb", {"F_c": F_c}).with_effect("viscous", {"F_v": 1e-5})
    found = diagnose(design, log, plan=False)
    given = compare(design, log).log.errors["torque"].relative
    assert found.errors["nominal"]["torque"]["relative"] == pytest.approx(given, rel=1e-9)
    assert found.errors["base"]["torque"]["relative"] < 0.5 * given
    stated = {"J": 1.1e-4, "F_c": F_c, "F_v": None if F_c is None else 1e-5}
    told = json.loads(json.dumps(found.to_dict()))["base"]["parameters"]
    for symbol, true in (("J", J), ("F_c", F_C), ("F_v", F_V)):
        estimate = found.base[symbol]
        assert abs(estimate.value - true) < 4.0 * estimate.stderr
        assert estimate.stderr < 0.05 * true
        assert estimate.nominal == stated[symbol]
        assert told[symbol]["value"] == estimate.value
        assert told[symbol]["unit"] == estimate.unit
    assert not found.steps
    text = " ".join(found.summary(width=1000).split())
    assert "design as given" in text
    assert "F_c = 0.0" in text
    assert text.count("not in the design") == (2 if F_c is None else 0)
    assert ("F_c and F_v, which it does not state" in text) is (F_c is None)
    assert {entry.id for entry in found.design.effects} == {"coulomb", "viscous"}
