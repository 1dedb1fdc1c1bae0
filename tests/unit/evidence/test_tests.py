"""Significance tests against scipy and tables."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, ncx2, wilcoxon

from pmsm_ctrl.evidence.tests import f_tail, holm, noncentrality, rank_test


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


def test_rank_test_bears_equal_gains() -> None:
    gains = np.array([1.0, -1.0, 2.0, 3.0, 3.0, 0.0, 4.0, 5.0])
    assert rank_test(gains) == pytest.approx(wilcoxon(gains, alternative="greater").pvalue)


def test_noncentrality_gives_half_the_power() -> None:
    for k in (1, 2, 5):
        threshold = chi2.isf(1e-3, k)
        assert ncx2.sf(threshold, k, noncentrality(1e-3, k)) == pytest.approx(0.5, abs=1e-6)
