"""The experiment that would separate what this log cannot: simulate one rival, ask how well the other imitates it.

T-optimality: of a menu of motions the one where the better rival beats the other by most. Source: A. C. Atkinson,
V. V. Fedorov, Biometrika 62 (1975) 57.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import fit_design
from pmsm_ctrl.diagnose.selection import Selection
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.regression.balances import make_record

__all__ = ["MENU", "next_experiment", "separation"]

# Motions to choose from, with what keeps them short.
MENU: Mapping[str, Mapping[str, float]] = {
    "identification": {},
    "sweep": {},
    "triangle": {},
    "creep": {"speed_min": 0.5, "count": 3.0},
    "multisine": {},
    "s_curve": {},
    "reversal": {},
    "warm_up": {"duration": 60.0},
}
# Log-likelihood (twice) by which one rival must beat the other before they count as separated.
SEPARATED = 30.0


def next_experiment(
    design: Design, fitted: Design, selection: Selection, effects: Mapping[str, Effect]
) -> Mapping[str, Any] | None:
    """Return the motion whose outcome differs most between an accepted effect and its rival; None without rivals."""
    pair = _rivals(selection, effects)
    if pair is None:
        return None
    first, second = pair
    best, power = "", 0.0
    if design.motor.electrical and design.loops is not None:
        for name in MENU:
            found = separation(design, fitted, name, pair, effects)
            if found > power:
                best, power = name, found
    if power < SEPARATED:
        need = effects[first].look_alikes.get(second, "no motion of the menu separates them")
        return {
            "separates": [first, second], "profile": "", "power": power,
            "why": f"{need}; {first} needs {effects[first].needs}",
        }  # fmt: skip
    why = (
        f"simulated with {first}, this motion would leave {second} {power:.3g} behind in twice the log-likelihood; "
        f"{first} needs {effects[first].needs}"
    )
    return {"separates": [first, second], "profile": best, "parameters": dict(MENU[best]), "power": power, "why": why}


def _rivals(selection: Selection, effects: Mapping[str, Effect]) -> tuple[str, str] | None:
    for step in selection.steps:
        for other in step.equivalents:
            if other in effects:
                return step.trial.candidate.effect.id, other
    return None


def separation(
    design: Design, fitted: Design, name: str, pair: tuple[str, str], effects: Mapping[str, Effect],
) -> float:  # fmt: skip
    """Return by how much the first effect would beat the second on this motion, were the first one true."""
    from pmsm_ctrl.simulate import simulate
    from pmsm_ctrl.simulate.scenarios import scenario

    try:
        motion = scenario(name, design, **MENU[name])
        log = simulate(design, motion, truth=fitted, seed=1)
        others = tuple(e for e in fitted.effects if e.id != pair[0])
        record = make_record(design, log)
        offered = {identifier: effects[identifier] for identifier in pair}
        fit = fit_design(design.replace_effects(others), record, (), offered)
    except PmsmCtrlError:
        return 0.0
    gains = {t.candidate.effect.id: 0.0 if t.wrong_sign else t.gain for t in fit.trials}
    return max(0.0, gains.get(pair[0], 0.0) - gains.get(pair[1], 0.0))
