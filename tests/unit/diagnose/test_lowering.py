"""An effect that does not lower the error of the written design has no name, whatever its fit gains."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from pmsm_ctrl.diagnose import diagnose, written
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.selection import Selection
from tests.benchmarks.worlds.hidden import simulate_world
from tests.benchmarks.worlds.world import draw


def found(monkeypatch: pytest.MonkeyPatch, *left: float, astray: bool = False, given: float = 0.1) -> Selection:
    """Return what is left of a selection whose designs have these errors."""
    names = "abc"[: len(left) - 1]
    fits: Any = tuple(SimpleNamespace(accepted=tuple(names[:k])) for k in range(len(left)))
    steps: Any = tuple(SimpleNamespace(trial=name) for name in names)
    case: Any = SimpleNamespace(
        believed=object(), policy=POLICY, design=None, as_given=None, record=None,
        fit=lambda accepted: SimpleNamespace(accepted=accepted),
    )  # fmt: skip
    monkeypatch.setattr(written, "fitted_design", lambda _, fit: fit)
    monkeypatch.setattr(written, "predict", lambda *_: SimpleNamespace(torque_error=(given, 1.0)))
    monkeypatch.setattr(written, "_as_compared", lambda *_: [(error, 1.0) for error in left])
    monkeypatch.setattr(written, "name_of", lambda trial: trial)
    monkeypatch.setattr(written, "astray", lambda *_: astray)
    return written.lowering(case, Selection(fits, steps))


@pytest.mark.parametrize(
    ("left", "kept"),
    [
        ((0.10, 0.08), "a"),
        ((0.10, 0.10), "a"),  # a dead time has no part in the torque
        ((0.10, 0.11), ""),
        ((0.10, 0.08, 0.09), "a"),
        ((0.10, 0.11, 0.12), ""),
        ((0.10, 0.11, 0.05), "ab"),  # two that stand for each other
    ],
)
def test_last_effects_that_raise_the_error_go(
    monkeypatch: pytest.MonkeyPatch, left: tuple[float, ...], kept: str
) -> None:
    selection = found(monkeypatch, *left)
    assert "".join(selection.fit.accepted) == "".join(step.trial for step in selection.steps) == kept  # type: ignore[misc]
    gone = "abc"[len(kept) : len(left) - 1]
    assert {name: why.reason for name, why in selection.refused.items()} == dict.fromkeys(gone, Reason.BALANCE_WORSE)


@pytest.mark.parametrize(
    ("alike", "ladder"),
    [
        # an effect with the sampling found without it, without it with the sampling found beside it
        ((0.045, 0.064), [0.064, 0.062]),  # without the effect noise was taken for a filter
        ((0.049, 0.064), [0.048, 0.062]),  # it raises the error by the sampling found without it
        ((0.045, 0.061), [0.048, 0.062]),  # it raises the error by its own sampling
    ],
)
def test_a_sampling_that_smooths_noise_is_no_gain_of_a_design(
    monkeypatch: pytest.MonkeyPatch, alike: tuple[float, float], ladder: list[float]
) -> None:
    own = {"without": 0.048, "with": 0.062}

    def predicted(design: str, record: str, like: str | None = None) -> SimpleNamespace:
        left = own[design] if like is None else dict(zip(("with", "without"), alike, strict=True))[design]
        return SimpleNamespace(torque_error=(left, 1.0))

    case: Any = SimpleNamespace(record=None, believed=SimpleNamespace(log=None))
    monkeypatch.setattr(written, "as_compared", lambda design, *_: design)
    monkeypatch.setattr(written, "predict", predicted)
    designs: Any = ["without", "with"]
    assert [rms for rms, _ in written._as_compared(case, designs)] == ladder


def test_nothing_that_is_accepted_beside_a_fit_that_is_astray_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    left = found(monkeypatch, 0.68, 0.125, 0.12, astray=True, given=0.136)
    assert left.steps == ()
    assert {name: why.reason for name, why in left.refused.items()} == dict.fromkeys("ab", Reason.REFIT_WORSE)


def test_what_half_of_the_given_design_s_error_needs_stays_beside_a_fit_that_is_astray(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An unbalance of 0.13 in place of 0.57: without it the fit follows it with an inertia, and leaves 1.83."""
    assert found(monkeypatch, 1.83, 0.134, astray=True, given=0.566).fit.accepted == ("a",)


@pytest.mark.parametrize(("given", "refitted", "said"), [(0.136, 0.68, True), (0.1, 0.142, True), (0.1, 0.141, False)])
def test_a_fit_is_astray_that_leaves_twice_the_mean_square_of_the_given_design(
    monkeypatch: pytest.MonkeyPatch, given: float, refitted: float, said: bool
) -> None:
    monkeypatch.setattr(written, "fitted_design", lambda *_: "refitted")
    errors = {"given": given, "refitted": refitted}
    monkeypatch.setattr(written, "predict", lambda design, record: SimpleNamespace(torque_error=(errors[design], 0.0)))
    case: Any = SimpleNamespace(believed=object(), policy=POLICY, as_given="given", design=None, record=None)
    assert written.astray(case, None) is said  # type: ignore[arg-type]


def test_an_effect_that_leads_a_fit_back_that_is_astray_has_no_name() -> None:
    """Steps of the speed in a slow log: J was a quarter of it, and a saturation brought 68 % of error back to 13 %."""
    world = draw(19330129)
    found = diagnose(world.design, simulate_world(world), plan=False)
    assert (found.verdict, found.steps, found.improved) == ("inconclusive", (), False)
    assert not any(one.flagged for one in found.parameter_deviations)
    assert next(row.refusal.reason for row in found.ranking if row.effect == "torque_saturation") == "refit_worse"
