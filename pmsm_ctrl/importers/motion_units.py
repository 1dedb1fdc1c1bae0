"""Units that a file does not state, from what its numbers say: factors, encoder counts, wraps and the inertia."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers.names import counts_of, unit_of, unit_spelling
from pmsm_ctrl.importers.relations import drive_balance
from pmsm_ctrl.importers.table import Array
from pmsm_ctrl.importers.timebase import quantum
from pmsm_ctrl.importers.wraps import wrap_period

__all__ = ["Chosen", "DriveUnit", "SpeedPair", "counted_unit", "drive_unit", "number", "pair_units", "speed_unit"]

FITS = 0.03  # of a factor; a filtered speed and a coarse encoder leave that much
LIKELY = 2.0  # times the design's inertia, within which a unit fits
FAR, PERCENT = 10.0, (3.0, 500.0)  # times the inertia, and largest values, of what may be per cent of a rated value
PAIRS = {
    "rotary": (
        ("rad", "rad/s"), ("deg", "rpm"), ("deg", "deg/s"), ("rad", "rpm"), ("rev", "rpm"), ("rev", "rev/s"),
        ("deg", "rad/s"), ("rad", "deg/s"), ("rev", "rad/s"), ("rad", "rev/s"),
    ),
    "linear": (("m", "m/s"), ("mm", "mm/s"), ("mm", "m/s"), ("mm", "m/min"), ("um", "mm/s"), ("mm", "mm/min")),
}  # fmt: skip
WHOLE = 100.0  # span of whole numbers from which a position without a unit is one of encoder counts
COUNTED = ("rpm", "rad/s", "rev/s", "deg/s")
TURN = {"rad": 2.0 * math.pi, "deg": 360.0, "rev": 1.0}


@dataclass(frozen=True)
class SpeedPair:
    """A position and its speed: the raw factor between them, the position's numbers, and the units that are stated."""

    factor: float
    position: Array
    position_unit: str
    speed_unit: str
    motion: str


@dataclass(frozen=True)
class Chosen:
    """Units of a position and a speed, a factor before the position's, whether they alone fit, and why."""

    position: str
    speed: str
    gain: float
    only: bool
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class DriveUnit:
    """Unit of a current or a torque, and what is not known of it."""

    channel: str
    unit: str
    reasons: tuple[str, ...] = ()
    assumed: bool = False
    from_inertia: bool = False
    question: str = ""


def number(value: float) -> str:
    """Return a factor with the digits that a mapping needs."""
    return f"{value:.12g}"


def pair_units(pair: SpeedPair, design: Design | None) -> Chosen:
    """Return the units that make the speed the derivative of the position.

    Parameters
    ----------
    pair : SpeedPair
    design : Design, optional
        Its encoder counts tell the unit of the position.

    Returns
    -------
    Chosen
    """
    counts = design.sensor.encoder_counts if design is not None else 0
    increments = bool(counts_of(pair.position_unit))
    stated = unit_of(pair.position_unit), unit_of(pair.speed_unit)
    fitting: list[tuple[str, str, float]] = []
    for position, speed in PAIRS[pair.motion]:
        gains = stated[0] or unit_of(position), stated[1] or unit_of(speed)
        if (
            gains[0] is None
            or gains[1] is None
            or not math.isclose(abs(pair.factor), gains[1][1] / gains[0][1], rel_tol=FITS)
        ):
            continue
        fitting.append((position if stated[0] is None else pair.position_unit,
                        speed if stated[1] is None else pair.speed_unit, 1.0))  # fmt: skip
    fitting = [] if increments else list(dict.fromkeys(fitting))
    counted = _counts(pair, stated[1] is not None, counts) if stated[0] is None and pair.motion == "rotary" else None
    if counted is not None and not fitting:
        turn, speed = counted
        said = f"{turn:.0f} counts a turn make the speed one in {speed}"
        return Chosen("rad", speed, 2.0 * math.pi / turn, counts == turn, (said,))
    if not fitting:
        return Chosen(pair.position_unit or "rad", pair.speed_unit or "rad/s", 1.0, False, ("no usual units fit",))
    if len(fitting) == 1:
        return Chosen(*fitting[0], True, ("only these units fit",))
    step, period = quantum(pair.position), wrap_period(pair.position)
    for position, speed, gain in fitting:
        turn = TURN.get(unit_spelling(position), math.nan)
        if counts and math.isfinite(step) and step > 0.0 and math.isclose(step * counts, turn, rel_tol=0.01):
            return Chosen(position, speed, gain, True, (f"a step of {step:.4g} is one of {counts} counts",))
        if period > 0.0 and math.isclose(period, turn, rel_tol=1e-3):
            return Chosen(position, speed, gain, True, (f"it wraps at {period:.6g}",))
    others = ", ".join(f"{position} and {speed}" for position, speed, _ in fitting[1:])
    return Chosen(*fitting[0], False, (f"{others} fit as well",))


