"""The tracker beside simpler ones under model errors: ``python -m tests.benchmarks.trackers``.

Every tracker gets the same log and the same wrong design. Printed are the rms errors of F_c and F_v after the first
quarter, and the changes of friction that were announced although friction never changed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from pmsm_ctrl.compensate import adaptive, baseline, compensated, simulate_adaptive
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import Scenario, scenario, simulate
from pmsm_ctrl.simulate.run import LOGGED
from pmsm_ctrl.track import FrictionTracker, Settings, track

ROOT = Path(__file__).resolve().parents[2]
F_C, F_V = 0.0213, 0.000168
MEMORY = 0.7  # s over which every tracker averages, that of the default drift
STANDSTILL = 0.1  # rad/s below which the simple trackers do not learn, that of the package for this motor
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A log whose plant is not what the design says.

    Attributes
    ----------
    name : str
    truth : callable
        Design -> the plant.
    damage : callable, optional
        Log, rng -> the log as it is read.
    holes : bool
        Whether runs of 5 to 100 ms of the current are NaN, twice a second. A log refuses them, a live stream has them.
    load : callable
        Time, s -> load torque, N m, that no channel shows.
    noise : float
        Factor on the current noise.
    """

    name: str
    truth: Callable[[Design], Design] = lambda design: design
    damage: Callable[[Log, np.random.Generator], Log] | None = None
    holes: bool = False
    load: Callable[[Array], Array] = np.zeros_like
    noise: float = 1.0


def inertia(factor: float) -> Callable[[Design], Design]:
    """Return the change of a plant's inertia."""
    return lambda design: design.with_parameters(J=factor * design.J)


def late_torque(log: Log, rng: np.random.Generator) -> Log:
    """Return the log with currents one sample late."""
    return Log({name: values[:-1] if name in ("i_d", "i_q") else values[1:] for name, values in log.channels.items()})


def lost_samples(log: Log, rng: np.random.Generator) -> Log:
    """Return the log without 5 % of its samples."""
    keep = rng.random(len(log)) > 0.05
    return Log({name: values[keep] for name, values in log.channels.items()})


def with_holes(log: Log, rng: np.random.Generator) -> Log:
    """Return a log that the simple trackers and a live stream can read, with NaN in the current."""
    i_q = log["i_q"].copy()
    for start in rng.integers(0, len(log) - 100, int(2 * log.t[-1])):
        i_q[start : start + rng.integers(5, 100)] = np.nan
    holed = object.__new__(Log)
    holed.__dict__.update({**log.__dict__, "channels": {**log.channels, "i_q": i_q}})
    return holed


CASES = (
    Case("nothing"),
    *(Case(f"J {100 * (f - 1):+.0f} %", inertia(f)) for f in (0.5, 0.8, 0.9, 1.1, 1.2, 1.5)),
    Case("load of 10 mN m", load=lambda t: np.full(t.shape, 0.01)),
    Case("load steps of 10 mN m", load=lambda t: 0.01 * (np.floor(t / 3.0) % 2)),
    Case("cogging of 4 mN m", lambda d: d.with_effect("cogging", {"a_s": 0.004, "a_c": 0.0, "order": 24.0})),
    Case("Stribeck, 10 mN m, 2 rad/s", lambda d: d.with_effect("stribeck", {"dF_s": 0.01, "w_s": 2.0, "delta": 2.0})),
    Case("presliding over 2 mrad", lambda d: d.with_effect("presliding", {"z_s": 0.002, "z_b": 0.5, "tau_z": 1e-3})),
    Case("currents one sample late", damage=late_torque),
    Case("5 % of the samples lost", damage=lost_samples),
    Case("runs of NaN in i_q, live", holes=True),
    Case("current noise twice as large", noise=2.0),
)


def misread(case: Case, seed: int) -> type[adaptive._Tracker]:
    """Return a tracker of the loop that reads the drive's rows as the case spoils them, interval by interval."""
    place, rng = [LOGGED.index(name) for name in ("i_d", "i_q")], np.random.default_rng(seed)

    class Misreading(adaptive._Tracker):
        last: Array | None = None

        def feed(self, rows: Array) -> None:
            if case.damage is late_torque:
                true, rows = rows, rows.copy()
                rows[1:, place] = true[:-1, place]
                rows[0, place] = true[0, place] if self.last is None else self.last
                self.last = true[-1, place]
            elif case.damage is lost_samples:
                rows = rows[rng.random(len(rows)) > 0.05]
            elif case.holes and rng.random() < 0.1:
                rows = rows.copy()
                rows[: rng.integers(5, len(rows)), place[1]] = np.nan
            super().feed(rows)

    return Misreading


