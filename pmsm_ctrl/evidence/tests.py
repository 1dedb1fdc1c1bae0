"""Significance tests: the F test, Holm's correction for many tests, and a rank test of gains."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["f_tail", "holm", "limited_gain_errors", "mean_gain", "noncentrality", "rank_test"]

Array = NDArray[np.float64]

MOST_EXACT = 50  # gains above and below zero whose ranks are counted out; sums up to 2^50 are exact


def f_tail(f: float, k: int, dof: int) -> float:
    """Return the upper tail of the F distribution.

    Parameters
    ----------
    f : float
        Value of the statistic.
    k, dof : int
        Degrees of freedom of the numerator and of the denominator.
    """
    from scipy.special import fdtrc

    return float(fdtrc(k, dof, f))


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values after Holm's step-down correction, in the given order.

    Source: S. Holm, Scand. J. Statist. 6 (1979) 65.

    Parameters
    ----------
    p_values : sequence of float
    """
    order = np.argsort(p_values)
    out = np.empty(len(p_values))
    worst = 0.0
    for rank, k in enumerate(order):
        worst = max(worst, min(1.0, (len(p_values) - rank) * p_values[k]))
        out[k] = worst
    return out.tolist()


def mean_gain(gains: Array) -> tuple[float, float]:
    """Return the mean of gains and its standard error; infinite without any gains.

    Parameters
    ----------
    gains : array, shape (blocks,)
    """
    if len(gains) == 0:
        return 0.0, float("inf")
    return float(gains.mean()), float(gains.std(ddof=1) / np.sqrt(len(gains)))


def limited_gain_errors(gains: Array, most: float) -> float:
    """Return by how many standard errors the mean of gains exceeds zero, where none counts as more than `most`.

    A block that the others do not determine is extrapolated. Its gain may be a million times theirs, which leaves the
    plain mean as uncertain as it is large. The standard error is no smaller than that of a gain of this size in normal
    noise.

    Parameters
    ----------
    gains : array, shape (blocks,)
    most : float
        In units of the noise.
    """
    mean, stderr = mean_gain(np.minimum(gains, most))
    stderr = max(stderr, 2.0 * float(np.sqrt(max(mean, 0.0) / max(len(gains), 1))))
    return mean / stderr if stderr > 0.0 else 0.0


def rank_test(gains: Array) -> float:
    """Return the one-sided p-value of Wilcoxon's signed-rank test that gains are above zero.

    It judges effects that show in a few short stretches, whose gains differ by orders of magnitude.
    Source: F. Wilcoxon, Biometrics Bulletin 1 (1945) 80.

    Parameters
    ----------
    gains : array, shape (blocks,)
        Without any, or where all are zero, the p-value is 1.
    """
    gains = gains[gains != 0.0]
    if not len(gains):
        return 1.0
    if len(gains) > MOST_EXACT:
        from scipy.stats import wilcoxon

        return float(wilcoxon(gains, alternative="greater").pvalue)
    _, place, count = np.unique(np.abs(gains), return_inverse=True, return_counts=True)
    doubled = (2 * np.cumsum(count) - count + 1)[place]  # equal ones share the mean of their ranks
    return float(_rank_sum_tail(tuple(sorted(doubled.tolist())))[int(doubled[gains > 0.0].sum())])


@lru_cache(maxsize=32)
def _rank_sum_tail(ranks: tuple[int, ...]) -> Array:
    """Chance that the ranks for which a coin falls on heads sum up to at least 0, 1, 2, ...: exact."""
    count = np.ones(1)
    for rank in ranks:
        count = np.pad(count, (0, rank)) + np.pad(count, (rank, 0))
    return np.cumsum(count[::-1])[::-1] / 2.0 ** len(ranks)


@lru_cache(maxsize=64)
def noncentrality(level: float, k: int) -> float:
    """Return the noncentrality at which a chi-square test has a power of one half.

    Parameters
    ----------
    level : float
        Significance of the test.
    k : int
        Degrees of freedom.
    """
    from scipy.optimize import brentq
    from scipy.stats import chi2, ncx2

    threshold = chi2.isf(level, k)
    return float(brentq(lambda x: ncx2.sf(threshold, k, x) - 0.5, 1e-6, 10.0 * threshold))
