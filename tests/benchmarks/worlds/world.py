"""What a world is: everything about a drive and its recorder that the owner of a log may not know, drawn at random."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design

__all__ = ["World", "draw"]

Array = NDArray[np.float64]
Rng = np.random.Generator

# R, L_d, L_q, p, psi_f, J, F_c, F_v, current limit, top speed: classes of motors, each drawn around
MOTORS = {
    "paper": (19.0, 49e-3, 49e-3, 4, 0.172, 0.9e-4, 0.0213, 1.68e-4, 3.0, 200.0),
    "small": (0.45, 0.55e-3, 0.55e-3, 5, 0.0071, 4.5e-6, 0.008, 4e-6, 16.0, 300.0),
    "2 kW": (0.65, 4.5e-3, 5.5e-3, 4, 0.18, 4.0e-3, 0.16, 1.1e-3, 25.0, 150.0),
    "geared": (1.6, 5.2e-3, 6.0e-3, 5, 0.085, 2.4e-4, 0.045, 3.5e-4, 12.0, 150.0),
    "torque motor": (3.0, 12e-3, 12e-3, 11, 0.45, 0.02, 0.4, 0.02, 12.0, 25.0),
}
# force per unit of drive, mass, dry and viscous friction, top speed of linear axes that only a force is known of
LINEAR = {"screw": (1.0, 95.0, 20.0, 200.0, 0.3), "belt": (1.0, 12.0, 9.0, 30.0, 1.2)}
MOTIONS = ("torque steps", "speed steps", "ramps", "sines", "moves", "jerk-limited", "staircase", "chirp")
MODES = ("instant", "mean", "command", "filtered")


@dataclass(frozen=True, eq=False)
class World:
    """One drawn world, clean; `hidden` effects are added by `pmsm_ctrl`-free code in `hidden.py`.

    Attributes
    ----------
    properties : dict
        The drawn properties by name, for the report by world.
    motor : tuple
        R, L_d, L_q, p, psi_f, J, F_c, F_v of the true drive; p = 0 is a linear axis known by its force.
    design : Design
        What the owner believes.
    """

    seed: int
    motor: tuple[float, ...]
    linear: bool
    design: Design
    f_control: float
    divider: int
    delay: int
    log_divider: int
    phase: int
    mode: str
    lag: float
    channel: str
    voltages: bool
    motion: str
    loops: tuple[float, ...]
    control: int
    noise: tuple[float, float, float]
    encoder: tuple[float, float, float]
    reference_hold: float
    dropped: float
    runs: int
    duration: float
    top: float
    i_max: float
    properties: dict[str, Any] = field(default_factory=dict)


def _log(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw(seed: int, **fixed: Any) -> World:
    """Draw a world.

    Parameters
    ----------
    seed : int
        The same seed draws the same world.
    fixed
        Properties that are not drawn: ``motion="sines"``, ``mode="instant"``, ``log_rate=1000.0``, ``linear=False``.
    """
    rng = np.random.default_rng([seed, 19])
    linear = bool(rng.random() < 0.2)
    f_control = float(rng.choice([4e3, 5e3, 8e3, 10e3, 16e3, 20e3]))
    divider = int(rng.choice([1, 2, 4, 8]))
    wanted = _log(rng, 250.0, 8000.0)
    motion, mode = str(rng.choice(MOTIONS)), str(rng.choice(MODES))
    if motion == "torque steps" and mode == "command":
        mode = "instant"
    linear, motion, mode = fixed.get("linear", linear), fixed.get("motion", motion), fixed.get("mode", mode)
    wanted = fixed.get("log_rate", wanted)
    log_divider = max(1, round(f_control / wanted))
    motor, i_max, top, name = _motor(rng, linear)
    factors = np.exp(rng.uniform(np.log(0.3), np.log(3.0), 2))
    friction = rng.random() < 0.5  # half of the designs know their friction to a tenth, the others are far off
    factors = factors if friction else rng.uniform(0.9, 1.1, 2)
    design = _design(rng, motor, factors, linear, f_control, divider, log_divider, i_max, seed)
    loops, control = _loops(rng, motor, linear, f_control, divider, i_max)
    K_t = motor[4] if linear else 1.5 * motor[3] * motor[4]
    level = motor[6] / K_t  # current of the dry friction
    noise = (level * _log(rng, 0.01, 0.3), float(rng.choice([0.0, rng.uniform(0.3, 0.9)])),
             float(rng.choice([0.0, level * _log(rng, 0.005, 0.1)])))  # fmt: skip
    bits = int(rng.integers(12, 25) if rng.random() < 0.85 else rng.integers(9, 12))
    counts = 2.0**bits * (2 * np.pi / 0.01 if linear else 1.0)  # a screw of 10 mm lead
    error = float(rng.choice([0.0, _log(rng, 1e-5, 2e-4) * (0.01 / (2 * np.pi) if linear else 1.0)]))
    order = float(rng.choice([64.0, 256.0, 1024.0])) * (2 * np.pi / 0.01 if linear else 1.0)
    voltages = bool(not linear and rng.random() < 0.6)
    channel = "torque" if linear else str(rng.choice(["i_q", "i_q", "torque", "torque command"]))
    voltages = voltages and channel == "i_q" and mode != "filtered"
    log_period = log_divider / f_control
    world = World(
        seed=seed, motor=motor, linear=linear, design=design, f_control=f_control, divider=divider,
        delay=int(rng.integers(0, 3)), log_divider=log_divider, phase=int(rng.integers(0, log_divider)), mode=mode,
        lag=float(log_period * rng.uniform(0.3, 2.0)), channel=channel, voltages=voltages, motion=motion, loops=loops,
        control=control, noise=noise, encoder=(counts, error, order),
        reference_hold=float(rng.choice([0.0, 1e-3, 2e-3])),
        dropped=float(rng.choice([0.0, 0.0, 0.0, 0.003])), runs=int(rng.choice([1, 1, 1, 1, 3])),
        duration=float(rng.uniform(15.0, 40.0)), top=top * float(rng.uniform(0.3, 1.0)), i_max=i_max,
    )  # fmt: skip
    world.properties.update(
        motor=name, linear=linear, f_control=f_control, divider=divider, delay=world.delay, mode=mode, motion=motion,
        log_rate=_bin(f_control / log_divider, (250, 500, 1000, 2000, 4000, 8001)), channel=channel, voltages=voltages,
        encoder_bits=_bin(bits, (9, 12, 16, 20, 25)), line_error=error > 0.0, reference_hold=world.reference_hold,
        dropped=world.dropped > 0.0, runs=world.runs, coloured=noise[1] > 0.0, adc=noise[2] > 0.0,
        friction_known=not friction, loop=("PI", "P-PI")[control == 1],
    )  # fmt: skip
    return world


def _bin(value: float, edges: tuple[float, ...]) -> str:
    k = int(np.searchsorted(edges, value, side="right")) - 1
    k = min(max(k, 0), len(edges) - 2)
    return f"{edges[k]:g} to {edges[k + 1]:g}"


def _motor(rng: Rng, linear: bool) -> tuple[tuple[float, ...], float, float, str]:
    """Draw the true motor around one of the classes; returns it, its current limit, its top speed and its class."""
    if linear:
        name = str(rng.choice(list(LINEAR)))
        K, M, F_c, F_v, top = LINEAR[name]
        M, F_c, F_v = M * _log(rng, 0.5, 2.0), F_c * _log(rng, 0.5, 2.0), F_v * _log(rng, 0.5, 2.0)
        limit = 12.0 * (F_c + F_v * top)
        return (0.0, 0.0, 0.0, 0.0, K, M, F_c, F_v), limit, top, name
    name = str(rng.choice(list(MOTORS)))
    R, L_d, L_q, p, psi, J, F_c, F_v, i_max, top = MOTORS[name]
    scale = _log(rng, 0.7, 1.5)
    J = J * _log(rng, 0.7, 3.0)
    F_c, F_v = F_c * _log(rng, 0.5, 2.0), F_v * _log(rng, 0.5, 2.0)
    return (R * scale, L_d * scale, L_q * scale, float(p), psi, J, F_c, F_v), i_max, top, name


def _design(
    rng: Rng, motor: tuple[float, ...], factors: Array, linear: bool, f_control: float, divider: int, log_divider: int,
    i_max: float, seed: int,
) -> Design:  # fmt: skip
    """Return what the owner believes: the datasheet inside its tolerance, friction off by `factors`."""
    R, L_d, L_q, p, psi, J, F_c, F_v = motor

    def off(share: float) -> float:
        return 1.0 + float(rng.uniform(-share, share))

    plain = {"J": J * off(0.08), "K_t": psi}
    winding = {
        "R": R * off(0.08), "L_d": L_d * off(0.08), "L_q": L_q * off(0.08), "p": int(p), "psi_f": psi * off(0.01),
        "J": J * off(0.08),
    }  # fmt: skip
    data: dict[str, Any] = {
        "name": f"world {seed}",
        "motion": "linear" if linear else "rotary",
        "motor": plain if linear else winding,
        "effects": [{"id": "coulomb", "F_c": F_c / factors[0]}, {"id": "viscous", "F_v": F_v / factors[1]}],
    }
    if not linear:
        data["drive"] = {"f_control": f_control, "speed_divider": divider, "i_max": i_max}
        data["sensor"] = {"log_divider": log_divider}
    return Design.from_dict(data)


def _loops(
    rng: Rng, motor: tuple[float, ...], linear: bool, f_control: float, divider: int, i_max: float
) -> tuple[tuple[float, ...], int]:
    """Return the gains for a drawn bandwidth, from soft to hard, and 0 for a speed loop, 1 for a position loop."""
    R, L_d, L_q, p, psi, J, F_c, F_v = motor
    K_t = psi if linear else 1.5 * p * psi
    fast = min(_log(rng, 200.0, 900.0), f_control / 14.0)  # Hz of the current loop
    speed = min(_log(rng, 8.0, 90.0), fast / 6.0, f_control / divider / 30.0)
    w_i, w_w = 2 * np.pi * fast, 2 * np.pi * speed
    kp_w = J * w_w / K_t
    ki_w = kp_w * w_w / float(rng.uniform(3.0, 8.0))
    control = int(rng.integers(0, 2))
    kp_x = w_w / float(rng.uniform(4.0, 8.0))
    kp_i, ki_i = (w_i, 0.0) if linear else (L_q * w_i, R * w_i)
    filter_time = float(rng.choice([0.0, 1.0, 3.0])) * divider / f_control
    forward = float(rng.choice([0.0, 0.0, 0.9]))
    return (kp_i, ki_i, kp_w, ki_w, kp_x, filter_time, forward, i_max, 0.0), control
