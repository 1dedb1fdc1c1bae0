"""Of effects that contradict each other those stay that explain more, whichever came first."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from pmsm_ctrl.diagnose import together
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.selection import Selection, Step


class Named(NamedTuple):
    name: str
    candidate: Any


@pytest.mark.parametrize(
    ("left_by_a", "left_by_b", "stays"),
    [(1.0, 9.0, "a"), (9.0, 1.0, "b")],
)
def test_what_came_later_goes_where_less_is_left_without_it(
    monkeypatch: pytest.MonkeyPatch, left_by_a: float, left_by_b: float, stays: str
) -> None:
    """Friction that was named beside an unbalance drove it out, and the residual was twelve times its floor."""
    left = {"": 20.0, "a": left_by_a, "ab": 0.5, "b": left_by_b}

    def fit(accepted: Any) -> Any:
        ids = tuple(accepted)
        return SimpleNamespace(accepted=ids, plain=SimpleNamespace(chi2=left["".join(one.effect.id for one in ids)]))

    def step(name: str) -> Any:
        trial = Named(name, SimpleNamespace(effect=SimpleNamespace(id=name)))
        return Step(trial, None, ("b",) if name == "a" else ())  # type: ignore[arg-type]

    def built(case: Any, accepted: Any, steps: Any) -> Selection:
        fits: Any = tuple(fit(accepted[:k]) for k in range(len(accepted) + 1))
        return Selection(fits, tuple(steps))

    a, b = (SimpleNamespace(effect=SimpleNamespace(id=name, repeated=False)) for name in "ab")
    monkeypatch.setattr(together, "_built", built)
    monkeypatch.setattr(together, "name_of", lambda trial: trial.name)
    monkeypatch.setattr(
        together, "_judged", lambda case, accepted, steps, asked: ({}, 0 if len(accepted) > 1 else None)
    )
    case: Any = SimpleNamespace(fit=fit)
    found = together.standing(case, built(case, [a, b], [step("a"), step("b")]))
    assert [one.effect.id for one in found.accepted] == [stays]
    assert [one.trial.name for one in found.steps] == [stays]  # type: ignore[attr-defined]
    # what had the other as its equivalent is one of the other
    assert [one.equivalents for one in found.steps] == [("b",) if stays == "a" else ("a",)]
    assert {name: why.reason for name, why in found.refused.items()} == (
        {"b": Reason.NOT_NEEDED} if stays == "a" else {}
    )
