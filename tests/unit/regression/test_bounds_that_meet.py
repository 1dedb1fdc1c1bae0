"""The optimum inside bounds of which two are one number, as those of a load's inertia at the end of its friction."""

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
