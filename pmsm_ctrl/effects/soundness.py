"""Whether an own effect's function is a number wherever an axis can be, and linear where it says so.

One that is not is refused at once: the regression would take it for something else, or for nothing.
"""

from __future__ import annotations

import itertools
import math
import random
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

import numpy as np

from pmsm_ctrl.errors import RequestError

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["place_of", "refusal", "repeats", "require_sound", "value_at"]

# Values of signals between which a term is tried: both signs, and zero.
_TRIED: dict[str, tuple[float, ...]] = {
    "omega": (-10.0, 0.0, 10.0), "theta": (-2.0, 0.0, 2.0), "torque": (-1.0, 0.0, 1.0), "t": (0.0, 10.0), "p": (4.0,),
    "i_d": (-1.0, 0.0, 1.0), "i_q": (-1.0, 0.0, 1.0), "di_d": (-100.0, 0.0, 100.0), "di_q": (-100.0, 0.0, 100.0),
    "twist": (-1e-3, 0.0, 1e-3), "twist_rate": (-0.1, 0.0, 0.1), "zeta": (-0.5, 0.0, 0.5), "travel": (-1e-5, 0.0, 1e-5),
    "limit": (0.5, 1.0), "direction": (-1.0, 0.0, 1.0),
}  # fmt: skip
_MOST = 6  # signals of which every combination is tried; of more the others keep one value
# Draws of signals and parameters at which a linear term is tried, and by how much of itself it may be off: rounding.
_DRAWS, _ROUNDING = 16, 1e-9
# The same a period further on, where a sine loses digits.
_TURNED = 1e-6
# Effects that were tried: a design asks for its effects often.
_SOUND: WeakSet[Any] = WeakSet()


def require_sound(effect: Effect, place: str = "") -> None:
    """Refuse an own effect that no regression evaluates, or whose term is no number somewhere, or not linear as stated.

    Parameters
    ----------
    effect : Effect
    place : str
        What the message begins with; the file of the term where it is left out.

    Raises
    ------
    RequestError
        With the values of the signals and the parameters there.
    """
    if effect in _SOUND:
        return
    _require_column(effect, place or place_of(effect))
    own = _parameters(effect)
    free = effect.signals[:_MOST]
    for tried in itertools.product(*(_TRIED[name] for name in free)):
        at = {name: _TRIED[name][-1] for name in effect.signals} | dict(zip(free, tried, strict=True))
        if at.get("omega") and "direction" in at and at["direction"] != math.copysign(1.0, at["omega"]):
            continue  # a moving axis has the direction of its speed
        if found := _fault(effect, at | own):
            raise refusal(effect, at | own, found, place)
    _require_linear(effect, place or place_of(effect))
    _SOUND.add(effect)


def refusal(effect: Effect, values: Mapping[str, float], found: str, place: str = "") -> RequestError:
    """Return the error of a term that is no number, in one line.

    Parameters
    ----------
    effect : Effect
    values : mapping of str to float
        Of every argument of the term.
    found : str
        "nan", "inf", or what Python said.
    place : str
        The file; that of the term where it is left out.
    """
    at = ", ".join(f"{name} = {values[name]:.6g}" for name in effect.arguments)
    what = "is not finite" if found in ("nan", "inf", "-inf") else "fails"
    function = effect.py_term.__name__
    place = place or place_of(effect)
    return RequestError(f"{place}effect '{effect.id}': function '{function}' {what} at {at or 'any time'}: {found}")


def value_at(effect: Effect, values: Mapping[str, float]) -> Any:
    """Return what the term of an effect gives in plain Python.

    Parameters
    ----------
    effect : Effect
    values : mapping of str to float
        Of every argument of the term.

    Raises
    ------
    RequestError
        When it overflows, or divides by zero, or leaves the domain of a function.
    """
    try:
        return effect.py_term(*(values[name] for name in effect.arguments))
    except (ArithmeticError, ValueError) as error:
        raise refusal(effect, values, str(error)) from error


def repeats(effect: Effect, signal: str, period: float) -> bool:
    """Return whether the term of an effect varies over a signal, and is the same a period further on.

    Parameters
    ----------
    effect : Effect
    signal : str
        One that the term reads.
    period : float
        Of that signal, in its unit.

    Returns
    -------
    bool
    """
    draw, own, varies = random.Random(1), _parameters(effect), False
    for _ in range(_DRAWS):
        at = own | {name: draw.uniform(min(_TRIED[name]), max(_TRIED[name])) for name in effect.signals}
        start, within, behind = (
            _numbers(effect, at | {signal: at[signal] + share * period}) for share in (0.0, draw.random(), 1.0)
        )
        if any(abs(a - b) > _TURNED * (abs(a) + abs(b)) for a, b in zip(start, behind, strict=False)):
            return False
        varies |= any(abs(a - b) > _TURNED * (abs(a) + abs(b)) for a, b in zip(start, within, strict=False))
    return varies


