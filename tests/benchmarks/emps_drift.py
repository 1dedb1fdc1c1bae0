r"""EMPS: how much the friction of both records differs, and what else was tried against it on ``DATA_EMPS`` alone.

    python -m tests.benchmarks.emps_drift            seconds: the drift without a model, and what it costs
    python -m tests.benchmarks.emps_drift --ideas    the table of further criteria as well; long

Both records follow the same reference, sample by sample. So the work that a sweep of the stroke takes says by how much
their friction differs, whatever its law. The second part moves one parameter of a model at a time and says what the
official task makes of it; it looks at the pulses and is no result. The third part continues the table of
`tests.benchmarks.emps_criteria` by the same rule: a cycle of ``DATA_EMPS`` is left out and simulated, the least error
chooses inside every row, and the chosen variant simulates the pulses once.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are
from scipy.optimize import least_squares
from scipy.signal import lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log
from tests.benchmarks.emps import CYCLE, DATA, FIRST, ROOT, stretches
from tests.benchmarks.emps_criteria import (
    ASYMMETRIC,
    PARAMETERS,
    PRIOR,
    RISING,
    SETTLED,
    STRUCTURES,
    H,
    Model,
    Record,
    force_fit,
    innovations,
)

Array = NDArray[np.float64]
SWEEP, TURN, BEFORE = 3120, 600, (100, 340)  # samples: of a sweep, about its ends, and before the first pulse
STEPS = {"J": 10.0, "F_c": 3.0, "F_v": 40.0, "T_0": 2.0, "dF_v": 30.0, "late": 2e-3}  # how far each is moved
DRIFT = 0.05  # of the dry friction, between records: what the package takes it for before it has seen several
NODES = np.array([-1.7320508, 0.0, 1.7320508]), np.array([1.0, 4.0, 1.0]) / 6.0  # of a normal distribution
MEMBERS, SEED = 25, 1
ROUNDS = 12
PLAIN = "asymmetry"


def rms(values: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def turns(y: Array) -> list[int]:
    """Return the samples at which the sweeps begin and end."""
    out = [0]
    for k in range(1, len(y) // SWEEP + 1):
        near = y[k * SWEEP - TURN : k * SWEEP + TURN]
        out.append(k * SWEEP - TURN + int(np.argmax(near) if k % 2 else np.argmin(near)))
    return out


def dry_by_sweep(record: Record, fitted: Model, x: Array, ends: Sequence[int]) -> Array:
    """Return the work of every sweep less that of mass and viscous friction, over its length, N."""
    p, _ = fitted.read(x)
    J, F_v, dF_v = p[0], p[2], p[4]
    force, v = record.driving(np.where(np.arange(len(p)) == 13, 0.0, p)), record.v
    out = []
    for a, b in itertools.pairwise(ends):
        s = slice(a, b)
        work = H * float(np.sum(force[s] * 0.5 * (v[a:b] + v[a + 1 : b + 1])))
        kinetic = 0.5 * J * (v[b] ** 2 - v[a] ** 2)
        viscous = H * float(np.sum(F_v * v[s] ** 2 + dF_v * np.abs(v[s]) * v[s]))
        out.append((work - kinetic - viscous) / (H * float(np.sum(np.abs(v[s])))))
    return np.array(out)


def evidence(train: Record, pulses: Record) -> None:
    """Print the drift of the friction without a model of it, and what moving one parameter does."""
    model = Model((*ASYMMETRIC, "late"))
    x = force_fit(model, train)
    ends = turns(train.y)
    own, other = (dry_by_sweep(record, model, x, ends) for record in (train, pulses))
    more = other - own
    alike = [float(np.std(own[k::2], ddof=1)) for k in (0, 1)]
    print(f"positions of both records differ by {1e3 * rms(pulses.y - train.y):.3f} mm rms: the same reference")
    print(f"dry friction by sweep, N: DATA_EMPS {np.round(own, 2)}, pulses {np.round(other, 2)}")
    print(f"more on the pulses: {more.mean():.2f} +- {more.std(ddof=1) / len(more) ** 0.5:.2f} N; sweeps of DATA_EMPS "
          f"in one direction differ by {alike[0]:.2f} and {alike[1]:.2f} N (standard deviation)")  # fmt: skip
    early = [float(record.force[slice(*BEFORE)].mean()) for record in (train, pulses)]
    print(f"before the first pulse, {BEFORE[0]} to {BEFORE[1]} ms: {early[0]:.2f} and {early[1]:.2f} N\n")
    moved(model, x, train, pulses)


def moved(model: Model, x: Array, train: Record, pulses: Record) -> None:
    """Print the official error over each parameter alone; the pulses choose, so these are no results."""
    print(
        "| moved alone, from the fit to the force of DATA_EMPS | by | pulses, mm | DATA_EMPS, mm |\n|---|---|---|---|"
    )
    print(f"| none | - | {rms(model.official(x, pulses)):.2f} | {rms(model.official(x, train)):.2f} |")

    def at(name: str, by: float) -> Array:
        z = x.copy()
        z[model.names.index(name)] += by / PARAMETERS[name][1]
        return z

    for name, far in STEPS.items():
        by = min(np.linspace(-far, far, 81).tolist(), key=lambda by: rms(model.official(at(name, by), pulses)))
        own, other = (rms(model.official(at(name, by), record)) for record in (train, pulses))
        print(f"| {name} | {by:+.4g} | {other:.2f} | {own:.2f} |", flush=True)
    best = model.fitted(lambda z: model.official(z, pulses)[::10], x)
    print("\n| dry friction moved, N | fit to the force: pulses | DATA_EMPS | fit of the pulses: pulses | DATA_EMPS |")
    print("|---|---|---|---|---|")
    for by in np.arange(-1.5, 1.76, 0.25).tolist():
        step = np.eye(1, len(x), model.names.index("F_c"))[0] * by / PARAMETERS["F_c"][1]
        told = [rms(model.official(z + step, record)) for z in (x, best) for record in (pulses, train)]
        print(f"| {by:+.2f} | " + " | ".join(f"{one:.2f}" for one in told) + " |", flush=True)


Predicting = Callable[[Array, Record, int | None], Array]  # parameters, record, begin of a cycle, None for the task


@dataclass(frozen=True)
class Way:
    """A structure, a criterion, and how a position is predicted from the parameters."""

    name: str
    start: Array
    fit: Callable[[Sequence[int], Array], Array]
    predict: Predicting

    def judged(self, record: Record) -> tuple[float, Array]:
        """Return the error of the cycles left out, mm, and the parameters fitted to all."""
        every = self.fit(range(4), self.start)
        squares = []
        for cycle in range(4):
            x = self.fit([c for c in range(4) if c != cycle], every)
            squares.append(np.mean(self.predict(x, record, FIRST + cycle * CYCLE) ** 2))
        return float(np.sqrt(np.mean(squares))), every


def simulated(model: Model) -> Predicting:
    """Return the prediction by one simulation."""

    def predict(x: Array, record: Record, begin: int | None) -> Array:
        if begin is None:
            return model.official(x, record)
        return model.apart(x, record, [begin], CYCLE, 1)[0]

    return predict


def solved(model: Model, residual: Callable[[Array], Array], x: Array, loss: str = "linear") -> Array:
    """Return the solution of a least squares problem."""
    low, high = model.bounds
    inside = np.clip(x, low + 1e-6, high - 1e-6)
    found: Array = least_squares(residual, inside, bounds=(low, high), diff_step=1e-3, max_nfev=ROUNDS, x_scale="jac",
                                 loss=loss).x  # fmt: skip
    return found


def plain(model: Model, record: Record, length: int, loss: str = "linear",
          of: Callable[[Array], Array] = lambda e: e) -> Callable[[Sequence[int], Array], Array]:  # fmt: skip
    """Return a fit of the position over stretches; `of` filters the error."""

    def fit(cycles: Sequence[int], x: Array) -> Array:
        starts = stretches(cycles, length)

        def residual(z: Array) -> Array:
            errors = [of(e) for e in model.apart(z, record, starts, length)]
            return np.concatenate([*errors, PRIOR * z[len(model.names) :]])

        return solved(model, residual, x, loss)

    return fit


def bristles_and_gains(record: Record) -> Iterator[Way]:
    """Yield LuGre's bristle and a gain of the drive that differs by sign."""
    for name, names in {
        "asymmetry, bristle": (*ASYMMETRIC, "z_s", "late"),
        "asymmetry, bristle, Stribeck of either sign (LuGre)": (*ASYMMETRIC, "dF_s", "w_s", "z_s", "late"),
        "asymmetry, rising friction, bristle": (*RISING, "z_s", "late"),
        "asymmetry, gain by the sign of the force": (*ASYMMETRIC, "g_a", "late"),
    }.items():
        model = Model(names)
        yield Way(f"{name}, 1 s", model.start, plain(model, record, 1000), simulated(model))


