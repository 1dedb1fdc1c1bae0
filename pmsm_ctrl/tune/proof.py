"""Every predicted figure of the loops, determined once more on the sampled nonlinear drive."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune import position
from pmsm_ctrl.tune.bench import LOOPS, Bench, LoopName, Multisine, StepName, multisine
from pmsm_ctrl.tune.linearise import default_speed
from pmsm_ctrl.tune.margins import Margins, margins, response
from pmsm_ctrl.tune.moves import MovePair, moves, stable_speed
from pmsm_ctrl.tune.noise import noise
from pmsm_ctrl.tune.observer import loop_with_observer
from pmsm_ctrl.tune.sampled import Cascade, frequencies
from pmsm_ctrl.tune.speed import open_loop
from pmsm_ctrl.tune.steps import Step, current_headroom, linear_step, linear_steps, voltage_headroom
from pmsm_ctrl.units import axis_unit

__all__ = [
    "BANDWIDTH_TOLERANCE", "OBSERVED", "PHASE_TOLERANCE", "Check", "Explanation", "MeasuredLoop", "Outcome", "Proof",
    "default_speed", "durations", "prove",
]  # fmt: skip

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

BANDWIDTH_TOLERANCE = 0.05  # share of the predicted crossover
PHASE_TOLERANCE = 3.0  # deg of phase margin
RIPPLE = "ripple of the current reference from the encoder"
RIPPLE_SPEEDS = (0.71, 0.83, 0.97, 1.09, 1.23)  # shares of the speed, over which the encoder's ripple is averaged
OBSERVED = "speed loop with disturbance observer"
SWAY = 0.3  # part of the speed by which a test signal may change it


class Outcome(StrEnum):
    """What became of a check."""

    PASSED = "passed"
    EXPLAINED = "explained"  # beyond the tolerance, and the cause is known
    FAILED = "failed"
    NOT_JUDGED = "not_judged"  # for information, without a tolerance


@dataclass(frozen=True)
class Explanation:
    """The cause of a difference: without it prediction and simulation agree.

    Attributes
    ----------
    cause : str
        An effect's id, "sensor_errors", "sensor_errors_and_effects", or "plant" (unlike the design).
    crossover, phase_margin : tuple of float
        Predicted and simulated without the cause, Hz and deg.
    """

    cause: str
    crossover: tuple[float, float]
    phase_margin: tuple[float, float]


@dataclass(frozen=True)
class Check:
    """One figure, predicted and simulated.

    Attributes
    ----------
    subject, quantity, unit : str
        Such as "speed loop", "crossover", "Hz".
    predicted, simulated : float
    outcome : Outcome
        Crossover and phase margin are judged, the others are for information.
    explanation : Explanation or None
    """

    subject: str
    quantity: str
    unit: str
    predicted: float
    simulated: float
    outcome: Outcome = Outcome.NOT_JUDGED
    explanation: Explanation | None = None


@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """An open loop measured in simulation and the predicted one.

    Attributes
    ----------
    frequency : array, shape (n,)
        Hz.
    simulated, predicted : array of complex, shape (n,)
    margins, predicted_margins : Margins
    """

    frequency: Array
    simulated: Complex
    predicted: Complex
    margins: Margins
    predicted_margins: Margins

    @property
    def agrees(self) -> bool:
        """Whether crossover and phase margin agree within the tolerances."""
        found, predicted = self.margins, self.predicted_margins
        return (
            abs(found.crossover - predicted.crossover) <= BANDWIDTH_TOLERANCE * predicted.crossover
            and abs(found.phase_margin - predicted.phase_margin) <= PHASE_TOLERANCE
        )


@dataclass(frozen=True, eq=False)
class Proof:
    """Every predicted figure, checked in simulation.

    Attributes
    ----------
    checks : tuple of Check
    loops : mapping of str to MeasuredLoop
    steps : mapping of str to Step
        Simulated.
    speed : float
        At which it was measured, rad/s.
    moves : tuple of MovePair
        Profiled moves, promised and simulated; none without a position loop.
    """

    checks: tuple[Check, ...]
    loops: Mapping[str, MeasuredLoop]
    steps: Mapping[str, Step] = field(default_factory=dict)
    speed: float = 0.0
    moves: tuple[MovePair, ...] = ()

    def having(self, outcome: Outcome) -> tuple[Check, ...]:
        """Return the checks with an outcome.

        Parameters
        ----------
        outcome : Outcome
        """
        return tuple(check for check in self.checks if check.outcome is outcome)

    @property
    def failed(self) -> tuple[Check, ...]:
        """Checks beyond their tolerance without a known cause."""
        return self.having(Outcome.FAILED)

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return not self.failed


def prove(
    design: Design,
    *,
    truth: Design | None = None,
    speed: float | None = None,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Proof:
    """Check the predictions for a tuned design on the simulated drive.

    Parameters
    ----------
    design : Design
        With its loops set; what the controller assumes.
    truth : Design, optional
        The plant; the predictions are made for `design` alone.
    speed : float, optional
        Speed during the measurement, high enough that friction keeps its sign, rad/s; by default a tenth of the
        no-load speed.
    seed : int
    progress : function, optional
        Called with the share done, 0 to 1.

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
    speed = speed if speed is not None else _sound_speed(design)
    whole, design = design, _without_feedback(design)
    cascade = Cascade.of(design, loops.current, loops.speed, loops.position, at=speed)
    experiment = _Experiment(Bench(design, truth or design, speed, seed), cascade)
    names = LOOPS if cascade.position else LOOPS[:2]
    found: dict[str, MeasuredLoop] = {}
    checks: list[Check] = []
    for k, name in enumerate(names):
        found[name] = experiment.loop(name)
        checks += _judge(name, found[name], experiment)
        if progress is not None:
            progress((k + 1) / (len(names) + 2))
    if whole.compensation.source == "observer" and whole.compensation.share > 0.0:
        observing = replace(experiment, bench=replace(experiment.bench, design=whole))
        found[OBSERVED] = observing.loop("speed")
        checks += _judge("speed", found[OBSERVED], observing, OBSERVED)
    steps, more = _steps(experiment, {name: loop.predicted_margins for name, loop in found.items()})
    checks += [*more, *_ripple(experiment)]
    driven = moves(cascade, truth or design, seed=seed) if cascade.position else ()
    for move in driven:
        checks += _move_checks(move, judged=truth is None, motion=design.motion)
    if progress is not None:
        progress(1.0)
    return Proof(tuple(checks), found, steps, speed, driven)


