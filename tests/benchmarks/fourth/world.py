"""A drive, its motion, its noise, its recorder and what its owner believes of it: everything from one seed.

The order of the random calls is part of the benchmark: a seed that has been judged gives the same log again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import signal

from tests.benchmarks.fourth.axis import Array
from tests.benchmarks.fourth.motions import MOTIONS, SPEED_MOTIONS, Path, log_uniform
from tests.benchmarks.fourth.motions import speed_of as draw_speed

STEP = 12e-6  # s, of the simulation
CASCADE, PID, STATE_FEEDBACK = range(3)
FIRST_ORDER, WINDINGS = 1, 2  # how the current loop is simulated

Range = tuple[float, float]


@dataclass(frozen=True)
class Family:
    """Ranges of one kind of axis; SI units, of a linear axis in m and N."""

    J: Range
    K_t: Range
    pole_pairs: tuple[int, int]
    top: Range  # speed
    peak: Range  # acceleration torque over F_c
    F_c: Range
    viscous: Range  # F_v times the top speed over F_c
    bits: tuple[int, int] | None  # of the encoder
    R: Range
    u_dc: float = 560.0  # V
    lines: tuple[int, ...] = (40000, 65536, 100000, 180000)  # encoder counts that are no power of two


COARSE = (4000, 8000, 10000, 20000)
FAMILIES = {
    "geared": Family((3e-4, 2e-3), (0.6, 1.6), (3, 5), (120, 300), (2, 10), (0.08, 0.4), (0.1, 0.8), (17, 23),
                     (0.4, 3)),
    "torque": Family((0.05, 2), (4, 20), (11, 22), (2, 15), (2, 8), (0.6, 6), (0.05, 0.5), (20, 25), (0.8, 5)),
    "linear": Family((5, 100), (30, 90), (1, 1), (0.3, 2), (3, 12), (6, 40), (0.1, 0.8), None, (1, 5)),
    "bldc": Family((3e-6, 3e-5), (0.02, 0.08), (2, 7), (150, 500), (1.5, 8), (8e-4, 5e-3), (0.1, 0.8), (11, 15),
                   (0.15, 1.2), 48, COARSE),
    "belt": Family((1e-3, 2e-2), (0.9, 2), (3, 5), (60, 200), (3, 10), (0.2, 1.2), (0.1, 0.5), (16, 22), (0.3, 1.5)),
    "robot": Family((3e-5, 5e-4), (0.1, 0.5), (4, 10), (80, 300), (0.8, 4), (0.02, 0.2), (0.4, 1.5), (14, 20),
                    (0.2, 1.5), 96, COARSE),
}  # fmt: skip
RATES = ([2000, 2500, 4000, 5000, 8000, 10000, 16000, 20000], [0.15, 0.1, 0.25, 0.1, 0.15, 0.1, 0.1, 0.05])  # Hz
LOG_RATES = (
    [200, 250, 400, 500, 1000, 2000, 4000, 5000, 10000],  # Hz
    [0.06, 0.08, 0.06, 0.15, 0.35, 0.15, 0.06, 0.06, 0.03],
)
SCALES = ([0.05e-6, 0.1e-6, 0.5e-6, 1e-6, 5e-6], [0.2, 0.25, 0.25, 0.2, 0.1])  # m, steps of linear encoders


@dataclass(frozen=True)
class Wishes:
    """What an effect needs of the world it is hidden in."""

    voltages: bool = False
    dq_currents: bool = False
    position: bool = False
    families: Sequence[str] = tuple(FAMILIES)
    motions: Sequence[str] = tuple(MOTIONS)


@dataclass
class World:
    """One axis; `parameters` are those of `axis.c`, `believed` those of the design that is asked with the log."""

    seed: int
    family: str
    rate: float = 0.0  # Hz, of the speed controller
    log_rate: float = 0.0  # Hz
    decimation: int = 1
    duration: float = 0.0  # s
    motion: str = ""
    top: float = 0.0  # speed
    steepest: float = 0.0  # acceleration
    peak: float = 0.0  # torque
    noise: float = 0.0  # A, rms of the measured current
    parameters: dict[str, Any] = field(default_factory=dict)
    recorder: dict[str, Any] = field(default_factory=dict)
    believed: dict[str, float] = field(default_factory=dict)

    @property
    def linear(self) -> bool:
        """Is it in metres?"""
        return self.family == "linear"

    @property
    def rated(self) -> float:
        """Rated torque."""
        return 0.35 * self.peak

    @property
    def u_dc(self) -> float:
        """Voltage of the link, in V."""
        return FAMILIES[self.family].u_dc

    @property
    def speed_bandwidth(self) -> float:
        """Crossover of the speed loop, in Hz."""
        p = self.parameters
        gain = p["K_p"] if p["structure"] == CASCADE else p["K_d"]
        return gain * p["K_t"] / p["J_control"] / 2 / np.pi


Reference = tuple[Array, Array, Array]
Noise = tuple[Array, Array, Array]


def draw(seed: int, wishes: Wishes = Wishes()) -> tuple[World, Reference, Noise]:
    """Draw a world; return it with its reference and its noise as `simulate` takes them."""
    rng = np.random.default_rng(seed)
    world = World(seed, str(rng.choice(list(wishes.families))))
    windings = _draw_axis(rng, world, wishes)
    _draw_encoder(rng, world)
    _draw_controller(rng, world)
    _draw_current_loop(rng, world, windings)
    world.motion = str(rng.choice(list(wishes.motions)))
    p = world.parameters
    may_be_speed = p["structure"] == CASCADE and world.motion in SPEED_MOTIONS
    p["speed_only"] = int(may_be_speed and rng.random() < 0.6)
    reference = _draw_reference(rng, world)
    noise = _draw_noise(rng, world, len(reference[0]))
    _draw_recorder(rng, world, wishes)
    _draw_belief(rng, world)
    return world, reference, noise


def _draw_axis(rng: np.random.Generator, world: World, wishes: Wishes) -> bool:
    """Draw the axis and its clocks. Returns whether its windings are simulated."""
    family = FAMILIES[world.family]
    J, K_t = log_uniform(rng, *family.J), log_uniform(rng, *family.K_t)
    pole_pairs = int(rng.integers(family.pole_pairs[0], family.pole_pairs[1] + 1))
    world.top, F_c = log_uniform(rng, *family.top), log_uniform(rng, *family.F_c)
    F_v = F_c * log_uniform(rng, *family.viscous) / world.top
    steepest = min(log_uniform(rng, *family.peak) * F_c / J, world.top / 0.02)
    world.steepest = max(steepest, world.top / 1.5)
    world.peak = J * world.steepest + F_c + F_v * world.top
    world.rate = float(rng.choice(RATES[0], p=RATES[1]))
    loop = WINDINGS if wishes.voltages else int(rng.choice([FIRST_ORDER, WINDINGS], p=[0.55, 0.45]))
    windings = loop == WINDINGS and not world.linear
    divider = max(1, round(16000 / world.rate)) if windings else 1
    T_control = 1 / world.rate / divider
    world.parameters.update(
        J=J, F_c=F_c, F_v=F_v, K_t=K_t, p=pole_pairs, i_max=1.6 * world.peak / K_t, windings=int(windings),
        T_control=T_control, substeps=max(1, round(T_control / STEP)), speed_divider=divider,
    )  # fmt: skip
    return windings


def _draw_encoder(rng: np.random.Generator, world: World) -> None:
    family = FAMILIES[world.family]
    if family.bits is None:
        step = float(rng.choice(SCALES[0], p=SCALES[1]))
    elif rng.random() < 0.7 or world.family == "torque":
        step = 2 * np.pi / 2 ** int(rng.integers(family.bits[0], family.bits[1] + 1))
    else:
        step = 2 * np.pi / float(rng.choice(family.lines))
    world.parameters["encoder_step"] = step


def _draw_controller(rng: np.random.Generator, world: World) -> None:
    """Draw motor windings, speed estimate, gains and feedforward, in this order."""
    p, T = world.parameters, 1 / world.rate
    R, time_constant = log_uniform(rng, *FAMILIES[world.family].R), log_uniform(rng, 1e-3, 8e-3)
    coarse = p["encoder_step"] / (world.top * T) >= 0.02
    wished = log_uniform(rng, 8, 25) if coarse else log_uniform(rng, 12, 60)
    bandwidth = 2 * np.pi * min(wished, world.rate / 60)  # rad/s
    structure = int(rng.choice([CASCADE, PID, STATE_FEEDBACK], p=[0.6, 0.2, 0.2]))
    estimator = int(rng.choice([0, 1, 2], p=[0.45, 0.35, 0.2]))
    if structure == STATE_FEEDBACK:
        estimator = int(rng.choice([1, 2]))
    p["J_control"] = p["J"] * rng.uniform(0.9, 1.1)
    p["filter_time"] = min(0.3 / bandwidth, max(T, log_uniform(rng, 2e-4, 2e-3)))
    p["mean_length"] = max(1, min(int(0.5 / bandwidth / T), int(rng.integers(2, 33))))
    p["observer_bandwidth"] = bandwidth * rng.uniform(3, 5)
    inductance = R * time_constant
    salient = 1 if rng.random() < 0.7 else 1.15
    p.update(R=R, L_d=inductance, L_q=inductance * salient, psi_f=p["K_t"] / (1.5 * p["p"]))
    p.update(structure=structure, estimator=estimator)
    p.update(_gains(rng, structure, bandwidth, p["J_control"] / p["K_t"]))
    p["acceleration_feedforward"] = float(rng.choice([0, 0.7, 0.9, 1.0]))
    if rng.random() < 0.3:
        p.update(coulomb_feedforward=p["F_c"] * rng.uniform(0.3, 1), viscous_feedforward=p["F_v"])
    p["bandwidth"] = bandwidth


def _gains(rng: np.random.Generator, structure: int, bandwidth: float, inertia: float) -> dict[str, float]:
    """Gains of the axis' controller; `inertia` in A s^2/rad."""
    if structure == CASCADE:
        K_i = inertia * bandwidth * bandwidth / rng.uniform(4, 10)
        return {"K_p": inertia * bandwidth, "K_i": K_i, "K_v": bandwidth / rng.uniform(4, 8)}
    if structure == PID:
        w = bandwidth / 2.2
        return {"K_d": inertia * 3 * w, "K_p": inertia * 3 * w * w, "K_i": inertia * w**3}
    w = bandwidth / 1.8
    return {"K_p": inertia * w * w, "K_d": inertia * 1.6 * w, "K_i": inertia * w**3 * 0.3}


