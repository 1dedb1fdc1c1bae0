"""Frequency responses measured on the simulated drive by a multisine, as one would on the machine.

A periodic signal with many lines runs for several periods while the shaft turns at constant speed, so that dry
friction stays on one side; the mean over whole periods has no leakage, and noise and quantisation average out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import Scenario, simulate
from pmsm_ctrl.tune.sampled import FAINT

__all__ = ["Multisine", "measure_current_loop", "measure_position_loop", "measure_speed_loop", "multisine"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Multisine:
    """One period of the test signal with a peak of one, at the period of the speed loop.

    Attributes
    ----------
    samples : array, shape (n,)
    lines : array of int, the excited lines of its spectrum
    period : s between two samples
    periods : how many are averaged, after one that is thrown away
    """

    samples: Array
    lines: NDArray[np.intp]
    period: float
    periods: int

    @property
    def frequencies(self) -> Array:
        """Excited frequencies in Hz."""
        return self.lines / (len(self.samples) * self.period)

    @property
    def spectrum(self) -> Complex:
        """Fourier coefficients at the excited lines."""
        return np.fft.rfft(self.samples)[self.lines] / len(self.samples)

    def at(self, t: Array) -> Array:
        """The signal at times that are multiples of the period."""
        return self.samples[np.rint(t / self.period).astype(np.intp) % len(self.samples)]


def multisine(period: float, low: float, high: float, *, count: int = 160, periods: int = 8) -> Multisine:
    """Return a multisine from `low` to `high` (Hz), lines spaced evenly on a logarithmic axis.

    The phases are Schroeder's (M. R. Schroeder, IEEE Trans. Inf. Theory 16 (1970) 85), for a low crest factor.
    """
    n = 1 << max(6, math.ceil(math.log2(1.0 / (low * period))))
    top = min(high * n * period, 0.47 * n)
    lines = np.unique(np.rint(np.geomspace(max(1.0, low * n * period), top, count)).astype(np.intp))
    order = np.arange(len(lines))
    phases = -math.pi * order * (order - 1) / len(lines)
    k = np.arange(n)
    samples = np.zeros(n)
    for line, phase in zip(lines, phases, strict=True):
        samples += np.cos(2.0 * math.pi * line * k / n + phase)
    return Multisine(samples / np.abs(samples).max(), lines, period, periods)


def _held(share: Array, divider: int) -> Array:
    """Content of a reference that is held over `divider` periods, at shares of the rate at which it changes."""
    turn = np.exp(-2j * math.pi * np.outer(np.arange(divider), share) / divider)
    return np.asarray(np.abs(turn.mean(axis=0)))


def _spectrum(log: Log, name: str, n: int, periods: int, lines: NDArray[np.intp]) -> Complex:
    """Fourier coefficients of a channel over its last whole periods."""
    mean = log[name][-n * periods :].reshape(periods, n).mean(axis=0)
    return np.fft.rfft(mean)[lines] / n


def _run(
    design: Design,
    truth: Design | None,
    signal: Multisine,
    references: Mapping[str, float],
    excited: str,
    amplitude: float,
    log_divider: int,
    seed: int,
) -> Log:
    """Run the drive at constant speed with the multisine added to one of its inputs."""
    speed = references["omega_ref"]

    def inputs(t: Array) -> dict[str, Array]:
        out = {name: np.full_like(t, value) for name, value in references.items()}
        out[excited] = out.get(excited, np.zeros_like(t)) + amplitude * signal.at(t)
        return out

    duration = (signal.periods + 1) * len(signal.samples) * signal.period
    logged = {"log_divider": log_divider}
    plant = (truth or design).replace(sensor=logged)
    log = simulate(
        design.replace(sensor=logged), Scenario("multisine", duration, inputs, omega_0=speed), truth=plant, seed=seed,
    )  # fmt: skip
    limit = design.drive.i_max
    if np.abs(log["i_q_ref"]).max() >= limit:
        raise RequestError(
            f"multisine: the current reference reaches its limit of {limit:g} A, which no longer measures the "
            "linear loop; take a smaller amplitude or speed"
        )
    if speed * log["omega"].min() < 0.0 or speed * log["omega"].max() < 0.0:
        raise RequestError("multisine: the shaft reversed, so dry friction is in the response; raise the speed")
    return log


def measure_speed_loop(
    design: Design,
    signal: Multisine,
    *,
    speed: float,
    amplitude: float,
    truth: Design | None = None,
    seed: int = 0,
) -> Complex:
    """Measure the open speed loop at the signal's frequencies.

    The signal (peak `amplitude` in A) is added behind the speed controller; what comes back through the
    controller over what goes to the current loop is -L.
    """
    log = _run(design, truth, signal, {"omega_ref": speed}, "i_q_add", amplitude, design.drive.speed_divider, seed)
    sent = _spectrum(log, "i_q_ref", len(signal.samples), signal.periods, signal.lines)
    return np.asarray(amplitude * signal.spectrum / sent - 1.0, dtype=np.complex128)


def measure_current_loop(
    design: Design,
    signal: Multisine,
    *,
    speed: float,
    amplitude: float,
    truth: Design | None = None,
    seed: int = 0,
) -> tuple[Array, Complex]:
    """Measure the open current loop (q axis): frequencies in Hz and L there.

    The reference changes at the rate of the speed loop, so its images excite the current loop well beyond the
    signal's own lines; those weaker than a sixth are left out.
    """
    divider = design.drive.speed_divider
    log = _run(design, truth, signal, {"omega_ref": speed}, "i_q_add", amplitude, 1, seed)
    n = len(signal.samples)
    total = n * divider
    images = [signal.lines]
    for k in range(1, divider // 2 + 1):
        images += [k * n - signal.lines, k * n + signal.lines]
    lines = np.unique(np.concatenate(images))
    lines = lines[(lines > 0) & (lines < total // 2)]
    share = lines / n
    lines = lines[_held(share, divider) > FAINT]
    current = _spectrum(log, "i_q", total, signal.periods, lines)
    reference = _spectrum(log, "i_q_ref", total, signal.periods, lines)
    return lines / (n * signal.period), np.asarray(current / (reference - current), dtype=np.complex128)


def measure_position_loop(
    design: Design,
    signal: Multisine,
    *,
    speed: float,
    amplitude: float,
    truth: Design | None = None,
    seed: int = 0,
) -> Complex:
    """Measure the open position loop at the signal's frequencies.

    The signal (peak `amplitude` in rad/s) is added to the reference of the speed loop; the position controller
    is the number K_v, so K_v times the angle over the reference is the loop.
    """
    assert design.loops is not None
    bare = design.replace(loops={"speed": design.loops.speed.model_copy(update={"reference_filter": 0.0}).model_dump()})
    log = _run(bare, truth, signal, {"omega_ref": speed}, "omega_ref", amplitude, design.drive.speed_divider, seed)
    n = len(signal.samples)
    ramp = log["t"] * speed
    turned = log.with_channels(theta=log["theta"] - ramp)
    # A rounding of the mean speed leaves a slow ramp in the angle; over whole periods it is removed exactly.
    tail = turned["theta"][-n * signal.periods :]
    drift = (tail[-n:].mean() - tail[:n].mean()) / (n * (signal.periods - 1)) if signal.periods > 1 else 0.0
    tail = tail - drift * np.arange(tail.size)
    angle = np.fft.rfft(tail.reshape(signal.periods, n).mean(axis=0))[signal.lines] / n
    return np.asarray(design.loops.position.K_v * angle / (amplitude * signal.spectrum), dtype=np.complex128)
