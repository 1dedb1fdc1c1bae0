"""Instrumental variables, and the test whether least squares is biased.

Least squares is biased where its columns are correlated with the noise of the torque: by the encoder's noise in speed
and acceleration, and by the current sensor's noise, which the loops turn into motion. The instruments are the same
columns of the simulated, noise-free drive that follows the same reference.

Sources: A. Janot, P. O. Vandanjon, M. Gautier, IEEE Trans. Control Syst. Technol. 22 (2014) 132 (IDIM-IV);
J. Durbin, Review of the International Statistical Institute 22 (1954) 23; J. A. Hausman, Econometrica 46 (1978) 1251.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.identify.notices import NOT_CONVERGED
from pmsm_ctrl.identify.policy import IV_CONVERGED, IV_ROUNDS
from pmsm_ctrl.identify.replay import Replay, plant_with
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared, Processing, prepare
from pmsm_ctrl.regression.inverse_dynamics import Problem, build_problem
from pmsm_ctrl.regression.least_squares import NEGLIGIBLE_BIAS, Fit, solve, t_quantile
from pmsm_ctrl.section import Notice

__all__ = ["BiasTest", "bias_test", "instrumental"]

Array = NDArray[np.float64]


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


def instrumental(
    design: Design, log: Log, replay: Replay, processing: tuple[Processing, Processing], inertia: bool = True
) -> tuple[Problem, Fit, BiasTest, tuple[Notice, ...]]:
    """Solve a regression by instrumental variables, and test whether least squares is biased.

    The noise-free drive is simulated with the last estimates, the columns of that log are the instruments of the
    next, until nothing moves. What the processing itself makes of the noise-free log (the residual it leaves) is
    subtracted from the target. `processing` is that of the estimates, and that of the least squares that is tested:
    instruments bear a wider band. Without `inertia` the design's is taken.

    Raises
    ------
    LogError
        When the simulated drive does not move.
    """
    wide, usual = processing
    prepared, narrow = prepare(design, log, wide), prepare(design, log, usual)
    problem = build_problem(design, prepared, inertia=inertia)
    values = _values(problem, solve(problem))
    notices: tuple[Notice, ...] = ()
    for _ in range(IV_ROUNDS):
        plant = plant_with(design, problem.columns, values)
        twin = replay.run(plant)
        corrected, instruments = _instruments(plant, twin, problem, values, prepared, wide)
        fit = solve(corrected, instruments, ratio=None)
        last, values = values, _values(problem, fit)
        moved = np.abs(values - last) > IV_CONVERGED * np.array([fit.stderr.get(n, np.inf) for n in problem.names])
        if not moved.any():
            break
    else:
        names = f" ({', '.join(np.array(problem.names)[moved])})"
        notices = (NOT_CONVERGED(method="instrumental variables", rounds=IV_ROUNDS, names=names),)
    ordinary = build_problem(design, narrow, inertia=inertia)
    tested, instruments = _instruments(plant, twin, ordinary, last, narrow, usual)
    return corrected, fit, bias_test(tested, solve(ordinary), solve(tested, instruments, ratio=None)), notices


def _instruments(
    plant: Design, twin: Log, problem: Problem, values: Array, prepared: Prepared, processing: Processing
) -> tuple[Problem, Array]:
    """Return the problem without what the processing makes of the noise-free log, and the instruments, its columns.

    The noise-free log is blanked where the log itself was as well.
    """
    try:
        made = prepare(plant, twin, processing).blanked(prepared.weight)
        clean = build_problem(plant, made, inertia=problem.inertia is not None)
    except LogError as error:
        raise LogError(f"the simulated drive does not follow this log's reference: {error}") from error
    z = clean.matrix()
    own = problem.physical  # the simulated drive is sampled with its motion
    return replace(problem, target=problem.target - (clean.target - z[:, own] @ values[own])), z


def _values(problem: Problem, fit: Fit) -> Array:
    """Return a value for every column: the design's where there is no estimate, and zero for the sampling."""
    return np.array([fit.values.get(c.name, c.nominal) for c in problem.columns])


def bias_test(problem: Problem, ordinary: Fit, unbiased: Fit) -> BiasTest:
    """Test whether least squares is biased.

    The difference of the two estimates is linear in the noise, ``d = D e``, so that its covariance under the
    hypothesis is ``s^2 D R D'`` with the residual's correlation R: no assumption of white noise.
    """
    from scipy.special import fdtrc

    held = {*ordinary.at_bound, *unbiased.at_bound}
    names = [n for n in problem.names if n in ordinary.values and n in unbiased.values and n not in held]
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
        biased=tuple(
            n for n, certain in zip(names, np.abs(d) - half > NEGLIGIBLE_BIAS * usual, strict=True) if certain
        ),
    )
