"""Friction beyond what the design believes: iron loss adds to F_c and F_v and to nothing else.

No column can tell it from the friction that is estimated beside it. But where a design names F_c and F_v, and a log
puts them well above that, the excess is either friction that grew or iron loss, and both have to be named.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import Fitted, errors
from pmsm_ctrl.diagnose.search import try_candidate
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.model import solve_model
from pmsm_ctrl.result import Estimate

__all__ = ["Excess", "friction_excess", "unexplained_excess", "with_excess"]

# Friction changes by that much from day to day; less is a parameter's deviation.
TOLERANCE = 0.2


@dataclass(frozen=True, eq=False)
class Excess:
    """Friction found above the design's, in iron loss' own parameters."""

    parameters: Mapping[str, Estimate]
    before: dict[str, tuple[float, float]]
    after: dict[str, tuple[float, float]]
    z: float
    equivalents: tuple[str, ...] = ("viscous", "coulomb")


def friction_excess(design: Design, fit: Fitted) -> Excess | None:
    """Return the excess of F_c and F_v over the design where it is beyond their tolerance; None where it is not."""
    p = design.motor.p
    present = [e.id for e in design.effects]
    if p is None or "iron_loss" in present:
        return None
    nominal = {"F_c": design.parameters("coulomb").get("F_c", 0.0), "F_v": design.parameters("viscous").get("F_v", 0.0)}
    names = fit.model.names
    if any(v <= 0.0 or s not in names for s, v in nominal.items()):
        return None
    over, sure = {}, {}
    for symbol, value in nominal.items():
        k = names.index(symbol)
        over[symbol] = float(fit.plain.values[k] - value)
        sure[symbol] = float(fit.plain.stderr[k])
    high = [s for s in over if over[s] > TOLERANCE * nominal[s] and over[s] > 4.0 * sure[s]]
    low = [s for s in over if over[s] < -0.05 * nominal[s] and over[s] < -4.0 * sure[s]]
    if not high or low:
        return None
    held = fit.plain.values.copy()
    for symbol, value in nominal.items():
        held[names.index(symbol)] = value
    parameters = {
        "T_h": Estimate(max(over["F_c"], 0.0), "N m", sure["F_c"]),
        "k_e": Estimate(max(over["F_v"], 0.0) / p, "N m s/rad", sure["F_v"] / p),
    }
    before = errors(fit.record, fit.record.target - fit.model.matrix @ held)
    z = max(over[s] / sure[s] for s in high)
    rivals = _rivals(fit, nominal)
    return Excess(parameters, before, errors(fit.record, fit.residual), float(z), ("viscous", "coulomb", *rivals))


def _rivals(fit: Fitted, nominal: Mapping[str, float]) -> tuple[str, ...]:
    """Other effects that explain the excess as well, were F_c and F_v what the design says."""
    sigma = fit.model.sigma.copy()
    for symbol, value in nominal.items():
        sigma[fit.model.names.index(symbol)] = 1e-3 * value
    held = solve_model(fit.record, replace(fit.model, sigma=sigma), fit.whitener)
    gain = held.chi2 - fit.solved.chi2
    found = []
    for trial in fit.trials:
        if trial.candidate.effect.id == "iron_loss":
            continue
        other = try_candidate(fit.record, held, fit.whitener, trial.candidate)
        if other is not None and not other.wrong_sign and other.gain > gain - max(20.0, 0.01 * gain):
            found.append(trial.candidate.effect.id)
    return tuple(found)


def with_excess(design: Design, fitted: Design, excess: Excess) -> Design:
    """Return the fitted design with the design's own F_c and F_v, and the excess as iron loss."""
    for identifier in ("coulomb", "viscous"):
        fitted = fitted.with_effect(identifier, design.parameters(identifier))
    values = {s: e.value for s, e in excess.parameters.items()}
    return fitted.with_effect("iron_loss", values, {s: e.stderr for s, e in excess.parameters.items()})


def unexplained_excess(design: Design, fit: Fitted) -> str:
    """Say by how much friction is above the design's, for when iron loss is not among the candidates."""
    parts = []
    for symbol, effect, unit in (("F_c", "coulomb", "N m"), ("F_v", "viscous", "N m s/rad")):
        value, nominal = float(fit.plain.values[fit.model.names.index(symbol)]), design.parameters(effect)[symbol]
        parts.append(f"{symbol} {100 * (value / nominal - 1.0):+.0f} % ({value:.3g} {unit})")
    return f"friction is well above the design's, {', '.join(parts)}: it grew, or something not on offer looks like it"


def step_of(record: Record, excess: Excess, table: Any) -> Any:
    """Return the step that reports the excess."""
    from scipy.special import ndtr

    from pmsm_ctrl.diagnose.diagnosis import DiagnosisStep

    p = float(2.0 * ndtr(-min(excess.z, 37.0)))
    return DiagnosisStep(
        effect="iron_loss",
        equivalents=excess.equivalents,
        parameters=dict(excess.parameters),
        error_before=table(record, excess.before),
        error_after=table(record, excess.after),
        holdout_before={},
        holdout_after={},
        evidence={
            "chi2_gain": excess.z**2, "p_value": p, "p_holm": p, "blocks": 0, "block_gain": np.nan,
            "block_stderr": np.nan, "p_rank": np.nan, "material_share": np.nan,
        },
    )  # fmt: skip
