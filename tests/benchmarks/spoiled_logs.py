r"""The table of spoiled logs: what a recorder, an export or a wrong design does to a clean log, and what is answered.

    python -m tests.benchmarks.spoiled_logs                 the reference motor, one seed
    python -m tests.benchmarks.spoiled_logs --seeds 5       five clean logs, each of another motor and motion
    python -m tests.benchmarks.spoiled_logs --examine       the examination of log and design alone, seconds

Prints a row per spoiled log: the answer (verdict, names, codes), the codes that were wanted, and in how many seeds
one of them came and no physical effect was named.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.log import Log

__all__ = ["SPOILED", "Spoiled", "clean_log"]

Array = NDArray[Any]
Change = Callable[[Log, Design, np.random.Generator], Log | tuple[Log, Design]]
CURRENTS, VOLTAGES, DQ = ("i_d", "i_q"), ("u_d", "u_q"), ("i_d", "i_q", "u_d", "u_q")


@dataclass(frozen=True)
class Spoiled:
    """One way to spoil a log.

    Attributes
    ----------
    change : function (log, design, generator) -> log, or log and design
    wanted : tuple of str
        Codes, verdicts or effects of which one answers it.
    """

    change: Change
    wanted: tuple[str, ...]


def _scaled(log: Log, factor: float, *names: str) -> Log:
    return log.with_channels(**{name: factor * log[name] for name in names if name in log})


def _swapped(log: Log, a: str, b: str) -> Log:
    return log.with_channels(**{a: log[b], b: log[a]})


def _late(log: Log, seconds: float, *names: str) -> Log:
    return log.with_channels(**{n: np.interp(log.t - seconds, log.t, log[n]) for n in names if n in log})


def _filtered(log: Log, seconds: float) -> Log:
    a = math.exp(-log.period / seconds)
    out = {n: lfilter([1 - a], [1.0, -a], log[n], zi=[a * log[n][0]])[0] for n in CURRENTS if n in log}
    return log.with_channels(**out)


def _held(log: Log, seconds: float) -> Log:
    step = max(2, round(seconds / log.period))
    place = np.arange(len(log)) // step * step
    return log.with_channels(i_q=log["i_q"][place])


def _rows(log: Log, keep: Array) -> Log:
    """Keep these rows, and write their times without the gaps."""
    t = log.t[0] + log.period * np.arange(int(keep.sum()))
    return Log({n: t if n == "t" else v[keep] for n, v in log.channels.items()}, log.motion)


def _lost(log: Log, rng: np.random.Generator) -> Log:
    return _rows(log, rng.random(len(log)) >= 0.05)


def _cut(log: Log, seconds: float) -> Log:
    return _rows(log, (log.t < 0.4 * log.duration) | (log.t > 0.4 * log.duration + seconds))


def _jitter(log: Log, periods: float, rng: np.random.Generator) -> Log:
    """Stamps of a clock that jitters; a later sample never has an earlier stamp."""
    t = np.sort(log.t + periods * log.period * rng.standard_normal(len(log)))
    return log.with_channels(t=t + 1e-9 * np.arange(len(t)))


def _bits(log: Log) -> Log:
    def coarse(values: Array) -> Array:
        step = float(np.max(np.abs(values))) / 127.0
        return np.round(values / step) * step if step > 0.0 else values

    return log.with_channels(**{n: coarse(v) for n, v in log.channels.items() if n not in ("t", "theta")})


def _clipped(log: Log, share: float) -> Log:
    limit = share * float(np.max(np.abs(log["i_q"])))
    return log.with_channels(i_q=np.clip(log["i_q"], -limit, limit))


def _alpha_beta(log: Log, design: Design) -> Log:
    angle = float(design.motor.p or 1) * log["theta"]
    c, s = np.cos(angle), np.sin(angle)
    return log.with_channels(i_d=c * log["i_d"] - s * log["i_q"], i_q=s * log["i_d"] + c * log["i_q"])


def _foreign(log: Log, design: Design, kind: str, rng: np.random.Generator) -> Log:
    size, n = float(np.std(log["i_q"])), len(log)
    if kind == "axis":
        moved = np.roll(log["i_q"][::-1], n // 3)
        return log.with_channels(i_q=moved)
    noise = rng.standard_normal(n)
    if kind == "walk":
        noise = np.cumsum(noise)
        noise = (noise - noise.mean()) / np.std(noise)
    return log.with_channels(i_q=size * noise)


def _jump(log: Log) -> Log:
    return log.with_channels(theta=log["theta"] + 2.0 * math.pi * (log.t > 0.45 * log.duration))


def _design(log: Log, design: Design, **changed: Any) -> tuple[Log, Design]:
    return log, design.replace(motor=changed)


def _omega_of(log: Log) -> Log:
    """The log with a speed and no angle."""
    speed = log["omega"] if "omega" in log else np.gradient(log["theta"], log.t)
    return Log({n: v for n, v in log.channels.items() if n not in ("theta", "omega")} | {"omega": speed})


def _reference(log: Log) -> Log:
    out = _omega_of(log)
    return out.with_channels(omega=log["omega_ref"])


def _per_unit(log: Log, design: Design) -> Log:
    return _scaled(log, math.sqrt(3.0) / design.drive.u_dc, *VOLTAGES)


SPOILED: dict[str, Spoiled] = {
    "nothing": Spoiled(lambda log, d, g: log, ("consistent",)),
    "i_q, wrong sign": Spoiled(lambda log, d, g: _scaled(log, -1.0, "i_q"), ("current_sign",)),
    "i_d and i_q, wrong sign": Spoiled(lambda log, d, g: _scaled(log, -1.0, *CURRENTS), ("current_sign",)),
    "voltages, wrong sign": Spoiled(lambda log, d, g: _scaled(log, -1.0, *VOLTAGES), ("voltage_sign",)),
    "voltages times sqrt(3)": Spoiled(lambda log, d, g: _scaled(log, 3**0.5, *VOLTAGES), ("voltage_factor",)),
    "voltages over sqrt(3)": Spoiled(lambda log, d, g: _scaled(log, 3**-0.5, *VOLTAGES), ("voltage_factor",)),
    "voltages over sqrt(2)": Spoiled(lambda log, d, g: _scaled(log, 2**-0.5, *VOLTAGES), ("voltage_factor",)),
    "voltages per unit": Spoiled(lambda log, d, g: _per_unit(log, d), ("voltage_factor",)),
    "u_d and u_q swapped": Spoiled(lambda log, d, g: _swapped(log, *VOLTAGES), ("voltages_swapped",)),
    "i_d and i_q swapped": Spoiled(lambda log, d, g: _swapped(log, *CURRENTS), ("currents_swapped",)),
    "3 pole pairs in the design": Spoiled(lambda log, d, g: _design(log, d, p=3), ("pole_pairs",)),
    "8 pole pairs in the design": Spoiled(lambda log, d, g: _design(log, d, p=8), ("pole_pairs",)),
    "encoder counted backwards": Spoiled(lambda log, d, g: _scaled(log, -1.0, "theta", "omega"), ("motion_sign",)),
    "angle wrapped electrically": Spoiled(
        lambda log, d, g: _omega_less(log, np.mod(float(d.motor.p or 1) * log["theta"], 2 * math.pi)),
        ("motion_factor", "speed_factor"),
    ),
    "angle wraps at 25": Spoiled(lambda log, d, g: _omega_less(log, np.mod(log["theta"], 25.0)), ("angle_unwrapped",)),
    "angle in degrees": Spoiled(
        lambda log, d, g: _scaled(log, 180 / math.pi, "theta"), ("speed_factor", "motion_factor")
    ),
    "angle in turns, no speed": Spoiled(
        lambda log, d, g: _omega_less(log, log["theta"] / (2 * math.pi)), ("motion_factor",)
    ),
    "rpm for rad/s, no angle": Spoiled(lambda log, d, g: _scaled(_omega_of(log), 30 / math.pi, "omega"),
                                       ("motion_factor",)),
    "current in per cent of rated": Spoiled(
        lambda log, d, g: _scaled(log, 100.0 / _rated(d), *CURRENTS), ("current_factor",)
    ),
    "torque in per cent of rated": Spoiled(lambda log, d, g: _percent_torque(log, d), ("inertia_factor",)),
    "ms taken for s": Spoiled(lambda log, d, g: _scaled(log, 1000.0, "t"), ("time_factor", "speed_factor")),
    "time doubled": Spoiled(lambda log, d, g: _scaled(log, 2.0, "t"), ("time_factor", "speed_factor")),
    "time doubled, angle alone": Spoiled(
        lambda log, d, g: _scaled(_omega_less(log, log["theta"]), 2.0, "t"), ("time_factor",)
    ),
    "current late by 5 ms": Spoiled(lambda log, d, g: _late(log, 5e-3, *CURRENTS), ("not_synchronous", "delay")),
    "current late by 10 ms": Spoiled(lambda log, d, g: _late(log, 1e-2, *CURRENTS), ("not_synchronous", "delay")),
    "current late by 50 ms": Spoiled(lambda log, d, g: _late(log, 5e-2, *CURRENTS), ("not_synchronous", "delay")),
    "current filtered, 2 ms": Spoiled(lambda log, d, g: _filtered(log, 2e-3), ("drive_signal_filtered",)),
    "current filtered, 5 ms": Spoiled(lambda log, d, g: _filtered(log, 5e-3), ("current_filtered", "not_synchronous")),
    "current filtered, 20 ms": Spoiled(lambda log, d, g: _filtered(log, 2e-2), ("current_filtered", "not_synchronous")),
    "current held for 10 ms": Spoiled(lambda log, d, g: _held(log, 1e-2), ("held_channel",)),
    "5 % of samples lost": Spoiled(lambda log, d, g: _lost(log, g), ("lost_samples", "position_jumps")),
    "stamps jitter by 0.6 periods": Spoiled(lambda log, d, g: _jitter(log, 0.6, g), ("equal_steps", "even_stamps")),
    "stamps jitter by 3 periods": Spoiled(lambda log, d, g: _jitter(log, 3.0, g), ("equal_steps", "even_stamps")),
    "6 s cut out": Spoiled(lambda log, d, g: _cut(log, 6.0), ("cut_in_time",)),
    "angle jumps by a turn": Spoiled(lambda log, d, g: _jump(log), ("cut_in_time", "position_jumps")),
    "current clipped": Spoiled(lambda log, d, g: _clipped(log, 0.3), ("clipped_channel",)),
    "8 bits": Spoiled(lambda log, d, g: _bits(log), ("coarse_steps", "quantised_channel", "consistent")),
    "abs(i_q)": Spoiled(lambda log, d, g: log.with_channels(i_q=np.abs(log["i_q"])), ("magnitude_channel",)),
    "abs(omega), no angle": Spoiled(
        lambda log, d, g: _omega_of(log).with_channels(omega=np.abs(_omega_of(log)["omega"])), ("magnitude_channel",)
    ),
    "alpha-beta currents": Spoiled(lambda log, d, g: _alpha_beta(log, d), ("stationary_currents",)),
    "reference for speed": Spoiled(lambda log, d, g: _reference(log), ("reference_as_measured", "unrelated_torque")),
    "current of another axis": Spoiled(lambda log, d, g: _foreign(log, d, "axis", g), ("unrelated_torque",)),
    "white noise for current": Spoiled(lambda log, d, g: _foreign(log, d, "noise", g), ("unrelated_torque",)),
    "random walk for current": Spoiled(lambda log, d, g: _foreign(log, d, "walk", g), ("unrelated_torque",)),
    "speed of a load behind 10": Spoiled(lambda log, d, g: _scaled(log, 0.1, "theta", "omega"), ("motion_factor",)),
    "offset of the current": Spoiled(
        lambda log, d, g: log.with_channels(i_q=log["i_q"] + 0.1), ("constant_load", "current_offset_dc")
    ),
    "constant current": Spoiled(
        lambda log, d, g: log.with_channels(i_q=np.full(len(log), 0.1)), ("LogError", "constant_channel")
    ),
}  # fmt: skip


def _omega_less(log: Log, theta: Array) -> Log:
    return Log({n: v for n, v in log.channels.items() if n not in ("theta", "omega")} | {"theta": theta})


def _rated(design: Design) -> float:
    return design.drive.i_max if math.isfinite(design.drive.i_max) else 3.0


def _percent_torque(log: Log, design: Design) -> Log:
    torque = 100.0 * log["i_q"] / _rated(design)
    return Log({n: v for n, v in log.channels.items() if n not in DQ} | {"torque": torque})


def clean_log(seed: int) -> tuple[Log, Design]:
    """Return a clean log with every channel: seed 0 of the reference motor, others of worlds drawn at random."""
    if seed % 2 == 0:
        from pathlib import Path

        from pmsm_ctrl.simulate import simulate
        from tests.benchmarks.blind import motion

        design = Design.read(Path(__file__).resolve().parents[2] / "designs" / "hand_tuned.toml")
        names = ("identification", "mixed", "moves", "servo")
        return simulate(design, motion(names[seed // 2 % 4], design, seed), seed=seed), design
    from tests.benchmarks.worlds.hidden import simulate_world
    from tests.benchmarks.worlds.world import draw

    for number in range(1000 + 50 * seed, 50000):
        world = draw(number, linear=False)
        if world.voltages and world.mode != "filtered" and world.runs == 1 and "omega_ref" and not world.dropped:
            log = simulate_world(world)
            if "omega_ref" in log and log.rate >= 900.0:
                return log, world.design
    raise AssertionError


def answer_of(log: Log, design: Design, only_examine: bool) -> tuple[str, set[str], set[str]]:
    """Return the verdict, the effects named and the codes of one log."""
    from pmsm_ctrl.diagnose import diagnose
    from pmsm_ctrl.importers import check
    from pmsm_ctrl.plausibility import examine

    codes = {notice.code for notice in check(log, design)}
    try:
        found = examine(design, log)
        codes |= {notice.code for notice in found.notices}
        if only_examine:
            verdict = "implausible" if found.contradictions else "doubtful" if found.notices else "consistent"
            return verdict, set(), codes
        diagnosis = diagnose(design, log, plan=False)
    except PmsmCtrlError as error:
        return type(error).__name__, set(), codes | {str(error)}
    codes |= {notice.code for notice in diagnosis.notices}
    return str(diagnosis.verdict), {step.effect for step in diagnosis.steps}, codes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--examine", action="store_true", help="without the diagnosis")
    parser.add_argument("--only", default="", help="rows whose name holds this")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    logs = [clean_log(seed) for seed in range(arguments.seeds)]
    total = met_total = 0
    print("spoiled log | answer | wanted | met")
    for name, row in SPOILED.items():
        if arguments.only not in name:
            continue
        answers: Counter[str] = Counter()
        met = 0
        for seed, (log, design) in enumerate(logs):
            made = row.change(log, design, np.random.default_rng(seed))
            spoiled, believed = made if isinstance(made, tuple) else (made, design)
            verdict, effects, codes = answer_of(spoiled, believed, arguments.examine)
            said = {verdict} | effects | codes
            good = bool(said & set(row.wanted)) and effects <= set(row.wanted)
            met += good
            answers[", ".join([verdict, *sorted(effects), *sorted(codes)])] += 1
        total, met_total = total + len(logs), met_total + met
        shown = "; ".join(f"{text}{f' ({count})' if count > 1 else ''}" for text, count in answers.most_common())
        print(f"{name} | {shown} | {' or '.join(row.wanted)} | {met} of {len(logs)}", flush=True)
    print(f"met: {met_total} of {total}")


if __name__ == "__main__":
    main()
