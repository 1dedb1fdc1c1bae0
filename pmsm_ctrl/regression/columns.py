"""What an effect adds to each balance, per unit of its linear parameters: columns over (balance, sample).

A torque or voltage effect adds its term. A measurement effect spoils a channel, and the balances built from that
channel are off by what follows to first order. A transmission adds what its load does differently from the rotor.
All of it is evaluated with the effect's own term; nothing of its physics is written again here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.evaluate import column, columns
from pmsm_ctrl.regression.balances import MODELLED, Memo, Record
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.motion import bristle_direction, load_behind_gap, load_behind_spring, spring_response

__all__ = [
    "Group",
    "UnavailableError",
    "as_candidate",
    "candidate_group",
    "effect_group",
    "missing_signals",
    "noise_of",
]

Array = NDArray[np.float64]


class UnavailableError(Exception):
    """This log or design cannot tell anything about an effect; the message says why."""


@dataclass(frozen=True, eq=False)
class Group:
    """Columns that stand or fall together.

    Attributes
    ----------
    effect : Effect or None
        None for what every axis has (inertia, winding).
    symbols : names of the linear parameters
    values : array, shape (channels, m, k)
    shape : the nonlinear parameters that the columns were built with
    entry : position in the design's list, or -1
    """

    effect: Effect | None
    symbols: tuple[str, ...]
    values: Array
    shape: Mapping[str, float]
    entry: int = -1


# What terms read that is no channel of a log but follows from the motion.
STATES = ("p", "zeta", "travel", "limit", "twist", "twist_rate")
ABOVE_NOISE = 4.0
# Bytes of columns that are kept from one fit to the next, roughly.
MOST_KEPT = 100e6
# Over the cutoff: for so long the low-pass before differentiation smooths the speed.
SMOOTHED = 0.1
LAGS = 3.0  # times its scale: the travel after which 95 % of a bristle's lag are over
# A scale common to all torques is the torque constant's business: no column can tell it from the parameters.
COMMON_SCALE = (("current_gain", "g"),)


def missing_signals(record: Record, effect: Effect) -> str:
    """Why the effect cannot be evaluated on this log; empty when it can."""
    motor = record.design.motor
    if effect.enters == "voltage" and "u_d" not in record.channels:
        return "it shows in the voltages alone, and this log has no u_d and u_q"
    if "p" in effect.signals and motor.p is None:
        return "the design does not know the pole pairs"
    if record.linear and ("theta" in effect.signals or effect.channels == ("theta",)):
        return "a linear axis has no known period of position"
    absent = [s for s in effect.signals if s not in record.signals and s not in STATES]
    if absent and effect.id != "delay":
        return f"the log has no {', '.join(absent)}"
    return ""


def effect_group(record: Record, effect: Effect, shape: Mapping[str, float], entry: int = -1) -> Group:
    """Return the columns of an effect on a log, its nonlinear parameters given by `shape`.

    Raises
    ------
    UnavailableError
        When the log or the design lacks what the effect needs.
    """
    why = missing_signals(record, effect)
    if why:
        raise UnavailableError(why)
    key = _key(effect, shape)
    symbols = _symbols(effect)
    memo = _memo(record, effect, key)
    if key not in memo:
        memo[key] = _build(record, effect, shape)
    return Group(effect, symbols, memo[key], dict(shape), entry)


def _memo(record: Record, effect: Effect, key: tuple[object, ...]) -> Memo:
    """Where the columns of an effect are remembered: from one fit to the next, if they follow from the motion alone."""
    if key in record.kept:
        return record.kept
    modelled = effect.channels == ("i_d", "i_q") or not MODELLED.isdisjoint(effect.signals)
    full = len(record.kept) * record.target.nbytes > MOST_KEPT
    return record.memo if modelled or full else record.kept


def _key(effect: Effect, shape: Mapping[str, float]) -> tuple[object, ...]:
    return (effect.id, id(effect.term), *sorted(shape.items()))


def _symbols(effect: Effect) -> tuple[str, ...]:
    if effect.structure == "transmission":
        return ("J_load",)
    if effect.structure == "bristle":
        return ("level",)
    return tuple(p.symbol for p in effect.linear if (effect.id, p.symbol) not in COMMON_SCALE)


def _build(record: Record, effect: Effect, shape: Mapping[str, float]) -> Array:
    if effect.structure == "transmission":
        parts = [_transmission(record, effect, shape)]
    elif effect.structure == "bristle":
        lag = bristle_direction(record, effect, shape) - record.signals["direction"]
        parts = [{"torque": lag}]
    else:
        values = {p.symbol: p.start for p in effect.parameters} | dict(shape)
        signals = term_signals(record)
        if effect.structure == "delay":
            signals |= {f"d{i}": record.slope_behind(record.signals[i]) for i in ("i_d", "i_q") if i in record.signals}
        terms, _ = columns(effect, signals, values)
        if not terms:
            raise UnavailableError("it has no parameter that multiplies a column")
        slow = _slow_enough(record, effect, shape)
        parts = [_entering(record, effect, terms[symbol] * slow, shape) for symbol in _symbols(effect)]
    filtered = effect.structure == "delay" and record.late is not None
    return record.stack_all(parts, filtered)


def _slow_enough(record: Record, effect: Effect, shape: Mapping[str, float]) -> Array | float:
    """Where an order of the angle lies below the log's Nyquist frequency; above it, it would come back as an alias.

    None of it is lost: the balances are filtered far below.
    """
    if "order" not in shape:
        return 1.0
    per_turn = shape["order"] * (record.design.motor.p or 1 if "p" in effect.signals else 1)
    return np.asarray(per_turn * np.abs(record.signals["omega"]) < 0.8 * np.pi * record.prepared.rate, dtype=float)


def candidate_group(record: Record, effect: Effect, shape: Mapping[str, float]) -> Group:
    """Return the columns by which an effect that is not in the model yet is judged, and remember no others.

    Raises
    ------
    UnavailableError
        When the log or the design lacks what the effect needs.
    """
    whole = _key(effect, shape)
    key = ("seen", *whole)
    memo = _memo(record, effect, key)
    if key in memo:
        return Group(effect, _symbols(effect), memo[key], dict(shape))
    group = effect_group(record, effect, shape)
    seen = as_candidate(record, group)
    if seen is not group:
        memo[key] = seen.values
        _memo(record, effect, whole).pop(whole, None)
    return seen


def as_candidate(record: Record, group: Group) -> Group:
    """Return the columns by which an effect that is not in the model yet is judged: nothing made of noise.

    A delay only where the torque changes faster than its noise does. The speed controller answers noise at once, so
    that noise and the slope of the torque go together, and look like a torque that comes too early.

    A load behind a spring or a gap only where it would accelerate otherwise than the shaft by more than noise. One that
    takes no part in the noise of the acceleration lowers every error, there or not.

    A friction that bends or lags only where the bend or the lag lasts for as long as the filters smooth: one that is
    over at once is an error of the moment of reversal.
    """
    if group.effect is None:
        return group
    if "w_s" in group.shape or "z_s" in group.shape:
        return replace(group, values=np.where(_over_at_once(record, group.shape)[:, None], 0.0, group.values))
    if group.effect.structure not in ("delay", "transmission"):
        return group
    values = group.values.copy()
    for part in values[0].T:
        if group.effect.structure == "delay":
            noise = noise_of(record, part)
        elif "gap" in group.shape:  # a load in contact follows the shaft nearly always
            noise = _shaft_noise(record)
        else:
            noise = _shaft_noise(record) * _resonance(record, group.shape)
        part[np.abs(part) <= ABOVE_NOISE * noise] = 0.0
    return replace(group, values=values)


def _over_at_once(record: Record, shape: Mapping[str, float]) -> NDArray[np.bool_]:
    """Where the axis accelerates so fast that a bend or a lag of its friction is over before the filters show it."""
    smoothed = SMOOTHED / record.prepared.cutoff
    alpha = np.abs(_acceleration(record))
    if "w_s" in shape:
        return np.asarray(alpha * smoothed > shape["w_s"])
    return np.asarray(0.5 * alpha * smoothed**2 > LAGS * shape["z_s"])


def _acceleration(record: Record) -> Array:
    key = ("alpha",)
    if key not in record.kept:
        record.kept[key] = record.shaped(record.signals["alpha"])
    return record.kept[key]


def _shaft_noise(record: Record) -> float:
    key = ("noise of alpha",)
    if key not in record.kept:
        record.kept[key] = np.array(noise_of(record, _acceleration(record)))
    return float(record.kept[key])


def _resonance(record: Record, shape: Mapping[str, float]) -> float:
    """What a spring makes of white noise in the band, rms: one that rings is shaken by little."""
    s = 2j * np.pi * np.linspace(0.0, record.prepared.cutoff, 4001)[1:]
    above, below = spring_response(shape["w_a"], shape["zeta"])
    return float(np.sqrt(np.mean(np.abs(np.polyval(above, s) / np.polyval(below, s)) ** 2)))


def noise_of(record: Record, values: Array) -> float:
    """Noise of a thinned signal, rms: what it holds in the upper half of the band, as a median."""
    fast = values - low_pass(values, record.rate, 0.5 * record.prepared.cutoff)
    return 1.4826 * np.sqrt(2.0) * float(np.median(np.abs(fast)))


def _entering(record: Record, effect: Effect, term: Array, shape: Mapping[str, float]) -> dict[str, Array]:
    """What a term per unit does to each balance, at the log's rate."""
    if effect.enters == "torque":
        return {"torque": term}
    if effect.enters == "voltage":
        return {"u_d": term[0], "u_q": term[1]}
    if effect.channels == ("theta",):
        return _angle(record, term, shape.get("frame", 1.0))
    if effect.structure == "delay" and record.design.motor.p is None:
        return _late_torque(record)
    return _current(record, term)


