"""Is the log what it says it is? Factors, signs and time stamps that real files get wrong.

The speed is compared with the derivative of the position (a public bench of geared servos is off by 1.99 and
1.66 there), K_t i_q with a torque column, the sign of the torque with the sign of the acceleration. All
comparisons use integrals over blocks of samples, which neither noise nor quantisation can upset.
"""

from __future__ import annotations

import math

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers.lost import lost_samples
from pmsm_ctrl.importers.table import Array
from pmsm_ctrl.importers.timebase import growing_steps, quantum, saturated_share, time_base
from pmsm_ctrl.log import Log

__all__ = ["check", "torque_factor", "velocity_factor"]

MIN_SAMPLES = 32
_RPM = math.pi / 30.0


def check(log: Log, design: Design | None = None) -> tuple[str, ...]:
    """Return what makes a log doubtful, each with the factor or place found; empty when nothing does.

    Parameters
    ----------
    log
        In SI units.
    design
        Adds the checks against K_t, pole pairs, gear, inertia and current limit.
    """
    with np.errstate(all="ignore"):
        warnings = [*_time(log)]
        if len(log) >= MIN_SAMPLES:
            warnings += [
                *_standing(log),
                *lost_samples(log, design),
                *_speed(log, design),
                *_reference(log),
                *_torque(log, design),
                *_sign(log, design),
                *_saturation(log, design),
                *_quantisation(log),
            ]
    return tuple(warnings)


def _time(log: Log) -> list[str]:
    if len(log) < 3:
        return [f"only {len(log)} sample{'s' if len(log) > 1 else ''}"]
    base = time_base(log.t)
    out = []
    if base.jitter_max > 0.1 * base.period:
        out.append(
            f"time stamps jitter by {1e3 * base.jitter_rms:.3g} ms rms, {1e3 * base.jitter_max:.3g} ms at most, "
            f"around a period of {1e3 * base.period:.4g} ms"
        )
    if base.gaps:
        out.append(
            f"{base.gaps} gap{'s' if base.gaps > 1 else ''} in the time stamps, the longest "
            f"{1e3 * base.longest_gap:.4g} ms at t = {base.longest_gap_at:.6g} s"
        )
    if base.period > 0.5 or base.period < 2e-7:
        out.append(f"sampling period of {base.period:.3g} s: is the unit of time right?")
    return out


def _standing(log: Log) -> list[str]:
    out = []
    for name in ("theta", "omega", "i_q", "torque"):
        if name in log and np.ptp(log[name]) == 0.0:
            out.append(f"{name} never changes ({log[name][0]:.6g} {log.unit(name)} throughout)")
    return out


def _edges(n: int, blocks: int) -> np.ndarray:
    length = max(2, n // blocks)
    return np.arange(0, n, length)


def _integral(t: Array, values: Array) -> Array:
    """Cumulative trapezoidal integral, shape (n,), starting at 0."""
    out = np.zeros(t.size)
    np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t), out=out[1:])
    return out


def _ratio(numerator: Array, denominator: Array) -> tuple[float, float]:
    """Return (ratio, its relative spread) over the entries with a large denominator."""
    size = np.abs(denominator)
    top = np.percentile(size, 95) if size.size else 0.0
    large = size > 0.2 * top
    if not top > 0.0 or np.count_nonzero(large) < 8:
        return math.nan, math.nan
    x, y = denominator[large], numerator[large]
    middle = float(np.median(y / x))
    error = np.abs(y / x - middle)
    spread = 1.4826 * float(np.median(error))
    # the ratio of sizes is not biased by a delay between the two, as the mean of ratios is; jumps are left out
    kept = error <= 6.0 * spread + 1e-9 * abs(middle)
    factor = math.copysign(math.sqrt(float(np.sum(y[kept] ** 2) / np.sum(x[kept] ** 2))), middle)
    return factor, spread / abs(middle) if middle else math.inf


def velocity_factor(log: Log) -> tuple[float, float]:
    """Return the factor dtheta/dt over omega and its relative spread; NaN when the axis hardly moves."""
    if "theta" not in log or "omega" not in log or len(log) < MIN_SAMPLES:
        return math.nan, math.nan
    edges = _edges(len(log), 500)
    travelled = np.diff(log["theta"][edges])
    integrated = np.diff(_integral(log.t, log["omega"])[edges])
    step = quantum(log["theta"])
    if np.percentile(np.abs(travelled), 95) < 5.0 * (step if math.isfinite(step) else 0.0):
        return math.nan, math.nan
    return _ratio(travelled, integrated)


