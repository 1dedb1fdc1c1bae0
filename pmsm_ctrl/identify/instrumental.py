"""Instrumental variables, and the test that says when least squares is biased.

Least squares is biased where its columns hold the noise they are to be told from: an encoder's noise in speed and
acceleration, and the current sensor's noise that the loops turn into motion. The instruments are the same columns of
the simulated, noise-free drive that follows the same reference.

Sources: A. Janot, P. O. Vandanjon, M. Gautier, IEEE Trans. Control Syst. Technol. 22 (2014) 132 (IDIM-IV);
J. Durbin, Review of the International Statistical Institute 22 (1954) 23; J. A. Hausman, Econometrica 46 (1978) 1251.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.identify.problem import Problem, build_problem
from pmsm_ctrl.identify.regression import Fit, solve, t_quantile
from pmsm_ctrl.identify.replay import Replay, plant_with
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, prepare

__all__ = ["BiasTest", "bias_test", "instrumental"]

Array = NDArray[np.float64]

ROUNDS = 10
# Rounds end when no parameter moves by more than this share of its standard error.
STILL = 0.01
# A bias of half a standard error takes the coverage of a 95 % interval to 92 %. Less is not worth a word; the
# feedback makes least squares biased by a little on every log, and a long log shows any bias there is.
MATTERS = 0.5


@dataclass(frozen=True)
class BiasTest:
    """Whether least squares is biased on a log: Durbin, Wu and Hausman's contrast of two estimates.

    Attributes
    ----------
    bias, stderr : dict of parameter to float
        Least squares less instrumental variables, and the standard error of that difference, by the noise model
        of the residual (its correlation allowed for).
    shares : dict of parameter to float
        The bias in standard errors of least squares.
    p_value : float
        Of the hypothesis that the columns hold none of the noise, so that both estimates have the same mean.
    biased : tuple of str
        Parameters whose bias is certain (95 % for all together) to exceed half a standard error of least squares,
        which takes the coverage of its 95 % intervals below 92 %.
    """

    bias: Mapping[str, float]
    stderr: Mapping[str, float]
    shares: Mapping[str, float]
    p_value: float
    biased: tuple[str, ...]

    def text(self, values: Mapping[str, float]) -> str:
        """Return the verdict as one line; `values` are the unbiased estimates."""
        if not self.bias:
            return "least squares cannot be tested for bias: nothing is identifiable by both methods"
        if not self.biased:
            return (
                f"least squares is not biased by more than half a standard error (p = {self.p_value:.2g} for no bias)"
            )
        parts = (
            f"{name} by {100.0 * self.bias[name] / values[name]:+.2g} % ({self.shares[name]:+.1f} standard errors)"
            for name in self.biased
        )
        return f"least squares is biased on this log: {', '.join(parts)}"

    def table(self) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
        """Return header and rows for a report."""
        header = ("parameter", "least squares less instruments", "standard error", "in errors of least squares", "")
        return header, tuple(
            (
                name,
                f"{self.bias[name]:+.3g}",
                f"{self.stderr[name]:.2g}",
                f"{self.shares[name]:+.2f}",
                "biased" if name in self.biased else "",
            )
            for name in self.bias
        )


def instrumental(
    design: Design,
    log: Log,
    replay: Replay,
    *,
    processing: Processing,
    usual: Processing,
    inertia: bool = True,
) -> tuple[Problem, Fit, BiasTest, tuple[str, ...]]:
    """Solve a regression by instrumental variables.

    The noise-free drive is simulated with the last estimates, the columns of that log are the instruments of the
    next, until nothing moves. What the processing itself makes of the noise-free log (the residual it leaves) is
    taken off the target.

    Parameters
    ----------
    processing, usual : Processing
        Of the estimates, and of the least squares that is tested for bias: instruments bear a wider band.
    inertia : bool
        Whether the inertia is searched; it is the design's otherwise.

    Returns
    -------
    problem, fit
        With the target that was explained.
    test : BiasTest
    warnings : tuple of str

    Raises
    ------
    LogError
        When the simulated drive does not move.
    """
    effects = catalogue_of(design)
    prepared, narrow = prepare(design, log, processing), prepare(design, log, usual)
    problem = build_problem(design, prepared, inertia=inertia)
    values = _values(problem, solve(problem, effects))
    warnings: tuple[str, ...] = ()
    for _ in range(ROUNDS):
        plant = plant_with(design, problem.columns, values)
        twin = replay.run(plant)
        corrected, instruments = _instruments(plant, twin, problem, values, processing, prepared.weight)
        fit = solve(corrected, effects, instruments, ratio=None)
        last, values = values, _values(problem, fit)
        moved = np.abs(values - last) > STILL * np.array([fit.stderr.get(n, np.inf) for n in problem.names])
        if not moved.any():
            break
    else:
        still = ", ".join(np.array(problem.names)[moved])
        warnings = (f"instrumental variables: {still} had not come to rest after {ROUNDS} rounds",)
    ordinary = build_problem(design, narrow, inertia=inertia)
    tested, instruments = _instruments(plant, twin, ordinary, last, usual, narrow.weight)
    test = bias_test(tested, solve(ordinary, effects), solve(tested, effects, instruments, ratio=None))
    return corrected, fit, test, warnings


def _instruments(
    plant: Design,
    twin: Log,
    problem: Problem,
    values: Array,
    processing: Processing,
    weight: Array | None,
) -> tuple[Problem, Array]:
    """Return the problem without what the processing makes of the noise-free log, and the instruments, its columns.

    The noise-free log is blanked where the problem was as well: `weight`, shape (n,).
    """
    try:
        inertia = any(column.symbol == "J" for column in problem.columns)
        clean = build_problem(plant, prepare(plant, twin, processing).blanked(weight), inertia=inertia)
    except LogError as error:
        raise LogError(f"the simulated drive does not follow this log's reference: {error}") from error
    z = clean.matrix()
    return replace(problem, target=problem.target - (clean.target - z @ values)), z


def _values(problem: Problem, fit: Fit) -> Array:
    """Return a value for every column: the design's where there is no estimate."""
    return np.array([
        min(max(fit.values.get(c.name, c.nominal), c.lower), c.upper) for c in problem.columns
    ])  # fmt: skip