def term_signals(record: Record) -> dict[str, Array | float]:
    """Signals as the terms read them."""
    signals: dict[str, Array | float] = {k: v for k, v in record.signals.items() if k != "alpha"}
    if record.design.motor.p is not None:
        signals["p"] = float(record.design.motor.p)
    for name in ("di_d", "di_q"):
        signals.setdefault(name, np.zeros(len(record.prepared.t)))
    return signals


def _current(record: Record, wrong: Array) -> dict[str, Array]:
    """Balances built from currents that are measured less true by `wrong`, shape (2, n)."""
    s, motor = record.signals, record.design.motor
    d, q = wrong
    if motor.p is None or motor.L_d is None or motor.L_q is None or motor.R is None:
        return {"torque": record.design.K_t_assumed * q}
    i_d = s.get("i_d", np.zeros_like(d))
    salient = 1.5 * motor.p * (motor.L_d - motor.L_q)
    out = {"torque": record.design.K_t_assumed * q + salient * (i_d * q + s["i_q"] * d)}
    if "u_d" in record.channels:
        # i_q follows from the motion here and is right; the loop holds the measured i_d, so the true one is off
        out["u_d"] = -(motor.R * d + motor.L_d * record.rate_of(d))
        out["u_q"] = -motor.p * s["omega"] * motor.L_d * d
    return out


