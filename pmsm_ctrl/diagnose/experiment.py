"""The motion that separates two effects which this log cannot: one is simulated, and the other fitted to it.

T-optimality: of a menu of motions the one where the better rival beats the other by most. Source: A. C. Atkinson,
V. V. Fedorov, Biometrika 62 (1975) 57.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.selection import Selection
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.regression.balances import make_record

__all__ = ["menu", "next_experiment", "separation"]


def menu(design: Design) -> dict[str, dict[str, float]]:
    """Return the motions to choose from, with what keeps them short.

    Parameters
    ----------
    design : Design

    Returns
    -------
    dict of str to dict of str to float
        Scenarios and their parameters, SI units.
    """
    from pmsm_ctrl.simulate.motions import Limits

    return {
        "identification": {},
        "sweep": {},
        "triangle": {},
        "creep": {"speed_min": 0.5 * Limits.of(design).length, "count": 3.0},
        "multisine": {},
        "s_curve": {},
        "reversal": {},
        "warm_up": {"duration": 60.0},
    }


def next_experiment(case: Case, selection: Selection) -> Mapping[str, Any] | None:
    """Return the motion whose outcome differs most between an accepted effect and its rival; None without rivals.

    Parameters
    ----------
    case : Case
    selection : Selection

    Returns
    -------
    dict with ``separates``, ``profile`` (empty where none separates them), ``power`` and ``why``, or None
    """
    pairs = [(step.trial.candidate.effect.id, other) for step in selection.steps for other in step.equivalents]
    pair = next((pair for pair in pairs if pair[1] in case.effects), None)
    if pair is None:
        return None
    first, second = pair
    best, power = "", 0.0
    if case.design.motor.electrical and case.design.loops is not None:
        truth = fitted_design(case.design, selection.fit)
        found = {name: separation(case, truth, name, pair) for name in menu(case.design)}
        best = max(found, key=lambda name: found[name])
        power = found[best]
    needs = f"{first} needs {case.effects[first].needs}"
    answer = {"separates": [first, second], "profile": "", "power": power}
    if power < case.policy.separated:
        reason = case.effects[first].look_alikes.get(second, "none of the simulated motions separates them")
        return answer | {"why": f"{reason}; {needs}"}
    why = (
        f"in a simulation with {first} the fit of {second} is worse by {power:.3g} in twice the log-likelihood; {needs}"
    )
    return answer | {"profile": best, "parameters": menu(case.design)[best], "why": why}


def separation(case: Case, truth: Design, name: str, pair: tuple[str, str]) -> float:
    """Return by how much the first effect would beat the second on a motion, were the first one true.

    Parameters
    ----------
    case : Case
    truth : Design
        With the first effect.
    name : str
        Of the motion.
    pair : (str, str)
        Ids of the effects.

    Returns
    -------
    float
        Twice the log-likelihood ratio; 0 where the motion cannot be simulated.
    """
    from pmsm_ctrl.simulate import simulate
    from pmsm_ctrl.simulate.scenarios import scenario

    try:
        log = simulate(case.design, scenario(name, case.design, **menu(case.design)[name]), truth=truth, seed=1)
        believed = case.design.replace_effects(tuple(e for e in truth.effects if e.id != pair[0]))
        offered = {identifier: case.effects[identifier] for identifier in pair}
        fit = Case(believed, make_record(case.design, log), offered).fit(())
    except PmsmCtrlError:
        return 0.0
    gains = {t.candidate.effect.id: 0.0 if t.wrong_sign else t.gain for t in fit.trials}
    return max(0.0, gains.get(pair[0], 0.0) - gains.get(pair[1], 0.0))
