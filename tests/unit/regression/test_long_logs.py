"""Logs of an hour: thinned so that they fit into the memory, with the same answer."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.events import _Merged
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression import columns, joining
from pmsm_ctrl.simulate import simulate

DESIGNS = Path(__file__).resolve().parents[3] / "designs"


@pytest.mark.parametrize(
    ("samples", "rate", "kept"),
    [(999_000, 1000.0, 1), (1_200_000, 1000.0, 2), (3_600_000, 1000.0, 4), (9_000_000, 1000.0, 4),
     (2_400_000, 4000.0, 4), (3_600_000, 500.0, 2)],
)  # fmt: skip
def test_a_long_log_is_thinned_to_a_million_samples(
    monkeypatch: pytest.MonkeyPatch, samples: int, rate: float, kept: int
) -> None:
    """As if a thousand samples were a million; never below 250 Hz."""
    monkeypatch.setattr(joining, "MOST", joining.MOST // 1000)
    t = np.arange(samples // 1000) / rate
    log = Log({"t": t, "theta": np.sin(2.0 * np.pi * 3.0 * t), "i_q": np.cos(2.0 * np.pi * 3.0 * t)})
    thin = joining.thinned(log)
    assert len(thin) == -(-len(log) // kept)
    inner = slice(len(thin) // 4, -(len(thin) // 4))
    assert thin["theta"][inner] == pytest.approx(np.sin(2.0 * np.pi * 3.0 * thin.t)[inner], abs=2e-3)


def test_merged_samples_leave_least_squares_as_it_is() -> None:
    """Where a signal is constant over what is merged, weighted sums of squares and products stay."""
    rng = np.random.default_rng(4)
    weight, steps = rng.uniform(0.0, 1.0, 600), np.repeat(rng.standard_normal((2, 200)), 3, axis=1)
    merged = _Merged(weight, 3)
    both = merged(steps)
    assert (both * merged.weight**2) @ both.T == pytest.approx((steps * weight**2) @ steps.T)


@pytest.mark.slow
def test_thinned_and_in_single_precision_the_answer_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """A log of 60 s, taken for a long one: half its rate, candidates in single precision."""
    design = Design.read(DESIGNS / "hand_tuned.toml")
    truth = design.with_effect("stribeck", {"dF_s": 0.008, "w_s": 5.0, "delta": 2.0})
    log = simulate(design, "identification", truth=truth, seed=5)
    usual = diagnose(design, log, plan=False)
    monkeypatch.setattr(joining, "MOST", len(log) - 1)
    monkeypatch.setattr(columns, "SINGLE", 100)
    monkeypatch.setattr("pmsm_ctrl.diagnose.fit.SINGLE", 100)
    monkeypatch.setattr("pmsm_ctrl.diagnose.events.MOST_ROWS", 1000)
    long = diagnose(design, log, plan=False)
    assert [step.name for step in long.steps] == [step.name for step in usual.steps] == ["stribeck"]
    assert long.verdict is usual.verdict
    assert "long_log" in [notice.code for notice in long.notices]
    for symbol, one in usual.steps[0].parameters.items():
        other = long.steps[0].parameters[symbol]
        assert abs(other.value - one.value) < 1.5 * one.stderr, symbol
        assert other.stderr < 1.5 * one.stderr, symbol
