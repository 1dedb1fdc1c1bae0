"""What identification promises, as tables: ``python -m tests.benchmarks.identification [seeds] [log] [first seed]``.

Every log is simulated with the sampled drive: the controller answers to the noise of its sensors, the angle is
quantised, the current is sampled once a log period while it moves in between. None of the methods models that.

The bound is Cramer and Rao's for somebody who knows the true motion at every sample at which the axis moves and has
only the noise of the logged torque against her, white, as strong as it is in the logs (sensor noise and what aliases
into the band, measured on the simulated truth). What a method loses by differentiating, filtering, thinning and
masking counts against it, and so does its bias: efficiency = bound / mean squared error.

A few hundred seeds leave an efficiency uncertain by a tenth, and all methods by the same amount: they share the logs.
So the estimates of that somebody are made as well, on the very same logs, and an efficiency is also given `paired`:
divided by hers.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import LogMap
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.identify import Identification, Processing, identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.simulate.motions import Scenario

ROOT = Path(__file__).resolve().parents[2]
METHODS = ("regression", "iv", "output_error")
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Case:
    """A drive, a motion, and what is searched; the design given to the methods is off by `wrong`."""

    name: str
    truth: Design
    motion: Scenario
    wrong: float = 1.1

    def believed(self) -> Design:
        """The design the methods start from: every linear parameter and the inertia off by the same factor.

        It says that all channels are sampled at once: the bound is that of somebody who knows this.
        """
        design = self.truth.with_parameters(J=self.truth.J * self.wrong)
        design = design.model_copy(update={"log": LogMap(sampling="instant")})
        for effect, values in bound_effects(self.truth):
            linear = {p.symbol for p in effect.linear}
            design = design.with_effect(
                effect.id, {k: v * (self.wrong if k in linear else 1.0) for k, v in values.items()}
            )
        return design

    def true_values(self) -> dict[str, float]:
        """The inertia and all parameters of all effects."""
        return {"J": self.truth.J} | {k: v for _, values in bound_effects(self.truth) for k, v in values.items()}


def cases() -> Iterator[Case]:
    """Logs that differ in motion, control, rate and friction."""
    seed_motor = Design.read(ROOT / "designs" / "hand_tuned.toml")
    yield Case("all kinds of motion, 12 s", seed_motor, scenario("identification", seed_motor, duration=12.0))
    yield Case("triangle, 12 s", seed_motor, scenario("triangle", seed_motor, speed=150.0, period=2.0, cycles=6.0))
    yield Case(
        "sine, position control, 12 s",
        seed_motor,
        scenario("reversal", seed_motor, speed=80.0, frequency=0.5, cycles=6.0),
    )
    fast = seed_motor.replace(sensor={"log_divider": 4, "current_noise": 0.01, "encoder_counts": 16384})
    yield Case(
        "triangle, 4 kHz log, 14 bit, 10 mA", fast, scenario("triangle", fast, speed=100.0, period=3.0, cycles=4.0)
    )
    rich = seed_motor.with_effect("stribeck", {"dF_s": 0.01, "w_s": 12.0, "delta": 2.0})
    rich = rich.with_effect("constant_load", {"T_0": 0.004})
    yield Case(
        "slow triangle, Stribeck and load, 12 s", rich, scenario("triangle", rich, speed=80.0, period=6.0, cycles=2.0)
    )


def clean_log(case: Case) -> Log:
    """The same experiment without sensor noise, truth included."""
    ideal = case.truth.replace(sensor={"current_noise": 0.0, "encoder_counts": 0})
    return simulate(case.believed(), case.motion, truth=ideal, keep_truth=True)


def true_columns(case: Case, log: Log, step: float = 1e-6) -> dict[str, Array]:
    """Derivative of the torque with respect to every parameter, on the true motion, from the effects' own terms."""
    omega = log["omega_true"]
    signals = {"omega": omega, "theta": log["theta_true"], "direction": np.sign(omega), "t": log.t, "p": 4.0}
    out = {"J": np.gradient(omega, log.period)}
    for effect, values in bound_effects(case.truth):
        for symbol, value in values.items():
            h = step * max(abs(value), 1e-3)
            after, before = ({**values, symbol: value + sign * h} for sign in (1.0, -1.0))
            out[symbol] = (column(effect, signals, after) - column(effect, signals, before)) / (2.0 * h)
    return out


def true_torque(case: Case, log: Log) -> Array:
    """Torque that the true motion took."""
    omega = log["omega_true"]
    signals = {"omega": omega, "theta": log["theta_true"], "direction": np.sign(omega), "t": log.t, "p": 4.0}
    torque = case.truth.J * np.gradient(omega, log.period)
    return torque + sum(column(effect, signals, values) for effect, values in bound_effects(case.truth))


