r"""EMPS: which criterion and which structure, chosen on ``DATA_EMPS`` alone, simulates the pulses best.

    python -m tests.benchmarks.emps_criteria            some minutes
    python -m tests.benchmarks.emps_criteria --all      every variant that was compared, not the chosen ones alone

The task is that of `tests.benchmarks.emps`. A cycle of ``DATA_EMPS`` is left out of the fit and simulated from its
measured begin; the least error over the four cycles chooses among structures and criteria. The pulses are simulated
once for every method, by the variant that was chosen, and never choose. The criteria:

- *stretches*: squared error of the position over stretches of some length, from the measured begin of each;
- *multiple shooting*: the same with speed and position at the begin of each stretch as nuisances;
- *innovations*: one-step prediction by a Kalman filter in innovations form, its gains fitted; the load beside the model
  is a disturbance whose correlation decays with a time constant, long ones being a random walk;
- *whole record*: the official error on ``DATA_EMPS``, least of many starts;
- *mean of many*: the mean of the positions that all fits to the whole record simulate which it hardly tells apart.

The integration is written here, one step a millisecond.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import butter, filtfilt, lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log
from tests.benchmarks.emps import CYCLE, DATA, FIRST, GIVEN, ROOT, stretches

Array = NDArray[np.float64]
H = 1e-3  # s
FOUR = ("J", "F_c", "F_v", "T_0")
ASYMMETRIC = (*FOUR, "dF_v")
RISING = (*ASYMMETRIC, "dF_r", "w_r")
STRUCTURES = {
    "four parameters": FOUR,
    "asymmetry": ASYMMETRIC,
    "asymmetry, rising friction": RISING,
    "asymmetry, saturation": (*ASYMMETRIC, "k_s"),
    "asymmetry, rising friction, saturation": (*RISING, "k_s"),
    "asymmetry, friction by load": (*ASYMMETRIC, "mu"),
    "asymmetry, Stribeck of either sign": (*ASYMMETRIC, "dF_s", "w_s"),
    "asymmetry, quadratic drag": (*ASYMMETRIC, "k_2"),
}
# Value that is nothing or the start, scale, lower and upper bound.
PARAMETERS = {
    "J": (95.1, 95.0, 50.0, 150.0), "F_c": (20.4, 20.0, 0.0, 40.0), "F_v": (203.0, 200.0, 0.0, 500.0),
    "T_0": (-3.2, 3.0, -20.0, 20.0), "dF_v": (0.0, 30.0, -200.0, 200.0), "dF_r": (0.0, 10.0, -20.0, 40.0),
    "w_r": (0.006, 0.006, 1e-3, 0.08), "mu": (0.0, 0.03, -0.3, 0.3), "k_s": (0.0, 3e-4, -2e-3, 2e-3),
    "k_2": (0.0, 200.0, -2000.0, 2000.0), "dF_s": (0.0, 5.0, -20.0, 20.0), "w_s": (0.01, 0.01, 1e-3, 0.1),
    "late": (-0.81e-3, 1e-3, -2e-3, 2e-3), "lag": (0.0, 1e-3, 0.0, 5e-3), "g_a": (0.0, 0.02, -0.2, 0.2),
    "z_s": (0.0, 1e-4, 1e-5, 5e-3),
}  # fmt: skip
NAMES = tuple(PARAMETERS)
FROM = {"dF_v": 20.0, "dF_r": 5.0, "dF_s": 0.5, "lag": 3e-4, "z_s": 1e-4}  # where a fit starts that has them
WAVES = (0, 2, 4, 6)  # cosines along the stroke for each direction, 1 N (one standard deviation) each
PRIOR = 3.0  # weight of that
LOW, HIGH, CELL = -0.003, 0.25, 1e-3  # m
LENGTHS, SHOOTING = (1000, 3090, CYCLE), (500, 1000, 3090)  # samples
DECAYS = (0.003, 0.03, 0.3, 3.0)  # s
STARTS, ABOUT, SEED = 20, 0.05, 1
ALIKE = (1.05, 1.15)  # errors on DATA_EMPS, over the least, of fits that are averaged
SETTLED = 300  # samples of the filter
BRISTLE_DAMPING = 0.6  # of a bristle, in the root of stiffness times mass: 0.3 of critical


@numba.njit
def step(q, v, force, p, beside):  # type: ignore[no-untyped-def]
    """Return position and speed after a millisecond; dry friction sticks."""
    J, F_c, F_v, T_0, dF_v, dF_r, w_r, mu, k_s, k_2, dF_s, w_s = p[:12]
    acting, a = force * (1.0 - k_s * abs(force)), abs(v)
    dry = max(F_c + mu * abs(force) + dF_s * np.exp(-a / w_s), 0.0)
    smooth = dF_v * a + k_2 * v * a + T_0 + beside
    if dF_r != 0.0:
        smooth += dF_r * np.tanh(v / w_r)
    half = 0.5 * H * F_v / J
    free, held = (v * (1.0 - half) + H * (acting - smooth) / J) / (1.0 + half), H * dry / J
    now = free - held if free > held else (free + held if free < -held else 0.0)
    return q + 0.5 * H * (v + now), now


@numba.njit
def step_bristle(q, v, z, force, p, beside):  # type: ignore[no-untyped-def]
    """Return position, speed and deflection, in its limits, after a millisecond; dry friction is LuGre's bristle."""
    J, F_c, F_v, T_0, dF_v, dF_r, w_r, mu, k_s, k_2, dF_s, w_s = p[:12]
    z_s, acting, a = p[15], force * (1.0 - k_s * abs(force)), abs(v)
    dry = max(F_c + mu * abs(force) + dF_s * np.exp(-a / w_s), 0.0)
    smooth = dF_v * a + k_2 * v * a + T_0 + beside + dF_r * np.tanh(v / w_r)
    towards = (1.0 if v > 0.0 else -1.0) * (1.0 - np.exp(-a * H / z_s))
    bent = z + towards - z * abs(towards)
    damped = BRISTLE_DAMPING * np.sqrt(J * dry / z_s) * z_s * (bent - z) / H
    half = 0.5 * H * F_v / J
    now = (v * (1.0 - half) + H * (acting - smooth - dry * bent - damped) / J) / (1.0 + half)
    return q + 0.5 * H * (v + now), now, bent


