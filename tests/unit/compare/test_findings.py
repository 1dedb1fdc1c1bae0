"""Findings as values: where a curve is large, what it is called, and what a residual depends on in one sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pmsm_ctrl.compare.notices import OBJECTIONS, coordinate_words, largest_words, structure_words
from pmsm_ctrl.residuals.dependence import Dependence, Extent, Objection, ResidualStructure, run_around

X = np.linspace(0.0, 10.0, 11)
FLAT = np.ones(11)
RISING = np.where(X >= 7.0, 1.0, 0.1)
MIDDLE = np.where((X >= 4.0) & (X <= 6.0), 1.0, 0.1)


def dependence(forward: np.ndarray, backward: np.ndarray, coordinate: str = "current", unit: str = "A") -> Dependence:
    return Dependence(coordinate, unit, 0.4, 0.4, 1, 1e-20, 9.0, None, X, X, forward, backward)


@pytest.mark.parametrize(
    ("forward", "backward", "extent", "words"),
    [
        (FLAT, FLAT, Extent(None, None, 0), "similar everywhere"),
        (RISING, RISING, Extent(7.0, None, 0), "above 7 A"),
        (RISING[::-1], RISING[::-1], Extent(None, 3.0, 0), "below 3 A"),
        (MIDDLE, 0.3 * MIDDLE, Extent(4.0, 6.0, 1), "between 4 and 6 A moving forward"),
        (0.3 * MIDDLE, -MIDDLE, Extent(4.0, 6.0, -1), "between 4 and 6 A moving backward"),
    ],
)
def test_where_a_curve_is_large(forward: np.ndarray, backward: np.ndarray, extent: Extent, words: str) -> None:
    found = dependence(forward, backward)
    assert found.extent == extent
    assert largest_words(found) == words


def test_an_order_is_large_at_its_greatest_amplitude() -> None:
    spectrum = np.array([[0.1, 0.4, 0.2], [0.05, 0.05, 0.05]])
    found = replace(dependence(FLAT, FLAT, "position", "rad"), orders=(3, 2), spectrum=spectrum)
    assert found.strongest_order == 2
    assert largest_words(found) == "in order 2"
    assert coordinate_words(found) == "position (orders 3, 2 of a turn)"


def test_the_sentence_names_shares_and_the_offset() -> None:
    second = replace(dependence(FLAT, FLAT, "position", "rad"), rank=2, added=0.1, orders=(6,))
    structure = ResidualStructure(
        (dependence(RISING, RISING), second), "N m", 0.001, 0.002, 0.2, True, np.zeros(1), np.ones(1, dtype=bool)
    )
    assert structure_words(structure) == (
        "20 % of the residual is a constant +0.002 N m; a further 40 % depends on current; largest above 7 A, "
        "up to 1 N m; a further 10 % depends on position (order 6 of a turn)"
    )
    nothing = replace(structure, dependences=(replace(second, rank=0),), offset_significant=False)
    assert structure_words(nothing) == "no significant structure in the residual"


def test_every_objection_has_words_and_a_code() -> None:
    assert set(OBJECTIONS) == set(Objection)
    missed = replace(dependence(FLAT, FLAT), objection=Objection.TOO_SMALL)
    assert not missed.significant
    assert missed.to_dict()["why_not"] == "too_small"


@pytest.mark.parametrize(("place", "run"), [(0, (0, 1)), (1, (0, 1)), (3, (3, 3)), (6, (5, 6))])
def test_run_around_a_place(place: int, run: tuple[int, int]) -> None:
    assert run_around(np.array([True, True, False, True, False, True, True]), place) == run
