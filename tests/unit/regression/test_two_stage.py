"""Candidates beside an inertia that instruments told without them, against two-stage least squares in one step."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.two_stage import HeldResponse, beside_held, gram_beside_held

Array = NDArray[np.float64]
J, AMOUNT = 2.0, 0.1


def columns() -> tuple[Array, Array, Array]:
    """Return the motion that a reference asks for, the measured one, and an effect that resembles it."""
    rng = np.random.default_rng(4)
    asked = np.sin(0.05 * np.arange(2000.0))
    return asked, asked + 0.3 * rng.standard_normal(2000), asked**3


def group(column: Array) -> Group:
    return Group(None, ("amount",), (column[None], None), {})


def test_a_candidate_beside_a_held_value_is_as_large_as_fitted_together_with_it() -> None:
    asked, measured, effect = columns()
    torque = J * measured + AMOUNT * effect
    slope = asked / float(asked @ measured)  # of the instrumental estimate asked'torque / asked'measured
    told = asked * float(asked @ measured) / float(asked @ asked)
    held = float(slope @ torque)
    assert held == pytest.approx(J + AMOUNT * float(slope @ effect))  # too large by what it holds of the effect
    seen = beside_held(group(effect), (HeldResponse(told, slope),)).rows[0]
    assert seen is not None
    left = torque - held * measured
    # the effect and the motion together by the instruments (asked, effect), Soderstrom and Stoica 1983, eq. 3.2
    together = np.linalg.solve(
        np.array([asked, effect]) @ np.array([measured, effect]).T, np.array([asked, effect]) @ torque
    )
    assert together == pytest.approx([J, AMOUNT])
    noise = 3.0 * np.sqrt(float(seen[0] @ seen[0])) * 0.3 * abs(held - J)  # of the measured motion, three deviations
    assert float(seen[0] @ left) == pytest.approx(AMOUNT * float(seen[0] @ seen[0]), abs=noise)
    assert float(seen[0] @ told) == pytest.approx(0.0, abs=1e-9 * float(told @ told))


def test_without_held_values_a_candidate_is_what_it_was() -> None:
    made = group(columns()[2])
    assert beside_held(made, ()) is made
    only_voltage = Group(None, ("amount",), (None, np.ones((1, 5))), {})
    assert beside_held(only_voltage, (HeldResponse(np.ones(5), np.ones(5)),)) is only_voltage


def test_the_gram_matrix_beside_held_values_is_that_of_the_columns() -> None:
    asked, measured, effect = columns()
    answer = HeldResponse(asked, asked / float(asked @ measured))
    seen = beside_held(group(effect), (answer,)).rows[0]
    assert seen is not None
    every = np.array([measured, effect, asked])
    found = gram_beside_held(every @ every.T, np.array([[0.0, float(effect @ answer.slope)]]))
    wanted = np.array([measured, seen[0]])
    assert found == pytest.approx(wanted @ wanted.T)
