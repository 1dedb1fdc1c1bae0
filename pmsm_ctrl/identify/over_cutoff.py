"""The inertia over the cutoff of the low-pass: where it moves beyond its interval, its interval is not to be believed.

Noise in the acceleration shrinks the estimate as the band grows; an effect that the model lacks is taken for inertia in
one band and not in another. A model that is right gives the same inertia in every band. Source of the idea: J. Hausman,
Econometrica 46 (1978) 1251.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.identify.notices import INERTIA_OVER_CUTOFF
from pmsm_ctrl.identify.policy import CUTOFFS, MOVED
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.inverse_dynamics import Problem, build_problem
from pmsm_ctrl.regression.least_squares import Fit, solve
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice

__all__ = ["inertia_over_cutoff", "moved"]


def inertia_over_cutoff(
    design: Design, log: Log, processing: Processing, problem: Problem, fit: Fit
) -> dict[float, Estimate]:
    """Return the inertia by least squares in narrower bands, and in a wider one where it was found from all of it.

    Parameters
    ----------
    design : Design
    log : Log
    processing : Processing
    problem, fit : Problem, Fit
        The estimate that is examined.

    Returns
    -------
    dict of float to Estimate
        By cutoff in Hz, ascending, that of `fit` included; empty where `fit` has no inertia.
    """
    if "J" not in fit.values:
        return {}
    own = problem.inertia_cutoff if problem.inertia_cutoff is not None else problem.cutoff
    unit = next(column.unit for column in problem.columns if column.name == "J")
    found = {own: Estimate(fit.values["J"], unit, fit.stderr["J"])}
    for factor in CUTOFFS:
        cutoff = factor * own
        if factor > 1.0 and (problem.inertia_cutoff is not None or cutoff > log.rate / 4.0):
            continue  # the wider band was found to be noise already
        try:
            other = solve(build_problem(design, log, replace(processing, cutoff=cutoff, inertia_cutoff=None)))
        except LogError:  # too few samples that move
            continue
        if "J" in other.values:
            found[cutoff] = Estimate(other.values["J"], unit, other.stderr["J"])
    return dict(sorted(found.items()))


def moved(found: Mapping[float, Estimate], fit: Fit) -> tuple[Notice, ...]:
    """Return a notice where the inertia of a band lies outside of the interval, by more than both uncertainties.

    Parameters
    ----------
    found : dict of float to Estimate
        As `inertia_over_cutoff` returns it.
    fit : Fit
    """
    if len(found) < 2:
        return ()
    own, (low, high) = fit.values["J"], fit.interval("J")
    sure = {
        cutoff: other for cutoff, other in found.items()
        if not low <= other.value <= high and abs(other.value - own) > MOVED * math.hypot(other.stderr, fit.stderr["J"])
    }  # fmt: skip
    if not sure:
        return ()
    cutoff, other = max(sure.items(), key=lambda pair: abs(pair[1].value - own))
    at = next(c for c, estimate in found.items() if estimate.value == own)
    said = INERTIA_OVER_CUTOFF(value=own, at=at, other=other.value, cutoff=cutoff, unit=other.unit, low=low, high=high)
    return (said,)
