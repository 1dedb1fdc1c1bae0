"""Whether the function of an own effect is a number wherever an axis can be: one that is not is refused at once."""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

import numpy as np

from pmsm_ctrl.errors import RequestError

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["place_of", "refusal", "require_sound", "value_at"]

# Values of signals between which a term is tried: both signs, and zero.
_TRIED: dict[str, tuple[float, ...]] = {
    "omega": (-10.0, 0.0, 10.0), "theta": (-2.0, 0.0, 2.0), "torque": (-1.0, 0.0, 1.0), "t": (0.0, 10.0), "p": (4.0,),
    "i_d": (-1.0, 0.0, 1.0), "i_q": (-1.0, 0.0, 1.0), "di_d": (-100.0, 0.0, 100.0), "di_q": (-100.0, 0.0, 100.0),
    "twist": (-1e-3, 0.0, 1e-3), "twist_rate": (-0.1, 0.0, 0.1), "zeta": (-0.5, 0.0, 0.5), "travel": (-1e-5, 0.0, 1e-5),
    "limit": (0.5, 1.0), "direction": (-1.0, 0.0, 1.0),
}  # fmt: skip
_MOST = 6  # signals of which every combination is tried; of more the others keep one value
# Effects that were tried: a design asks for its effects often.
_SOUND: WeakSet[Any] = WeakSet()


def require_sound(effect: Effect, place: str = "") -> None:
    """Refuse an own effect whose term fails or is not finite at some value of its signals.

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
    own = _parameters(effect)
    free = effect.signals[:_MOST]
    for tried in itertools.product(*(_TRIED[name] for name in free)):
        at = {name: _TRIED[name][-1] for name in effect.signals} | dict(zip(free, tried, strict=True))
        if at.get("omega") and "direction" in at and at["direction"] != math.copysign(1.0, at["omega"]):
            continue  # a moving axis has the direction of its speed
        if found := _fault(effect, at | own):
            raise refusal(effect, at | own, found, place)
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


def place_of(effect: Effect) -> str:
    """Return the file of an effect's term as a message begins with it; empty where it was typed at a prompt."""
    name = effect.py_term.__code__.co_filename
    return "" if name.startswith("<") else f"{Path(name).name}: "


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