@numba.njit
def run(p, along, force, q, v, n, start):  # type: ignore[no-untyped-def]
    """Return the position, n samples from a sample of the record on."""
    out, z = np.empty(n), 1.0 if v > 0.0 else -1.0
    out[0] = q
    for k in range(1, n):
        place = min(max(int((q - LOW) / CELL), 0), along.shape[1] - 1)
        beside = along[0 if v > 0.0 else 1, place]
        if p[15] > 0.0:
            q, v, z = step_bristle(q, v, z, force[start + k - 1], p, beside)
        else:
            q, v = step(q, v, force[start + k - 1], p, beside)
        out[k] = q
    return out


@numba.njit
def innovations(p, force, y, gain, decay, n, start, v):  # type: ignore[no-untyped-def]
    """Return measured less predicted position, one step ahead."""
    e, q, load = np.zeros(n), y[start], 0.0
    for k in range(1, n):
        q, v = step(q, v, force[start + k - 1], p, load)
        e[k] = y[start + k] - q
        q, v, load = q + gain[0] * e[k], v + gain[1] * e[k], decay * load - gain[2] * e[k]
    return e


@dataclass(frozen=True, eq=False)
class Record:
    """Position, m, speed, m/s, and force, N, of a record."""

    y: Array
    v: Array
    force: Array

    @classmethod
    def of(cls, log: Log) -> Record:
        """Read a log."""
        y = np.array(log["theta"])
        return cls(y, np.gradient(filtfilt(*butter(2, 100.0 * 2.0 * H), y), H), np.array(log["torque"]))

    def driving(self, p: Array) -> Array:
        """Return the force in the middle of every step, lateness and lag of the drive signal as given."""
        late, lag, by_sign = p[12:15]
        t = np.arange(len(self.y)) * H
        made = np.interp(t + 0.5 * H + late, t, self.force)
        if lag > 0.0:
            share = 1.0 - np.exp(-H / lag)
            made = lfilter([share], [1.0, share - 1.0], made - made[0]) + made[0]
        out: Array = made + by_sign * np.abs(made)
        return out


