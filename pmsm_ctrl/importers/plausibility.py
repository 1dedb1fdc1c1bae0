"""Plausibility of a log: factors, signs and time stamps that real files get wrong.

The speed is compared with the derivative of the position (a public bench of geared servos is off by 1.99 and
1.66 there), K_t i_q with a torque column, the sign of the torque with the sign of the acceleration. All
comparisons use integrals over blocks of samples, which are robust against noise and quantisation, and instruments,
which noise does not bias.
"""

from __future__ import annotations

import math

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import notices as say
from pmsm_ctrl.importers.delays import delays
from pmsm_ctrl.importers.lost import lost_samples
from pmsm_ctrl.importers.relations import BLOCKS, axis_balance, block_edges, drive_factor, integral, rate_factor, ratio
from pmsm_ctrl.importers.rivals import LEADS
from pmsm_ctrl.importers.table import Array
from pmsm_ctrl.importers.timebase import growing_steps, quantum, saturated_share, time_base
from pmsm_ctrl.log import Log
from pmsm_ctrl.section import Notice

__all__ = ["check", "speed_doubts", "torque_factor", "velocity_factor"]

MIN_SAMPLES = 32
SURE = 0.999  # correlation of two rates above which the delay between them is that of the channels, not of their noise
CERTAIN, INTERVAL = 12.0, 3.0  # standard errors of an inertia: that it counts at all, and that it is beyond a limit
SLOWEST = 0.02  # s; a period above it is none of a log of a drive, but that of 20 us and more in a wrong unit
_RPM = math.pi / 30.0


def check(log: Log, design: Design | None = None) -> tuple[Notice, ...]:
    """Return what makes a log doubtful, each with the factor or place found.

    Parameters
    ----------
    log : Log
        In SI units.
    design : Design, optional
        Adds the checks against K_t, pole pairs, gear, inertia and current limit.

    Returns
    -------
    tuple of Notice
        Empty when nothing is doubtful.
    """
    with np.errstate(all="ignore"):
        found = [*_time(log)]
        if len(log) >= MIN_SAMPLES:
            found += [
                *_standing(log),
                *lost_samples(log, design),
                *speed_doubts(log, design),
                *_leading(log),
                *_reference(log),
                *_torque(log, design),
                *_sign(log, design),
                *_saturation(log, design),
                *_quantisation(log),
            ]
    return tuple(found)


def _time(log: Log) -> list[Notice]:
    if len(log) < 3:
        return [say.FEW_SAMPLES(count=len(log))]
    base = time_base(log.t)
    out = []
    if base.jitter_max > 0.1 * base.period:
        rms_ms, largest_ms, period_ms = 1e3 * base.jitter_rms, 1e3 * base.jitter_max, 1e3 * base.period
        out.append(say.IRREGULAR_TIME(rms_ms=rms_ms, largest_ms=largest_ms, period_ms=period_ms))
    if base.gaps:
        out.append(say.TIME_GAPS(count=base.gaps, longest_ms=1e3 * base.longest_gap, at=base.longest_gap_at))
    if base.period > 0.5 or base.period < 2e-7:
        out.append(say.UNLIKELY_PERIOD(period=base.period))
    return out


def _standing(log: Log) -> list[Notice]:
    return [
        say.CONSTANT_CHANNEL(channel=name, value=float(log[name][0]), unit=log.unit(name))
        for name in ("theta", "omega", "i_q", "torque")
        if name in log and np.ptp(log[name]) == 0.0
    ]


def velocity_factor(log: Log) -> tuple[float, float]:
    """Return the factor dtheta/dt over omega and its relative spread; NaN when the axis hardly moves."""
    if "theta" not in log or "omega" not in log or len(log) < MIN_SAMPLES:
        return math.nan, math.nan
    step = quantum(log["theta"])
    return rate_factor(log.t, log["theta"], log["omega"], step if math.isfinite(step) else 0.0)


def _near(value: float, known: float, tolerance: float = 0.02) -> bool:
    return abs(value / known - 1.0) < tolerance