def _counts(pair: SpeedPair, speed_stated: bool, known: int) -> tuple[float, str] | None:
    """Return (counts a turn, unit of the speed) where the position counts whole increments; known ones come first."""
    if not np.array_equal(pair.position, np.round(pair.position)):
        return None
    units = (pair.speed_unit,) if speed_stated else COUNTED
    for unit in units:
        gain = unit_of(unit)
        if gain is None:
            continue
        turn = abs(pair.factor) * 2.0 * math.pi / gain[1]
        usual = [2.0**k for k in range(9, 33)] + [4.0 * n for n in (500, 1000, 1024, 2000, 2500, 3600, 5000, 9000)]
        usual += [1e4, 1e5, 1e6, *([float(known)] if known else [])]
        best = min(usual, key=lambda one: abs(math.log(one / turn)))
        if math.isclose(best, turn, rel_tol=0.01):
            return best, unit
    return None


def counted_unit(values: Array, stated: str, channel: str, design: Design | None) -> tuple[float, str] | None:
    """Return the factor to rad, m or their rates of a column of encoder counts, and why; None where it is none.

    Parameters
    ----------
    values : array, shape (n,)
    stated : str
        The file's unit, or empty; without one a position of whole numbers is one.
    channel : str
    design : Design, optional
        Its encoder counts.

    Returns
    -------
    (float, str) or None
    """
    counts = design.sensor.encoder_counts if design is not None else 0
    whole = not stated and channel.startswith("theta") and np.array_equal(values, np.round(values))
    if design is None or not counts or not (counts_of(stated) or (whole and np.ptp(values) > WHOLE)):
        return None
    said = f"{counts} counts a {'metre' if design.motion == 'linear' else 'turn'}, as the design states"
    return design.encoder_step, said if stated else f"whole numbers: {said}"


def speed_unit(values: Array, channel: str, motion: str) -> tuple[str, str]:
    """Return the likeliest unit of a position or a speed that stands alone, and why.

    Parameters
    ----------
    values : array, shape (n,)
    channel, motion : str

    Returns
    -------
    (str, str)
    """
    if motion == "linear":
        return ("m", "m assumed") if channel.startswith("theta") else ("m/s", "m/s assumed")
    largest = float(np.max(np.abs(values), initial=0.0))
    if channel.startswith("theta"):
        period = wrap_period(values)
        turned = next((unit for unit, turn in TURN.items() if math.isclose(period, turn, rel_tol=1e-3)), "")
        return (turned, f"it wraps at {period:.6g}") if turned else ("rad", "rad assumed")
    if largest > 400.0 or quantum(values) == 1.0:
        return "rpm", f"rpm assumed: whole numbers or as large as {largest:.4g}"
    return "rad/s", f"rad/s assumed: no larger than {largest:.4g}"


def drive_unit(
    values: Array, stated: str, channel: str, t: Array, motion: Mapping[str, Array], design: Design | None
) -> DriveUnit:
    """Return the unit of a current or a torque; a share of a rated value needs that value.

    Parameters
    ----------
    values : array, shape (n,)
    stated : str
        The file's unit, or empty.
    channel : str
        ``i_q``, ``i_q_ref``, ``torque`` or ``T_load``.
    t : array, shape (n,)
    motion : mapping
        Speed or position in SI, as `drive_balance` takes it; empty where there is none.
    design : Design, optional
        Its inertia and torque constant tell the scale.

    Returns
    -------
    DriveUnit
    """
    linear = design is not None and design.motion == "linear"
    si = "A" if channel in ("i_q", "i_q_ref") else "N" if linear else "N m"
    found = drive_balance(t, values, **motion) if motion else None
    scale = math.nan  # SI for a unit of the file, by the design's inertia
    known = design is not None and design.motor.J is not None
    if known and design is not None and found is not None and found.certain > 8.0 and found.inertia != 0.0:
        scale = abs(design.J / found.inertia) / (design.K_t_assumed if si == "A" else 1.0)
    part = {"%": 100.0, "‰": 1000.0}.get(unit_spelling(stated))
    if part is not None:
        sign = "%" if part == 100.0 else "‰"
        if not math.isfinite(scale):
            return DriveUnit(
                channel, f"{sign} of RATED {si}", ("a share of the rated value",), question="the rated value"
            )
        rated = float(f"{part * scale:.3g}")
        why = f"{rated:g} {si} makes the inertia that of the design"
        return DriveUnit(channel, f"{sign} of {rated:g} {si}", (why,), from_inertia=True)
    if unit_of(stated) is not None:
        return DriveUnit(channel, stated)
    if not math.isfinite(scale) or channel not in ("i_q", "torque"):
        return DriveUnit(channel, si, (f"{si} assumed",), assumed=True)
    if 1.0 / LIKELY <= scale <= LIKELY:
        return DriveUnit(channel, si, (f"its inertia is {1.0 / scale:.3g} times the design's",), assumed=True)
    if 1e-3 / LIKELY <= scale <= 1e-3 * LIKELY:
        return DriveUnit(channel, f"m{si}", (f"in m{si} its inertia is near the design's",), assumed=True)
    away = f"in {si} its inertia is {1.0 / scale:.3g} times the design's"
    percent = float(np.max(np.abs(values), initial=0.0))
    if scale < 1.0 / FAR and PERCENT[0] <= percent <= PERCENT[1]:
        rated = float(f"{100.0 * scale:.3g}")
        return DriveUnit(channel, f"% of {rated:g} {si}", (away, "per cent of a rated value?"), from_inertia=True)
    return DriveUnit(channel, si, (f"{si} assumed", away), assumed=True)