@dataclass(frozen=True, eq=False)
class Model:
    """The parameters that are fitted, those of the position behind the others, all scaled."""

    names: tuple[str, ...]
    waves: int = 0

    @property
    def start(self) -> Array:
        """Where a fit starts."""
        known = [FROM.get(n, PARAMETERS[n][0]) / PARAMETERS[n][1] for n in self.names]
        return np.array([*known, *np.zeros(2 * self.waves)])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds."""
        ends = [[PARAMETERS[n][k] / PARAMETERS[n][1] for n in self.names] for k in (2, 3)]
        return np.array([*ends[0], *[-20.0] * 2 * self.waves]), np.array([*ends[1], *[20.0] * 2 * self.waves])

    def read(self, x: Array) -> tuple[Array, Array]:
        """Return all parameters, and the force along the stroke for each direction."""
        own = dict(zip(self.names, x.tolist(), strict=False))
        p = np.array([own[n] * PARAMETERS[n][1] if n in own else PARAMETERS[n][0] for n in NAMES])
        cells = np.arange(int((HIGH - LOW) / CELL) + 2) * CELL / (HIGH - LOW)
        if not self.waves:
            return p, np.zeros((2, len(cells)))
        cosines = np.cos(np.pi * np.outer(np.arange(1, self.waves + 1), cells))
        along: Array = x[len(self.names) :].reshape(2, self.waves) @ cosines
        return p, along

    def fitted(self, residual: Callable[[Array], Array], x: Array) -> Array:
        """Return the least squares solution; the waves have their prior."""

        def whole(x: Array) -> Array:
            return np.concatenate([residual(x), PRIOR * x[len(self.names) :]])

        low, high = self.bounds
        inside = np.clip(x, low + 1e-9, high - 1e-9)
        found: Array = least_squares(whole, inside, bounds=(low, high), diff_step=1e-3, max_nfev=40, x_scale="jac").x
        return found

    def apart(self, x: Array, record: Record, starts: Sequence[int], length: int, thin: int = 10) -> list[Array]:
        """Return simulated less measured position of stretches, mm."""
        p, along = self.read(x)
        force, y = record.driving(p), record.y
        return [
            _finite(1e3 * (run(p, along, force, y[a], record.v[a], length, a) - y[a : a + length])[::thin])
            for a in starts
        ]

    def official(self, x: Array, record: Record) -> Array:
        """Return the error of the official task, mm."""
        p, along = self.read(x)
        force, y = record.driving(p), record.y
        slow, fast = (run(p, along, force, y[0], speed, GIVEN, 0) for speed in (0.01, 0.02))
        columns = np.column_stack([(fast - slow) / 0.01, np.ones(GIVEN)])
        speed, offset = np.linalg.lstsq(columns, y[:GIVEN] - slow, rcond=None)[0]
        return _finite(1e3 * (run(p, along, force, y[0], 0.01 + speed, len(y), 0) + offset - y)[GIVEN:])


Fitter = Callable[[Sequence[int], Array], Array]  # of cycles, from a start


@dataclass(frozen=True)
class Variant:
    """A structure and a criterion, fitted to chosen cycles."""

    name: str
    model: Model
    fit: Fitter
    start: Array

    def judged(self, record: Record) -> tuple[float, Array]:
        """Return the error of the cycles left out, mm, and the parameters fitted to all."""
        every = self.fit(range(4), self.start)
        squares = []
        for cycle in range(4):
            x = self.fit([c for c in range(4) if c != cycle], every)
            squares.append(np.mean(self.model.apart(x, record, [FIRST + cycle * CYCLE], CYCLE, 1)[0] ** 2))
        return float(np.sqrt(np.mean(squares))), every


def _finite(values: Array) -> Array:
    return np.clip(np.nan_to_num(values, nan=1e3), -1e3, 1e3)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def force_fit(model: Model, record: Record) -> Array:
    """Return the parameters by inverse dynamics below 40 Hz, on all cycles."""
    filters = butter(4, 40.0 * 2.0 * H)
    v = np.gradient(filtfilt(*filters, record.y), H)
    alpha, t = np.gradient(v, H), np.arange(len(v)) * H

    def residual(x: Array) -> Array:
        p, _ = model.read(x)
        J, F_c, F_v, T_0, dF_v, dF_r, w_r, mu, k_s, k_2, dF_s, w_s, late = p[:13]
        acting = np.interp(t + late, t, record.force)
        dry = F_c + mu * np.abs(record.force) + dF_s * np.exp(-np.abs(v) / w_s)
        rest = F_v * v + dF_v * np.abs(v) + k_2 * v * np.abs(v) + T_0 + dF_r * np.tanh(v / w_r) + np.sign(v) * dry
        left = filtfilt(*filters, acting * (1.0 - k_s * np.abs(acting)) - rest) - J * alpha
        return np.asarray(left[FIRST : FIRST + 4 * CYCLE - 60 : 5])

    return model.fitted(residual, model.start)


def by_stretches(record: Record) -> Iterator[Variant]:
    """Yield structures, with forces along the stroke or without, and lengths."""
    for name, structure in STRUCTURES.items():
        for waves in WAVES:
            model = Model((*structure, "late"), waves)
            for length in LENGTHS:

                def fit(cycles: Sequence[int], x: Array, model: Model = model, length: int = length) -> Array:
                    starts = stretches(cycles, length)
                    return model.fitted(lambda x: np.concatenate(model.apart(x, record, starts, length)), x)

                along = f", {2 * waves} waves along the stroke" if waves else ""
                yield Variant(f"{name}{along}, {H * length:g} s", model, fit, model.start)


def by_shooting(record: Record) -> Iterator[Variant]:
    """Yield structures and lengths; what the begin of a stretch adds is projected out."""
    for name in ("asymmetry", "asymmetry, rising friction", "asymmetry, rising friction, saturation"):
        model = Model((*STRUCTURES[name], "late"))
        start = force_fit(model, record)
        for length in SHOOTING:

            def fit(cycles: Sequence[int], x: Array, model: Model = model, length: int = length) -> Array:
                starts, t = stretches(cycles, length), np.arange(length)[::10] * H

                def residual(x: Array) -> Array:
                    p, _ = model.read(x)
                    tau = p[0] / p[2]
                    basis = np.linalg.qr(np.column_stack([np.ones(len(t)), tau * (1.0 - np.exp(-t / tau))]))[0]
                    apart = model.apart(x, record, starts, length)
                    return np.concatenate([one - basis @ (basis.T @ one) for one in apart])

                return model.fitted(residual, x)

            yield Variant(f"{name}, {H * length:g} s", model, fit, start)


def by_innovations(record: Record) -> Iterator[Variant]:
    """Yield structures and time constants of the load beside the model."""
    usual = np.array([0.5, 700.0, 3e5])
    for name in ("asymmetry", "asymmetry, rising friction", "asymmetry, rising friction, saturation"):
        model = Model((*STRUCTURES[name], "late"))
        start = force_fit(model, record)
        for decay in DECAYS:

            def fit(cycles: Sequence[int], x: Array, model: Model = model, decay: float = decay) -> Array:
                n, (low, high) = len(x), model.bounds

                def residual(z: Array) -> Array:
                    p, _ = model.read(z[:n])
                    force, gain = record.driving(p), usual * np.exp(z[n:])
                    begins = [FIRST + c * CYCLE for c in cycles]
                    apart = [innovations(p, force, record.y, gain, np.exp(-H / decay), CYCLE, a, record.v[a])[SETTLED:]
                             for a in begins]  # fmt: skip
                    return np.clip(np.nan_to_num(1e7 * np.concatenate(apart), nan=1e4), -1e4, 1e4)

                ends = np.append(low, [-6.0] * 3), np.append(high, [0.65, 6.0, 6.0])
                inside = np.clip(np.append(x, [0.0] * 3), ends[0] + 1e-6, ends[1] - 1e-6)
                found = least_squares(residual, inside, bounds=ends, diff_step=1e-3, max_nfev=40, x_scale="jac").x
                return np.asarray(found[:n])

            yield Variant(f"{name}, {decay:g} s", model, fit, start)


def over_whole(record: Record) -> list[tuple[float, str, Model, Array]]:
    """Return error on the record, structure, model and parameters of every start, best first."""
    rng, found = np.random.default_rng(SEED), []
    for name, structure in STRUCTURES.items():
        if name == "four parameters":  # 30 % worse on the record
            continue
        model = Model((*structure, "late"))
        start = force_fit(model, record)
        like = np.array([20.0 / 3.0 if n == "T_0" else abs(v) for n, v in zip(model.names, start, strict=True)])
        for number in range(STARTS):
            moved = ABOUT * rng.standard_normal(len(start)) * like if number else 0.0
            x = model.fitted(lambda x, model=model: model.official(x, record)[::10], start + moved)  # type: ignore[misc]
            found.append((_rms(model.official(x, record)), name, model, x))
    return sorted(found, key=lambda one: one[0])


def chosen(method: str, variants: Iterator[Variant], records: Mapping[str, Record], tell: bool) -> None:
    """Print the row of the variant that left-out cycles choose."""
    train, pulses = records["train"], records["pulses"]
    found = []
    for variant in variants:
        found.append((*variant.judged(train), variant))
        if tell:
            told = dict(zip(NAMES, variant.model.read(found[-1][1])[0].tolist(), strict=True))
            values = ", ".join(f"{n} {told[n]:.4g}" for n in variant.model.names)
            print(f"    {variant.name}: {found[-1][0]:.2f}; {values}", flush=True)
    error, x, variant = min(found, key=lambda one: one[0])
    own, other = (_rms(variant.model.official(x, record)) for record in (train, pulses))
    print(f"| {method} | {variant.name} (of {len(found)}) | {error:.2f} | {own:.2f} | {other:.2f} |", flush=True)


def averaged(records: Mapping[str, Record]) -> None:
    """Print the rows of the fits to the whole record: the least error, and means of positions."""
    train, pulses = records["train"], records["pulses"]
    found = over_whole(train)
    least, name, model, x = found[0]
    print(f"| whole record | {name} (of {len(found)}) | - | {least:.2f} | {_rms(model.official(x, pulses)):.2f} |")
    for share in ALIKE:
        alike = [(m, x) for error, _, m, x in found if error <= share * least]
        own, other = ([m.official(x, record) for m, x in alike] for record in (train, pulses))
        each = [_rms(one) for one in other]
        members = f"{len(alike)} fits within {share - 1:.0%}; each alone {min(each):.1f} to {max(each):.1f}"
        of_mean = " | ".join(f"{_rms(np.mean(one, axis=0)):.2f}" for one in (own, other))
        print(f"| mean of many | {members} | - | {of_mean} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="print the error of left-out cycles of every variant")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    design = Design.read(ROOT / "designs" / "emps.toml")
    files = {"train": "DATA_EMPS", "pulses": "DATA_EMPS_PULSES"}
    try:
        records = {name: Record.of(read_log(DATA / f"{file}.mat", design)) for name, file in files.items()}
    except FileNotFoundError as error:
        raise SystemExit(f"SKIPPED: {error.filename} is not there; set PMSM_CTRL_DATA") from None
    print("| method | chosen on DATA_EMPS | left-out cycles, mm | DATA_EMPS, mm | pulses, mm |\n|---|---|---|---|---|")
    train = records["train"]
    chosen("stretches", by_stretches(train), records, args.all)
    chosen("multiple shooting", by_shooting(train), records, args.all)
    chosen("innovations", by_innovations(train), records, args.all)
    averaged(records)


if __name__ == "__main__":
    main()