def durations(found: Mapping[str, Margins]) -> dict[str, float]:
    """Return how long step responses last (s), from the margins of the open loops."""
    outer = 5.0 / found["speed"].crossover
    out = {"current": 8.0 / found["current"].crossover, "speed": outer, "load": outer}
    return out | ({"position": 3.0 / found["position"].crossover} if "position" in found else {})


def _without_feedback(design: Design) -> Design:
    """Return a design without a compensation that feeds the measured speed back: it is part of none of the loops."""
    own = design.compensation
    if own.source not in ("observer", "measured"):
        return design
    off = own.model_copy(update={"gain": 0.0, "source": "reference"})
    return design.model_copy(update={"compensation": off})


def _sound_speed(design: Design) -> float:
    """Return the usual speed, or a lower one at which the tests keep a reserve to where the loops become unstable."""
    loops, usual = design.require_loops(), default_speed(design)
    cascade = Cascade.of(design, loops.current, loops.speed, loops.position, at=usual)
    return stable_speed(cascade, (1.0 + SWAY) * usual) / (1.0 + SWAY)


@dataclass(frozen=True, eq=False)
class _Experiment:
    """The test bench and the linear cascade that predicts it."""

    bench: Bench
    cascade: Cascade

    def with_plant(self, design: Design, plant: Design) -> _Experiment:
        """The same gains predicted for one design and measured on another plant."""
        c = self.cascade
        changed = Cascade.of(design, c.current, c.speed, c.position, at=self.bench.speed)
        return _Experiment(replace(self.bench, design=design, plant=plant), changed)

    @property
    def room(self) -> float:
        """Current available for tests, A."""
        return current_headroom(self.bench.design, self.cascade.model.point.i_q)

    def predicted(self, name: LoopName) -> Any:
        assert self.cascade.speed is not None
        if name == "current":
            return self.cascade.current_response(frequencies(1.0 / self.bench.design.drive.f_control, 1e-3, 1500))
        if name == "speed" and self.bench.design.compensation.source == "observer":
            own = self.bench.design.compensation
            assert own.bandwidth is not None
            free = self.bench.design.replace(loops={"position": {"K_v": 0.0}})
            return loop_with_observer(free, own.bandwidth, gain=own.share, at=self.bench.speed)
        if name == "speed":
            return open_loop(self.cascade, self.cascade.speed)
        assert self.cascade.position is not None
        return position.open_loop(self.cascade, self.cascade.position.K_v)

    def signal(self, name: LoopName, crossover: float) -> Multisine:
        """Lines around every frequency at which the gain crosses 1: a resonance may cross it again."""
        T_s = self.cascade.period
        first, last = self.crossings(name, crossover)
        low = first / (8.0 if name == "current" else 15.0)
        high = 0.47 / T_s if name == "current" else min(8.0 * last, 0.47 / T_s)
        found = multisine(T_s, low, high, lambda frequency: self.expected(name, 2.0 * math.pi * frequency))
        # Filters of the current reference would leave too little of the upper lines for a measurement of the current.
        return found.before(self.cascade.speed.filters) if name == "current" and self.cascade.speed else found

    def crossings(self, name: LoopName, crossover: float) -> tuple[float, float]:
        """Lowest and highest frequency at which the predicted gain crosses 1, Hz."""
        grid = np.geomspace(0.1 * crossover, 0.47 / self.cascade.period, 4000)
        above = np.abs(self.expected(name, 2.0 * math.pi * grid)) > 1.0
        found = grid[np.flatnonzero(above[:-1] != above[1:])]
        return (min(crossover, float(found[0])), max(crossover, float(found[-1]))) if found.size else (crossover,) * 2

    def expected(self, name: LoopName, omega: Array) -> Complex:
        """Predicted open loop at angular frequencies, rad/s."""
        if name != "current":
            return response(self.predicted(name), omega)
        model = self.cascade.current_response(omega)  # without frequencies that the held reference hardly contains
        found = response(model, np.asarray(model.omega))
        real, imaginary = (np.interp(omega, model.omega, part) for part in (found.real, found.imag))
        return np.asarray(real + 1j * imaginary)

    def amplitude(self, name: LoopName, signal: Multisine) -> float:
        """As large as the limits and friction of constant sign allow, by the linear model."""
        cascade, source = self.cascade.with_gains(position=None), "i_q_add"
        if name == "position":
            assert cascade.speed is not None
            cascade = cascade.with_gains(speed=cascade.speed.model_copy(update={"reference_filter": 0.0}))
            source = "omega_ref"
        omega = 2.0 * math.pi * signal.frequencies

        def peak(output: str, less: str | None = None) -> float:
            """Largest value of an output, or of its difference from another, per unit of the signal."""
            found = response(cascade.system((source,), (output,)), omega)
            if less is not None:
                found = found - response(cascade.system((source,), (less,)), omega)
            spectrum = np.zeros(len(signal.samples) // 2 + 1, dtype=np.complex128)
            spectrum[signal.lines] = found * signal.spectrum
            return float(np.abs(np.fft.irfft(spectrum, len(signal.samples))).max()) * len(signal.samples)

        # A nearly unstable current loop turns a small reference into large control errors, which the voltage follows.
        error = max(peak("i_q_ref", "i_q"), peak("i_d"))
        by_voltage = voltage_headroom(self.bench.design)
        return min(SWAY * self.bench.speed / peak("omega"), self.room / peak("i_q_ref"), by_voltage / error)

    def loop(self, name: LoopName) -> MeasuredLoop:
        model = self.predicted(name)
        predicted = margins(model)
        if math.isnan(predicted.crossover):
            raise RequestError(f"{name} loop: its gain never crosses 1, so it has no crossover to measure")
        signal = self.signal(name, predicted.crossover)
        frequency, L = self.bench.measure_loop(name, signal, self.amplitude(name, signal))
        # Far above the phase crossover the loop gain is below the noise and its phase is meaningless.
        top = 1.6 * predicted.phase_crossover if math.isfinite(predicted.phase_crossover) else math.inf
        keep = frequency <= max(top, 4.0 * self.crossings(name, predicted.crossover)[1])
        frequency, L = frequency[keep], L[keep]
        omega = 2.0 * math.pi * frequency
        if name == "current":
            model = self.cascade.current_response(omega)
            seen = np.isin(omega, model.omega)
            frequency, L, omega = frequency[seen], L[seen], omega[seen]
        return MeasuredLoop(frequency, L, response(model, omega), margins(ct.frd(L, omega)), predicted)


def _judge(name: LoopName, loop: MeasuredLoop, experiment: _Experiment, subject: str = "") -> list[Check]:
    predicted, found, subject = loop.predicted_margins, loop.margins, subject or f"{name} loop"
    explanation = None if loop.agrees else _explain(name, experiment)
    out = []
    for quantity, unit, wanted, value, tolerance in (
        ("crossover", "Hz", predicted.crossover, found.crossover, BANDWIDTH_TOLERANCE * predicted.crossover),
        ("phase margin", "deg", predicted.phase_margin, found.phase_margin, PHASE_TOLERANCE),
    ):
        if abs(value - wanted) <= tolerance:
            out.append(Check(subject, quantity, unit, wanted, value, Outcome.PASSED))
        else:
            outcome = Outcome.FAILED if explanation is None else Outcome.EXPLAINED
            out.append(Check(subject, quantity, unit, wanted, value, outcome, explanation))
    return [
        *out,
        Check(subject, "gain margin", "dB", predicted.gain_margin_db, found.gain_margin_db),
        Check(subject, "bandwidth (-3 dB)", "Hz", predicted.bandwidth, found.bandwidth),
        Check(subject, "sensitivity peak", "1", predicted.sensitivity_peak, found.sensitivity_peak),
    ]


def _explain(name: LoopName, experiment: _Experiment) -> Explanation | None:
    """Remove the drive's imperfections one after the other until prediction and simulation agree."""
    for cause, design, plant in _without(experiment.bench.design, experiment.bench.plant):
        loop = experiment.with_plant(design, plant).loop(name)
        if loop.agrees:
            p, f = loop.predicted_margins, loop.margins
            return Explanation(cause, (p.crossover, f.crossover), (p.phase_margin, f.phase_margin))
    return None


def _without(design: Design, plant: Design) -> Iterator[tuple[str, Design, Design]]:
    """Yield a cause of differences, and design and plant without it."""
    ideal = {"encoder_counts": 0, "current_noise": 0.0}
    yield "sensor_errors", design, plant.replace(sensor=ideal)
    believed, bare = design, plant
    for effect in _nonlinear(plant):
        yield effect, design.without_effect(effect), plant.without_effect(effect)
        believed, bare = believed.without_effect(effect), bare.without_effect(effect)
    yield "sensor_errors_and_effects", believed, bare.replace(sensor=ideal)
    if plant is not design:
        yield "plant", design, design


def _nonlinear(plant: Design) -> list[str]:
    """Effects that the linear model at constant speed does not represent completely."""
    linear = {
        effect.id
        for effect, _ in bound_effects(plant)
        if effect.enters == "torque" and not effect.has_state and len(effect.linear) == len(effect.parameters)
        and set(effect.signals) <= {"omega", "direction"}
    }  # fmt: skip
    return list(dict.fromkeys(entry.id for entry in plant.effects if entry.id not in linear))


def _steps(experiment: _Experiment, found: Mapping[str, Margins]) -> tuple[dict[str, Step], list[Check]]:
    """Run the steps; sizes are as large as the limits and friction of constant sign allow."""
    bench, cascade, room = experiment.bench, experiment.cascade, experiment.room
    lengths = durations(found)
    predicted = linear_steps(cascade, lengths)
    inner = cascade.with_gains(position=None)
    peak = np.abs(linear_step(inner, "omega_ref", "i_q_ref", lengths["speed"])[1]).max()
    sizes: dict[StepName, float] = {
        "load": min(bench.design.K_t * room, SWAY * bench.speed / predicted["load"].overshoot),
        "speed": min(SWAY * bench.speed, room / float(peak)),
    }
    if "position" in lengths:
        peak = np.abs(linear_step(cascade, "theta_ref", "i_q_ref", lengths["speed"])[1]).max()
        swing = float(np.abs(np.diff(predicted["position"].y)).max()) / cascade.period
        sizes["position"] = min(SWAY * bench.speed / swing, room / float(peak))
    wait = 2.0 * max(lengths[name] for name in sizes)
    steps = {"current": bench.current_step(cascade.model.point.i_q, room, lengths["current"])}
    for name, size in sizes.items():
        steps[name] = bench.step(name, size, wait, lengths[name])
    return steps, [check for name, step in steps.items() for check in _step_checks(name, predicted[name], step)]


def _step_checks(name: str, predicted: Step, found: Step) -> list[Check]:
    settling = 1e3 * predicted.settling, 1e3 * found.settling
    if name == "load":
        return [
            Check("load step", "largest deviation", "rad/s per N m", predicted.overshoot, found.overshoot),
            Check("load step", "return to 5 %", "ms", *settling),
        ]
    return [
        Check(f"{name} step", "overshoot", "%", predicted.overshoot, found.overshoot),
        Check(f"{name} step", "settling (2 %)", "ms", *settling),
    ]


def _move_checks(move: MovePair, *, judged: bool, motion: str) -> list[Check]:
    """Peak error, overshoot and settling of a profiled move; the peak without dry friction is judged."""
    subject, milli = f"{move.profile.replace('_', '-')} move", f"m{axis_unit('rad', motion)}"
    outcome = Outcome.NOT_JUDGED
    if judged and not move.limited:
        outcome = Outcome.PASSED if move.agrees else Outcome.FAILED
    smooth = 1e3 * move.smooth_promised.peak, 1e3 * move.smooth_simulated.peak
    promised, simulated = move.promised, move.simulated
    window = f"settling within {1e3 * move.window:.2g} {milli}"
    return [
        Check(subject, "peak error without dry friction", milli, *smooth, outcome),
        Check(subject, "peak error", milli, 1e3 * promised.peak, 1e3 * simulated.peak),
        Check(subject, "overshoot", milli, 1e3 * promised.overshoot, 1e3 * simulated.overshoot),
        Check(subject, window, "ms", 1e3 * promised.settling, 1e3 * simulated.settling),
    ]


def _ripple(experiment: _Experiment) -> list[Check]:
    """Ripple of the current reference from the encoder: predicted, and the difference to an ideal encoder."""
    bench = experiment.bench
    if not bench.plant.sensor.encoder_counts:
        return []
    squares = []
    for counts in (bench.plant.sensor.encoder_counts, 0):
        plant = bench.plant.replace(sensor={"current_noise": 0.0, "encoder_counts": counts})
        # At one speed the encoder's steps beat with the sampling; the mean over several speeds is predicted.
        runs = [Bench(bench.design, plant, bench.speed * share).ripple() ** 2 for share in RIPPLE_SPEEDS]
        squares.append(sum(runs) / len(runs))
    found = math.sqrt(max(squares[0] - squares[1], 0.0))
    predicted = noise(experiment.cascade).encoder_ripple
    return [Check("speed loop", RIPPLE, "mA rms", 1e3 * predicted, 1e3 * found)]
