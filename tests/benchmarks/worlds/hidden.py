"""Effects that are hidden in a world, with strengths relative to what the noise allows anybody to see.

How much a log shows is measured without the diagnosis: a straight regression of the drive's torque (and of its
voltages) on acceleration, direction and speed, once with the effect and once without, in the same world with the same
noise. What no owner of a log knows is projected out: the mean delay of the drive signal, half the variance of its
impulse response (up to the square of one period of the log or of the speed loop), and the moments of reversal (to 0.1
ms and a twentieth of a sample). An effect in their span, such as a spring above the band, is not seen by any test
(Cramer and Rao's bound with nuisance parameters, S. M. Kay 1998, sec. 6.5). The growth of the residual over what the
clean world leaves, times the number of independent samples of the band, is the noncentrality of the best test; its
root over that of a test that finds the effect in half of all logs (22 candidates, 1 %) is the *margin*: at 1 a coin,
at 3 and more nobody has an excuse.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.log import Log
from tests.benchmarks.worlds.motion import reference
from tests.benchmarks.worlds.plant import HIDDEN, PLACE, run
from tests.benchmarks.worlds.recorder import record
from tests.benchmarks.worlds.world import World

__all__ = ["EFFECTS", "hidden_log", "simulate_world"]

Array = NDArray[np.float64]
Rng = np.random.Generator

# Root of the noncentrality at which a chi-square test of two columns at 0.01 / 22 finds an effect in half of all logs.
HALF = 3.9
BAND = 25.0  # Hz
# How well the moments of reversal are known, s and samples of the log.
TURN, TURN_SAMPLES = 1e-4, 0.05


def _dry(world: World) -> float:
    return world.motor[6]


def _at_top(world: World) -> float:
    """Dry and viscous friction at the fastest speed of this world."""
    return world.motor[6] + world.motor[7] * world.top


def _stribeck(w: World, g: Rng) -> dict[str, float]:
    return {"stribeck": 0.3 * _dry(w), "stribeck_speed": w.top * math.exp(g.uniform(math.log(0.01), math.log(0.15))),
            "stribeck_lorentz": float(g.integers(0, 2))}  # fmt: skip


def _compliance(w: World, g: Rng) -> dict[str, float]:
    J = w.motor[5] * float(g.uniform(0.3, 0.7))
    w_a = 2 * math.pi * float(g.uniform(15.0, 60.0))
    return {"load_inertia": J, "stiffness": J * w_a**2, "damping": 2 * 0.03 * J * w_a}


def _backlash(w: World, g: Rng) -> dict[str, float]:
    J = w.motor[5] * float(g.uniform(0.3, 0.6))
    w_a = 2 * math.pi * 150.0
    return {"gap": 0.01 * (w.top / 100.0), "load_inertia": J, "stiffness": J * w_a**2, "damping": 0.4 * J * w_a}


# effect -> what it sets in the plant (the first entry, or those of `SCALED`, carry its strength), and where it can be
EFFECTS: dict[str, Callable[[World, Rng], dict[str, float]]] = {
    "stribeck": _stribeck,
    "viscous_asymmetry": lambda w, g: {"viscous_asymmetry": 0.1 * _at_top(w) / w.top},
    "constant_load": lambda w, g: {"constant_load": 0.15 * _dry(w)},
    "viscous_power": lambda w, g: {"drag_gain": 0.2 * _at_top(w) / w.top**0.6, "drag_power": 0.6},
    "quadratic_drag": lambda w, g: {"drag_gain": 0.2 * _at_top(w) / w.top**2, "drag_power": 2.0},
    "load_dependent_friction": lambda w, g: {"load_friction": 0.08},
    "thermal_drift": lambda w, g: {"warm_share": 0.3, "warm_time": w.duration * float(g.uniform(0.2, 0.6))},
    "presliding": lambda w, g: {"bristle": 1e-3 * w.top / 10.0},
    "position_dependent_friction": lambda w, g: {
        "position_friction": 0.2 * _dry(w), "position_phase": float(g.uniform(0, 6))},
    "unbalance": lambda w, g: {"wave": 0.2 * _dry(w), "wave_order": 1.0, "wave_phase": float(g.uniform(0, 6))},
    "cogging": lambda w, g: {
        "wave": 0.2 * _dry(w), "wave_order": float(g.choice([12, 18, 24, 36, 72])),
        "wave_phase": float(g.uniform(0, 6))},
    "torque_ripple": lambda w, g: {"ripple": 0.05, "ripple_order": 6.0},
    "torque_saturation": lambda w, g: {"saturation": 0.1 / w.i_max},
    "compliance": _compliance,
    "backlash": _backlash,
    "dead_time": lambda w, g: {"dead_voltage": 0.3 * w.motor[0] * _dry(w) / (1.5 * w.motor[3] * w.motor[4]),
                               "dead_current": 0.05 * _dry(w) / (1.5 * w.motor[3] * w.motor[4])},
    "current_offset": lambda w, g: {"offset_a": 0.05 * _dry(w) / (1.5 * w.motor[3] * w.motor[4]),
                                    "offset_b": 0.03 * _dry(w) / (1.5 * w.motor[3] * w.motor[4])},
    "current_gain": lambda w, g: {"gain_a": 0.03},
    "encoder_eccentricity": lambda w, g: {"eccentricity": 2e-3, "eccentricity_phase": float(g.uniform(0, 6))},
}  # fmt: skip
SCALED = {"current_offset": ("offset_a", "offset_b"), "compliance": ("load_inertia", "stiffness", "damping")}
# What a linear axis, known by its force alone, cannot have; and what only shows where voltages are logged.
ROTARY = {"position_dependent_friction", "unbalance", "cogging", "torque_ripple", "current_offset", "current_gain",
          "encoder_eccentricity", "dead_time"}  # fmt: skip
NEEDS_VOLTAGES = {"dead_time"}


def possible(world: World) -> list[str]:
    """Return the effects that this world can have and its log could show."""
    out = [e for e in EFFECTS if not (world.linear and e in ROTARY)]
    return [e for e in out if world.voltages or e not in NEEDS_VOLTAGES]


def simulate_world(world: World, hidden: dict[str, float] | None = None) -> Log:
    """Return the log of a world, with these entries of the plant's hidden physics."""
    x = np.zeros(len(HIDDEN))
    x[PLACE["stribeck_speed"]] = x[PLACE["warm_time"]] = x[PLACE["dead_current"]] = 1.0
    for name, value in (hidden or {}).items():
        x[PLACE[name]] = value
    tables = []
    substeps = max(2, math.ceil(3.1e4 / world.f_control))
    sizes = np.array([1.0 / world.f_control, substeps, world.divider, world.delay])
    for number in range(world.runs):
        ref, mode = reference(world, number, world.duration / world.runs)
        tables.append(
            run(
                np.array(world.motor), x, ref, sizes, np.array(world.loops), mode, np.array(world.noise),
                np.array(world.encoder), world.seed * 10 + number,
            )
        )  # fmt: skip
        if not np.all(np.isfinite(tables[-1])):
            raise ArithmeticError(f"world {world.seed}: the drive leaves the finite numbers")
    return record(world, tables)