def short(record: Record) -> Iterator[Way]:
    """Yield stretches as long as a pulse lasts."""
    model = Model((*STRUCTURES[PLAIN], "late"))
    for length in (100, 200, 400):
        yield Way(f"{H * length:g} s", force_fit(model, record), plain(model, record, length), simulated(model))


def bands(record: Record) -> Iterator[Way]:
    """Yield errors of the position weighted by frequency, over a whole cycle."""
    model = Model((*STRUCTURES[PLAIN], "late"))
    for span in (20, 300):  # of every tenth sample

        def change(e: Array, span: int = span) -> Array:
            return e[span:] - e[:-span]

        def slow(e: Array, span: int = span) -> Array:
            return np.asarray(lfilter([1.0 / span], [1.0, 1.0 / span - 1.0], e))

        for told, of in ((f"change over {0.01 * span:g} s", change), (f"below {16 / span:.3g} Hz", slow)):
            yield Way(told, force_fit(model, record), plain(model, record, CYCLE, of=of), simulated(model))


def robust(record: Record) -> Iterator[Way]:
    """Yield a loss that large errors hardly move."""
    for name in ("four parameters", PLAIN):
        model = Model((*STRUCTURES[name], "late"))
        for length in (3090, CYCLE):
            yield Way(f"{name}, {H * length:g} s", model.start, plain(model, record, length, "soft_l1"),
                      simulated(model))  # fmt: skip


