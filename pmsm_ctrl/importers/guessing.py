"""From columns to channels: names first, then what the numbers say of units and of columns without a name."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import notices as say
from pmsm_ctrl.importers.header_rate import ASSUMED_UNITS
from pmsm_ctrl.importers.motion_units import (
    DriveUnit,
    SpeedPair,
    counted_unit,
    drive_unit,
    number,
    pair_units,
    speed_unit,
)
from pmsm_ctrl.importers.names import counts_of, says_rms, unit_of, unit_spelling
from pmsm_ctrl.importers.naming import (
    AS_STATED,
    Case,
    Guess,
    fits,
    leave_constants,
    leave_untimed,
    say_gaps,
    settle,
    take_by_name,
)
from pmsm_ctrl.importers.relations import drive_balance, rate_likeness, roughness
from pmsm_ctrl.importers.rivals import alike
from pmsm_ctrl.importers.strange_units import strange_unit
from pmsm_ctrl.importers.table import Array, HeaderPeriod, Table
from pmsm_ctrl.importers.wraps import unwrapped, wrap_period
from pmsm_ctrl.log import CHANNELS
from pmsm_ctrl.section import Notice

__all__ = ["Guess", "guesses"]

NO_PERIOD = "every PERIOD ms"  # of a file whose rate nothing tells
RATE_IS_OPEN = "the rate"
FACTOR_IS_OPEN = "the factor, 2 pi over the encoder counts of a turn (or encoder_counts in the design),"
DERIVATIVE = 0.99  # correlation of travelled distance and integrated speed
MOST_PAIRED = 12  # columns that are tried in pairs
CLEARLY = 0.1  # share that is left unexplained where neither motion nor drive signal is known by name
LITTLE = 0.1  # of what a position varies, by which it differs from its reference
LITTLE_MORE = 0.02  # difference of such shares that tells nothing
EXPLAINED = 0.5  # share of a drive signal that inertia and friction leave unexplained at most
CERTAIN = 8.0  # standard errors of its inertia
POSITIONS, SPEEDS, DRIVES = ("theta", "theta_ref"), ("omega", "omega_ref"), ("i_q", "torque")


def guesses(
    table: Table, design: Design | None, stated: Mapping[str, tuple[str, int, str]]
) -> tuple[list[Guess], list[tuple[str, str]], list[Notice]]:
    """Return the proposed channels, the columns left over with what they seem to be, and the doubts.

    Parameters
    ----------
    table : Table
    design : Design, optional
    stated : mapping of str to (str, int, str)
        Channel to its mapping, column and unit, where they are known.
    """
    case = Case(table, design, stated)
    leave_constants(case)
    leave_untimed(case)
    take_by_name(case)
    if design is None and _is_linear(case):
        case.motion = "linear"
    t = _time(case)
    if t is not None:
        _by_motion(case, t)
        _units_of_motion(case, t)
        _drives(case, t)
    say_gaps(case)
    made = [_spelled(case, i) for i in case.role]
    if case.assumed:
        said = ", ".join(f"{unit} for {channel}" for channel, unit in dict.fromkeys(case.assumed))
        case.doubts.append(say.UNIT_ASSUMED(channels=[channel for channel, _ in case.assumed], units=said))
    made += [case.clock] if case.clock is not None else []
    left = [(column.label, _seen_as(case, i)) for i, column in enumerate(case.columns)
            if i not in case.role and (column.label or not column.is_text)]  # fmt: skip
    return [guess for guess in made if guess is not None], left, case.doubts


def _seen_as(case: Case, i: int) -> str:
    """Return what a column that is no channel seems to be."""
    column = case.columns[i]
    follows = any(other.group == column.group for other in case.columns[i + 1 : i + 2])
    clock = f"the time of {'the columns that follow it' if follows else 'other columns'}" if column.is_time else ""
    default = "text" if column.is_text else clock
    return case.seen_as.get(i) or default or strange_unit(column, case.motion) or "not recognised"


def _is_linear(case: Case) -> bool:
    units = [(unit_of(case.unit.get(i, "")) or ("",))[0] for i, role in case.role.items() if role in POSITIONS + SPEEDS]
    return any(si in ("m", "m/s") for si in units)


def _time(case: Case) -> Array | None:
    """Decide on the time of the columns; return it in s, None where nothing tells the rate."""
    i = case.at("t")
    if i is None:
        i = next((k for k in case.free(_group(case)) if _is_clock(case.values[k])), None)
        if i is not None:
            case.take(i, "t", "increases by equal steps")
    if i is None:
        return _rate_from_motion(case, None)
    values, stated = case.values[i], case.unit[i]
    if case.columns[i].is_date or "t" in case.stated:
        factor = 1.0 if case.columns[i].is_date else (unit_of(stated) or ("s", 1.0))[1]
        return values * factor * _factor_of(case.stated.get("t", ("",))[0])
    if stated:
        return values * (unit_of(stated) or ("s", 1.0))[1]
    step = float(np.median(np.diff(values))) if values.size > 1 else math.nan
    if step == 1.0 and float(values[0]) in (0.0, 1.0) and np.all(np.diff(values) == 1.0):
        return _rate_from_motion(case, i)
    unit = next((u for u, top in ASSUMED_UNITS if step <= top), "s")
    case.unit[i] = unit
    case.why[i].append(f"a step of {step:.6g} is one of {step * (unit_of(unit) or ('', 1.0))[1] * 1e3:.6g} ms")
    if unit != "s":
        case.assumed.append(("t", unit))
    return values * (unit_of(unit) or ("s", 1.0))[1]


def _factor_of(spec: str) -> float:
    from pmsm_ctrl.importers.mapping import FACTOR

    match = FACTOR.fullmatch(spec.strip())
    return 1.0 if match is None else -1.0 if match["minus"] else float(match["factor"])


def _group(case: Case) -> int:
    """Return the time base of the motion, or of most columns."""
    for channel in ("omega", "theta", "i_q", "torque"):
        if (i := case.at(channel)) is not None:
            return case.columns[i].group
    groups = [case.columns[i].group for i in case.usable]
    return max(set(groups), key=groups.count) if groups else 0


def _is_clock(values: Array) -> bool:
    step = np.diff(values)
    return bool(step.size > 8 and (step > 0.0).all() and np.percentile(step, 90) < 1.5 * np.percentile(step, 10))


def _rate_from_motion(case: Case, ticks: int | None) -> Array | None:
    """Find the rate from a position and a speed with units; without them it has to be stated."""
    position, speed = case.at("theta"), case.at("omega")
    label = "no time column" if ticks is None else f"'{case.columns[ticks].label}' counts samples"
    some = next((values for i, values in case.values.items() if case.columns[i].group == _group(case)), np.empty(0))
    index = np.arange(some.size, dtype=np.float64)
    period = math.nan
    if position is not None and speed is not None:
        gains = [unit_of(case.unit.get(i, "")) for i in (position, speed)]
        if gains[0] is not None and gains[1] is not None:
            factor, likeness = rate_likeness(index, _unwound(case, position), case.values[speed])
            period = factor * gains[0][1] / gains[1][1] if likeness > DERIVATIVE else math.nan
    header = case.table.header_period
    if header is not None:
        return _timed_by_header(case, ticks, header, index)
    known = math.isfinite(period) and period > 0.0
    if known:
        period = _round(period)
        case.doubts.append(say.RATE_FROM_MOTION(what=label, rate=1.0 / period))
    question = "" if known else RATE_IS_OPEN
    reasons = (label, "the period makes the speed the derivative of the position" if known else "its rate is not known")
    if ticks is None:
        case.clock = Guess(
            "t", -1, "none", f"every {number(1e3 * period)} ms" if known else NO_PERIOD, reasons, question
        )
    else:
        case.open[ticks] = question
        case.factor[ticks] = period
        case.unit[ticks] = "s"
        case.why[ticks] = list(reasons)
    if not known:
        case.doubts.append(say.NO_RATE(what=label))
        return None
    return index * period


def _timed_by_header(case: Case, ticks: int | None, header: HeaderPeriod, index: Array) -> Array:
    """Take the period that stands above the numbers; where its unit is assumed, that is a doubt."""
    reason = f"the header says '{header.text}'"
    if header.assumed:
        case.assumed.append(("t", header.assumed))
    if ticks is None:
        case.clock = Guess("t", -1, "none", header.mapping, (reason,))
    else:
        case.open[ticks] = ""
        case.factor[ticks] = header.seconds
        case.unit[ticks] = "s"
        case.why[ticks] = [reason]
    return index * header.seconds


def _round(period: float) -> float:
    """Return the period a drive has where one lies within a hundredth: a round number of us or Hz."""
    choices = [k * 10.0**e for e in range(-6, 1) for k in (1, 1.25, 2, 2.5, 4, 5, 8)] + [0.888e-3, 1.777e-3, 0.444e-3]
    best = min(choices, key=lambda one: abs(math.log(one / period)))
    return best if abs(best / period - 1.0) < 0.02 else float(f"{period:.3g}")


def _unwound(case: Case, i: int) -> Array:
    with np.errstate(all="ignore"):
        period = wrap_period(case.values[i])
    return unwrapped(case.values[i], period) if period > 0.0 else case.values[i]


def _by_balance(case: Case, t: Array) -> None:
    """Find a position or a speed that moves as a drive signal drives it, where nothing else tells the motion."""
    free = [i for i in case.free(_group(case)) if case.values[i].size == t.size][:MOST_PAIRED]
    known = next((i for name in DRIVES if (i := case.at(name)) is not None), None)
    drives = [i for i in free if _may_drive(case, i)] if known is None else [known]
    found = []
    for i in free:
        for channel, kind in (("theta", "position"), ("omega", "speed")):
            for k in drives:
                if k == i or case.commanded(i) or not fits(case.columns[i], channel):
                    continue
                one = drive_balance(t, case.values[k], **{kind: _unwound(case, i)})
                fitting = one.left < CLEARLY and one.certain > CERTAIN and one.inertia > 0.0
                # a reference is the speed that follows it, and a share of its rate, as a drive signal is
                if fitting and not alike(case.values[k], case.values[i]):
                    found.append((one.left, i, channel, k))
    if not found:
        return
    # a reference explains nearly as much as what follows it: the rougher one is measured
    found = [one for one in found if case.is_measured(one[1])] or found
    near = [one for one in found if one[0] < min(found)[0] + LITTLE_MORE]
    _, i, channel, k = max(near, key=lambda one: roughness(case.values[one[1]]))
    same = list(dict.fromkeys(one[1] for one in near if one[2:] == (channel, k)))
    i = settle(case, channel, same)
    case.take(i, channel, f"'{case.columns[k].label}' drives it as a drive signal would")
    case.doubts.append(say.FROM_PHYSICS(columns=case.columns[i].label, what="the motion"))


def _may_drive(case: Case, i: int) -> bool:
    """Whether the unit and the name of a column allow a measured torque or current."""
    return not case.commanded(i) and any(fits(case.columns[i], name) for name in DRIVES)


def _by_motion(case: Case, t: Array) -> None:
    """Find the speed of a position, or both, among the columns without a name."""
    group = _group(case)
    position, speed = case.at("theta"), case.at("omega")
    if position is not None and speed is not None:
        return
    free = [i for i in case.free(group) if case.values[i].size == t.size]
    measured = [i for i in free if not case.commanded(i)]
    positions = [position] if position is not None else [i for i in measured if fits(case.columns[i], "theta")]
    speeds = [speed] if speed is not None else [i for i in measured if fits(case.columns[i], "omega")]
    found = [
        (likeness, p, s)
        for p in positions for s in speeds
        if p != s and (likeness := rate_likeness(t, _unwound(case, p), case.values[s])[1]) > DERIVATIVE
    ]  # fmt: skip
    if not found:
        if position is None and speed is None:
            _by_balance(case, t)
        return
    p = _measured_position(case, found)
    best = max(one for one in found if one[1] == p)
    rivals = list(dict.fromkeys(s for _, q, s in found if q == p))
    s = rivals[0] if speed is not None else settle(case, "omega", rivals, np.gradient(_unwound(case, p), t))
    said = f"its derivative is '{case.columns[s].label}' (correlation {best[0]:.4f})"
    if position is None:
        case.take(p, "theta", said)
    if speed is None:
        case.take(s, "omega", f"derivative of '{case.columns[p].label}' (correlation {best[0]:.4f})")
    unnamed = [case.columns[i].label for i, old in ((p, position), (s, speed)) if old is None]
    case.doubts.append(say.FROM_PHYSICS(columns=", ".join(unnamed), what="position and speed"))


def _measured_position(case: Case, found: list[tuple[float, int, int]]) -> int:
    """Return the position that a name says is measured; of a position and its like the one that has the noise."""
    named = [one for one in found if case.is_measured(one[1])]
    p = max(named or found)[1]
    size = float(np.std(case.values[p]))
    same = [q for _, q, _ in found if case.is_measured(q) == case.is_measured(p) and _same(case, p, q, size)]
    return settle(case, "theta", list(dict.fromkeys(same)))


def _same(case: Case, p: int, q: int, size: float) -> bool:
    """Whether two columns are one quantity, measured and commanded: they differ by little of what either varies."""
    return float(np.std(case.values[p] - case.values[q])) <= LITTLE * size


def _units_of_motion(case: Case, t: Array) -> None:
    """Decide on the units of position and speed where the file states none."""
    position, speed = case.at("theta"), case.at("omega")
    if position is not None and speed is not None:
        factor, likeness = rate_likeness(t, _unwound(case, position), case.values[speed])
        if likeness > DERIVATIVE:
            pair = SpeedPair(factor, case.values[position], case.unit[position], case.unit[speed], case.motion)
            chosen = pair_units(pair, case.design)
            for i, unit, gain in ((position, chosen.position, chosen.gain), (speed, chosen.speed, 1.0)):
                if not unit_of(case.unit[i]):
                    case.unit[i] = unit
                    case.factor[i] = gain
                    case.why[i] += [f"dtheta/dt is {factor:.4g} times the speed, in raw numbers", *chosen.reasons]
                    if not chosen.only:
                        case.assumed.append((case.role[i], unit))
    for i in [k for k, role in case.role.items() if role in POSITIONS + SPEEDS and not unit_of(case.unit[k])]:
        channel = case.role[i]
        measured = case.at("theta" if channel in POSITIONS else "omega")
        if measured is not None and measured != i and unit_of(case.unit[measured]):
            case.unit[i], case.factor[i] = case.unit[measured], case.factor.get(measured, 1.0)
            case.why[i].append(f"unit as that of '{case.columns[measured].label}'")
            continue
        _unit_alone(case, i, channel)


def _unit_alone(case: Case, i: int, channel: str) -> None:
    """Decide on the unit of a position or a speed that no other column tells."""
    stated = case.unit[i]
    unit, why = speed_unit(case.values[i], channel, case.motion)
    counted = counted_unit(case.values[i], stated, channel, case.design)
    if counts_of(stated) or (counted is not None and unit in ("rad", "m")):
        unit = CHANNELS[channel][case.motion == "linear"]
        case.factor[i], why = counted or (1.0, "encoder counts, and nothing states how many make a turn")
        if counted is None:
            case.open[i] = FACTOR_IS_OPEN
    case.unit[i] = unit
    case.why[i].append(why)
    if not counts_of(stated):
        case.assumed.append((channel, unit))


def _drives(case: Case, t: Array) -> None:
    """Find the drive signal: proportional to acceleration plus friction; decide on its unit."""
    position, speed = case.at("theta"), case.at("omega")
    moving = {}
    if position is not None and case.values[position].size == t.size:
        gain = (unit_of(case.unit[position]) or ("", 1.0))[1] * case.factor.get(position, 1.0)
        moving = {"position": _unwound(case, position) * gain}
    elif speed is not None and case.values[speed].size == t.size:
        gain = (unit_of(case.unit[speed]) or ("", 1.0))[1] * case.factor.get(speed, 1.0)
        moving = {"speed": case.values[speed] * gain}
    if moving:
        _by_acceleration(case, t, moving)
    if moving and not any(case.at(name) is not None for name in DRIVES):
        tried = {
            i: drive_balance(t, case.values[i], **moving)
            for i in case.free(_group(case)) if case.values[i].size == t.size and _may_drive(case, i)
        }  # fmt: skip
        fitting = [i for i, one in tried.items() if one.left < EXPLAINED and one.certain > CERTAIN]
        if fitting:
            # the rougher of several is measured; a commanded current is smoother
            i = max(fitting, key=lambda k: roughness(case.values[k]))
            share = f"acceleration and friction explain {100 * (1 - tried[i].left):.0f} % of it"
            channel = "torque" if (unit_of(case.columns[i].unit) or ("",))[0] in ("N m", "N") else "i_q"
            case.take(i, channel, share)
            case.doubts.append(say.FROM_PHYSICS(columns=case.columns[i].label, what="the drive signal"))
            for k in fitting:
                if k != i:
                    case.seen_as[k] = f"a drive signal as well, smoother than '{case.columns[i].label}'"
    for i in [k for k, role in case.role.items() if role in (*DRIVES, "i_q_ref", "T_load")]:
        if case.role[i] in case.stated:
            continue
        same = moving if case.values[i].size == t.size else {}
        chosen = drive_unit(case.values[i], case.unit[i], case.role[i], t, same, case.design)
        _settle(case, i, chosen)


def _by_acceleration(case: Case, t: Array, moving: Mapping[str, Array]) -> None:
    """Choose between drive signals that are named alike: the one that acceleration and friction explain."""
    for channel in DRIVES:
        taken = case.at(channel)
        rivals = [i for i in case.rivals.get(taken, []) if i not in case.role] if taken is not None else []
        if taken is None or not rivals:
            continue
        tried = {
            i: drive_balance(t, case.values[i], **moving) for i in (taken, *rivals) if case.values[i].size == t.size
        }
        fitting = [i for i, one in tried.items() if one.left < EXPLAINED and one.certain > CERTAIN]
        best = min(fitting, key=lambda i: tried[i].left, default=taken)
        near = [i for i in fitting if tried[i].left < tried[best].left + LITTLE_MORE]
        if len(near) > 1:
            best = settle(case, channel, near)
        if best != taken:
            case.exchange(taken, best, f"of {len(rivals) + 1} columns that are named so")
        if best in fitting:
            case.why[best].append(f"acceleration and friction explain {100 * (1 - tried[best].left):.0f} % of it")
        for i in (taken, *rivals):
            if i != best and i not in case.role:
                share = f"{100 * max(0.0, 1 - tried[i].left):.0f} %" if i in tried else "an unknown share"
                case.seen_as.setdefault(i, f"{channel} as well; acceleration and friction explain {share} of it")


def _settle(case: Case, i: int, chosen: DriveUnit) -> None:
    if chosen.channel != case.role[i] and chosen.channel not in case.role.values():
        case.role[i] = chosen.channel
    case.unit[i], case.open[i] = chosen.unit, chosen.question
    case.why[i] += chosen.reasons
    facts = {"channel": case.role[i], "column": case.columns[i].label, "unit": chosen.unit}
    if chosen.question:
        case.doubts.append(say.RATED_UNKNOWN(**facts))
    elif chosen.from_inertia:
        case.doubts.append(say.RATED_FROM_INERTIA(**facts))
    elif chosen.assumed:
        case.assumed.append((case.role[i], chosen.unit))


def _spelled(case: Case, i: int) -> Guess:
    """Return the guess with the mapping that reads this column: by name where it is the only one, else by number."""
    channel, column = case.role[i], case.columns[i]
    if channel in case.stated and case.stated[channel][0]:
        return Guess(channel, i, column.label, case.stated[channel][0], (AS_STATED,))
    same = [c for c in case.columns if c.name == column.name]
    plain = (
        column.name and len(same) == 1 and not set("[]*#") & set(column.name) and column.name[0] not in "-+.0123456789"
    )
    name = column.name if plain else f"#{i + 1}"
    unit = case.unit.get(i) or column.unit or CHANNELS[channel][case.motion == "linear"]
    if channel.startswith("i_") and unit_spelling(unit) == "A" and says_rms(column.name):
        unit = "A rms"
    if column.is_date:
        unit = "s"
    elif not case.unit.get(i):
        case.assumed.append((channel, unit))
    factor = case.factor.get(i, 1.0)
    before = f"{number(factor)} * " if factor != 1.0 else ""
    before = {RATE_IS_OPEN: "PERIOD * ", FACTOR_IS_OPEN: "FACTOR * "}.get(case.open.get(i, ""), before)
    return Guess(channel, i, column.label, f"{before}{name} [{unit}]", tuple(case.why[i]), case.open.get(i, ""))