def residual_powers(world: World, log: Log) -> tuple[Array, float]:
    """Return the mean squares that the plain model leaves per balance, and the number of independent samples."""
    from scipy.signal import butter, sosfiltfilt

    t, rate = log.t, 1.0 / float(np.median(np.diff(log.t)))
    band = min(BAND, rate / 8.0)
    sections = butter(4, band, fs=rate, output="sos")

    def smooth(values: Array) -> Array:
        return np.asarray(sosfiltfilt(sections, values))

    omega = np.gradient(smooth(log["theta"]), t)
    alpha = np.gradient(omega, t)
    drive = log["torque"] if "torque" in log else log["i_q"]
    w = np.abs(omega)
    used = (w > 0.01 * np.quantile(w, 0.99)) & (np.gradient(t) < 1.5 / rate)
    edge = round(4 * rate / band)
    used[:edge] = used[-edge:] = False
    late = np.gradient(smooth(drive), t)
    period = max(world.log_divider, world.divider) / world.f_control
    dry = _dry(world) / (1.0 if "torque" in log else _torque_constant(world))
    turned = dry * np.gradient(smooth(np.sign(omega)), t)
    known = {4: period**2, 5: TURN + TURN_SAMPLES * world.log_divider / world.f_control}
    rows = [smooth(alpha), smooth(np.sign(omega)), smooth(omega), late, np.gradient(late, t), turned]
    balances: list[tuple[Array, list[Array], dict[int, float]]] = [(drive, rows, known)]
    if "u_q" in log:
        p = world.motor[3]
        i_q, i_d = smooth(log["i_q"]), smooth(log["i_d"])
        rows = [i_q, smooth(omega), np.gradient(i_q, t), p * omega * i_d, np.gradient(smooth(log["u_q"]), t)]
        balances.append((log["u_q"], rows, {}))
        rows = [i_d, p * omega * i_q, np.gradient(i_d, t), np.gradient(smooth(log["u_d"]), t)]
        balances.append((log["u_d"], rows, {}))
    independent = 2.0 * band / rate
    powers = [
        _left(np.column_stack(rows)[used], smooth(target)[used], known, independent) for target, rows, known in balances
    ]
    return np.array(powers), float(used.sum()) * independent