def speed_doubts(log: Log, design: Design | None) -> list[Notice]:
    """Return what makes a speed doubtful beside the position: a factor, a sign, or none of its own.

    Parameters
    ----------
    log : Log
    design : Design or None
        Adds the pole pairs and the gear to what a factor may be.
    """
    factor, spread = velocity_factor(log)
    if not math.isfinite(factor):
        return []
    if _magnitude(log):
        return [say.SPEED_MAGNITUDE()]
    if not spread < 0.2:
        return [say.SPEED_UNRELATED()]
    if abs(factor - 1.0) < 0.05:
        return []
    if unit := _unit_of_time(log.period, factor):
        return [say.SPEED_FACTOR(factor=factor, cause=f": t looks like {unit} read as s", time=unit)]
    known = [
        (-1.0, "opposite signs"),
        (_RPM, "omega looks like rpm read as rad/s"),
        (1.0 / _RPM, "omega looks like rad/s read as rpm"),
        (180.0 / math.pi, "theta looks like degrees read as rad, or omega like rad/s read as deg/s"),
        (math.pi / 180.0, "omega looks like deg/s read as rad/s"),
        (1.0 / (2.0 * math.pi), "theta looks like turns read as rad"),
        (2.0 * math.pi, "omega looks like turns per second read as rad/s"),
        (1000.0, "a prefix milli was lost"),
        (0.001, "a prefix milli was lost"),
    ]
    if design is not None and design.motor.p is not None and design.motor.p > 1:
        known += [
            (float(design.motor.p), f"theta looks electrical (p = {design.motor.p:g})"),
            (1.0 / design.motor.p, f"omega looks electrical (p = {design.motor.p:g})"),
        ]
    if design is not None and design.load.gear != 1.0:
        known += [
            (design.load.gear, "speed of the load, position of the motor"),
            (1.0 / design.load.gear, "speed of the motor, position of the load"),
        ]
    return [say.SPEED_FACTOR(factor=factor, cause=_suspect(factor, known))]


def _unit_of_time(period: float, factor: float) -> str:
    """Return the unit of time with which position and speed agree, empty where the period is that of a drive's log."""
    found = next((unit for unit, size in (("ms", 1e-3), ("us", 1e-6)) if _near(factor, size)), "")
    return found if period > SLOWEST else ""


def _magnitude(log: Log) -> bool:
    """Whether the speed never changes its sign, although the position goes a tenth of its way back."""
    speed, way = log["omega"], np.diff(log["theta"][block_edges(len(log), BLOCKS)])
    forward, back = float(way[way > 0.0].sum()), -float(way[way < 0.0].sum())
    low, high = np.quantile(speed, (0.001, 0.999)).tolist()
    one_sided = min(abs(low), abs(high)) < 0.01 * max(abs(low), abs(high)) or low * high > 0.0
    if not one_sided or min(forward, back) <= 0.1 * (forward + back):
        return False
    ends = block_edges(len(log), BLOCKS)
    spread = ratio(np.abs(way), np.diff(integral(log.t, np.abs(speed))[ends]))[1]
    return bool(spread < 0.2)


def _suspect(factor: float, known: list[tuple[float, str]]) -> str:
    return next((f": {text}" for value, text in known if _near(factor, value)), "")


def _leading(log: Log) -> list[Notice]:
    """A speed that is ahead of the position: no filter and no difference of measured positions is."""
    found = next((one for one in delays(log) if one.later == "omega"), None)
    if found is None or found.seconds > -LEADS * log.period or found.correlation < SURE:
        return []
    return [say.SPEED_LEADS(lead_ms=-1e3 * found.seconds)]


def _reference(log: Log) -> list[Notice]:
    if "omega" not in log or "omega_ref" not in log:
        return []
    edges = block_edges(len(log), BLOCKS)
    factor, spread = ratio(*(np.diff(integral(log.t, log[name])[edges]) for name in ("omega", "omega_ref")))
    if math.isnan(factor) or not spread < 0.1 or abs(factor - 1.0) < 0.2:
        return []
    known = [
        (-1.0, "opposite signs"),
        (_RPM, "omega_ref looks like rpm read as rad/s"),
        (1.0 / _RPM, "omega looks like rpm read as rad/s"),
    ]
    return [say.REFERENCE_FACTOR(factor=factor, cause=_suspect(factor, known))]


def torque_factor(log: Log, design: Design | None) -> tuple[float, float]:
    """Return the factor torque over K_t i_q and their correlation; NaN without both channels or a design."""
    if design is None or "torque" not in log or "i_q" not in log or len(log) < MIN_SAMPLES:
        return math.nan, math.nan
    return drive_factor(design.K_t_assumed * log["i_q"], log["torque"])