def stated_noise(record: Record) -> Iterator[Way]:
    """Yield prediction errors with a stated noise of force and a stated load beside the model, Kalman's gains."""
    model = Model((*STRUCTURES[PLAIN], "late"))
    start = force_fit(model, record)
    for white, size, decay in ((0.3, 0.0, 1.0), (3.0, 0.0, 1.0), (0.3, 0.2, 0.3), (0.3, 0.2, 3.0), (0.3, 1.0, 3.0)):
        keep = float(np.exp(-H / decay))

        def fit(cycles: Sequence[int], x: Array, white: float = white, size: float = size,
                keep: float = keep) -> Array:  # fmt: skip
            begins = [FIRST + c * CYCLE for c in cycles]

            def residual(z: Array) -> Array:
                p, _ = model.read(z)
                gain, force = _gain(p, white, size, keep), record.driving(p)
                apart = [innovations(p, force, record.y, gain, keep, CYCLE, a, record.v[a])[SETTLED:] for a in begins]
                return np.clip(np.nan_to_num(1e6 * np.concatenate(apart), nan=1e4), -1e4, 1e4)

            return solved(model, residual, x)

        yield Way(f"{white:g} N white, {size:g} N over {decay:g} s", start, fit, simulated(model))


def _gain(p: Array, white: float, size: float, keep: float) -> Array:
    """Return Kalman's gains for position, speed and (with its sign) load; the position is read to a micrometre."""
    slow = 1.0 - H * p[2] / p[0]
    a = np.array([[1.0, H, 0.0], [0.0, slow, -H / p[0]], [0.0, 0.0, keep]])
    noise = np.diag([1e-16, (H * white / p[0]) ** 2, size**2 * (1.0 - keep**2) + 1e-12])
    c = np.array([[1.0, 0.0, 0.0]])
    covariance = solve_discrete_are(a.T, c.T, noise, np.array([[1e-12]]))
    gain = (covariance @ c.T / (covariance[0, 0] + 1e-12)).ravel()
    return np.array([gain[0], gain[1], -gain[2]])