def _draw_current_loop(rng: np.random.Generator, world: World, windings: bool) -> None:
    p = world.parameters
    bandwidth = p.pop("bandwidth")
    if not windings:
        p["current_time"] = min(0.15 / bandwidth, log_uniform(rng, 1.5e-4, 1.2e-3))
        return
    crossover = 2 * np.pi * min(log_uniform(rng, 200, 900), 1 / p["T_control"] / 20)
    u_max = world.u_dc / math.sqrt(3)
    p.update(current_gain=p["L_d"] * crossover, current_reset=p["L_d"] / p["R"], u_max=u_max)
    electric, i_max = p["p"] * world.top, p["i_max"]
    need = electric * p["psi_f"] * 1.15 + p["R"] * i_max * 0.65 + p["L_d"] * p["p"] * world.top * i_max * 0.65
    if need > u_max:
        _rewind(p, 0.9 * u_max / need)


def _rewind(p: dict[str, Any], turns: float) -> None:
    """Give the motor fewer turns, so that its voltage suffices."""
    for name in ("K_t", "psi_f"):
        p[name] *= turns
    for name in ("R", "L_d", "L_q", "current_gain"):
        p[name] *= turns * turns
    for name in ("i_max", "K_p", "K_i", "K_d"):
        if name in p:
            p[name] /= turns


