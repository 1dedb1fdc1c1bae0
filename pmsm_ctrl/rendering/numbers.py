"""Numbers as text with sensible digits: `present.py` of every room writes its cells with these.

What rounds to zero has no sign: ``+ 0.0`` makes a zero of a negative one.
"""

from __future__ import annotations

import math

__all__ = ["fit", "number", "percent", "probability", "with_error", "with_prefix"]

_SMALLEST_P = 1e-12  # smaller p-values are not distinguished
_PREFIXES = ((1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_PREFIXABLE = ("N", "s", "A", "V", "W", "Hz", "m", "H", "rad", "Ohm")  # "kg m^2" takes no prefix


def number(value: float, digits: int = 4) -> str:
    """Return a number with this many significant digits.

    Parameters
    ----------
    value : float
    digits : int

    Returns
    -------
    str
        "-" for NaN.
    """
    return "-" if math.isnan(value) else f"{value + 0.0:.{digits}g}"


def counted(number: int, one: str, several: str = "") -> str:
    """Return a number with its noun: "1 log", "2 logs".

    Parameters
    ----------
    number : int
    one : str
    several : str
        The plural; that of `one` with an s where it is left out.

    Returns
    -------
    str
    """
    return f"{number} {one if number == 1 else several or one + 's'}"


def percent(share: float, decimals: int = 2) -> str:
    """Return a share as percent.

    Parameters
    ----------
    share : float
        1 for 100 %.
    decimals : int

    Returns
    -------
    str
        Such as "12.30 %"; "-" for NaN.
    """
    return "-" if math.isnan(share) else f"{round(100.0 * share, decimals) + 0.0:.{decimals}f} %"


def fit(share: float) -> str:
    """Return the fit of a simulation as percent, 100 % where it is exact.

    Parameters
    ----------
    share : float
        1 for 100 %; below 0 the simulation is further off than the mean of what was measured, by any factor.

    Returns
    -------
    str
        Such as "98.81 %", or "drifts away"; "-" for NaN.
    """
    return "drifts away" if share < 0.0 else percent(share)


def probability(p: float) -> str:
    """Return a p-value with two digits.

    Parameters
    ----------
    p : float

    Returns
    -------
    str
        "< 1e-12" below that; "-" for NaN.
    """
    return f"< {_SMALLEST_P:.0e}" if p < _SMALLEST_P else number(p, 2)


def with_error(value: float, stderr: float, unit: str = "", ends: tuple[float, float] | None = None) -> str:
    """Return a value rounded to the second digit of its standard error, with that error, or with its 95 % interval.

    Parameters
    ----------
    value, stderr : float
        In `unit`. A standard error that is not finite, or 0, is left out.
    unit : str
        Written behind; "1" is not.
    ends : (float, float), optional
        Of the 95 % interval, where the standard error does not tell them; infinite where the data do not bound it.
        Equal ones, of a value that could not move, are left out.

    Returns
    -------
    str
        Such as "5230 ± 260", "8.9900e-05 ± 1.2e-08 kg m^2" or "0.522 (95 %: 0.359 to 0.757)".
    """
    behind = f" {unit}" if unit not in ("", "1") else ""
    if ends is not None and ends[0] < ends[1]:
        return f"{number(value)} (95 %: {_between(*ends)}){behind}"
    if not (math.isfinite(value) and math.isfinite(stderr) and stderr > 0.0):
        return number(value) + behind
    last = math.floor(math.log10(stderr)) - 1
    first = math.floor(math.log10(max(abs(value), stderr)))
    if -3 <= first < 6:
        decimals = max(0, -last)
        return f"{round(value, -last) + 0.0:.{decimals}f} ± {round(stderr, -last):.{decimals}f}{behind}"
    return f"{round(value, -last) + 0.0:.{max(0, first - last)}e} ± {stderr:.1e}{behind}"


def _between(low: float, high: float) -> str:
    if not math.isfinite(high):
        return f"above {number(low)}" if math.isfinite(low) else "not bounded"
    return f"{number(low)} to {number(high)}" if math.isfinite(low) else f"below {number(high)}"


def with_prefix(value: float, unit: str, digits: int = 2) -> str:
    """Return a quantity with the SI prefix that suits its size.

    Parameters
    ----------
    value : float
        In `unit`.
    unit : str
        SI; a unit that takes no prefix is written with the plain number.
    digits : int
        Significant digits.

    Returns
    -------
    str
        Such as "0.41 mN m" for 0.00041 N m.
    """
    if not math.isfinite(value) or unit.split(" ")[0].split("/")[0] not in _PREFIXABLE:
        return f"{number(value, digits)} {unit}" if unit not in ("", "1") else number(value, digits)
    # a prefix is used from a tenth of its size on: 0.41 mN m, not 410 µN m
    factor, prefix = next((pair for pair in _PREFIXES if abs(value) >= 0.1 * pair[0]), _PREFIXES[-1])
    if value == 0.0:
        factor, prefix = 1.0, ""
    return f"{float(f'{value / factor:.{digits}g}') + 0.0:g} {prefix}{unit}"