def own_levels(record: Record) -> Iterator[Way]:
    """Yield dry friction and offset of every stretch drawn from a normal distribution; the mean simulates."""
    model = Model((*STRUCTURES[PLAIN], "late"))
    n, dry, load = len(model.names), PARAMETERS["F_c"][1], PARAMETERS["T_0"][1]
    i, j = (model.names.index(one) for one in ("F_c", "T_0"))
    for length in (3090,):
        for width in (0.2, 1.0):

            def fit(cycles: Sequence[int], x: Array, length: int = length, width: float = width) -> Array:
                starts = [FIRST + c * CYCLE + k for c in cycles for k in range(0, CYCLE - length + 1, length)]
                z = np.asarray(x[:n])
                for _ in range(3):  # levels of every stretch in turn with what all share
                    levels = []
                    for start in starts:

                        def alone(d: Array, z: Array = z, start: int = start) -> Array:
                            return np.append(model.apart(_level(z, d), record, [start], length)[0], 3.0 * d / width)

                        levels.append(least_squares(alone, [0.0, 0.0], diff_step=1e-3, max_nfev=6).x)

                    def together(z: Array, levels: Sequence[Array] = levels) -> Array:
                        every = [model.apart(_level(z, d), record, [s], length)[0]
                                 for s, d in zip(starts, levels, strict=True)]  # fmt: skip
                        return np.concatenate(every)

                    centre = np.mean(levels, axis=0)
                    levels = [d - centre for d in levels]
                    z = solved(model, lambda z, levels=levels: together(z, levels), _level(z, centre))  # type: ignore[misc]
                return z

            def _level(z: Array, d: Array) -> Array:
                out = z.copy()
                out[i], out[j] = out[i] + d[0] / dry, out[j] + d[1] / load
                return out

            told = f"{PLAIN}, {H * length:g} s, {width:g} N"
            yield Way(told, force_fit(model, record), fit, simulated(model))


def drifting(record: Record) -> Iterator[Way]:
    """Yield fits that count with a drift: dry friction of the record as it would be after it, the loop closed."""
    model = Model((*STRUCTURES[PLAIN], "late"))
    backward = np.sign(np.where(np.abs(record.v) < 1e-3, 0.0, record.v))
    for size in (0.01, DRIFT):
        shifts = 20.2 * size * NODES[0]
        drawn = [replace(record, force=record.force + by * backward) for by in shifts.tolist()]
        for length in (3090, CYCLE) if size == DRIFT else (CYCLE,):

            def fit(cycles: Sequence[int], x: Array, length: int = length, drawn: list[Record] = drawn) -> Array:
                starts = stretches(cycles, length)

                def residual(z: Array) -> Array:
                    return np.concatenate([
                        w**0.5 * np.concatenate(model.apart(z, one, starts, length))
                        for w, one in zip(NODES[1], drawn, strict=True)
                    ])  # fmt: skip

                return solved(model, residual, x)

            yield Way(f"drift of {100 * size:g} %, {H * length:g} s", force_fit(model, record), fit, simulated(model))


