"""The catalogue: one line an effect. A user's own effect comes with the design and needs no line here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from pmsm_ctrl.design import Design, EffectEntry
from pmsm_ctrl.effects import (
    backlash,
    cogging,
    compliance,
    constant_load,
    coulomb,
    current_gain,
    current_offset,
    dead_time,
    delay,
    detent_force,
    encoder_eccentricity,
    inductance_saturation,
    iron_loss,
    load_dependent_friction,
    load_gravity,
    position_dependent_friction,
    presliding,
    quadratic_drag,
    rising_friction,
    stribeck,
    thermal_drift,
    torque_ripple,
    torque_saturation,
    unbalance,
    viscous,
    viscous_asymmetry,
    viscous_power,
)
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.soundness import require_sound
from pmsm_ctrl.errors import DesignError, NextCommand, RequestError, nearest, require_kind

__all__ = ["CATALOGUE", "bound_effects", "catalogue_of", "catalogue_with", "lookup", "require_entry"]

CATALOGUE: Mapping[str, Effect] = {
    module.effect.id: module.effect
    for module in (
        coulomb,
        viscous,
        stribeck,
        rising_friction,
        presliding,
        viscous_asymmetry,
        constant_load,
        viscous_power,
        quadratic_drag,
        load_dependent_friction,
        position_dependent_friction,
        thermal_drift,
        unbalance,
        load_gravity,
        cogging,
        torque_ripple,
        detent_force,
        torque_saturation,
        iron_loss,
        compliance,
        backlash,
        dead_time,
        inductance_saturation,
        current_offset,
        current_gain,
        encoder_eccentricity,
        delay,
    )
}


def catalogue_with(own: Iterable[Effect] = ()) -> dict[str, Effect]:
    """Return the catalogue with a user's own effects added.

    Parameters
    ----------
    own : iterable of Effect
        Effects with ids that the catalogue does not have.

    Returns
    -------
    dict of str to Effect

    Raises
    ------
    RequestError
        When an own effect takes an id that is in use, or its term is no number at some value of its signals, has no
        linear parameter, or is not linear in those it states.
    """
    effects = dict(CATALOGUE)
    for effect in own:
        if effect.id in effects:
            raise RequestError(f"own effect '{effect.id}': this id is in the catalogue already; choose another")
        require_sound(effect)
        effects[effect.id] = effect
    return effects


def catalogue_of(design: Design) -> dict[str, Effect]:
    """Return the effects that a design may name: the catalogue and the own effects that the design carries.

    Parameters
    ----------
    design : Design

    Returns
    -------
    dict of str to Effect

    Raises
    ------
    RequestError
        When an own effect takes an id that is in use, or `design` is none.
    """
    require_kind(design, Design, "design")
    return catalogue_with(design.own_effects)


def lookup(identifier: str, effects: Mapping[str, Effect] = CATALOGUE) -> Effect:
    """Return one effect by id.

    Parameters
    ----------
    identifier : str
    effects : mapping of str to Effect
        Where to look: `catalogue_of` of a design where its own effects count too.

    Returns
    -------
    Effect

    Raises
    ------
    RequestError
        For an unknown id, naming the nearest.
    """
    if identifier not in effects:
        raise RequestError(_unknown(identifier, effects), next_command=NextCommand.EFFECTS)
    return effects[identifier]


def _unknown(identifier: str, effects: Mapping[str, Effect]) -> str:
    return f"unknown effect '{identifier}'{nearest(identifier, effects)} (known: {', '.join(effects)})"


def bound_effects(design: Design) -> list[tuple[Effect, dict[str, float]]]:
    """Return the design's effects with all their parameter values, checked against their bounds.

    Parameters
    ----------
    design : Design

    Returns
    -------
    list of (Effect, dict of str to float)
        In the order of the design.

    Raises
    ------
    DesignError
        For an unknown effect or parameter, a value outside its bounds, or an order that is no whole number.
    """
    effects = catalogue_of(design)
    where = f"{design.source}: " if design.source else ""
    bound = []
    for entry in design.effects:
        effect = require_entry(design, entry, effects)
        bound.append((effect, effect.values(entry, where)))
    return bound


def require_entry(design: Design, entry: EffectEntry, effects: Mapping[str, Effect] | None = None) -> Effect:
    """Return the effect of a design's entry, whatever its values are.

    Parameters
    ----------
    design : Design
    entry : EffectEntry
    effects : mapping of str to Effect, optional
        Where to look: `catalogue_of` the design where it is left out.

    Raises
    ------
    DesignError
        For an unknown effect or parameter, or an order that is no whole number: along a line it may be any.
    """
    known = catalogue_of(design) if effects is None else effects
    where = f"{design.source}: " if design.source else ""
    if entry.id not in known:
        message = f"{where}effects: {_unknown(entry.id, known)}"
        raise DesignError(message, next_command=NextCommand.EFFECTS)
    effect = known[entry.id]
    effect.require_names(entry, where)
    order = entry.parameters.get(effect.order, 1.0)
    if design.motion == "rotary" and math.isfinite(order) and not float(order).is_integer():
        place = f"{where}effects.{entry.id}.{effect.order}"
        raise DesignError(f"{place}: found {order:g}; a whole number of periods in a turn was expected")
    return effect
