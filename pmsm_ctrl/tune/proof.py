"""Promised against measured: every figure of the design once more, on the sampled nonlinear drive."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune import position, steps
from pmsm_ctrl.tune.excite import (
    Multisine,
    measure_current_loop,
    measure_position_loop,
    measure_speed_loop,
    multisine,
)
from pmsm_ctrl.tune.margins import Margins, margins, response
from pmsm_ctrl.tune.noise import noise
from pmsm_ctrl.tune.sampled import Cascade, frequencies
from pmsm_ctrl.tune.speed import open_loop

__all__ = ["BANDWIDTH_TOLERANCE", "PHASE_TOLERANCE", "Figure", "MeasuredLoop", "Proof", "prove"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

BANDWIDTH_TOLERANCE = 0.05  # share of the promised crossover
PHASE_TOLERANCE = 3.0  # deg of phase margin

# Effects that a loop is designed with; what else the design holds may explain a difference.
EXPECTED = {"coulomb", "viscous", "constant_load", "compliance"}


@dataclass(frozen=True)
class Figure:
    """One promised figure and what was measured.

    Attributes
    ----------
    verdict : {"met", "explained", "failed", "shown"}
        Crossover and phase margin are judged; the other figures stand side by side.
    explanation : str
        What was taken away to make the difference vanish.
    """

    loop: str
    name: str
    unit: str
    promised: float
    measured: float
    verdict: str = "shown"
    explanation: str = ""


@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """A measured open loop beside the promised one: frequencies in Hz, responses, margins."""

    name: str
    frequency: Array
    measured: Complex
    promised: Complex
    margins: Margins
    promised_margins: Margins


@dataclass(frozen=True, eq=False)
class Proof:
    """Every promised figure, measured again.

    Attributes
    ----------
    figures : in the order of the table
    loops : measured and promised responses by loop
    steps : (promised, measured) step responses by name
    speed : rad/s at which it was measured
    """

    figures: tuple[Figure, ...]
    loops: Mapping[str, MeasuredLoop]
    steps: Mapping[str, tuple[steps.Step, steps.Step]] = field(default_factory=dict)
    speed: float = 0.0

    @property
    def failed(self) -> tuple[Figure, ...]:
        """Figures that differ by more than is granted, and nothing explains it."""
        return tuple(figure for figure in self.figures if figure.verdict == "failed")

    @property
    def passed(self) -> bool:
        """Whether every judged figure is met or explained."""
        return not self.failed


def prove(
    design: Design,
    *,
    truth: Design | None = None,
    speed: float | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Proof:
    """Measure the loops of a tuned design on the simulated drive.

    Parameters
    ----------
    design : Design
        With its loops set; what the controller believes.
    truth : Design, optional
        The plant; the promise is made for `design` alone.
    speed : rad/s, optional
        Speed during the measurement, high enough that friction stays on one side; by default a tenth of the
        no-load speed.
    seed : int

    Returns
    -------
    Proof

    Raises
    ------
    DesignError
        When the design has no loops.
    RequestError
        When the signal would reach a limit of the drive.
    """
    loops = design.require_loops()
    speed = speed if speed is not None else default_speed(design)
    has_position = loops.position.K_v > 0.0
    cascade = Cascade.of(design, loops.current, loops.speed, loops.position if has_position else None, at=speed)
    measure = _Measurement(design, truth, cascade, speed, seed)
    names = ["current", "speed", *(["position"] if has_position else [])]
    found: dict[str, MeasuredLoop] = {}
    figures: list[Figure] = []
    for k, name in enumerate(names):
        found[name] = measure.loop(name)
        figures += _judge(name, found[name], measure)
        if progress is not None:
            progress((k + 1) / (len(names) + 2))
    promised, measured = _steps(measure, has_position)
    for name, step in measured.items():
        figures += _step_figures(name, promised[name], step)
    figures += _noise_figures(measure)
    if progress is not None:
        progress(1.0)
    return Proof(tuple(figures), found, {n: (promised[n], measured[n]) for n in measured}, speed)


def default_speed(design: Design) -> float:
    """A tenth of the speed at which the EMF alone takes the whole voltage, rad/s."""
    assert design.motor.p is not None
    assert design.motor.psi_f is not None
    return 0.1 * design.drive.u_dc / math.sqrt(3.0) / (design.motor.p * design.motor.psi_f)


@dataclass(frozen=True, eq=False)
class _Measurement:
    """What a measurement needs to be repeated with something taken away."""

    design: Design
    truth: Design | None
    cascade: Cascade
    speed: float
    seed: int

    def changed(self, design: Design, truth: Design) -> _Measurement:
        """The same gains promised for one design and measured on another plant."""
        c = self.cascade
        cascade = Cascade.of(design, c.current, c.speed, c.position, at=self.speed)
        return _Measurement(design, truth, cascade, self.speed, self.seed)

    def promised(self, name: str) -> Any:
        if name == "current":
            period = 1.0 / self.design.drive.f_control
            return self.cascade.current_response(frequencies(period, 1e-3, 1500))
        if name == "speed":
            assert self.cascade.speed is not None
            return open_loop(self.cascade, self.cascade.speed)
        assert self.cascade.position is not None
        return position.open_loop(self.cascade, self.cascade.position.K_v)

    def signal(self, name: str, crossover: float) -> Multisine:
        T_s = self.cascade.period
        low = crossover / (8.0 if name == "current" else 15.0)
        high = 0.47 / T_s if name == "current" else min(8.0 * crossover, 0.47 / T_s)
        return multisine(T_s, low, high, periods=16)

    def amplitude(self, name: str, signal: Multisine) -> float:
        """As large as limits and a one-sided friction allow, by the linear model."""
        cascade = self.cascade.with_gains(position=None)
        source = "omega_ref" if name == "position" else "i_q_add"
        if name == "position":
            assert cascade.speed is not None
            cascade = cascade.with_gains(speed=cascade.speed.model_copy(update={"reference_filter": 0.0}))
        omega = 2.0 * math.pi * signal.frequencies
        peaks = []
        for output in ("omega", "i_q_ref"):
            through = response(cascade.system((source,), (output,)), omega) * signal.spectrum
            spectrum = np.zeros(len(signal.samples) // 2 + 1, dtype=np.complex128)
            spectrum[signal.lines] = through
            peaks.append(float(np.abs(np.fft.irfft(spectrum, len(signal.samples))).max()) * len(signal.samples))
        room = steps.current_headroom(self.design, self.cascade.model.point.i_q)
        return min(0.3 * self.speed / peaks[0], room / peaks[1])

    def loop(self, name: str) -> MeasuredLoop:
        model = self.promised(name)
        promise = margins(model)
        if math.isnan(promise.crossover):
            raise RequestError(f"{name} loop: it crosses no gain of one, there is nothing to measure")
        signal = self.signal(name, promise.crossover)
        amplitude = self.amplitude(name, signal)
        options: dict[str, Any] = {
            "speed": self.speed, "amplitude": amplitude, "truth": self.truth, "seed": self.seed,
        }  # fmt: skip
        frequency = signal.frequencies
        if name == "current":
            frequency, L = measure_current_loop(self.design, signal, **options)
        elif name == "speed":
            L = measure_speed_loop(self.design, signal, **options)
        else:
            L = measure_position_loop(self.design, signal, **options)
        # Far above the phase crossover the loop is smaller than its noise and its phase means nothing.
        top = 1.6 * promise.phase_crossover if math.isfinite(promise.phase_crossover) else math.inf
        keep = frequency <= max(top, 4.0 * promise.crossover)
        frequency, L = frequency[keep], L[keep]
        omega = 2.0 * math.pi * frequency
        if name == "current":
            model = self.cascade.current_response(omega)
            seen = np.isin(omega, model.omega)
            frequency, L, omega = frequency[seen], L[seen], omega[seen]
        curve = response(model, omega)
        return MeasuredLoop(name, frequency, L, curve, margins(ct.frd(L, omega)), promise)


def _judge(name: str, loop: MeasuredLoop, measure: _Measurement) -> list[Figure]:
    promise, found = loop.promised_margins, loop.margins
    judged = [
        ("crossover", "Hz", promise.crossover, found.crossover, BANDWIDTH_TOLERANCE * promise.crossover),
        ("phase margin", "deg", promise.phase_margin, found.phase_margin, PHASE_TOLERANCE),
    ]
    out = []
    explanation: str | None = None
    for figure, unit, promised, measured, tolerance in judged:
        verdict, reason = "met", ""
        if not abs(measured - promised) <= tolerance:
            if explanation is None:
                explanation = _explain(name, measure)
            verdict, reason = ("explained", explanation) if explanation else ("failed", "")
        out.append(Figure(f"{name} loop", figure, unit, promised, measured, verdict, reason))
    shown = [
        ("gain margin", "dB", promise.gain_margin_db, found.gain_margin_db),
        ("bandwidth (-3 dB)", "Hz", promise.bandwidth, found.bandwidth),
        ("sensitivity peak", "1", promise.sensitivity_peak, found.sensitivity_peak),
    ]
    return out + [Figure(f"{name} loop", *row) for row in shown]


def _explain(name: str, measure: _Measurement) -> str:
    """Take the drive's imperfections away one after the other until the promise is met; say which it was."""
    design, plant = measure.design, measure.truth or measure.design
    ideal = {"encoder_counts": 0, "current_noise": 0.0}
    extra = list(dict.fromkeys(e.id for e in plant.effects if e.id not in EXPECTED))
    variants = [("ideal sensors", design, plant.replace(sensor=ideal))]
    variants += [(f"no {effect}", design.without_effect(effect), plant.without_effect(effect)) for effect in extra]
    bare, believed = plant, design
    for effect in extra:
        bare, believed = bare.without_effect(effect), believed.without_effect(effect)
    variants.append(("ideal sensors and none of the extra effects", believed, bare.replace(sensor=ideal)))
    if measure.truth is not None:
        variants.append(("the plant that the design assumes", design, design))
    for what, promised_for, changed in variants:
        loop = measure.changed(promised_for, changed).loop(name)
        promise, found = loop.promised_margins, loop.margins
        if (
            abs(found.crossover / promise.crossover - 1.0) <= BANDWIDTH_TOLERANCE
            and abs(found.phase_margin - promise.phase_margin) <= PHASE_TOLERANCE
        ):
            return (
                f"with {what} {found.crossover:.4g} Hz and {found.phase_margin:.1f} deg are measured, "
                f"{promise.crossover:.4g} Hz and {promise.phase_margin:.1f} deg promised"
            )
    return ""