def bias_test(problem: Problem, ordinary: Fit, unbiased: Fit) -> BiasTest:
    """Test whether least squares is biased.

    The difference of the two estimates is linear in the noise, ``d = D e``, so that its covariance under the
    hypothesis is ``s^2 D R D'`` with the residual's correlation R: no assumption of white noise.
    """
    from scipy.special import fdtrc

    names = [n for n in problem.names if n in ordinary.values and n in unbiased.values]
    rows = [problem.names.index(n) for n in names]
    d = np.array([ordinary.values[n] - unbiased.values[n] for n in names])
    contrast = np.zeros((len(problem.target), len(rows)))
    contrast[problem.mask] = (ordinary.weights - unbiased.weights)[rows].T
    noisy = contrast.T @ np.where(problem.mask, problem.target, 0.0)
    covariance = unbiased.spread * contrast.T @ unbiased.noise.toeplitz(contrast)
    stderr = np.sqrt(np.diag(covariance))
    size = np.where(stderr > 0.0, stderr, 1.0)
    root = np.linalg.pinv(covariance / np.outer(size, size), rcond=1e-6, hermitian=True)
    rank = int(np.linalg.matrix_rank(root, hermitian=True)) if len(names) else 0
    statistic = float((noisy / size) @ root @ (noisy / size)) / max(rank, 1)
    # Bonferroni over the parameters
    half = t_quantile(1.0 - 0.05 / max(len(names), 1), unbiased.dof) * stderr
    usual = np.array([ordinary.stderr[n] for n in names])
    return BiasTest(
        bias=dict(zip(names, d.tolist(), strict=True)),
        stderr=dict(zip(names, stderr.tolist(), strict=True)),
        shares=dict(zip(names, (d / usual).tolist(), strict=True)),
        p_value=float(fdtrc(rank, unbiased.dof, statistic)) if rank else float("nan"),
        biased=tuple(n for n, certain in zip(names, np.abs(d) - half > MATTERS * usual, strict=True) if certain),
    )
