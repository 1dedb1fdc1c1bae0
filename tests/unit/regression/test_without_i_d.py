"""Voltages beside i_q alone, as most drives log them: the winding is judged with the current that they keep at zero."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import examine
from pmsm_ctrl.regression.timed_record import timed_record
from tests.effort import seeds
from tests.unit.plausibility.drives import L, P, R, believed, drawn

DEAD, FROM = 0.4, 0.05  # V, and the current from which on it acts whole, A


def kept_at_zero(seed: int, **more: np.ndarray) -> Log:
    """The drawn log of a drive whose i_d is zero, and not logged."""
    log = drawn(seed)
    i_d = 0.05 * np.sin(2.0 * math.pi * 0.9 * log.t)  # what flows in `drawn`
    omega = log["omega_ref"] - 0.3
    voltages = {"u_d": log["u_d"] - R * i_d, "u_q": log["u_q"] - P * omega * L * i_d}
    return Log({name: log[name] for name in ("t", "theta", "i_q")} | voltages | more)


def test_it_is_said_what_stands_for_i_d() -> None:
    log = kept_at_zero(3)
    for given, words in ((log, ["i_d = 0"]), (log.with_channels(i_d_ref=0.0 * log.t), ["its reference"])):
        record = timed_record(believed(), given)
        assert record.channels == ("torque", "u_d", "u_q")
        assert [note.detail["assumed"] for note in record.notes if note.code == "i_d_assumed"] == words
    assert "i_d_assumed" not in [note.code for note in timed_record(believed(), drawn(3)).notes]


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(3, 4, 5))
def test_a_dead_time_is_named_without_i_d(seed: int) -> None:
    log = kept_at_zero(seed)
    assert diagnose(believed(), log, plan=False).verdict == "consistent"
    u_d, u_q = log["u_d"].copy(), log["u_q"].copy()
    for phase in (P * log["theta"] - 2.0 * math.pi * k / 3.0 for k in range(3)):
        lost = DEAD * np.clip(-np.sin(phase) * log["i_q"] / FROM, -1.0, 1.0)
        u_d, u_q = u_d + 2.0 / 3.0 * np.cos(phase) * lost, u_q - 2.0 / 3.0 * np.sin(phase) * lost
    found = diagnose(believed(), kept_at_zero(seed, u_d=u_d, u_q=u_q), plan=False)
    assert [step.effect for step in found.steps] == ["dead_time"]
    assert found.steps[0].parameters["dU"].value == pytest.approx(DEAD, rel=0.1)


@pytest.mark.parametrize("seed", seeds(3, 4, 5))
def test_voltages_of_another_scaling_are_told_without_i_d(seed: int) -> None:
    log = kept_at_zero(seed)
    assert examine(believed(), log).notices == ()
    scaled = log.with_channels(u_d=math.sqrt(3.0) * log["u_d"], u_q=math.sqrt(3.0) * log["u_q"])
    assert [notice.code for notice in examine(believed(), scaled).contradictions] == ["voltage_factor"]