def between_turns(omega: Array) -> NDArray[np.bool_]:
    """Samples, shape (n,), at which the shaft turns and does not turn round."""
    turned = np.convolve(np.diff(np.sign(omega), prepend=0.0) != 0.0, np.ones(9), "same") > 0
    return ~turned & (omega != 0.0)


def with_known_motion(case: Case, log: Log, clean: Log, names: list[str]) -> Array:
    """What the noise of the logged torque does to the parameters when the true motion is known, shape (names,).

    What sampling makes of the torque without any noise is taken off; the columns are those of the clean log, since
    what the sensors' noise really does to the shaft is too fast for the log.
    """
    kept = between_turns(log["omega_true"]) & between_turns(clean["omega_true"])
    columns = true_columns(case, clean)
    x = np.column_stack([columns[n] for n in names])[kept]
    size = np.sqrt(np.mean(x**2, axis=0))
    noise, sampling = (case.truth.K_t * each["i_q"] - true_torque(case, each) for each in (log, clean))
    return np.linalg.lstsq(x / size, (noise - sampling)[kept], rcond=None)[0] / size


def noise_level(case: Case, seeds: range = range(5000, 5012)) -> float:
    """Variance of white noise as strong as the logged torque's noise between 1 and 100 Hz, (N m)^2 a sample."""
    levels = []
    for seed in seeds:
        log = simulate(case.believed(), case.motion, truth=case.truth, seed=seed, keep_truth=True)
        kept = between_turns(log["omega_true"])
        noise = np.where(kept, case.truth.K_t * log["i_q"] - true_torque(case, log), 0.0)
        power = np.abs(np.fft.rfft(noise)) ** 2 / kept.sum()
        frequency = np.fft.rfftfreq(len(noise), log.period)
        levels.append(float(power[(frequency > 1.0) & (frequency < 100.0)].mean()))
    return float(np.mean(levels))


def bound(case: Case, everywhere: bool = True) -> dict[str, dict[str, float]]:
    """Cramer-Rao standard errors for the methods' sets of parameters: linear ones alone, and all.

    From all samples at which the axis moves, or else from those away from reversals.
    """
    log = clean_log(case)
    derivatives, level = true_columns(case, log), noise_level(case)
    linear = {"J"} | {p.symbol for effect, _ in bound_effects(case.truth) for p in effect.linear}
    moving = log["omega_true"] != 0.0 if everywhere else between_turns(log["omega_true"])
    out = {}
    for method in METHODS:
        names = [n for n in derivatives if n in linear or method == "output_error"]
        x = np.column_stack([derivatives[n] for n in names])[moving]
        size = np.sqrt(np.sum(x**2, axis=0))
        covariance = level * np.linalg.inv((x / size).T @ (x / size))
        out[method] = dict(zip(names, (np.sqrt(np.diag(covariance)) / size).tolist(), strict=True))
    return out


@dataclass(frozen=True)
class Quality:
    """One parameter by one method over many seeds.

    bias and stated in standard deviations of the estimates; `efficiency` by mean squared error, `paired` divided by the
    efficiency of somebody who knows the motion, on the same logs.
    """

    bias: float
    stated: float
    efficiency: float
    paired: float
    coverage: float
    count: int


def quality(case: Case, seeds: range, progress: Callable[[int], None] = lambda seed: None) -> tuple[
    dict[tuple[str, str], Quality], dict[str, float]
]:  # fmt: skip
    """Identify one case's logs of all seeds by all methods.

    Returns
    -------
    table : dict of (method, parameter) to Quality
    flagged : dict of parameter to the share of logs on which least squares was called biased
    """
    truth, bounds, between = case.true_values(), bound(case), bound(case, everywhere=False)
    found: dict[tuple[str, str], list[tuple[float, float, bool]]] = {}
    known: dict[tuple[str, str], list[float]] = {}
    flagged = dict.fromkeys(truth, 0.0)
    clean = clean_log(case)
    for seed in seeds:
        log = simulate(case.believed(), case.motion, truth=case.truth, seed=seed, keep_truth=True)
        for method in METHODS:
            errors = with_known_motion(case, log, clean, list(bounds[method]))
            for name, error in zip(bounds[method], errors.tolist(), strict=True):
                known.setdefault((method, name), []).append(error)
        log = Log({name: values for name, values in log.channels.items() if not name.endswith("_true")}, log.motion)
        for method in METHODS:
            result = identify(case.believed(), log, method=method)  # type: ignore[arg-type]
            for name, estimate in result.estimates.items():
                low, high = result.intervals[name]
                row = (estimate.value - truth[name], estimate.stderr, low <= truth[name] <= high)
                found.setdefault((method, name), []).append(row)
            for name in result.bias.biased if result.bias else ():
                flagged[name] += 1.0 / len(seeds)
        progress(seed)
    table = {}
    for (method, name), rows in found.items():
        error, stderr, inside = (np.array(x, dtype=np.float64) for x in zip(*rows, strict=True))
        spread, square = float(np.std(error)), float(np.mean(error**2))
        efficiency = bounds[method][name] ** 2 / square
        luck = between[method][name] ** 2 / float(np.mean(np.square(known[method, name])))
        table[method, name] = Quality(
            float(np.mean(error)) / spread, float(np.sqrt(np.mean(stderr**2))) / spread, efficiency,
            efficiency / luck, float(np.mean(inside)), len(rows),
        )  # fmt: skip
    return table, flagged