def _near(value: float, known: float, tolerance: float = 0.02) -> bool:
    return abs(value / known - 1.0) < tolerance


def _speed(log: Log, design: Design | None) -> list[str]:
    factor, spread = velocity_factor(log)
    if not math.isfinite(factor):
        return []
    if not spread < 0.2:
        return ["omega does not follow dtheta/dt: no constant factor between them"]
    if abs(factor - 1.0) < 0.05:
        return []
    known = [
        (-1.0, "opposite signs"),
        (_RPM, "omega looks like rpm taken for rad/s"),
        (1.0 / _RPM, "omega looks like rad/s taken for rpm"),
        (180.0 / math.pi, "theta looks like degrees taken for rad, or omega like rad/s taken for deg/s"),
        (math.pi / 180.0, "omega looks like deg/s taken for rad/s"),
        (1.0 / (2.0 * math.pi), "theta looks like turns taken for rad"),
        (2.0 * math.pi, "omega looks like turns per second taken for rad/s"),
        (1000.0, "milli taken for whole units"),
        (0.001, "milli taken for whole units"),
    ]
    if design is not None and design.motor.p is not None and design.motor.p > 1:
        known += [
            (float(design.motor.p), f"theta looks electrical (p = {design.motor.p})"),
            (1.0 / design.motor.p, f"omega looks electrical (p = {design.motor.p})"),
        ]
    if design is not None and design.load.gear != 1.0:
        known += [
            (design.load.gear, "speed of the load, position of the motor"),
            (1.0 / design.load.gear, "speed of the motor, position of the load"),
        ]
    return [f"dtheta/dt is {factor:.4g} times omega{_suspect(factor, known)}"]


def _suspect(factor: float, known: list[tuple[float, str]]) -> str:
    return next((f": {text}" for value, text in known if _near(factor, value)), "")


def _reference(log: Log) -> list[str]:
    if "omega" not in log or "omega_ref" not in log:
        return []
    edges = _edges(len(log), 500)
    followed = np.diff(_integral(log.t, log["omega"])[edges])
    asked = np.diff(_integral(log.t, log["omega_ref"])[edges])
    factor, spread = _ratio(followed, asked)
    if math.isnan(factor) or not spread < 0.1 or abs(factor - 1.0) < 0.2:
        return []
    known = [
        (-1.0, "opposite signs"),
        (_RPM, "omega_ref looks like rpm taken for rad/s"),
        (1.0 / _RPM, "omega looks like rpm taken for rad/s"),
    ]
    return [f"omega is {factor:.4g} times omega_ref{_suspect(factor, known)}"]


def torque_factor(log: Log, design: Design | None) -> tuple[float, float]:
    """Return the factor torque over K_t i_q and their correlation; NaN without both channels or a design."""
    if design is None or "torque" not in log or "i_q" not in log or len(log) < MIN_SAMPLES:
        return math.nan, math.nan
    current, torque = log["i_q"], log["torque"]
    predicted = design.K_t_assumed * current
    scale = float(np.max(np.abs(predicted))), float(np.max(np.abs(torque)))
    if not min(scale) > 0.0 or not np.isfinite(max(scale)):
        return math.nan, math.nan
    x, y = predicted / scale[0], torque / scale[1]
    factor = float(np.dot(x, y) / np.dot(x, x)) * scale[1] / scale[0]
    correlation = float(np.dot(x, y) / np.sqrt(np.dot(x, x) * np.dot(y, y)))
    return factor, correlation


def _torque(log: Log, design: Design | None) -> list[str]:
    factor, correlation = torque_factor(log, design)
    if math.isnan(factor):
        return []
    if abs(correlation) < 0.7:
        return [f"torque does not follow K_t i_q (correlation {correlation:.2f})"]
    if abs(factor - 1.0) < 0.1:
        return []
    root = math.sqrt(2.0)
    known = [
        (-1.0, "opposite signs"),
        (root, "i_q looks like A rms taken for A peak"),
        (1.0 / root, "K_t looks like N m per A rms taken for per A peak"),
        (1.5, "the factor 3/2 of the dq scaling"),
        (2.0 / 3.0, "the factor 3/2 of the dq scaling"),
        (1000.0, "milli taken for whole units"),
        (0.001, "milli taken for whole units"),
    ]
    if design is not None and design.load.gear != 1.0:
        known += [
            (design.load.gear, "torque behind the gear"),
            (-design.load.gear, "torque behind the gear, opposite signs"),
        ]
    return [f"torque is {factor:.4g} times K_t i_q{_suspect(factor, known)}"]


