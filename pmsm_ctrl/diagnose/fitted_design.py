"""The design as the diagnosis leaves it: refitted friction, and the accepted effects with their parameters."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.units import axis_unit

__all__ = ["fitted_design", "fitted_parameters", "position_of"]


def fitted_design(design: Design, fit: Fitted) -> Design:
    """Return the design with refitted friction and the accepted effects; the winding stays the datasheet's.

    Parameters
    ----------
    design : Design
    fit : Fitted
    """
    entries = list(design.effects)
    for position, group in enumerate(fit.model.groups):
        if group.entry < 0 or group.effect is None:
            continue
        columns = fit.model.columns_of(position)
        entry = entries[group.entry]
        found, stderr = dict(entry.parameters), dict(entry.stderr)
        if not group.effect.has_state:
            for symbol, k in zip(group.symbols, range(columns.start, columns.stop), strict=True):
                if k in fit.estimate.held:  # at a bound: no estimate, and no standard error of one
                    found[symbol] = fit.estimate.held[k]
                    stderr.pop(symbol, None)
                elif np.isfinite(fit.estimate.stderr[k]):
                    found[symbol] = float(fit.estimate.values[k])
                    stderr[symbol] = float(fit.estimate.stderr[k])
        entries[group.entry] = entry.model_copy(update={"parameters": found, "stderr": stderr})
    out = design.replace_effects(tuple(entries))
    J = dict(zip(fit.model.names, fit.estimate.values, strict=True))["J"]
    if design.load.J / design.load.gear**2 < J:
        out = out.with_parameters(J=float(J))
    for number, one in enumerate(fit.accepted):
        parameters = fitted_parameters(fit, number)
        values = {symbol: e.value for symbol, e in parameters.items()}
        stderr = {symbol: e.stderr for symbol, e in parameters.items() if np.isfinite(e.stderr)}
        add = out.add_effect if one.effect.repeated else out.with_effect
        out = add(one.effect.id, values, stderr)
    return out


def fitted_parameters(fit: Fitted, number: int) -> dict[str, Estimate]:
    """Return the parameters of the accepted effect at this position, in the effect's own symbols.

    Parameters
    ----------
    fit : Fitted
    number : int
        Position among the accepted effects.
    """
    one = fit.accepted[number]
    found = dict(one.shape)
    stderr: dict[str, float] = {}
    position = position_of(fit, number)
    if position is not None:
        columns = fit.model.columns_of(position)
        symbols = fit.model.groups[position].symbols
        found |= dict(zip(symbols, fit.estimate.values[columns].tolist(), strict=True))
        stderr = dict(zip(symbols, fit.estimate.stderr[columns].tolist(), strict=True))
    values = one.effect.structure.parameters(one.effect, found)
    motion = fit.record.prepared.motion
    return {
        p.symbol: Estimate(values[p.symbol], axis_unit(p.unit, motion), stderr.get(p.symbol, float("nan")))
        for p in one.effect.parameters
        if p.symbol in values
    }


def position_of(fit: Fitted, number: int) -> int | None:
    """Return where the accepted effect stands among the model's groups; None where it has no columns of its own.

    Parameters
    ----------
    fit : Fitted
    number : int
        Position among the accepted effects.
    """
    if fit.accepted[number].effect.structure.replaces_direction:
        return None
    wired = [k for k, a in enumerate(fit.accepted) if not a.effect.structure.replaces_direction]
    return len(fit.model.groups) - len(wired) + wired.index(number)
