"""The design as the diagnosis leaves it: refitted friction, and the accepted effects with their parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import BASE, Fitted
from pmsm_ctrl.diagnose.shapes import searched
from pmsm_ctrl.regression.total_inertia import with_total_inertia
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.units import axis_unit

__all__ = ["base_parameters", "fitted_design", "fitted_parameters", "with_errors"]

Quantities = Callable[[Mapping[str, float]], Mapping[str, float]]  # of a shape and the values of its columns


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
        if group.effect.has_state:  # its other parameters hang on the one that multiplies a column
            values = dict(zip(group.symbols, fit.estimate.values[columns].tolist(), strict=True))
            found |= group.effect.structure.parameters(group.effect, dict(group.shape) | values)
        else:
            for symbol, k in zip(group.symbols, range(columns.start, columns.stop), strict=True):
                if fit.model.as_stated(k):
                    continue
                if k in fit.estimate.held:  # at a bound: no estimate, and no standard error of one
                    found[symbol] = fit.estimate.held[k]
                    stderr.pop(symbol, None)
                elif np.isfinite(fit.estimate.stderr[k]):
                    found[symbol] = float(fit.estimate.values[k])
                    stderr[symbol] = float(fit.estimate.stderr[k])
        entries[group.entry] = entry.model_copy(update={"parameters": found, "stderr": stderr})
    out = design.replace_effects(tuple(entries))
    k = fit.model.names.index("J")
    J, J_stderr = float(fit.estimate.values[k]), float(fit.estimate.stderr[k])
    out = with_total_inertia(out, J, J_stderr)
    for number, one in enumerate(fit.accepted):
        parameters = fitted_parameters(fit, number)
        values = {symbol: e.value for symbol, e in parameters.items()}
        stderr = {symbol: e.stderr for symbol, e in parameters.items() if np.isfinite(e.stderr)}
        add = out.add_effect if one.effect.repeated else out.with_effect
        out = add(one.effect.id, values, stderr)
    return out


def base_parameters(given: Design, fit: Fitted) -> dict[str, Estimate]:
    """Return inertia and linear effect parameters of a fit, with what the given design states; None where nothing.

    Parameters
    ----------
    given : Design
    fit : Fitted
        Of the design without any other effect.
    """
    nominal: float | None
    motion, stated = fit.record.prepared.motion, {entry.id for entry in given.effects}
    found = {}
    for k, name in enumerate(fit.model.names):
        group = fit.model.group_of(k)
        if name == "J":
            unit, nominal = axis_unit("kg m^2", motion), given.J
        elif group.effect is not None and group.entry >= 0:
            unit = axis_unit(group.effect.parameter(name.split("#")[0]).unit, motion)
            nominal = float(fit.model.nominal[k]) if group.effect.id in stated else None
        else:
            continue
        known = k in fit.estimate.held or fit.model.as_stated(k)
        stderr = float("nan") if known else float(fit.estimate.stderr[k])
        found[name] = Estimate(float(fit.estimate.values[k]), unit, stderr, nominal, fit.profiles.get((BASE, name)))
    return found


def fitted_parameters(fit: Fitted, number: int) -> dict[str, Estimate]:
    """Return the parameters of the accepted effect at this position, in the effect's own symbols.

    Parameters
    ----------
    fit : Fitted
    number : int
        Position among the accepted effects.
    """
    one = fit.accepted[number]
    values, stderr = with_errors(fit, number, partial(one.effect.structure.parameters, one.effect))
    motion = fit.record.prepared.motion
    return {
        p.symbol: Estimate(
            values[p.symbol],
            axis_unit(p.unit, motion),
            stderr.get(p.symbol, float("nan")),
            ends=fit.profiles.get((number, p.symbol)),
        )
        for p in one.effect.parameters
        if p.symbol in values
    }


def with_errors(fit: Fitted, number: int, of: Quantities) -> tuple[Mapping[str, float], dict[str, float]]:
    """Return quantities of the accepted effect at this position, and the standard errors of those that have one.

    Parameters
    ----------
    fit : Fitted
    number : int
        Position among the accepted effects.
    of : function of dict of str to float
        Returns the quantities from a shape and the values of the effect's columns.
    """
    one = fit.accepted[number]
    found = dict(one.shape)
    stderr: dict[str, float] = {}
    position = fit.position(number)
    linear: dict[str, int] = {}
    if position is not None:
        columns = fit.model.columns_of(position)
        linear = dict(zip(fit.model.groups[position].symbols, range(columns.start, columns.stop), strict=True))
        found |= {symbol: float(fit.estimate.values[k]) for symbol, k in linear.items()}
        stderr = {symbol: float(fit.estimate.stderr[k]) for symbol, k in linear.items()}
    if fit.covariance is not None and not set(linear.values()) & set(fit.estimate.held):
        stderr |= _with_shapes(fit, fit.covariance, number, found, linear, of)
    return of(found), {} if number in fit.rough else stderr


def _with_shapes(
    fit: Fitted,
    covariance: NDArray[np.float64],
    number: int,
    found: dict[str, float],
    linear: dict[str, int],
    of: Quantities,
) -> dict[str, float]:
    """Return the standard errors of quantities of an effect, by the slopes over what was fitted."""
    one, count = fit.accepted[number], len(fit.model.names)
    fitted = {**linear, **{name: count + k for k, (n, name) in enumerate(fit.free) if n == number}}

    def own(name: str, sign: float) -> tuple[Mapping[str, float], float]:
        """The quantities after a step of one of what was fitted, and the step in the covariance's unit."""
        if name in linear:
            step = sign * 1e-4 * (abs(found[name]) or float(np.sqrt(covariance[fitted[name], fitted[name]])))
            return of({**found, name: found[name] + step}), step
        moved = {**found, name: found[name] * float(np.exp(sign * 1e-4))}
        return of(moved), sign * 1e-4

    known = set(one.shape) - set(searched(one))
    slopes: dict[str, list[float]] = {}
    unknown: set[str] = set()  # what hangs on a shape at its bound has no standard error, as the shape itself
    for name in (*fitted, *(name for name in one.shape if name not in fitted and name not in known)):
        (ahead, plus), (back, minus) = own(name, 1.0), own(name, -1.0)
        for symbol in ahead:
            slope = (ahead[symbol] - back[symbol]) / (plus - minus)
            if name in fitted:
                slopes.setdefault(symbol, []).append(slope)
            elif slope != 0.0:
                unknown.add(symbol)
    part = covariance[np.ix_(list(fitted.values()), list(fitted.values()))]
    sizes = {symbol: float(np.sqrt(max(np.array(s) @ part @ np.array(s), 0.0))) for symbol, s in slopes.items()}
    return {symbol: float("nan") if symbol in unknown else size for symbol, size in sizes.items() if size > 0.0}
