"""The peers: each takes a library and returns the effects it selects, the first one first."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.peers.library import Library

__all__ = ["PEERS", "VARIANTS", "base_alone", "frols", "greedy_bic", "stlsq"]

Array = NDArray[np.float64]

# Blocked folds of the cross-validation, contiguous in time.
FOLDS = 5
# Thresholds of STLSQ in shares of the rms that the base model leaves over: every column has rms 1 beside the base.
THRESHOLDS = np.geomspace(0.01, 1.0, 25)
# Largest models that FROLS tries: its default is 15.
MOST_TERMS = 20


def base_alone(library: Library) -> list[str]:
    """Select nothing: inertia, Coulomb and viscous friction alone."""
    return []


def greedy_bic(library: Library) -> list[str]:
    """Add the effect that lowers Schwarz's criterion most until none does; columns of an effect together.

    Searched nonlinear parameters cost as much as linear ones. Source: G. Schwarz, Annals of Statistics 6 (1978) 461.
    """
    y, x = library.beside_base()
    n, out = len(y), []
    names = np.array(library.names)

    def criterion(chosen: list[str]) -> float:
        inside = np.isin(names, chosen)
        left = y - x[:, inside] @ np.linalg.lstsq(x[:, inside], y, rcond=1e-8)[0] if chosen else y
        k = int(inside.sum()) + sum(library.free.get(name, 0) for name in chosen)
        return n * math.log(max(float(np.mean(left**2)), 1e-300)) + k * math.log(n)

    now = criterion(out)
    while rest := sorted(set(library.names) - set(out)):
        best, name = min((criterion([*out, name]), name) for name in rest)
        if best >= now:
            break
        now, out = best, [*out, name]
    return out


def stlsq(library: Library, one_error: bool = True) -> list[str]:
    """PySINDy's STLSQ, its threshold by cross-validation on blocks of time; by contribution.

    With `one_error` the largest threshold counts whose error lies within one standard error of the smallest
    (L. Breiman et al., Classification and Regression Trees, 1984, sec. 3.4.3), else that of the smallest.
    """
    if not library.names:
        return []
    errors = _left_out(library)
    mean = errors.mean(axis=1)
    least = int(np.argmin(mean))
    allowed = mean[least] + (errors[least].std(ddof=1) / math.sqrt(FOLDS) if one_error else 0.0)
    y, x = library.beside_base()
    values = _thresholded(float(THRESHOLDS[np.flatnonzero(mean <= allowed).max()]), x, y)
    sizes: dict[str, float] = {}
    for name, value in zip(library.names, values.tolist(), strict=True):
        if value != 0.0:
            sizes[name] = math.hypot(sizes.get(name, 0.0), value)
    return sorted(sizes, key=lambda name: -sizes[name])


@lru_cache(maxsize=2)
def _left_out(library: Library) -> Array:
    """Mean squares in the folds, shape (thresholds, folds)."""
    from sklearn.model_selection import KFold

    y, x = library.beside_base()
    return np.array([
        [float(np.mean((y[test] - x[test] @ _thresholded(level, x[fit], y[fit])) ** 2))
         for fit, test in KFold(FOLDS).split(x)]
        for level in THRESHOLDS.tolist()
    ])  # fmt: skip


def _thresholded(level: float, x: Array, y: Array) -> Array:
    from pysindy.optimizers import STLSQ

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a threshold that leaves no column is an answer here
        return np.asarray(STLSQ(threshold=level).fit(x, y).coef_[0])


def frols(library: Library, criterion: str = "bic") -> list[str]:
    """SysIdentPy's FROLS, the number of terms by its information criterion; in the order of its error reduction.

    Its inputs are lagged by at least one sample, so the columns are given one sample ahead. It always selects a term;
    here none is selected where the same criterion is lower without any.
    """
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    y, x = library.beside_base()
    if x.shape[1] == 0:
        return []
    ahead = np.vstack([x[1:], x[-1:]])
    model = FROLS(
        order_selection=True, info_criteria=criterion, n_info_values=min(MOST_TERMS, x.shape[1]), model_type="NFIR",
        xlag=[[1]] * x.shape[1], ylag=1, estimator=LeastSquares(), basis_function=Polynomial(degree=1),
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(X=ahead, y=y[:, None])
    if (len(y) - 1) * math.log(float(np.var(y[1:], ddof=1))) <= model.info_values[0]:
        return []
    # a regressor is coded 1000 * (input + 2) + lag; 0 is the constant, which is no effect's
    picked = [int(code) // 1000 - 2 for code in np.ravel(model.final_model).tolist() if code >= 2000]
    return list(dict.fromkeys(library.names[k] for k in picked))


PEERS: Mapping[str, tuple[Callable[[Library], list[str]], bool]] = {
    "base model alone": (base_alone, False),
    "greedy BIC": (greedy_bic, False),
    "PySINDy STLSQ": (stlsq, False),
    "PySINDy STLSQ, generic": (stlsq, True),
    "SysIdentPy FROLS": (frols, False),
    "SysIdentPy FROLS, generic": (frols, True),
}
# What was weighed against these on other seeds.
VARIANTS: Mapping[str, tuple[Callable[[Library], list[str]], bool]] = {
    "variant: STLSQ, least error": (partial(stlsq, one_error=False), False),
    "variant: FROLS, AICc": (partial(frols, criterion="aicc"), False),
}
