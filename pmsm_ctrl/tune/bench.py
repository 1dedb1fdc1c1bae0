"""The simulated drive as a test bench: frequency responses by multisine, step responses, current ripple.

A periodic signal with many lines runs for several periods while the shaft turns at constant speed, so that dry
friction keeps its sign. The mean over whole periods has no leakage; noise and quantisation average out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design, Filter
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import Scenario, simulate
from pmsm_ctrl.simulate.feedforward import observer_share
from pmsm_ctrl.tune.linearise import operating_point
from pmsm_ctrl.tune.sampled import FAINT
from pmsm_ctrl.tune.steps import Step

__all__ = ["LOOPS", "Bench", "LoopName", "Multisine", "StepName", "multisine"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Control = Literal["position", "speed", "current"]
LoopName = Literal["current", "speed", "position"]
StepName = Literal["speed", "load", "position"]

LOOPS: tuple[LoopName, ...] = ("current", "speed", "position")

LINES = 160  # of a multisine, at most; twice as many where a resonance bends the response
FOLLOWED = 0.5  # nepers and radians between two lines that follow a response
LIFT = 100.0  # largest factor by which a line is raised to pass a filter
LONGEST = 1 << 16  # samples of a period, at most
RIPPLE_SAMPLES = 8192  # speed periods over which the ripple is taken, after as many to settle


@dataclass(frozen=True, eq=False)
class Multisine:
    """One period of the test signal with a peak of one, sampled at the period of the speed loop.

    Attributes
    ----------
    samples : array, shape (n,)
    lines : array of int, shape (m,)
        The excited lines of its spectrum.
    period : float
        Between two samples, s.
    periods : int
        How many are averaged, after a first one that is discarded.
    """

    samples: Array
    lines: NDArray[np.intp]
    period: float
    periods: int = 16

    @property
    def frequencies(self) -> Array:
        """Excited frequencies, shape (m,), Hz."""
        return self.lines / (len(self.samples) * self.period)

    @property
    def spectrum(self) -> Complex:
        """Fourier coefficients at the excited lines, shape (m,)."""
        return np.fft.rfft(self.samples)[self.lines] / len(self.samples)

    @property
    def duration(self) -> float:
        """All periods and the discarded one, s."""
        return (self.periods + 1) * len(self.samples) * self.period

    def before(self, filters: Iterable[Filter]) -> Multisine:
        """Return the signal that is this one behind filters, but for its size, raised by no more than `LIFT`.

        Parameters
        ----------
        filters : iterable of Filter
        """
        z = np.exp(2j * math.pi * self.frequencies * self.period)
        passed = np.ones_like(z)
        for one in filters:
            passed = passed * one.biquad.sampled_at(z, self.period)
        if np.all(passed == 1.0):
            return self
        size = np.abs(passed)
        spectrum = np.zeros(len(self.samples) // 2 + 1, dtype=np.complex128)
        spectrum[self.lines] = self.spectrum * np.conj(passed) / size / np.maximum(size, size.max() / LIFT)
        samples = np.fft.irfft(spectrum, len(self.samples))
        return replace(self, samples=samples / np.abs(samples).max())

    def at(self, t: Array) -> Array:
        """Return the signal at times (s) that are multiples of the period."""
        return self.samples[np.rint(t / self.period).astype(np.intp) % len(self.samples)]


def multisine(
    period: float, low: float, high: float, curve: Callable[[Array], Complex] | None = None
) -> Multisine:  # fmt: skip
    """Return a multisine from `low` to `high` (Hz), its lines evenly spaced on a logarithmic axis.

    Where a resonance bends the expected response (`curve` of frequencies in Hz) faster than these lines follow, they
    are evenly spaced along the response instead, and the period is as long as its width asks for. The phases are
    Schroeder's (M. R. Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85), for a low crest factor.
    """
    n = 1 << max(6, math.ceil(math.log2(1.0 / (low * period))))
    top = min(high * n * period, 0.47 * n)
    lines = np.unique(np.rint(np.geomspace(max(1.0, low * n * period), top, LINES)).astype(np.intp))
    if curve is not None and _bends(curve(lines / (n * period))).max(initial=0.0) > FOLLOWED:
        n, lines = _along(curve, period, low, high, n)
    order = np.arange(len(lines))
    phases = -math.pi * order * (order - 1) / len(lines)
    k = np.arange(n)
    samples = np.zeros(n)
    for line, phase in zip(lines, phases, strict=True):
        samples += np.cos(2.0 * math.pi * line * k / n + phase)
    return Multisine(samples / np.abs(samples).max(), lines, period)


def _bends(response: Complex) -> Array:
    """Distance between neighbouring points of a response in the plane of its logarithm: nepers and radians."""
    return np.asarray(np.hypot(np.diff(np.log(np.abs(response))), np.angle(response[1:] / response[:-1])))


def _along(
    curve: Callable[[Array], Complex], period: float, low: float, high: float, n: int
) -> tuple[int, NDArray[np.intp]]:
    """Return a number of samples and lines that are evenly spaced along a response."""
    while True:
        every = np.arange(max(1, round(low * n * period)), round(min(high * n * period, 0.47 * n)) + 1)
        bends = _bends(curve(every / (n * period)))
        if bends.max(initial=0.0) <= FOLLOWED or n >= LONGEST:
            break
        n *= 2
    # half of the lines by the logarithm of the frequency, half by the way that the response takes
    way = np.log(every[1:] / every[:-1])
    length = np.concatenate([[0.0], np.cumsum(way / way.sum() + bends / bends.sum())])
    chosen = np.interp(np.linspace(0.0, length[-1], 2 * LINES), length, every)
    return n, np.unique(np.rint(chosen).astype(np.intp))


def _held(share: Array, divider: int) -> Array:
    """Content of a reference that is held over `divider` periods, at shares of the rate at which it changes."""
    turn = np.exp(-2j * math.pi * np.outer(np.arange(divider), share) / divider)
    return np.asarray(np.abs(turn.mean(axis=0)))


def _mean_period(values: Array, n: int, periods: int) -> Array:
    return np.asarray(values[-n * periods :].reshape(periods, n).mean(axis=0))


@dataclass(frozen=True, eq=False)
class Bench:
    """The simulated drive, turning at constant speed.

    Attributes
    ----------
    design : Design
        What the controller assumes; its loops are set.
    plant : Design
        The true drive.
    speed : float
        rad/s.
    seed : int
        Of the measurement noise.
    """

    design: Design
    plant: Design
    speed: float
    seed: int = 0

    def measure_loop(self, name: LoopName, signal: Multisine, amplitude: float) -> tuple[Array, Complex]:
        """Measure an open loop; return frequencies (Hz) and responses.

        The signal (peak `amplitude`) is added behind the speed controller (speed and current loop, A) or to the
        reference of the speed loop (position loop, rad/s).

        Raises
        ------
        RequestError
            When the current reference reaches its limit, or the shaft reverses.
        """
        n, periods, lines = len(signal.samples), signal.periods, signal.lines
        if name == "current":
            return self._current_loop(signal, amplitude)
        divider = self.design.drive.speed_divider
        if name == "speed":
            log = self._excited(signal, "i_q_add", amplitude, divider)
            sent = np.fft.rfft(_mean_period(log["i_q_ref"], n, periods))[lines] / n
            # The signal passes through the filters of the current reference before it is logged there.
            z = np.exp(2j * math.pi * signal.frequencies * signal.period)
            behind = np.ones_like(z)
            for one in self.design.require_loops().speed.filters:
                behind = behind * one.biquad.sampled_at(z, signal.period)
            own, passed = self.design.compensation, behind
            if own.source == "observer" and own.bandwidth is not None:
                # The observer takes the signal, a part of the current that it sees, for a disturbance of its own.
                a = observer_share(self.design, own.bandwidth)
                passed = behind / (1.0 - own.share * behind * a / (z - 1.0 + a))
            return signal.frequencies, np.asarray(amplitude * signal.spectrum * passed / sent - 1.0)
        loops = self.design.require_loops()
        unfiltered = {"speed": {**loops.speed.model_dump(), "reference_filter": 0.0}}
        log = replace(self, design=self.design.replace(loops=unfiltered))._excited(
            signal, "omega_ref", amplitude, divider
        )
        angle = (log["theta"] - log["t"] * self.speed)[-n * periods :]
        # Rounding of the mean speed leaves a slow ramp in the angle; over whole periods it is removed exactly.
        drift = (angle[-n:].mean() - angle[:n].mean()) / (n * (periods - 1))
        angle = angle - drift * np.arange(angle.size)
        found = np.fft.rfft(_mean_period(angle, n, periods))[lines] / n
        # The position controller is the number K_v.
        return signal.frequencies, np.asarray(loops.position.K_v * found / (amplitude * signal.spectrum))

    def _current_loop(self, signal: Multisine, amplitude: float) -> tuple[Array, Complex]:
        """Measure the current loop also at the images of the reference, which changes at the speed loop's rate.

        The signal runs with either sign. In half the difference the products of speed and current, which fold lines
        onto other lines, cancel. The periods are shared between the two, which have noise of their own.
        """
        n, divider = len(signal.samples), self.design.drive.speed_divider
        total = n * divider
        images = [signal.lines]
        for k in range(1, divider // 2 + 1):
            images += [k * n - signal.lines, k * n + signal.lines]
        lines = np.unique(np.concatenate(images))
        lines = lines[(lines > 0) & (lines < total // 2)]
        lines = lines[_held(lines / n, divider) > FAINT]
        half = replace(signal, periods=signal.periods // 2)
        there = self._excited(half, "i_q_add", amplitude, 1)
        back = replace(self, seed=self.seed + 1)._excited(half, "i_q_add", -amplitude, 1)
        current, reference = (
            np.fft.rfft(_mean_period(0.5 * (there[name] - back[name]), total, half.periods))[lines] / total
            for name in ("i_q", "i_q_ref")
        )
        return lines / (n * signal.period), np.asarray(current / (reference - current))

    def _excited(self, signal: Multisine, channel: str, amplitude: float, log_divider: int) -> Log:
        """Run with the multisine added to one input; refuse a record that is not linear.

        It rises over half of the period that is discarded: begun at once, a filter of the reference would ring.
        """
        rise = 0.5 * len(signal.samples) * signal.period

        def inputs(t: Array) -> dict[str, Array]:
            out = {"omega_ref": np.full_like(t, self.speed)}
            added = amplitude * signal.at(t) * np.minimum(t / rise, 1.0)
            out[channel] = out.get(channel, np.zeros_like(t)) + added
            return out

        log = self._run(Scenario("multisine", signal.duration, inputs, omega_0=self.speed), log_divider=log_divider)
        limit = self.design.drive.i_max
        if np.abs(log["i_q_ref"]).max() >= limit:
            raise RequestError(
                f"multisine: the current reference reaches its limit of {limit:g} A, so the loop is not linear; take a "
                "smaller amplitude or speed"
            )
        if (self.speed * log["omega"]).min() < 0.0:
            raise RequestError("multisine: the shaft reversed, so dry friction is in the response; raise the speed")
        return log

    def _run(self, scenario: Scenario, *, keep_truth: bool = False, **sensor: float) -> Log:
        design, plant = self.design.replace(sensor=sensor), self.plant.replace(sensor=sensor)
        if scenario.control != "current":
            scenario = replace(scenario, references=self._carried(scenario.references))
        return simulate(design, scenario, truth=plant, seed=self.seed, keep_truth=keep_truth)

    def _carried(self, references: Callable[[Array], Mapping[str, Array]]) -> Callable[[Array], dict[str, Array]]:
        """Return references with the current that holds the speed: on a slow loop friction would stop the shaft."""
        held = operating_point(self.plant, self.speed).i_q

        def carried(t: Array) -> dict[str, Array]:
            given = references(t)
            return {**given, "i_q_add": held + given.get("i_q_add", np.zeros_like(t))}

        return carried

    def current_step(self, i_0: float, size: float, duration: float) -> Step:
        """Step i_q by `size` from i_0 (A), outer loops open, for a duration (s)."""
        T_s = self.design.drive.speed_period
        wait = math.ceil(400.0 / self.design.drive.f_control / T_s) * T_s

        def inputs(t: Array) -> dict[str, Array]:
            return {"i_q_add": np.asarray(i_0 + size * (t >= wait - 1e-9), dtype=np.float64)}

        # Settling to 2 % cannot be read from a record with 1 % of noise; without noise it is the mean of many.
        motion = Scenario("current step", wait + duration, inputs, control="current", omega_0=self.speed)
        after = self._run(motion, log_divider=1, current_noise=0.0).between(wait - 1e-9, wait + duration)
        return Step.of(after.t - after.t[0], (after["i_q"] - i_0) / size)

    def step(self, name: StepName, size: float, wait: float, duration: float) -> Step:
        """Step the speed (rad/s), the position (rad) or the load (N m) from constant speed, minus the run without it.

        `wait` and `duration` are the times before and after the step, s.
        """
        T_s = self.design.drive.speed_period
        wait = math.ceil(wait / T_s) * T_s
        stepped, still = (
            self._run(
                _step_scenario(name, self.speed, amount, wait, duration), keep_truth=True,
                log_divider=self.design.drive.speed_divider,
            ).between(wait - 0.5 * T_s, wait + duration)
            for amount in (size, 0.0)
        )  # fmt: skip
        channel = "theta_true" if name == "position" else "omega_true"
        y, t = (stepped[channel] - still[channel]) / size, stepped.t - wait
        return Step.of_load(t, y) if name == "load" else Step.of(t, y)

    def ripple(self) -> float:
        """Return the rms of the current reference about its mean at constant speed, A."""
        motion = _constant(self.speed, 2.0 * RIPPLE_SAMPLES * self.design.drive.speed_period)
        log = self._run(motion, log_divider=self.design.drive.speed_divider)
        return float(np.std(log["i_q_ref"][-RIPPLE_SAMPLES:]))


def _constant(speed: float, duration: float) -> Scenario:
    return Scenario("constant speed", duration, lambda t: {"omega_ref": np.full_like(t, speed)}, omega_0=speed)


def _step_scenario(name: StepName, speed: float, size: float, wait: float, duration: float) -> Scenario:
    def inputs(t: Array) -> Mapping[str, Array]:
        after = t >= wait - 1e-9
        out = {"omega_ref": np.full_like(t, speed), "theta_ref": speed * t}
        if name == "load":
            return {**out, "T_load": np.asarray(size * after, dtype=np.float64)}
        key = "theta_ref" if name == "position" else "omega_ref"
        return {**out, key: out[key] + size * after}

    control: Control = "position" if name == "position" else "speed"
    return Scenario(f"{name} step", wait + duration, inputs, control=control, omega_0=speed)