def _draw_reference(rng: np.random.Generator, world: World) -> Reference:
    T = 1 / world.rate
    duration = log_uniform(rng, 14, 75)
    world.decimation = max(1, round(world.rate / float(rng.choice(LOG_RATES[0], p=LOG_RATES[1]))))
    world.log_rate = world.rate / world.decimation
    if world.log_rate > 1500:
        duration = min(duration, max(14, 90000 / world.log_rate))
    world.duration = duration
    speed = draw_speed(world.motion, Path(rng, T, duration, world.top, world.steepest))
    angle = np.cumsum(speed) * T + rng.uniform(-1, 1) * (0.1 if world.linear else 3)
    return angle, speed, np.gradient(speed) / T


def _draw_noise(rng: np.random.Generator, world: World, n: int) -> Noise:
    """Draw the noise of both currents, of the encoder and of the load: white, coloured, lines, the mains."""
    T, K_t = 1 / world.rate, world.parameters["K_t"]
    world.noise = rms = log_uniform(rng, 0.003, 0.03) * world.rated / K_t
    current = rng.standard_normal((2, n)) * rms
    if rng.random() < 0.4:
        kept = math.exp(-2 * np.pi * log_uniform(rng, 30, 400) * T)
        coloured = signal.lfilter([math.sqrt(1 - kept * kept)], [1, -kept], rng.standard_normal(n))
        current[0] += coloured * rms * rng.uniform(0.3, 1)
    t = np.arange(n) * T
    if rng.random() < 0.4:
        for _ in range(int(rng.integers(1, 3))):
            line, size = rng.uniform(8, 0.45 * world.rate), rms * rng.uniform(0.2, 0.8)
            current[0] += size * np.sin(2 * np.pi * line * t + rng.uniform(0, 6))
    if rng.random() < 0.5:
        mains = rms * rng.uniform(0.05, 0.4)
        current[0] += mains * np.sin(2 * np.pi * 50 * t + rng.uniform(0, 6))
    jitter = world.parameters["encoder_step"] * float(rng.choice([0, 0.3, 1.0, 2.0]))
    angle, load = jitter * rng.standard_normal(n), np.zeros(n)
    if rng.random() < 0.3:
        filtered = signal.butter(1, min(0.9, 2 * T * log_uniform(rng, 20, 300)))
        x = signal.lfilter(*filtered, rng.standard_normal(n))
        load = x / x.std() * rms * K_t * rng.uniform(0.2, 0.8)
    return current, angle, load