def _steps(measure: _Measurement, has_position: bool) -> tuple[dict[str, steps.Step], dict[str, steps.Step]]:
    design, cascade, speed = measure.design, measure.cascade, measure.speed
    i_0 = cascade.model.point.i_q
    room = steps.current_headroom(design, i_0)
    promise_speed = margins(measure.promised("speed"))
    inner = 8.0 / margins(measure.promised("current")).crossover
    outer = 5.0 / promise_speed.crossover
    durations = {"speed": outer, "load": outer}
    promised = {
        "current": steps.linear_current(design, cascade, inner),
        "speed": steps.linear_speed(cascade, outer),
        "load": steps.linear_load(cascade, outer),
    }
    if has_position:
        durations["position"] = 3.0 / margins(measure.promised("position")).crossover
        promised["position"] = steps.linear_position(cascade, durations["position"])
    sizes = {"load": min(design.K_t * room, 0.3 * speed / promised["load"].overshoot)}
    peak = float(np.abs(_unit_current(cascade.with_gains(position=None), "omega_ref", outer)).max())
    sizes["speed"] = min(0.3 * speed, room / peak)
    if has_position:
        peak = float(np.abs(_unit_current(cascade, "theta_ref", outer)).max())
        swing = float(np.abs(np.diff(promised["position"].y)).max()) / cascade.period
        sizes["position"] = min(0.3 * speed / swing, room / peak)
    common: dict[str, Any] = {"truth": measure.truth, "seed": measure.seed}
    measured = {"current": steps.run_current(design, speed, i_0, room, inner, **common)}
    measured |= steps.run_steps(design, speed, sizes, durations, **common)
    return promised, measured