def place_of(effect: Effect) -> str:
    """Return the file of an effect's term as a message begins with it; empty where it was typed at a prompt."""
    name = effect.py_term.__code__.co_filename
    return "" if name.startswith("<") else f"{Path(name).name}: "


def _require_column(effect: Effect, place: str) -> None:
    """Refuse an effect of which a regression has no column: whatever its values, it would count as nothing there."""
    if effect.linear or effect.structure.symbols(effect):
        return
    known = ", ".join(p.symbol for p in effect.parameters)
    raise RequestError(
        f"{place}effect '{effect.id}': no parameter multiplies its term, so that no regression would evaluate it; "
        f"at least one Parameter(..., linear=True) was expected" + (f" (its parameters: {known})" if known else "")
    )


def _require_linear(effect: Effect, place: str) -> None:
    """Refuse a term that is not linear in its linear parameters: f(x + y) = f(x) + f(y), the others held."""
    if not effect.linear:
        return
    draw = random.Random(1)
    held = {name: value for name, value in _parameters(effect).items() if not effect.parameter(name).linear}
    for _ in range(_DRAWS):
        at = {name: draw.uniform(min(_TRIED[name]), max(_TRIED[name])) for name in effect.signals}
        if "direction" in at:
            at["direction"] = math.copysign(1.0, at.get("omega", at["direction"]))
        x, y = ({p.symbol: _drawn(draw, p.lower, p.upper) for p in effect.linear} for _ in range(2))
        both = {name: x[name] + y[name] for name in x}
        whole, one, other = (_numbers(effect, at | held | values) for values in (both, x, y))
        off = [(a, b + c) for a, b, c in zip(whole, one, other, strict=False) if _apart(a, b + c, abs(b) + abs(c))]
        if off:
            name = effect.py_term.__name__
            where = ", ".join(f"{key} = {(at | held)[key]:.4g}" for key in effect.arguments if key in at | held)
            given = [", ".join(f"{key} = {value:.4g}" for key, value in values.items()) for values in (x, y, both)]
            raise RequestError(
                f"{place}effect '{effect.id}': function '{name}' is not linear in {', '.join(x)} as stated: "
                f"{f'at {where} ' if where else ''}it gives {off[0][0]:.4g} for {given[2]}, but {off[0][1]:.4g} is the "
                f"sum of {given[0]} and {given[1]}; linear=True is for a parameter that only multiplies"
            )


def _drawn(draw: random.Random, lower: float, upper: float) -> float:
    """Return a value of a linear parameter, of a sign that its bounds allow."""
    size = draw.uniform(0.5, 1.5)
    negative = upper <= 0.0 or (lower < 0.0 and draw.random() < 0.5)
    return -size if negative else size


def _numbers(effect: Effect, values: Mapping[str, float]) -> list[float]:
    """Return what the term gives, nothing where it fails: that is said elsewhere, by the compiler or on a log."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return [float(part) for part in np.atleast_1d(effect.py_term(*(values[name] for name in effect.arguments)))]
    except Exception:
        return []


def _apart(a: float, b: float, size: float) -> bool:
    return math.isfinite(a) and math.isfinite(size) and abs(a - b) > _ROUNDING * max(abs(a), size)


def _parameters(effect: Effect) -> dict[str, float]:
    """Return values with which an effect acts: its example, or start values, and 1 for a column."""
    values = {}
    for one in effect.parameters:
        value = effect.example.get(one.symbol, one.start)
        values[one.symbol] = value if value != 0.0 or not one.linear else min(max(1.0, one.lower), one.upper)
    return values


def _fault(effect: Effect, values: Mapping[str, float]) -> str:
    """Return what is wrong with the term here; empty where it is finite, or fails in a way that the compiler names."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            result = effect.py_term(*(values[name] for name in effect.arguments))
    except (ArithmeticError, ValueError) as error:
        return str(error) or type(error).__name__
    except Exception:
        return ""
    parts = result if isinstance(result, tuple | list) else (result,)
    if any(isinstance(part, complex) for part in parts):
        return "a complex number"
    bad = [part for part in parts if isinstance(part, int | float) and not math.isfinite(part)]
    return str(float(bad[0])) if bad else ""
