"""Significance tests against scipy and tables."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, ncx2, t, wilcoxon

from pmsm_ctrl.evidence.tests import f_tail, holm, limited_gain_errors, noncentrality, rank_test
from tests.effort import amount


def test_holm_against_the_published_example() -> None:
    # S. Holm, Scand. J. Statist. 6 (1979) 65, as in R's p.adjust(c(0.01, 0.02, 0.03, 0.04), "holm")
    assert holm([0.01, 0.02, 0.03, 0.04]) == pytest.approx([0.04, 0.06, 0.06, 0.06])
    assert holm([0.04, 0.01, 0.03, 0.02]) == pytest.approx([0.06, 0.04, 0.06, 0.06])


def test_f_tail_against_tables() -> None:
    # upper 5 % points of F: F(2, 10) = 4.103, F(5, 20) = 2.711
    assert f_tail(4.103, 2, 10) == pytest.approx(0.05, abs=2e-4)
    assert f_tail(2.711, 5, 20) == pytest.approx(0.05, abs=2e-4)


@pytest.mark.parametrize("n", [4, 16, 50, 60])
def test_rank_test_is_scipys(rng: np.random.Generator, n: int) -> None:
    for shift in (-0.5, 0.0, 0.5, 3.0):
        gains = rng.standard_normal(n) + shift
        assert rank_test(gains) == pytest.approx(wilcoxon(gains, alternative="greater").pvalue, rel=1e-9)


@pytest.mark.parametrize("blocks", [0, 1, 8, 60])
def test_gains_of_zero_say_nothing(blocks: int) -> None:
    assert rank_test(np.zeros(blocks)) == 1.0


@pytest.mark.parametrize(
    "gains",
    [
        [1.0, -1.0, 2.0, 3.0, 3.0, 0.0, 4.0, 5.0],
        [0.0, 0.0, 2.0, -1.0, 4.0, 7.0],
        [-2.0, 2.0, 2.0, 2.0, 1.0, 1.0, -1.0, 3.0],
    ],
)
def test_rank_test_bears_equal_gains_and_zeros(gains: list[float]) -> None:
    assert rank_test(np.array(gains)) == pytest.approx(wilcoxon(gains, alternative="greater").pvalue)


def test_noncentrality_gives_half_the_power() -> None:
    for k in (1, 2, 5):
        threshold = chi2.isf(1e-3, k)
        assert ncx2.sf(threshold, k, noncentrality(1e-3, k)) == pytest.approx(0.5, abs=1e-6)


def test_blocks_that_are_extrapolated_do_not_hide_the_gain_of_all_others() -> None:
    gains = np.array([7e8, 505.0, 203.0, 2104.0, 355.0, 1.2e9])
    assert gains.mean() < 2.0 * gains.std(ddof=1) / np.sqrt(6)
    assert limited_gain_errors(gains, 475.0) > 5.0


def test_few_blocks_alone_confirm_nothing() -> None:
    assert limited_gain_errors(np.array([1e9, -1.0, 2.0, -3.0, 1.0]), 50.0) < 2.0
    assert limited_gain_errors(np.array([0.4, 49.0, 139.0, -5.9, 20.5, 602.0, 19.2]), 85.0) < 2.8
    assert limited_gain_errors(np.zeros(0), 1.0) == 0.0


def test_gains_within_the_noise_are_no_surer_for_being_equal() -> None:
    """The gain g of a true amplitude in unit normal noise scatters by 2 sqrt(g)."""
    assert limited_gain_errors(np.ones(9), 2.0) == pytest.approx(1.5)


@pytest.mark.parametrize("n", [5, 16])
def test_gains_of_nothing_are_confirmed_no_more_often_than_students_t_says(rng: np.random.Generator, n: int) -> None:
    """Where there is nothing the gains of left-out blocks scatter around zero, some a thousand times as large."""
    draws = amount(4_000, 20_000)
    for heavy in (False, True):
        size = np.exp(rng.normal(0.0, 3.0, (draws, n))) if heavy else 1.0
        gains = size * rng.standard_normal((draws, n))
        found = [limited_gain_errors(one, float(np.median(np.abs(one)))) for one in gains]
        assert np.mean(np.array(found) > 2.8) < 1.3 * t.sf(2.8, n - 1)
