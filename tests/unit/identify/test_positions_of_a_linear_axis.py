"""A linear axis has no turn, but a place: what hangs on the place is identified, what repeats with a turn is told."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import CATALOGUE, Effect, Parameter, kernel
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log

K = 18.0  # N/m


@kernel
def chain(theta: float, k_chain: float) -> float:
    """k_chain theta: the force of a cable chain along the stroke."""
    return k_chain * theta


@kernel
def stop(theta: float, k_stop: float) -> float:
    """k_stop max(0, theta - 0.5): a buffer at the end of the stroke."""
    return k_stop * max(0.0, theta - 0.5)


@kernel
def ripple(theta: float, direction: float, k_six: float) -> float:
    """k_six sin(6 theta)^3 sgn(omega): a wave of the turn with harmonics, which names no order."""
    return k_six * math.sin(6.0 * theta) ** 3 * direction


def own(term: object, symbol: str, unit: str) -> Effect:
    return Effect(
        id=f"own_{symbol}", title="Own", equation="k", source="own measurement", enters="torque", term=term,
        parameters=(Parameter(symbol, unit, 0.0, -math.inf, math.inf, "size", linear=True),),
        needs="motion over the stroke", validated="not at all",
    )  # fmt: skip


CHAIN = own(chain, "k_chain", "N/m")


@pytest.fixture(scope="module")
def design() -> Design:
    return Design.from_dict({
        "name": "slide", "motion": "linear",
        "motor": {"p": 100.0, "psi_f": 0.3, "R": 2.3, "L_d": 1.5e-3, "L_q": 1.5e-3, "J": 6.5},
        "effects": [{"id": "coulomb", "F_c": 6.0}, {"id": "viscous", "F_v": 8.0}],
    })  # fmt: skip


@pytest.fixture(scope="module")
def log(design: Design) -> Log:
    t = 1e-3 * np.arange(12_000)
    waves = [(0.3, 1.1, 0.0), (0.1, 2.9, 1.0), (0.01, 13.0, 2.0)]  # m, rad/s, rad
    theta = sum(a * np.sin(w * t + phi) for a, w, phi in waves)
    omega = sum(a * w * np.cos(w * t + phi) for a, w, phi in waves)
    alpha = -sum(a * w * w * np.sin(w * t + phi) for a, w, phi in waves)
    force = 6.5 * alpha + 6.0 * np.tanh(omega / 1e-3) + 8.0 * omega + K * theta
    noise = np.random.default_rng(1).normal(0.0, 0.2, len(t))
    return Log({"t": t, "theta": theta, "omega": omega, "i_q": (force + noise) / design.K_t}, motion="linear")


def test_a_force_along_the_stroke_is_identified(design: Design, log: Log) -> None:
    found = identify(design.with_own_effects(CHAIN).with_effect(CHAIN.id), log, check_method=False, check_cutoff=False)
    assert found.estimates["k_chain"].value == pytest.approx(K, rel=0.02)
    assert not any(notice.code == "effect_left_out" for notice in found.notices)


def test_what_repeats_with_a_turn_is_told(design: Design, log: Log) -> None:
    turning = design.with_effect("unbalance", {"a_s": 1.0})
    found = identify(turning, log, check_method=False, check_cutoff=False)
    (notice,) = (notice for notice in found.notices if notice.code == "effect_left_out")
    assert "unbalance of the design is left out of the torque: a linear axis has no turn" in notice.text


def test_which_terms_repeat_with_the_turn() -> None:
    named = {effect.id for effect in CATALOGUE.values() if effect.repeats_with_turn}
    assert named == {"cogging", "encoder_eccentricity", "position_dependent_friction", "unbalance"}
    assert own(ripple, "k_six", "N").repeats_with_turn
    assert not any(own(term, name, "N/m").repeats_with_turn for term, name in ((chain, "k_chain"), (stop, "k_stop")))