def _unit_current(cascade: Cascade, source: str, duration: float) -> Array:
    """Current reference after a unit step of a reference, A."""
    t = cascade.period * np.arange(math.ceil(duration / cascade.period) + 1)
    out = ct.forced_response(cascade.system((source,), ("i_q_ref",)), T=t, inputs=np.ones_like(t))
    return np.asarray(out.outputs, dtype=np.float64).reshape(-1)


def _step_figures(name: str, promised: steps.Step, measured: steps.Step) -> list[Figure]:
    if name == "load":
        return [
            Figure("load step", "largest dip", "rad/s per N m", promised.overshoot, measured.overshoot),
            Figure("load step", "back within 5 %", "ms", 1e3 * promised.settling, 1e3 * measured.settling),
        ]
    return [
        Figure(f"{name} step", "overshoot", "%", promised.overshoot, measured.overshoot),
        Figure(f"{name} step", "settling (2 %)", "ms", 1e3 * promised.settling, 1e3 * measured.settling),
    ]


def _noise_figures(measure: _Measurement) -> list[Figure]:
    """Ripple of the current reference from the encoder: predicted, and the difference an ideal encoder makes."""
    plant = measure.truth or measure.design
    if not plant.sensor.encoder_counts:
        return []
    quiet = plant.replace(sensor={"current_noise": 0.0})
    ripple = []
    for counts in (plant.sensor.encoder_counts, 0):
        truth = quiet.replace(sensor={"encoder_counts": counts})
        # At one speed the encoder's steps beat with the sampling; the mean over several speeds is what is predicted.
        squares = [
            steps.ripple(measure.design, measure.speed * share, truth=truth) ** 2
            for share in (0.71, 0.83, 0.97, 1.09, 1.23)
        ]
        ripple.append(math.sqrt(sum(squares) / len(squares)))
    predicted = noise(measure.cascade).encoder_ripple
    found = math.sqrt(max(ripple[0] ** 2 - ripple[1] ** 2, 0.0))
    return [Figure("speed loop", "current ripple from the encoder", "mA rms", 1e3 * predicted, 1e3 * found)]