def _late_torque(record: Record) -> dict[str, Array]:
    """Delay of a log that has a torque and no currents: measured less true torque is -tau dT/dt."""
    return {"torque": -record.slope_behind(record.signals["torque"])}


def _angle(record: Record, wrong: Array, frame: float) -> dict[str, Array]:
    """Balances built from an angle that is measured less true by `wrong`, shape (n,).

    The acceleration is wrong by its second derivative, and u_q loses p psi_f times the false speed. Where the drive
    turns its frame by the same angle (`frame` 1), the magnets' flux stands askew in it: u_d gains
    p^2 omega psi_f delta. A drive that commutates by another sensor, or logs another encoder, has `frame` 0.
    """
    motor = record.design.motor
    speed = record.rate_of(wrong)
    out = {"torque": -record.design.J * record.rate_of(speed)}
    if motor.p is not None and motor.psi_f is not None:
        out["u_d"] = frame * motor.p**2 * record.signals["omega"] * motor.psi_f * wrong
        out["u_q"] = -motor.p * motor.psi_f * speed
    return out


def _transmission(record: Record, effect: Effect, shape: Mapping[str, float]) -> dict[str, Array]:
    """T = J alpha + J_load (alpha_load - alpha): the load's acceleration against the rotor's."""
    return {"torque": load_behind_gap(record, effect, shape) if "gap" in shape else load_behind_spring(record, shape)}


def evaluate_term(record: Record, effect: Effect, parameters: Mapping[str, float]) -> Array:
    """The term itself over the log, at the log's rate."""
    return column(effect, term_signals(record), parameters)