def _draw_recorder(rng: np.random.Generator, world: World, wishes: Wishes) -> None:
    r, windings = world.recorder, bool(world.parameters["windings"])
    dq_currents = wishes.voltages or wishes.dq_currents
    thinned = world.decimation > 1
    r["thinning"] = str(rng.choice(["instant", "fir", "mean"], p=[0.6, 0.2, 0.2])) if thinned else "instant"
    r["theta"] = wishes.position or bool(rng.random() < 0.8)
    if r["theta"]:
        kinds = ["none", "drive", "mean", "difference", "rounded"]
        r["omega"] = str(rng.choice(kinds, p=[0.3, 0.25, 0.2, 0.15, 0.1]))
    else:
        r["omega"] = str(rng.choice(["drive", "mean"]))
    torque = str(rng.choice(["i_q", "command", "torque", "permille"], p=[0.4, 0.2, 0.2, 0.2]))
    if wishes.voltages or (dq_currents and torque != "command"):
        torque = "i_q"
    r["torque"] = torque
    filtered = torque in ("torque", "permille") and rng.random() < 0.6
    r["torque_filter"] = log_uniform(rng, 3e-4, 4e-3) if filtered else 0.0  # s
    r["mean_length"] = int(rng.integers(2, 17))
    r["coarse_time"] = bool(rng.random() < 0.2)
    r["digits"] = int(rng.choice([5, 6, 7, 9]))
    r["reference"] = bool(rng.random() < 0.5)
    r["voltages"] = bool(windings and torque == "i_q" and (wishes.voltages or rng.random() < 0.5))
    r["motor_known"] = (dq_currents or r["voltages"] or bool(rng.random() < 0.4)) and not world.linear
    r["format"] = str(rng.choice(["csv", "npz"]))
    r["counts"] = bool(rng.random() < 0.25 and r["theta"])


def _draw_belief(rng: np.random.Generator, world: World) -> None:
    """Draw the design's values: friction may be wrong by three, the motor's data by a few per cent."""

    def believed_friction(true: float) -> float:
        return true * (log_uniform(rng, 1 / 3, 3) if rng.random() < 0.5 else rng.uniform(0.9, 1.1))

    p, b = world.parameters, world.believed
    b["J"] = p["J"] * rng.uniform(0.92, 1.08)
    b["F_c"], b["F_v"] = believed_friction(p["F_c"]), believed_friction(p["F_v"])
    for name, off in (("psi_f", 0.015), ("R", 0.05), ("L_d", 0.07), ("L_q", 0.07), ("K_t", 0.015)):
        b[name] = p[name] * rng.uniform(1 - off, 1 + off)
