"""Channels that are not what they are called: exchanged, of another frame, another axis, or without their sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import notices as say
from pmsm_ctrl.plausibility.bins import summed
from pmsm_ctrl.plausibility.policy import POLICY
from pmsm_ctrl.plausibility.relations import (
    BOXES,
    WIDE,
    Evidence,
    Fit,
    bristle_balance,
    fitted,
    moved,
    torque_balance,
    voltage_balances,
    weight_balance,
)  # fmt: skip
from pmsm_ctrl.regression.measurement_correction import known_delay
from pmsm_ctrl.regression.timed_record import SPEED_FILTERS
from pmsm_ctrl.section import Notice

__all__ = ["foreign_current", "foreign_voltage", "late_channel", "magnitudes", "moved_back", "sensor_offset"]

Array = NDArray[np.float64]

DRIVE = ("torque", "i_q", "i_d")
LAGS = 6  # at most, from which a delay is read


def late_channel(evidence: Evidence, log: Log) -> tuple[Log, tuple[Notice, ...], float]:
    """Say by how much the current or torque is late against the motion, where sampling does not explain it.

    A lag that no correction of sampling instants reaches is taken out of the log. It has to explain far more than a
    friction that bends before it slides, which is an effect and no fault of the recorder: a delay is as large from
    whatever lag it is read, and what a bend looks like is not. A delay that the design states is known. The third value
    is the lag, s, where a delay explains it better than a filter does; else 0.
    """
    fit, lag, width = evidence.narrow, evidence.lag, evidence.bins.width
    slope = fit.ratio("late", -1.0) if fit is not None else None
    if evidence.torque is None or slope is None or fit is None:
        return log, (), 0.0
    late = lag * width + slope.value
    if known := known_delay(evidence.design):  # the slope of the torque says little of a long one
        read = _delay(evidence, evidence.torque, known)
        late = 0.0 if read is None else read[0] - known
    if abs(late) - POLICY.late_errors * slope.stderr <= max(POLICY.late, POLICY.late_periods * log.period):
        return log, (), 0.0
    if -2.0 * SPEED_FILTERS[-1] <= late < 0.0 and "theta" not in log:
        return log, (), 0.0  # drives filter a speed: the fits find by how much
    filtered, left, behind = False, fit.left, 0.0
    if late > 0.0 and not known:
        # y + tau y' is the torque exactly behind a filter of first order; behind a delay the lag in bins is better
        as_filter = torque_balance(evidence.bins, evidence.torque)
        as_delay = torque_balance(evidence.bins, evidence.torque, BOXES, max(1, round(late / width)))
        if as_filter is not None and as_delay is not None:
            filtered = as_filter.left < POLICY.sharper * as_delay.left
            if filtered:
                late = -as_filter.value("late")
            elif (closer := _delay(evidence, evidence.torque, late)) is not None:
                late, left = closer[0], min(left, closer[1])
                behind = late if closer[1] < POLICY.sharper * as_filter.left else 0.0
    if late > 0.0 and "theta" in log:  # around a reversal both look alike
        bends = bristle_balance(evidence.bins, evidence.torque, log["theta"])
        if bends is not None and left > POLICY.late_gain * bends.left:
            return log, (), 0.0
    words = say.CURRENT_FILTERED if filtered else say.NOT_SYNCHRONOUS
    notice = words(channel=evidence.channel, lag_ms=1e3 * late)
    if abs(late) <= POLICY.beyond:
        return log, (notice,), behind
    if not filtered:
        return moved_back(log, late), (notice,), behind
    drive = [name for name in DRIVE if name in log]
    undone = {name: log[name] + late * np.gradient(log[name], log.t) for name in drive}
    return log.with_channels(**undone), (notice,), behind


def moved_back(log: Log, late: float) -> Log:
    """Return a log whose torque and currents are taken this much later, s.

    Parameters
    ----------
    log : Log
    late : float
    """
    return log.with_channels(**{n: np.interp(log.t + late, log.t, log[n]) for n in DRIVE if n in log})


def _delay(evidence: Evidence, torque: Array, late: float) -> tuple[float, float] | None:
    """Return a delay, s, and what it leaves of the torque's power; None where it is another one from the next lag."""
    width, lag = evidence.bins.width, max(1, round(late / evidence.bins.width))
    for _ in range(LAGS):
        fit = torque_balance(evidence.bins, torque, BOXES, lag)
        if fit is None:
            return None
        size = lag * width - fit.value("late")
        if (at := max(1, round(size / width))) == lag:
            beside = torque_balance(evidence.bins, torque, BOXES, lag - 1 or 2)
            other = np.inf if beside is None else (lag - 1 or 2) * width - beside.value("late")
            return (size, fit.left) if abs(other - size) <= POLICY.same_delay * size else None
        lag = at
    return None