def exogenous_log(design: Design, motion: Scenario, seed: int, angle: float, torque: float) -> Log:
    """A log that least squares is made for: the noise was added afterwards, the loops never saw it.

    `angle` (rad rms) is white, `torque` (N m rms) is autoregressive with 0.9, both independent of everything.
    """
    clean = simulate(design.replace(sensor={"current_noise": 0.0, "encoder_counts": 0}), motion)
    rng = np.random.default_rng(seed)
    coloured = lfilter([np.sqrt(1.0 - 0.81)], [1.0, -0.9], rng.normal(size=len(clean) + 200))[200:]
    return clean.with_channels(
        theta=clean["theta"] + angle * rng.normal(size=len(clean)),
        i_q=clean["i_q"] + torque / design.K_t * coloured,
    )


@dataclass(frozen=True)
class Alarms:
    """How the test for bias fared on logs of one kind: shares of logs, and the means of the estimates of J."""

    rejected: float
    flagged: float
    least_squares: float
    instruments: float


def alarms(angle: float, cutoff: float, seeds: range) -> Alarms:
    """Test logs whose angle holds white noise (rad rms) for bias, with a band of `cutoff` Hz."""
    design = Design.read(ROOT / "designs" / "hand_tuned.toml")
    motion = scenario("triangle", design, speed=150.0, period=2.0, cycles=4.0)
    processing = Processing(cutoff=cutoff)
    rejected, flagged, ordinary, unbiased = [], [], [], []
    for seed in seeds:
        log = exogenous_log(design, motion, seed, angle, 2e-3)
        result: Identification = identify(design, log, method="iv", processing=processing)
        assert result.bias is not None
        rejected.append(result.bias.p_value < 0.05)
        flagged.append(bool(result.bias.biased))
        unbiased.append(result.estimates["J"].value / design.J - 1.0)
        ordinary.append(unbiased[-1] + result.bias.bias["J"] / design.J)
    return Alarms(*(float(np.mean(x)) for x in (rejected, flagged, ordinary, unbiased)))


def main() -> None:
    """Print the tables; for one kind of log alone where a part of its name is given, or "bias"; from a first seed."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    wanted = sys.argv[2] if len(sys.argv) > 2 else ""
    first = int(sys.argv[3]) if len(sys.argv) > 3 else 0
    chosen = [case for case in cases() if wanted in case.name]
    if chosen:
        print_quality(chosen, range(first, first + count))
    if wanted in "bias":
        print_alarms(range(first, first + count))


def print_quality(chosen: list[Case], seeds: range) -> None:
    """Print bias, efficiency and coverage of every parameter by every method."""
    print("| log | parameter | method | bias | stated error | efficiency | paired | coverage | LS called biased |")
    print("|---|---|---|---|---|---|---|---|---|")
    for case in chosen:
        table, flagged = quality(case, seeds)
        for name in case.true_values():
            for method in METHODS:
                q = table.get((method, name))
                if q is None:
                    continue
                said = f"{100 * flagged[name]:.0f} %" if method == "regression" else ""
                print(
                    f"| {case.name} | {name} | {method} | {q.bias:+.2f} | {q.stated:.2f} | {q.efficiency:.2f} "
                    f"| {q.paired:.2f} | {100 * q.coverage:.1f} % | {said} |"
                    + ("" if q.count == len(seeds) else f" {q.count} logs"),
                    flush=True,
                )


def print_alarms(seeds: range) -> None:
    """Print how often least squares is called biased on logs of which that is known."""
    print("\n| noise added to the log | p below 5 % | LS called biased | J by least squares | J by instruments |")
    print("|---|---|---|---|---|")
    for angle, cutoff in ((2e-6, 40.0), (2e-6, 150.0), (3e-4, 40.0), (3e-4, 150.0)):
        a = alarms(angle, cutoff, seeds)
        print(
            f"| angle {angle:g} rad, band {cutoff:g} Hz | {100 * a.rejected:.1f} % | {100 * a.flagged:.1f} % "
            f"| {100 * a.least_squares:+.2f} % | {100 * a.instruments:+.2f} % |",
            flush=True,
        )


if __name__ == "__main__":
    main()
