"""A user's own effect that is one of the catalogue in everything but its names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pmsm_ctrl.effects import SIGNALS, Effect, kernel
from pmsm_ctrl.effects.structures import LogView, Search

__all__ = ["names_of", "renamed"]


def names_of(effect: Effect) -> dict[str, str]:
    """Return a new symbol for every parameter."""
    return {p.symbol: f"u_{k}" for k, p in enumerate(effect.parameters)}


def renamed(effect: Effect) -> Effect:
    """Return the effect with another id, other symbols, and the arguments of its term in another order."""
    names = names_of(effect)

    def other(symbols: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(names[symbol] for symbol in symbols)

    def mapped(values: Mapping[str, Any]) -> dict[str, Any]:
        return {names.get(symbol, symbol): value for symbol, value in values.items()}

    def search(log: LogView) -> Search:
        assert effect.search is not None
        found = effect.search(log)
        found = found if isinstance(found, Search) else Search(tuple(found))
        return replace(found, shapes=tuple(mapped(shape) for shape in found.shapes))

    roles = {role: names[symbol] for role, symbol in vars(effect.structure).items() if symbol}
    return replace(
        effect,
        id=f"own_{effect.id}",
        parameters=tuple(replace(p, symbol=names[p.symbol]) for p in effect.parameters),
        term=_term(effect, names),
        example=mapped(effect.example),
        structure=replace(effect.structure, **roles),
        amplitudes=other(effect.amplitudes),
        order=names.get(effect.order, ""),
        period=names.get(effect.period, ""),
        bends_over=names.get(effect.bends_over, ""),
        common_scale=other(effect.common_scale),
        same_as=mapped(effect.same_as),
        search=search if effect.search is not None else None,
    )


def _term(effect: Effect, names: Mapping[str, str]) -> Any:
    arguments = [name if name in SIGNALS else names[name] for name in effect.arguments]
    scope: dict[str, Any] = {"inner": effect.term}
    head = f"def term({', '.join(reversed(arguments))}):\n"
    exec(f"{head}    return inner({', '.join(arguments)})\n", scope)
    return kernel(scope["term"])