def sensor_offset(evidence: Evidence, log: Log) -> tuple[Notice, ...]:
    """Say that i_q has an offset which the torque and the voltage agree on; a load is in the torque alone."""
    fit, q = evidence.narrow, evidence.voltages.get("q")
    if fit is None or q is None or not evidence.from_current or not q.value("R") > 0.0:
        return ()
    in_torque, in_voltage = fit.ratio("constant", evidence.design.K_t_assumed), q.ratio("u_0", -q.value("R"))
    if in_torque is None or in_voltage is None:
        return ()
    dry = evidence.design.parameters("coulomb").get("F_c", 0.0) / evidence.design.K_t_assumed
    sure = all(abs(o.value) > POLICY.least_t * o.stderr for o in (in_torque, in_voltage))
    alike = abs(in_voltage.value / in_torque.value - 1.0) < POLICY.alike
    if not sure or not alike or abs(in_torque.value) < POLICY.offset * dry:
        return ()
    return (say.CURRENT_OFFSET(offset=in_torque.value),)


def foreign_current(evidence: Evidence, log: Log) -> tuple[Notice, ...]:
    """Say why the torque has nothing to do with the motion: another frame, exchanged currents, or another axis."""
    narrow, wide = evidence.narrow, evidence.wide
    if evidence.torque is None or narrow is None or wide is None:
        return ()
    swapped = _swapped_currents(evidence)
    if swapped:
        return swapped
    if narrow.left < POLICY.unexplained or not (_absent(evidence, narrow, 3.0) and _absent(evidence, wide, 2.0)):
        return ()
    if _lifts(evidence, log):
        return ()
    if found := _stationary(evidence, log):
        return found
    share = 100.0 * max(0.0, min(narrow.value("J"), wide.value("J")) / evidence.design.J)
    return (say.UNRELATED_TORQUE(channel=evidence.channel, percent=share, left=100.0 * narrow.left),)


def _absent(evidence: Evidence, fit: Fit, surely: float) -> bool:
    """Whether the inertia's torque is missing by so many standard errors, although it would be seen."""
    if "J" not in fit.names:
        return False
    k = fit.names.index("J")
    J, stderr = float(fit.values[k]), float(fit.stderr[k])
    share = evidence.design.J**2 * (fit.own[k] / J**2 if J else 0.0)
    return J + surely * stderr < evidence.design.J and share > POLICY.expected


def _lifts(evidence: Evidence, log: Log) -> bool:
    """Whether the weight of an arm stands between the torque and the motion: beside it the torque drives the axis."""
    if evidence.torque is None or log.motion != "rotary" or "theta" not in log:
        return False
    fits = (
        weight_balance(evidence.bins, evidence.torque, log["theta"], boxes, evidence.lag) for boxes in (BOXES, WIDE)
    )
    return any(fit is not None and fit.left < POLICY.unexplained and fit.value("J") > 0.0 for fit in fits)


def _swapped_currents(evidence: Evidence) -> tuple[Notice, ...]:
    have = evidence.bins.channels
    if "i_d" not in have or "i_q" not in have or not evidence.from_current:
        return ()
    other = torque_balance(evidence.bins, evidence.design.K_t_assumed * have["i_d"])
    if other is None or evidence.narrow is None or other.left > POLICY.swap * evidence.narrow.left:
        return ()
    k = other.value("J") / evidence.design.J
    return (say.CURRENTS_SWAPPED(),) if 1.0 / POLICY.swap_limit < abs(k) < POLICY.swap_limit else ()


def _stationary(evidence: Evidence, log: Log) -> tuple[Notice, ...]:
    """Turn the currents back by the electrical angle; does the motion explain them then?"""
    p = evidence.design.motor.p
    if p is None or not {"i_d", "i_q", "theta"} <= set(log) or "torque" in log:
        return ()
    angle = p * log["theta"]
    c, s = np.cos(angle), np.sin(angle)
    a, b = log["i_d"], log["i_q"]
    parts = [c * a + s * b, c * b - s * a]
    best = 1.0
    for part in parts:  # the angle may count from another axis: either part, or both, can be the torque's
        fit = torque_balance(evidence.bins, evidence.design.K_t_assumed * evidence.bins.means(part))
        best = min(best, fit.left) if fit is not None else best
    return (say.STATIONARY_CURRENTS(),) if best < POLICY.swap else ()


