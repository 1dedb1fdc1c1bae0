"""Dry friction through a reversal: the share of its level that acts in each sample.

The speed is smoothed before it is differentiated. Dry friction puts a kink into it where the direction changes, so that
the smoothed speed crosses zero up to a millisecond late, always late. In the torque balance this looks like a delay, a
spring or a gap. A shaft that reverses slowly also sticks for a while. So each reversal is simulated with the measured
torque, from the speed before it, which the kink does not affect, to the speed after it.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.presliding import effect as presliding
from pmsm_ctrl.evidence.noise import stretches
from pmsm_ctrl.kernels import inlined, kernel
from pmsm_ctrl.regression.filters import shifted

__all__ = ["REACHES", "ROUNDED", "as_sampled", "bend", "reversals", "timed_sign"]

Array = NDArray[np.float64]

REST = 4  # times what the smoothing mixes: a shaft that does not move for longer rests
LONGEST = 30  # times what the smoothing mixes: what goes on for longer is no reversal
MOST_TURNS = 2  # in a row, close together: of more, nobody knows from two unknowns which way the shaft goes when
# Share of the rounded kink that stays as an error of the moment of reversal; samples up to which it is smaller than
# what steps of the torque, and turns beside this one, make of a reversal that is followed.
ROUNDED, CLEAR = 0.15, 0.25
REACHES = np.geomspace(1e-4, 0.1, 31)  # of the travel, by which friction bends before it slides
MOST_BETWEEN = 3  # samples, of a reversal that is followed; a shaft whose friction balances the drive for longer rests
LEVELS = (0.5, 2.5)  # friction at the reversal over its usual level
CLOSE = 1e-8  # of the speed, and of the travel, by which the usual friction would change them in all that time
ROUNDS = 20  # of either search at most; four are usual


def bend(angle: Array, share: float, elastic: float = 1.0) -> Array:
    """Return the friction of a spring that slides, as a share of its level, shape (n,).

    Parameters
    ----------
    angle : array, shape (n,)
    share : float
        Of the travel, over which it reaches.
    elastic : float
        Share of the level from which on it slides in part: 1 is a spring that slides as a whole.
    """
    from pmsm_ctrl.kernels.springs import slider

    angle, reach, out = np.ascontiguousarray(angle), share * float(np.ptp(angle)), np.empty(len(angle))
    if elastic < 1.0:
        symbols = (p.symbol for p in presliding.parameters)  # deflection, elastic share, damping
        values = dict(zip(symbols, (reach, elastic, 0.0), strict=True))
        return presliding.structure.memory_along(presliding, values, np.zeros_like(angle), angle)[:, 0]
    slider(angle, reach, out)
    return out / reach


def timed_sign(omega: Array) -> Array:
    """Sign of the speed whose area is right where it changes between two samples."""
    sign = np.sign(omega)
    turns = np.flatnonzero(sign[:-1] * sign[1:] < 0.0)
    return _placed(sign, turns, turns + omega[turns] / (omega[turns] - omega[turns + 1]))


def _placed(sign: Array, turns: NDArray[np.intp], places: Array) -> Array:
    """Let a sign that changes after these samples do so at these places: the nearest sample makes the area right."""
    out = sign.copy()
    for near in range(-1, 3):
        at = turns + near
        inside = (at >= 0) & (at < len(sign))
        out[at[inside]] = (sign[turns] * np.clip(2.0 * (places - at), -1.0, 1.0))[inside]
    return out


def as_sampled(direction: Array, omega: Array, moment: float | None, finer: int = 1, moved: float = 0.0) -> Array:
    """Return the direction at the instants of the log's samples, so many periods after the speed's change of sign.

    Where the shaft rests it stays; without a moment, everywhere.

    Parameters
    ----------
    direction, omega : array, shape (n,)
    moment : float or None
        Periods of the log.
    finer : int
        Samples that the log had for one of these: it was low-passed and thinned, and a step keeps its place.
    moved : float
        Periods of the log by which what has the step was moved to earlier times.
    """
    if moment is None:
        return direction
    resting = np.zeros(len(omega), dtype=np.bool_)
    for piece in stretches(np.abs(direction) < 1.0):
        resting[piece] = piece.stop - piece.start > MOST_BETWEEN
    later = shifted(omega, 1.0, -moment / finer)
    seen = np.sign(later)
    if finer > 1 or moved % 1.0:
        turns = np.flatnonzero(seen[:-1] * seen[1:] < 0.0)
        place = finer * (turns + later[turns] / (later[turns] - later[turns + 1]))  # in periods of the log
        seen = _placed(seen, turns, (np.floor(place + moved) + 0.5 - moved) / finer)
    return np.where(resting, direction, seen)


def reversals(
    direction: Array, resting: NDArray[np.bool_], omega: Array, ends: tuple[Array, Array], torque: Array, J: float,
    period: float, reach: int,
) -> tuple[list[slice], list[slice]]:  # fmt: skip
    """Overwrite `direction` around every reversal by what a shaft with dry friction would do there.

    Returns the stretches in which the shaft stops, or nearly, and goes on as before, and those in which it turns many
    times in a row: its direction is not known in either.

    Parameters
    ----------
    direction : array, shape (n,)
        Friction as a share of its level; changed in place.
    resting : bool array, shape (n,)
        Samples at which the shaft rests.
    omega : array, shape (n,)
        Smoothed speed.
    ends : (array, array), shape (n,)
        Speed and position before and after a reversal, in the band of the torque.
    torque : array, shape (n,)
        What drives the axis less everything but dry friction, as a share of its level.
    J : float
        Inertia over the level of dry friction, s^2.
    period : float
        s.
    reach : int
        Samples on either side that the smoothing of the speed mixes.
    """
    longest = reach * (2 + LONGEST)
    speed, theta = ends[0].copy(), ends[1]
    share = np.empty(longest)
    unknown, shaken = [], []
    for first, last, start, stop in _uncertain(omega, resting, J, period, reach):
        if start < 0 or stop > len(omega):
            continue
        moving = np.sign(omega[first : last + 1][~resting[first : last + 1]])
        turns = np.count_nonzero(moving[:-1] != moving[1:])
        told = reach + 2 < stop - start <= longest and turns <= MOST_TURNS and not resting[stop - 1]
        if not told:
            shaken.append(slice(start, stop))
            continue
        driven = torque[start:stop]
        if resting[start] and not turns:
            found = left_rest(speed[stop - 1], driven, J, period, share)
        else:
            speed[start] *= not resting[start]
            found = turned(speed[start:stop], theta[start:stop], driven, J, period, share)
        if found:
            direction[start + 1 : stop - 1] = share[1 : stop - start - 1]
        elif resting[start] or omega[start] * omega[stop - 1] > 0.0:
            unknown.append(slice(start, stop))
    return unknown, shaken


def _uncertain(
    omega: Array, resting: NDArray[np.bool_], J: float, period: float, reach: int
) -> Iterator[tuple[int, int, int, int]]:
    """Yield first and last sample of what is uncertain, and from where to where it is followed.

    Of turns close together the smoothed speed tells the fast ones. The others are followed to halfway to their
    neighbours, and two of which one is slow, or those that are all slow, as one.
    """
    needed = ROUNDED * 2.0 / J * reach * period / (2.0 * np.pi) / CLEAR  # change of the speed in a sample
    for first, last in _parts(omega, resting, reach):
        turns = first + np.flatnonzero(omega[first:last] * omega[first + 1 : last + 1] < 0.0)
        slow = np.abs(omega[turns + 1] - omega[turns]) < needed
        for k, (this, then) in enumerate(itertools.pairwise(turns.tolist())):
            if then - this < reach or np.max(np.abs(omega[this + 1 : then + 1])) < 0.5 * reach * needed:
                slow[k : k + 2] = True  # what lies in between is no longer, or no faster, than what smoothing makes
        as_one = len(turns) < 2 or slow.all() or (len(turns) <= MOST_TURNS and slow.any())
        if as_one or resting[first : last + 1].any():
            yield first, last, first - reach, last + reach + 1
            continue
        apart = np.minimum(np.diff(turns, prepend=turns[0] - 2 * reach, append=turns[-1] + 2 * reach) // 2, reach)
        for turn, before, after in zip(turns[slow], apart[:-1][slow], apart[1:][slow], strict=True):
            yield int(turn), int(turn) + 1, int(turn - before), int(turn + after) + 2


def _parts(omega: Array, resting: NDArray[np.bool_], reach: int) -> Iterator[tuple[int, int]]:
    """Yield first and last sample of what is uncertain: reversals, and what is beside a rest that no filter bridges.

    How an axis stops without turning back needs no simulation: the friction opposes the motion until it balances the
    drive.
    """
    for first, last in _events(omega, resting, reach):
        rests = [first + p.start for p in stretches(resting[first : last + 1]) if p.stop - p.start > REST * reach]
        begin, rested = first, False
        for stop in (*rests, last + 1):
            signs = np.sign(omega[begin:stop])
            turns = np.any(signs[:-1] * signs[1:] < 0.0)
            if turns or not rests or (rested and stop - begin < reach and stop <= last):
                yield begin, stop - 1
            elif rested:
                yield begin, begin
            begin, rested = stop + int(np.argmin(np.append(resting[stop : last + 1], False))), True


def _events(omega: Array, resting: NDArray[np.bool_], reach: int) -> list[tuple[int, int]]:
    """First and last sample of what is uncertain: changes of sign and rests, together where they are close."""
    sign = np.sign(omega)
    doubtful = resting.copy()
    turns = np.flatnonzero(sign[:-1] * sign[1:] < 0.0)
    doubtful[turns] = doubtful[turns + 1] = True
    found = np.flatnonzero(doubtful)
    if not len(found):
        return []
    cuts = np.flatnonzero(np.diff(found) > 2 * reach)
    firsts = found[np.concatenate([[0], cuts + 1])]
    lasts = found[np.concatenate([cuts, [len(found) - 1]])]
    return list(zip(firsts.tolist(), lasts.tolist(), strict=True))


@kernel
def turned(omega: Array, theta: Array, torque: Array, J: float, period: float, share: Array) -> bool:
    """Fill `share` for one reversal; False when no dry friction turns the shaft like that.

    Two unknowns are solved for: a missing torque, from the speed at the end, and the level of friction at low speed,
    from the travel, since more friction bends the path more.
    """
    travel, duration = theta[-1] - theta[0], (torque.size - 1) * period
    # friction delays the turn: with more of it the shaft gets further the way it drives
    way = 1.0 if omega[-1] > omega[0] else -1.0
    low, high = LEVELS
    level, missing = np.sqrt(low * high), 0.0
    tried = error = np.nan
    for _ in range(ROUNDS):
        missing, travelled = _balanced(omega, torque, missing, level, J, period, share)
        error, before = way * (travelled - travel), error
        if abs(error) < CLOSE * duration**2 / J:
            break
        if error > 0.0:
            high = level
        else:
            low = level
        tried, level = level, _between(low, high, level - error * (level - tried) / (error - before))
    return bool(abs(missing) < 0.5)


@kernel
def left_rest(end: float, torque: Array, J: float, period: float, share: Array) -> bool:
    """Fill `share` for one start from rest to the speed `end`; False when no dry friction lets the shaft leave so.

    One unknown is solved for, the friction at which the shaft leaves: in one direction a missing torque is the same.
    At rest friction balances the measured torque, whatever its level.
    """
    low, high = LEVELS
    way = 1.0 if end > 0.0 else -1.0
    level, tried, error = 1.0, np.nan, np.nan
    for _ in range(ROUNDS):
        last, _travelled = through(0.0, torque, 0.0, level, 1.0, J, period, share)
        error, before = way * (last - end), error
        if abs(error) < CLOSE * (torque.size - 1) * period / J:
            return True
        if error > 0.0:
            low = level
        else:
            high = level
        tried, level = level, _between(low, high, level - error * (level - tried) / (error - before))
    return high - low < 1e-3 and LEVELS[0] < low and high < LEVELS[1]


@kernel
def _balanced(
    omega: Array, torque: Array, missing: float, level: float, J: float, period: float, share: Array
) -> tuple[float, float]:
    """Return the torque that is missing where the last speed is met, at most one level of friction, and the travel."""
    low, high = -1.0, 1.0
    tried = error = np.nan
    travelled = 0.0
    for _ in range(ROUNDS):
        last, travelled = through(omega[0], torque, missing, level, level, J, period, share)
        error, before = last - omega[-1], error
        if abs(error) < CLOSE * (torque.size - 1) * period / J:
            break
        if error > 0.0:
            high = missing
        else:
            low = missing
        tried, missing = missing, _between(low, high, missing - error * (missing - tried) / (error - before))
    return missing, travelled


@inlined
def _between(low: float, high: float, guess: float) -> float:
    """Return a secant's guess, or the middle where there is none in between."""
    return guess if low < guess < high else 0.5 * (low + high)