def log_of(case: Case, design: Design, motion: Scenario, seed: int) -> Log:
    """Return the log of a case as a tracker reads it."""
    noisy = design.replace(sensor={"current_noise": case.noise * design.sensor.current_noise})

    def references(t: Array) -> dict[str, Array]:
        return {**motion.references(t), "T_load": case.load(t)}

    loaded = Scenario(motion.name, motion.duration, references, control=motion.control)
    log = simulate(noisy, loaded, truth=case.truth(noisy), seed=seed)
    hidden = Log({name: log[name] for name in log if name != "T_load"})
    rng = np.random.default_rng(seed)
    if case.holes:
        return with_holes(hidden, rng)
    return case.damage(hidden, rng) if case.damage else hidden


@dataclass(frozen=True)
class Found:
    """Histories of F_c and F_v, and the changes announced."""

    t: Array
    F_c: Array
    F_v: Array
    changes: int = 0


def ours(design: Design, log: Log) -> Found:
    """Track by the package, everything by default; a stream with NaN by the live tracker."""
    if not np.isfinite(log["i_q"]).all():
        tracker = FrictionTracker(design, Settings(estimate=("T_load", "J")), period=log.period)
        rows = zip(*(log[name].tolist() for name in ("t", "theta", "i_q")), strict=True)
        read = [tracker.update(t, theta=theta, i_q=i_q) for t, theta, i_q in rows]
        changes = sum(one.event == "change" for one in read)
        return Found(log.t, np.array([one.F_c for one in read]), np.array([one.F_v for one in read]), changes)
    found = track(design, log)
    return Found(log.t, found.history["F_c"], found.history["F_v"], found.counts.get("change", 0))


def steps(design: Design, log: Log) -> list[tuple[float, float, float, float]]:
    """Return (time, step, speed, torque) of the samples that can be read."""
    torque = design.K_t_assumed * log["i_q"]
    rows, last = [], 0
    for k in range(1, len(log)):
        if np.isfinite(log["omega"][k]) and np.isfinite(torque[k]) and np.isfinite(torque[last]):
            rows.append((k, log.t[k] - log.t[last], log["omega"][k], 0.5 * (torque[k] + torque[last])))
        if np.isfinite(torque[k]) or not np.isfinite(torque[last]):
            last = k
    return rows


def filled(values: Array) -> Array:
    """Return a history with every gap filled by the value before."""
    known = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(values.size), 0))
    return values[known]


def plain_kalman(design: Design, log: Log) -> Found:
    """filterpy's Kalman filter on speed, F_c and F_v: no gate but standstill, no change detector."""
    kf = KalmanFilter(dim_x=3, dim_z=1)
    start = np.array([F_C, F_V])
    kf.x, kf.P = np.array([0.0, *start]), np.diag([1.0, *(0.5 * start) ** 2])
    kf.H, kf.R = np.array([[1.0, 0.0, 0.0]]), np.array([[0.03**2]])
    density = (design.K_t_assumed * design.sensor.current_noise) ** 2 * log.period
    F_c, F_v = np.full(len(log), np.nan), np.full(len(log), np.nan)
    F_c[0], F_v[0] = start
    for k, dt, speed, torque in steps(design, log):
        if abs(speed) > STANDSTILL:
            kf.F = np.eye(3)
            kf.F[0, 1:] = -dt / design.J * np.array([np.sign(speed), kf.x[0]])
            kf.Q = np.diag([density * dt / design.J**2, *((0.01 * start) ** 2 * dt)])
            kf.predict(u=np.array([torque]), B=np.array([[dt / design.J], [0.0], [0.0]]))
            kf.update(np.array([speed]))
        else:
            kf.x[0] = speed
            kf.P[0, :] = kf.P[:, 0] = 0.0
            kf.P[0, 0] = 0.03**2
        F_c[k], F_v[k] = kf.x[1:]
    return Found(log.t, filled(F_c), filled(F_v))


def forgetting(design: Design, log: Log) -> Found:
    """Recursive least squares with exponential forgetting on the torque balance, acceleration over 10 ms."""
    scale = np.array([1.0, 100.0])  # of sgn(omega) and omega
    x, P = np.array([F_C, F_V * 100.0]), np.diag([1e2, 1e2])
    F_c, F_v = np.full(len(log), np.nan), np.full(len(log), np.nan)
    F_c[0], F_v[0] = F_C, F_V
    torque_sum = time = 0.0
    before: float | None = None
    for k, dt, speed, torque in steps(design, log):
        if abs(speed) < STANDSTILL or dt > 0.02 or (before is not None and before * speed < 0.0):
            before = None
        elif before is None:
            before, torque_sum, time = speed, 0.0, 0.0
        else:
            torque_sum, time = torque_sum + torque * dt, time + dt
            if time > 0.0095:
                row = np.array([np.sign(speed), 0.5 * (speed + before)]) / scale
                y = torque_sum / time - design.J * (speed - before) / time
                fade = np.exp(-time / MEMORY)
                gain = P @ row / (fade + row @ P @ row)
                x = x + gain * (y - row @ x)
                P = (P - np.outer(gain, row @ P)) / fade
                before, torque_sum, time = speed, 0.0, 0.0
        F_c[k], F_v[k] = x / scale
    return Found(log.t, filled(F_c), filled(F_v))