def foreign_voltage(evidence: Evidence, log: Log) -> tuple[Notice, ...]:
    """Say whether u_d and u_q are exchanged, or belong to no winding that turns like this."""
    d, q = evidence.voltages.get("d"), evidence.voltages.get("q")
    if d is None or q is None or evidence.design.motor.p is None:
        return ()
    other = voltage_balances(evidence.bins, evidence.design.motor, ("u_q", "u_d", "i_d", "i_q"))
    cross_d, cross_q = other.get("d"), other.get("q")
    if cross_d is None or cross_q is None:
        return ()
    k = abs(cross_q.value("psi_f") / (evidence.design.motor.psi_f or np.inf))
    now, then = q.left * q.power + d.left * d.power, cross_q.left * cross_q.power + cross_d.left * cross_d.power
    if then < POLICY.swap * now and 1.0 / POLICY.swap_limit < k < POLICY.swap_limit:
        return (say.VOLTAGES_SWAPPED(),)
    return ()


def magnitudes(evidence: Evidence, log: Log) -> tuple[Notice, ...]:
    """Say that a current, a torque or a speed lost its sign."""
    bins = evidence.bins
    if "omega" in log and "theta" not in log and _one_sided(log["omega"]) and (found := _folded_speed(evidence)):
        return found
    if evidence.torque is None or not _one_sided(evidence.torque):
        return ()
    motion = moved(bins, BOXES)
    if motion is None or evidence.narrow is None:
        return ()
    omega, alpha = motion
    expected = evidence.design.J * alpha + _friction(evidence, omega)
    both = float(np.nanmean(expected > 0.0)), float(np.nanmean(expected < 0.0))
    sign = np.sign(expected)
    lasting = np.abs(summed(np.nan_to_num(sign), 3 * BOXES)) > 3 * BOXES - 1
    if min(both) < 0.1 or not _signs_help(bins.smooth(evidence.torque, BOXES), omega, alpha, sign, lasting):
        return ()
    return (say.MAGNITUDE_CHANNEL(channel=evidence.channel),)


def _signs_help(seen: Array, omega: Array, alpha: Array, sign: Array, used: NDArray[np.bool_]) -> bool:
    """Whether inertia and friction with these signs explain far more of a torque than without.

    Friction is not known well, so every part has a free size, and only the sign is taken from the design.
    """

    def left(signs: Array | float) -> float:
        parts = {
            "J": signs * alpha,
            "F_c": signs * np.sign(omega),
            "F_v": signs * omega,
            "constant": np.ones_like(seen),
        }
        fit = fitted(seen, parts, used)
        return fit.left if fit is not None else np.inf

    plain = left(1.0)
    return np.isfinite(plain) and left(sign) < POLICY.fold * plain


def _friction(evidence: Evidence, omega: Array) -> Array:
    """Return the friction that the design states, or that of the log where it states none."""
    parameters, fit = evidence.design.parameters, evidence.narrow
    dry, viscous = parameters("coulomb").get("F_c", 0.0), parameters("viscous").get("F_v", 0.0)
    if not (dry or viscous) and fit is not None:  # without it an axis that runs one way would need both signs
        dry, viscous = max(fit.value("F_c"), 0.0), max(fit.value("F_v"), 0.0)
    return np.asarray(dry * np.sign(omega) + viscous * omega)


def _one_sided(values: Array) -> bool:
    """Whether a channel that moves never leaves one side of zero."""
    low, high = np.percentile(values, [0.2, 99.8])
    return bool(low > -0.02 * high if high > 0.0 else False)


def _folded_speed(evidence: Evidence) -> tuple[Notice, ...]:
    """Whether the torque changes its sign with a speed that only touches zero: the sign is chosen per run."""
    bins, torque = evidence.bins, evidence.torque
    if torque is None or _one_sided(torque):
        return ()
    omega = bins.channels["omega"]
    top = float(np.quantile(omega, 0.99))
    rest = summed((omega < 0.03 * top).astype(float), 3) > 0.5
    runs = np.cumsum(np.diff(rest.astype(int), prepend=0) == 1)
    if runs[-1] < 2:
        return ()
    speed, alpha = bins.speed(omega, BOXES)
    seen = bins.smooth(torque, BOXES)
    plain = evidence.design.J * alpha + _friction(evidence, speed)
    good = np.isfinite(seen) & np.isfinite(plain) & ~rest
    product = np.bincount(runs[good], weights=(seen * plain)[good], minlength=runs[-1] + 1)
    sign = np.where(product < 0.0, -1.0, 1.0)[runs]
    share = float(np.mean(product[np.bincount(runs[good], minlength=runs[-1] + 1) > 10] < 0.0))
    if not 0.1 < share < 0.9 or not _signs_help(seen, speed, alpha, sign, good):
        return ()
    return (say.MAGNITUDE_CHANNEL(channel="omega"),)
