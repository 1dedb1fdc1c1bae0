"""The optimum inside bounds that meet, or hang on what is found, as those of the inertia of a load that rubs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.regression import bounds


@pytest.mark.parametrize("only", [0.3, 1.0, 7.0])
def test_a_parameter_that_can_be_one_number_is_held_there(only: float, monkeypatch: pytest.MonkeyPatch) -> None:
    held: dict[int, float] = {}

    def holding(free: Any, found: dict[int, float]) -> Any:
        held.update(found)
        return SimpleNamespace(values=np.array([only, 2.0]))

    monkeypatch.setattr(bounds, "column_bounds", lambda *_: [(only, only), (-np.inf, np.inf)])
    monkeypatch.setattr(bounds, "holding", holding)
    triangle = np.array([[3.0, 1.0], [0.0, 2.0]])
    free: Any = SimpleNamespace(
        model=None, values=np.array([0.5, 2.0]), triangle=triangle, along=triangle @ np.array([0.5, 2.0])
    )
    assert bounds.bounded(free).values[0] == only
    assert held == {0: pytest.approx(only)}


def test_a_bound_that_hangs_on_another_parameter_settles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each pass holds x_0 at its bound x_1 / 2, which makes x_1 smaller: they end where both agree."""
    triangle = np.array([[2.0, -0.8], [0.0, 2.0]])
    best = np.array([2.0, 1.0])

    def holding(free: Any, found: dict[int, float]) -> Any:
        x0 = found[0]
        shared = triangle[:, 1] @ triangle[:, 0] / (triangle[:, 1] @ triangle[:, 1])
        return SimpleNamespace(values=np.array([x0, best[1] - shared * (x0 - best[0])]))

    def bounds_at(_: Any, values: np.ndarray) -> list[tuple[float, float]]:
        return [(0.0, 0.5 * float(values[1])), (-np.inf, np.inf)]

    monkeypatch.setattr(bounds, "column_bounds", bounds_at)
    monkeypatch.setattr(bounds, "holding", holding)
    free: Any = SimpleNamespace(model=None, values=best, triangle=triangle, along=triangle @ best)
    found = bounds.bounded(free).values
    assert found[0] == pytest.approx(0.5 * found[1], rel=1e-8)