def observer(design: Design, log: Log) -> Found:
    """Disturbance observer: torque that the inertia does not explain, averaged along the motion; F_v as designed."""
    level, speed_last = F_C, 0.0
    F_c = np.full(len(log), np.nan)
    F_c[0] = F_C
    for k, dt, speed, torque in steps(design, log):
        if abs(speed) > STANDSTILL and speed * speed_last > 0.0 and dt <= 0.02:
            unexplained = torque - design.J * (speed - speed_last) / dt
            level += dt / MEMORY * (np.sign(speed) * unexplained - F_V * abs(speed) - level)
        speed_last, F_c[k] = speed, level
    return Found(log.t, filled(F_c), np.full(len(log), F_V))


TRACKERS = {
    "track": ours, "filterpy's Kalman filter": plain_kalman, "least squares with forgetting": forgetting,
    "disturbance observer": observer,
}  # fmt: skip


def errors(found: Found) -> tuple[float, float, int]:
    """Return the rms errors of F_c and F_v after the first quarter, %, and the changes announced."""
    late = found.t > found.t[0] + 0.25 * np.ptp(found.t)
    pairs = ((found.F_c, F_C), (found.F_v, F_V))
    F_c, F_v = (100.0 * float(np.sqrt(np.mean((values[late] / true - 1.0) ** 2))) for values, true in pairs)
    return F_c, F_v, found.changes


def in_the_loop(design: Design, case: Case, seeds: range) -> tuple[float, float, float]:
    """Return rms position errors of reversals at 10 rad/s, mrad: not compensated, fixed values, tracked values."""
    base = baseline(design)
    motion = scenario("reversal", design, speed=10.0)

    def references(t: Array) -> dict[str, Array]:
        return {**motion.references(t), "T_load": case.load(t)}

    loaded = Scenario(motion.name, motion.duration, references, control=motion.control)
    ways = [base, *(compensated(base, ["coulomb", "viscous"], source=way) for way in ("reference", "adaptive"))]
    found = []
    for believed, seed in ((b, seed) for b in ways for seed in seeds):
        noisy = believed.replace(sensor={"current_noise": case.noise * design.sensor.current_noise})
        plant = case.truth(noisy)
        if believed.compensation.source == "adaptive":
            with patch.object(adaptive, "_Tracker", misread(case, seed)):
                log = simulate_adaptive(believed, loaded, truth=plant, seed=seed).log
        else:
            log = simulate(believed, loaded, truth=plant, seed=seed, keep_truth=True)
        late = log.t > 2.0
        found.append(float(np.sqrt(np.mean((log["theta_ref"] - log["theta_true"])[late] ** 2))))
    none, fixed, tracked = 1e3 * np.sqrt(np.mean(np.square(found).reshape(3, -1), axis=1))
    return none, fixed, tracked


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--speed", type=float, default=150.0, help="of the triangle, rad/s")
    parser.add_argument("--loop", action="store_true", help="position errors with the tracker in the loop")
    parser.add_argument("--case", help="only cases whose name contains this")
    asked = parser.parse_args()
    design = Design.read(ROOT / "designs" / "seed_motor.toml")
    motion = scenario("triangle", design, speed=asked.speed, period=2.0, cycles=10.0)
    seeds = range(asked.first, asked.first + asked.seeds)
    if asked.loop:
        print("Reversals at 10 rad/s, rms position error in mrad\n")
        print("| wrong | not compensated | fixed | tracked | change |\n|---|---|---|---|---|", flush=True)
        for case in CASES:
            if not asked.case or asked.case in case.name:
                none, fixed, tracked = in_the_loop(design, case, seeds)
                change = 100.0 * (tracked / fixed - 1.0)
                print(f"| {case.name} | {none:.2f} | {fixed:.3f} | {tracked:.3f} | {change:+.1f} % |", flush=True)
        return
    print("F_c, F_v: rms error in %; in brackets: changes of friction announced in all runs\n")
    print(f"| wrong | {' | '.join(TRACKERS)} |\n|---|{'---|' * len(TRACKERS)}", flush=True)
    for case in CASES:
        if asked.case and asked.case not in case.name:
            continue
        logs = [log_of(case, design, motion, seed) for seed in seeds]
        cells = []
        for name, tracker in TRACKERS.items():
            rows = np.array([errors(tracker(design, log)) for log in logs])
            F_c, F_v = np.sqrt(np.mean(rows[:, :2] ** 2, axis=0))
            cells.append(f"{F_c:.1f}, {F_v:.1f}" + (f" ({rows[:, 2].sum():.0f})" if name == "track" else ""))
        print(f"| {case.name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