def _left(columns: Array, target: Array, known: dict[int, float], independent: float) -> float:
    """Return the mean square that columns leave of a target, those of `known` with a prior of that width.

    `independent` is the share of independent samples, by which the noise is weighed against the priors.
    """
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    a = columns / size
    width = np.array([known.get(k, np.inf) for k in range(a.shape[1])]) * size
    prior = np.zeros((a.shape[1], a.shape[1]))
    for _ in range(3):  # the weight of the priors hangs on the noise
        both, wanted = np.vstack([a, prior]), np.concatenate([target, np.zeros(len(prior))])
        rest = wanted - both @ np.linalg.lstsq(both, wanted, rcond=1e-10)[0]
        noise = float(np.mean(rest[: len(target)] ** 2)) / independent
        prior = np.diag(math.sqrt(noise) / width)
    return float(rest @ rest) / len(target)


def _torque_constant(world: World) -> float:
    return world.motor[4] if world.linear else 1.5 * world.motor[3] * world.motor[4]


def margin(world: World, clean: Log, log: Log) -> float:
    """Return by how much the effect in `log` exceeds what the noise allows to be seen in half of all logs."""
    before, n = residual_powers(world, clean)
    after, _ = residual_powers(world, log)
    growth = float(np.sum(np.maximum(after / np.maximum(before, 1e-300) - 1.0, 0.0)))
    return math.sqrt(n * growth) / HALF


def hidden_log(world: World, effect: str, wanted: float) -> tuple[Log, float, dict[str, float]] | None:
    """Return a log with the effect at about this margin, the margin reached, and its parameters; None where it fails.

    Strengths are scaled twice; what is reported is the margin measured on the log itself.
    """
    rng = np.random.default_rng([world.seed, 31])
    clean = simulate_world(world)
    values = EFFECTS[effect](world, rng)
    scaled = SCALED.get(effect, (next(iter(values)),))
    for _ in range(4):
        try:
            log = simulate_world(world, values)
        except ArithmeticError:
            factor = 0.3
        else:
            reached = margin(world, clean, log)
            if 0.7 * wanted <= reached <= 1.5 * wanted:
                return log, reached, values
            factor = min(max(wanted / max(reached, 0.05), 0.1), 8.0)
        values = {name: value * (factor if name in scaled else 1.0) for name, value in values.items()}
        if values.get("load_inertia", 0.0) > 0.8 * world.motor[5] or values.get("ripple", 0.0) > 0.5:
            return None
        if values.get("stribeck", 0.0) > 4.0 * world.motor[6] or values.get("load_friction", 0.0) > 0.5:
            return None
        if values.get("position_friction", 0.0) > 0.9 * world.motor[6]:  # dry friction has one sign
            return None
        if values.get("eccentricity", 0.0) > 0.05 or values.get("gap", 0.0) > 0.5 or values.get("gain_a", 0.0) > 0.3:
            return None
        if values.get("warm_share", 0.0) > 0.8 or values.get("saturation", 0.0) * world.i_max > 0.6:
            return None
    return None