def averaged(record: Record) -> Iterator[Way]:
    """Yield means of the positions that are simulated with levels of friction drawn from what they may be."""
    for name, length in ((PLAIN, 0), ("asymmetry, rising friction", 0)):
        model = Model((*STRUCTURES[name], "late"))
        start = force_fit(model, record)

        def kept(cycles: Sequence[int], x: Array, start: Array = start) -> Array:
            return start  # the fit to the force, of all cycles: the one left out as well

        fit = plain(model, record, length) if length else kept
        for size in (0.01, 0.025, DRIFT):
            rng = np.random.default_rng(SEED)
            drawn = 20.2 * size * rng.standard_normal((MEMBERS, 2)) * [1.0, 0.3]
            alone = simulated(model)

            def predict(x: Array, record: Record, begin: int | None, model: Model = model, drawn: Array = drawn,
                        alone: Predicting = alone) -> Array:  # fmt: skip
                i, j = (model.names.index(one) for one in ("F_c", "T_0"))
                own = []
                for by in drawn:
                    z = x.copy()
                    z[i] += by[0] / PARAMETERS["F_c"][1]
                    z[j] += by[1] / PARAMETERS["T_0"][1]
                    own.append(alone(z, record, begin))
                return np.asarray(np.mean(own, axis=0))

            by_what = f"stretches of {H * length:g} s" if length else "force"
            yield Way(f"{name}, {by_what}, {100 * size:g} %", start, fit, predict)


def stacked(record: Record) -> Iterator[Way]:
    """Yield the mean of the positions of all structures, fitted over stretches, forces along the stroke or none."""
    for waves, length in ((0, 3090), (6, CYCLE)):
        models = [Model((*names, "late"), waves) for names in STRUCTURES.values()]
        starts = [model.start for model in models]
        cuts = np.cumsum([len(start) for start in starts])[:-1]

        def fit(cycles: Sequence[int], x: Array, models: list[Model] = models, length: int = length,
                cuts: Array = cuts) -> Array:  # fmt: skip
            parts = zip(models, np.split(x, cuts), strict=True)
            return np.concatenate([plain(model, record, length)(cycles, z) for model, z in parts])

        def predict(x: Array, record: Record, begin: int | None, models: list[Model] = models,
                    cuts: Array = cuts) -> Array:  # fmt: skip
            parts = zip(models, np.split(x, cuts), strict=True)
            return np.asarray(np.mean([simulated(model)(z, record, begin) for model, z in parts], axis=0))

        along = f", {2 * waves} waves along the stroke" if waves else ""
        yield Way(f"{len(models)} structures{along}, {H * length:g} s", np.concatenate(starts), fit, predict)


IDEAS: dict[str, Callable[[Record], Iterator[Way]]] = {
    "mean of positions over the level of the friction": averaged,
    "fitted to the record as other friction would leave it": drifting,
    "stated noise of the force and a stated load, Kalman filter": stated_noise,
    "LuGre's bristle; gain of the drive by sign": bristles_and_gains,
    "stretches as long as a transient": short,
    "error of the position in a band": bands,
    "levels of friction and offset for every stretch": own_levels,
    "robust loss": robust,
    "mean of positions over structures": stacked,
}


def ideas(train: Record, pulses: Record, which: Sequence[int]) -> None:
    """Print a row for every further criterion, chosen by left-out cycles."""
    print("\n| criterion | chosen | left-out cycles, mm | DATA_EMPS, mm | pulses, mm |\n|---|---|---|---|---|")
    for k, (told, ways) in enumerate(IDEAS.items()):
        if which and k not in which:
            continue
        found = []
        for way in ways(train):
            error, x = way.judged(train)
            found.append((error, way, x))
            print(f"    {way.name}: {error:.2f}", flush=True)
        error, way, x = min(found, key=lambda one: one[0])
        own, other = (rms(way.predict(x, record, None)) for record in (train, pulses))
        print(f"| {told} | {way.name} (of {len(found)}) | {error:.2f} | {own:.2f} | {other:.2f} |", flush=True)


def main() -> None:
    """Print the drift, and the further criteria."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ideas", nargs="*", type=int, default=None, help="further criteria, all or by number")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    design = Design.read(ROOT / "designs" / "emps.toml")
    try:
        logs: list[Log] = [read_log(DATA / f"{file}.mat", design) for file in ("DATA_EMPS", "DATA_EMPS_PULSES")]
    except FileNotFoundError as error:
        raise SystemExit(f"SKIPPED: {error.filename} is not there; set PMSM_CTRL_DATA") from None
    train, pulses = (Record.of(log) for log in logs)
    evidence(train, pulses)
    if args.ideas is not None:
        ideas(train, pulses, args.ideas)


if __name__ == "__main__":
    main()
