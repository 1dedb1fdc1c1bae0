"""What an effect has to pass before it is taken in, and after."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.candidates import REPEATED
from pmsm_ctrl.diagnose.fit import Fitted, errors
from pmsm_ctrl.diagnose.search import Evidence, Trial, blocked_gain, physical_bounds
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.regression.model import Model, Solved

__all__ = [
    "ABSURD",
    "BEYOND",
    "BLOCK_ERRORS",
    "LEAST_ERRORS",
    "MATERIAL",
    "OUTSIDE",
    "RELIEF",
    "SIGNIFICANCE",
    "TELLING",
    "UNSEEN",
    "UNSTEADY",
    "WINDING",
    "gates",
    "name_of",
    "objection",
    "relief",
    "strain",
]

Array = NDArray[np.float64]

SIGNIFICANCE = 0.01  # family-wise, by Holm
# Standard errors that the gain of left-out blocks must reach. A small first effect may do with less: spread evenly over
# the blocks its gain reaches half the root of the whole, and this share of that must be seen.
BLOCK_ERRORS, LEAST_ERRORS, SEEN = 2.8, 2.0, 0.75
# Smallest contribution worth a name, as a share of the balance's size. A smaller one is where it explains this share of
# what is left: beside a hard acceleration all friction is small.
MATERIAL, SMALL, TELLING = 0.004, 0.001, 0.012
LOWERED = 0.996  # what is left of the error in at least one balance once an effect is in
# The winding stands in for effects, at a price: squares of how far it left its datasheet, in tolerances. An effect that
# brings back so much of it need not lower an error, and so much more of it need only hold up on left-out blocks:
# nobody's resistance is four times that of the datasheet.
RELIEF, ABSURD = 25.0, 225.0
WINDING = ("R", "L_d", "L_q", "psi_f")
BEYOND = "beyond its bounds"
UNSEEN, OUTSIDE = "not significant", "its parameters come out beyond their bounds"
UNSTEADY = "does not hold on left-out blocks"
SERVED = 0.2  # what one balance may lose of what another one gains
SPOILT = 1.1  # times the error of a balance that an effect on the voltages may leave


def name_of(trial: Trial) -> str:
    """Return the effect, with its order where an axis can have several."""
    order = trial.group.shape.get("order")
    effect = trial.candidate.effect.id
    return f"{effect} {order:g}" if effect in REPEATED and order else effect


def gates(fit: Fitted, trial: Trial, p_holm: float, least: float) -> tuple[str, Evidence | None]:
    """Return why an effect is not taken in, empty when it passes, and its evidence where it came that far."""
    if trial.singular:
        return "this log cannot tell it from what the model has already", None
    if trial.wrong_sign:
        return OUTSIDE, None
    if p_holm > SIGNIFICANCE:
        return f"{UNSEEN} (corrected p = {p_holm:.2g})", None
    material = _material(fit, trial)
    telling = trial.plain_gain > TELLING * fit.plain.chi2
    if material < (SMALL if telling else MATERIAL):
        return f"significant but immaterial: {100 * material:.2g} % of the balance where it acts", None
    judge = (fit.plain, fit.weights) if trial.slow else (fit.solved, fit.whitener)
    direction = trial.plain_direction if trial.slow else trial.direction
    mean, stderr, blocks, p_rank = blocked_gain(fit.record, *judge, trial.group, direction, fit.whitener.memory)
    evidence = Evidence(trial.gain, trial.p_value, p_holm, blocks, mean, stderr, p_rank, material)
    asked = min(max(SEEN * 0.5 * np.sqrt(_from_rows(judge[0], direction)), least), BLOCK_ERRORS)
    surely = mean > asked * stderr or p_rank < 0.5 * SIGNIFICANCE or relief(judge[0], direction) > ABSURD
    if not (surely and mean > 0.0):
        return f"{UNSTEADY} (gain {mean:.3g} +- {stderr:.2g})", evidence
    return "", evidence


def objection(after: Fitted, before: Fitted, newest: Effect) -> str:
    """An effect that makes one balance worse to please another is not the missing one."""
    old, new = _weighted(before), _weighted(after)
    sizes = dict(zip(after.record.channels, after.weights.sigma, strict=True))
    change = {name: (new[name] ** 2 - old[name] ** 2) / sizes[name] ** 2 for name in new}
    for name, more in change.items():
        # a winding that was bent to stand in for the effect may have served one balance better than the truth does
        if new[name] > 1.03 * old[name] and more > -SERVED * min(change.values()):
            return f"makes the {name} balance worse"
    plain = [{name: rms for name, (rms, _) in errors(fit.record, fit.residual).items()} for fit in (before, after)]
    if newest.enters == "voltage":
        # it acts on every sample alike, those that count little included
        rise = {name: rms**2 - plain[0][name] ** 2 for name, rms in plain[1].items() if name != "torque"}
        for name, more in rise.items():
            if plain[1][name] > SPOILT * plain[0][name] and more > -SERVED * min(rise.values()):
                return f"makes the {name} balance worse"
    relieved = strain(before.plain) - strain(after.plain) > RELIEF
    lowered = any(b[name] <= LOWERED * a[name] for a, b in ((old, new), plain) for name in new)
    if not (relieved or lowered):
        return "lowers no error by an amount worth a name"
    known = dict(zip(after.model.names, after.plain.values.tolist(), strict=True))
    bounds = physical_bounds((g.effect for g in after.model.groups if g.effect), known)
    for k, name in enumerate(after.model.names):
        low, high = bounds.get(name.split("#")[0], (-np.inf, np.inf))
        value, slack = after.plain.values[k], 3.0 * after.plain.stderr[k]
        if not low - slack <= value <= high + slack:
            return f"drives {name} to {value:.3g}, {BEYOND}"
    return ""


def _from_rows(solved: Solved, direction: Array) -> float:
    """What of a gain the rows of the log bring; the rest is parameters that come back towards their nominal values."""
    rest, part = solved.rest[: solved.rows], direction[: solved.rows]
    return max(float(part @ (2.0 * rest - part)), 0.0)


def relief(solved: Solved, direction: Array) -> float:
    """What of a gain the winding brings by coming back to its datasheet."""
    rest, part = solved.rest[solved.rows :], direction[solved.rows :]
    return float(np.sum((part * (2.0 * rest - part))[_winding(solved.model)]))


def strain(solved: Solved) -> float:
    """How far the winding had to leave its datasheet, as a sum of squares in its tolerances."""
    return float(np.sum(solved.rest[solved.rows :][_winding(solved.model)] ** 2))


def _winding(model: Model) -> NDArray[np.bool_]:
    """Which of the rows of priors are the winding's."""
    return np.array([name in WINDING for name in np.array(model.names)[np.isfinite(model.sigma)]], dtype=bool)


def _material(fit: Fitted, trial: Trial) -> float:
    """Size of what only this effect explains against the balance, on the tenth of the samples where it is largest.

    None of it where the steps of the channel are as large.
    """
    best = 0.0
    for row in range(len(fit.record.channels)):
        part = np.abs(trial.plain_direction[: fit.plain.rows][fit.whitener.channel == row]) * fit.whitener.sigma[row]
        if not np.any(part):
            continue
        count = max(10, len(part) // 10)
        largest = np.partition(part, -count)[-count:]
        level = np.sqrt(np.mean((fit.record.target[row] * fit.record.weight[row])[fit.record.mask] ** 2))
        size = float(np.sqrt(np.mean(largest**2)))
        if size > fit.record.coarse[row]:
            best = max(best, size / max(level, 1e-300))
    return best


def _weighted(fit: Fitted) -> dict[str, float]:
    """Rms residual per balance; samples that the log's rate could not follow count as little as they did in the fit."""
    used = fit.record.mask
    rows = (fit.residual * fit.record.weight)[:, used]
    return dict(zip(fit.record.channels, np.sqrt(np.mean(rows**2, axis=1)).tolist(), strict=True))