@kernel
def through(
    speed: float, torque: Array, missing: float, level: float, at_rest: float, J: float, period: float, share: Array
) -> tuple[float, float]:
    """Follow a reversal; return the last speed and the travel, and in `share` the friction around every sample.

    Exact for a torque that is straight between samples: from each stop or start of the shaft to the next one. At rest,
    dry friction balances the torque up to its level. There its share is that of the level `at_rest`.
    """
    push, rate, travel = 1.0 / J, 1.0 / period, 0.0
    share[: torque.size] = 0.0
    for n in range(2 * (torque.size - 1)):  # half samples: each counts for the nearest sample
        first, second = torque[n // 2], torque[n // 2 + 1]
        slope = (second - first) * rate
        driven = missing + (first if n % 2 == 0 else 0.5 * (first + second))
        left, balanced = 0.5 * period, 0.0
        while left > 0.0:
            if speed == 0.0 and abs(driven) < level:
                bound = level if slope > 0.0 else -level
                stays = abs(driven + slope * left) <= level
                time = left if stays else (bound - driven) / slope
                balanced += (driven + 0.5 * slope * time) * time / at_rest
                driven = bound  # where the shaft leaves
            else:
                friction = level if speed > 0.0 or (speed == 0.0 and driven > 0.0) else -level
                start = push * (driven - friction)
                time, end = left, speed + (start + 0.5 * push * slope * left) * left
                if speed * end <= 0.0 or speed * (speed + 0.5 * start * left) <= 0.0:  # a parabola's control points
                    time = min(left, _stop(speed, start, push * slope))
                balanced += friction * time / level
                travel += (speed + (0.5 * start + push * slope * time / 6.0) * time) * time
                speed = end if time == left else 0.0
                driven += slope * time
            left -= time
        share[(n + 1) // 2] += balanced * rate
    return speed, travel


@inlined
def _stop(speed: float, start: float, jerk: float) -> float:
    """Return when ``speed + start t + jerk t^2 / 2`` meets zero first, after t = 0."""
    if speed == 0.0:
        return -2.0 * start / jerk if start * jerk < 0.0 else np.inf
    inside = start * start - 2.0 * jerk * speed
    closing = np.sqrt(max(inside, 0.0)) - (start if speed > 0.0 else -start)
    return 2.0 * abs(speed) / closing if inside >= 0.0 and closing > 0.0 else np.inf