def _balance(log: Log, torque: Array) -> tuple[float, float]:
    """Return (inertia, its t value) of torque = J alpha + F_c sgn + F_v omega + T_0 over blocks."""
    t, n = log.t, len(log)
    edges = _edges(n, 1000)
    if edges.size < 16:
        return math.nan, 0.0
    if "omega" in log:
        speed = log["omega"]
    else:
        # blocks of position, so that quantisation is divided by the length of a block
        speed = np.interp(t, 0.5 * (t[edges[1:]] + t[edges[:-1]]), np.diff(log["theta"][edges]) / np.diff(t[edges]))
    length = np.diff(t[edges])
    alpha = np.diff(speed[edges]) / length
    columns = [np.diff(_integral(t, part)[edges]) / length for part in (np.sign(speed), speed)]
    target = np.diff(_integral(t, torque)[edges]) / length
    matrix = np.column_stack([alpha, *columns, np.ones(alpha.size)])
    scale = np.max(np.abs(matrix), axis=0)
    if not np.isfinite(matrix).all() or not np.isfinite(target).all() or not (scale > 0.0).all():
        return math.nan, 0.0
    try:
        u, singular, vt = np.linalg.svd(matrix / scale, full_matrices=False)
    except np.linalg.LinAlgError:
        return math.nan, 0.0
    if not singular[-1] > 1e-8 * singular[0]:
        return math.nan, 0.0  # not excited
    solution = vt.T @ ((u.T @ target) / singular)
    residual = target - matrix / scale @ solution
    noise = float(residual @ residual) / max(1, target.size - 4)
    spread = math.sqrt(noise * float(np.sum((vt[:, 0] / singular) ** 2)))
    return float(solution[0] / scale[0]), float(solution[0] / spread) if spread > 0.0 else math.inf * solution[0]


def _sign(log: Log, design: Design | None) -> list[str]:
    """The sign of the torque against the sign of the acceleration, friction taken out, and the size of J."""
    if "torque" in log:
        torque, name = log["torque"], "torque"
    elif "i_q" in log:
        torque, name = log["i_q"] * (design.K_t_assumed if design is not None else 1.0), "i_q"
    else:
        return []
    if np.ptp(torque) == 0.0:
        return []
    inertia, t_value = _balance(log, torque)
    # neighbouring blocks are correlated: ask for far more than the nominal 2
    if not math.isfinite(inertia) or abs(t_value) < 12.0:
        return []
    if inertia < 0.0:
        return [f"{name} has the opposite sign of the acceleration: one of them is counted the other way round"]
    if design is None:
        return []
    factor = inertia / design.J
    if 0.5 <= factor <= 2.0:
        return []
    unit = "kg" if log.motion == "linear" else "kg m^2"
    return [f"{name} over acceleration gives an inertia of {inertia:.3g} {unit}, {factor:.3g} times the design's J"]


def _saturation(log: Log, design: Design | None) -> list[str]:
    out = []
    for name in ("i_q", "torque", "i_q_ref", "u_d", "u_q"):
        if name not in log:
            continue
        share = saturated_share(log[name])
        if share:
            peak = float(np.max(np.abs(log[name])))
            out.append(
                f"{name} sits at its limit of {peak:.4g} {log.unit(name)} for {100 * share:.2g} % of the samples"
            )
    if design is not None and "i_q" in log and math.isfinite(design.drive.i_max):
        excess = float(np.max(np.abs(log["i_q"]))) / design.drive.i_max
        if excess > 1.1:
            out.append(f"i_q reaches {excess:.3g} times the design's i_max: A rms taken for A peak, or another motor?")
    return out


def _quantisation(log: Log) -> list[str]:
    out = []
    for name in ("theta", "omega", "i_q", "torque", "u_d", "u_q"):
        if name not in log:
            continue
        step, size = quantum(log[name]), float(np.std(log[name]))
        if math.isfinite(step) and step > 0.05 * size > 0.0:
            relative = f"{100 * step / size:.2g} % of its standard deviation"
            out.append(f"{name} is quantised to {step:.4g} {log.unit(name)}, {relative}")
    grown = growing_steps(log["theta"]) if "theta" in log else 0.0
    if grown > 0.0:
        where = f"its steps grow with it, up to {grown:.2g} {log.unit('theta')}"
        out.append(f"theta was written with few digits: {where}; write more of them, or the angle within one turn")
    return out
