"""Friction beyond what the design believes: iron loss adds to F_c and F_v and to nothing else.

No column can tell it from the friction that is estimated beside it. But where a design names F_c and F_v, and a log
puts them well above that, the excess is either friction that increased or iron loss, and both have to be named.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import notices
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fit import Fitted, errors
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.search import try_candidate
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.regression.model import solve_model
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice

__all__ = ["Excess", "friction_excess"]

FRICTION = {"F_c": ("coulomb", "N m"), "F_v": ("viscous", "N m s/rad")}
HELD = 1e-3  # share of its value within which a friction parameter stays where it is held


@dataclass(frozen=True, eq=False)
class Excess:
    """Friction found above the design's.

    Attributes
    ----------
    effect : Effect or None
        The candidate whose columns are those of the friction; None where there is none.
    parameters : dict of symbol to Estimate
        Of that effect.
    before, after : dict of balance to (rms, share)
        Errors with the design's friction, and with what was found.
    z : float
        Standard errors of the excess.
    equivalents : tuple of str
        Effects that explain it as well.
    notice : Notice
        The excess in words, for when there is no such effect.
    """

    effect: Effect | None
    parameters: Mapping[str, Estimate]
    before: dict[str, tuple[float, float]]
    after: dict[str, tuple[float, float]]
    z: float
    equivalents: tuple[str, ...]
    notice: Notice

    def added_to(self, fitted: Design, design: Design) -> Design:
        """Return the fitted design with the friction of the design as given, and the excess as the effect.

        Parameters
        ----------
        fitted, design : Design
        """
        for identifier, _ in FRICTION.values():
            fitted = fitted.with_effect(identifier, design.parameters(identifier))
        values = {s: e.value for s, e in self.parameters.items()}
        assert self.effect is not None
        return fitted.with_effect(self.effect.id, values, {s: e.stderr for s, e in self.parameters.items()})


def friction_excess(case: Case, fit: Fitted) -> Excess | None:
    """Return the excess of F_c and F_v over the design where it is beyond their tolerance; None where it is not.

    Parameters
    ----------
    case : Case
    fit : Fitted
    """
    design, policy = case.design, case.policy
    p, names = design.motor.p, fit.model.names
    nominal = {symbol: design.parameters(effect).get(symbol, 0.0) for symbol, (effect, _) in FRICTION.items()}
    known = all(value > 0.0 and symbol in names for symbol, value in nominal.items())
    if p is None or any(e.same_as for e, _ in bound_effects(design)) or not known:
        return None
    found = {symbol: float(fit.plain.values[names.index(symbol)]) for symbol in nominal}
    over = {symbol: found[symbol] - value for symbol, value in nominal.items()}
    stderr = {symbol: float(fit.plain.stderr[names.index(symbol)]) for symbol in nominal}
    if not increased(over, stderr, nominal, policy):
        return None
    held = fit.plain.values.copy()
    for symbol, value in nominal.items():
        held[names.index(symbol)] = value
    amounts = [f"{s} {100 * (found[s] / nominal[s] - 1.0):+.0f} % ({found[s]:.3g} {FRICTION[s][1]})" for s in nominal]
    effect = next((e for e in case.effects.values() if e.same_as), None)
    return Excess(
        effect,
        {} if effect is None else _parameters(effect, over, stderr, p),
        errors(fit.record, fit.record.target - fit.model.matrix @ held),
        errors(fit.record, fit.residual),
        max(over[s] / stderr[s] for s in nominal if _high(s, over, stderr, nominal, policy)),
        ("viscous", "coulomb", *_rivals(fit, nominal, effect, policy)),
        notices.FRICTION_CHANGED(amounts=", ".join(amounts)),
    )


def _parameters(effect: Effect, over: Mapping[str, float], stderr: Mapping[str, float], p: int) -> dict[str, Estimate]:
    """Return the excess in the effect's parameters: of a column that is a multiple of that of the friction."""
    off = {q.symbol: 0.0 if q.linear else q.start for q in effect.parameters}
    out = {}
    for symbol, friction in effect.same_as.items():
        here = next(name for name, (identifier, _) in FRICTION.items() if identifier == friction)
        multiple = effect.standing({**off, symbol: 1.0}, omega=1.0, p=float(p))
        unit = effect.parameter(symbol).unit
        out[symbol] = Estimate(max(over[here], 0.0) / multiple, unit, stderr[here] / multiple)
    return out


def increased(
    over: Mapping[str, float], stderr: Mapping[str, float], nominal: Mapping[str, float], policy: Policy = POLICY
) -> bool:
    """Whether one part of the friction is well above the design's, and no part below it.

    Below is what is significantly less, by more than a wrong torque constant explains.

    Parameters
    ----------
    over, stderr, nominal : dict of symbol to float
        Excess over the nominal value, its standard error, and the nominal value.
    policy : Policy
    """
    high = any(_high(s, over, stderr, nominal, policy) for s in over)
    least = {s: max(policy.torque_constant * nominal[s], policy.sure_errors * stderr[s]) for s in over}
    return high and not any(over[s] < -least[s] for s in over)


def _high(
    s: str, over: Mapping[str, float], stderr: Mapping[str, float], nominal: Mapping[str, float], policy: Policy
) -> bool:
    return over[s] > policy.friction_change * nominal[s] and over[s] > policy.sure_errors * stderr[s]


def _rivals(fit: Fitted, nominal: Mapping[str, float], effect: Effect | None, policy: Policy) -> tuple[str, ...]:
    """Other effects that explain the excess as well, were F_c and F_v what the design says."""
    sigma = fit.model.sigma.copy()
    for symbol, value in nominal.items():
        sigma[fit.model.names.index(symbol)] = HELD * value
    held = solve_model(fit.record, replace(fit.model, sigma=sigma), fit.whitener)
    gain = held.chi2 - fit.solved.chi2
    found = []
    for trial in fit.trials:
        if trial.candidate.effect is effect:
            continue
        other = try_candidate(fit.record, held, fit.whitener, trial.candidate)
        if other is not None and not other.wrong_sign and other.gain > gain - policy.tie(gain):
            found.append(trial.candidate.effect.id)
    return tuple(found)