def _torque(log: Log, design: Design | None) -> list[Notice]:
    factor, correlation = torque_factor(log, design)
    if math.isnan(factor):
        return []
    if abs(correlation) < 0.7:
        return [say.TORQUE_UNRELATED(correlation=correlation)]
    if abs(factor - 1.0) < 0.1:
        return []
    root = math.sqrt(2.0)
    known = [
        (-1.0, "opposite signs"),
        (root, "i_q looks like A rms read as A peak"),
        (1.0 / root, "K_t looks like N m per A rms read as per A peak"),
        (1.5, "the factor 3/2 of the dq scaling"),
        (2.0 / 3.0, "the factor 3/2 of the dq scaling"),
        (1000.0, "a prefix milli was lost"),
        (0.001, "a prefix milli was lost"),
    ]
    if design is not None and design.load.gear != 1.0:
        known += [
            (design.load.gear, "torque behind the gear"),
            (-design.load.gear, "torque behind the gear, opposite signs"),
        ]
    return [say.TORQUE_FACTOR(factor=factor, cause=_suspect(factor, known))]


def _sign(log: Log, design: Design | None) -> list[Notice]:
    """The sign of the torque against the sign of the acceleration, friction taken out, and the size of J."""
    if "torque" in log:
        torque, name = log["torque"], "torque"
    elif "i_q" in log:
        torque, name = log["i_q"] * (design.K_t_assumed if design is not None else 1.0), "i_q"
    else:
        return []
    if np.ptp(torque) == 0.0:
        return []
    linear = log.motion == "linear"
    found = axis_balance(log.t, torque, speed=log.get("omega"), position=log.get("theta"), linear=linear)
    inertia = found.inertia
    # the scatter over stretches of time is itself uncertain, so the limit is far above the nominal 2
    if not math.isfinite(inertia) or found.certain < CERTAIN:
        return []
    if inertia < 0.0:
        return [say.TORQUE_SIGN(channel=name)]
    if design is None or design.motor.J is None:
        return []
    factor, error = inertia / design.J, INTERVAL * found.stderr / design.J
    if factor + error >= 0.5 and factor - error <= 2.0:
        return []
    unit = "kg" if linear else "kg m^2"
    return [say.UNLIKELY_INERTIA(channel=name, inertia=inertia, unit=unit, factor=factor)]


def _saturation(log: Log, design: Design | None) -> list[Notice]:
    out = []
    for name in ("i_q", "torque", "i_q_ref", "u_d", "u_q"):
        if name not in log:
            continue
        share = saturated_share(log[name])
        if share:
            peak = float(np.max(np.abs(log[name])))
            out.append(say.SATURATED_CHANNEL(channel=name, limit=peak, unit=log.unit(name), percent=100 * share))
    if design is not None and "i_q" in log and math.isfinite(design.drive.i_max):
        excess = float(np.max(np.abs(log["i_q"]))) / design.drive.i_max
        if excess > 1.1:
            out.append(say.CURRENT_BEYOND_LIMIT(factor=excess, cause=_cause_of_excess(log["i_q"])))
    return out


def _cause_of_excess(current: Array) -> str:
    """Say why a current may be too large: one of whole numbers of A has not been converted."""
    if np.array_equal(current, np.round(current)):
        return (
            "whole numbers, so raw counts may be read as A; --map i_q='FACTOR * COLUMN [A]' converts them, with the A "
            "of a count, or scale in [log]"
        )
    return "A rms read as A peak, or another motor"


def _quantisation(log: Log) -> list[Notice]:
    out = []
    for name in ("theta", "omega", "i_q", "torque", "u_d", "u_q"):
        if name not in log:
            continue
        step, size = quantum(log[name]), float(np.std(log[name]))
        if math.isfinite(step) and step > 0.05 * size > 0.0:
            out.append(say.QUANTISED_CHANNEL(channel=name, step=step, unit=log.unit(name), percent=100 * step / size))
    grown = growing_steps(log["theta"]) if "theta" in log else 0.0
    if grown > 0.0:
        out.append(say.FEW_DIGITS(step=grown, unit=log.unit("theta")))
    return out
