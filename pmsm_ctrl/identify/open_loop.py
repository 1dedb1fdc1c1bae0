"""Output error in open loop: the axis alone, driven by the logged torque, in stretches from the measured state on.

Neither loops nor references are needed, effects with states of their own are simulated, and so are reversals. Noise of
the torque makes the speed of a simulation a random walk, and its position the sum of one. The second differences of the
position over a few samples are stationary again, the same linear filter of both sides, and times the inertia a torque:
their squares are what is made small. When the drive signal was sampled is fitted beside the parameters.

A bristle is bent by the travel since the last reversal, which such a random walk would falsify. So an axis with one,
and with one mass, is simulated over the whole record and corrected at every sample by what the measured position is
beside the simulated one, with the gains of a steady Kalman filter: the torque that would correct it as much is made
small. The inertia is the regression's then: noise of the torque and of the angle pull it to either side.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall 1999, sec. 7.2 (output error, prefilters) and
7.5 (predictions, steady filters); P. R. Kalata, IEEE Trans. Aerosp. Electron. Syst. 20 (1984) 174 (gains); H. G. Bock,
Recent advances in parameter identification techniques for ODE, Birkhaeuser 1983 (restarted stretches).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.errors import DesignError, LogError
from pmsm_ctrl.identify import policy
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared, Processing, prepare
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD, sampling_columns
from pmsm_ctrl.regression.inverse_dynamics import Column, Problem
from pmsm_ctrl.regression.joining import parts_of
from pmsm_ctrl.regression.timing import uniform
from pmsm_ctrl.simulate.mechanics import INPUTS, Mechanics
from pmsm_ctrl.units import axis_unit

__all__ = ["OpenLoop", "open_loop"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Record:
    """The stretches of one record that are simulated; `first` is the sample of each from which it is scored.

    With `gains`, 1/s and a number, the record is simulated as a whole and corrected at every sample.
    """

    mechanics: Mechanics
    inputs: Mapping[str, Array]
    motion: tuple[Array, Array]
    starts: NDArray[np.int64]
    length: int
    first: int
    step: int
    used: Mask
    prepared: Prepared
    sampled: Mapping[str, Array]
    gains: tuple[float, float] | None = None

    def apart(self, mechanics: Mechanics, inputs: Mapping[str, Array]) -> Array:
        """Return measured less simulated increments as torques, shape (stretches, increments)."""
        theta = self.prepared.signals["theta"]
        if self.gains is None:
            run = mechanics.run(inputs, self.starts, self.motion, self.length)[:, :, 1]
            # the inertia of these values: the design's would let a larger one make the noise of the torque smaller
            return mechanics.J * self.accelerations(self.at(theta) - run)
        begin = np.zeros(1, dtype=np.int64)
        run = mechanics.run(inputs, begin, self.motion, len(theta), gains=self.gains)[0, :, 1]
        by_correction: Array = mechanics.J * self.gains[0] / mechanics.period * self.at(theta - run)[:, 1:-1]
        return by_correction

    def accelerations(self, theta: Array) -> Array:
        """Return mean accelerations over two steps each from positions, shape (stretches, length)."""
        turned = np.diff(theta[:, self.first :: self.step], axis=1)
        made: Array = np.diff(turned, axis=1) / (self.step * self.mechanics.period) ** 2
        return made

    def driven(self, beside: Mapping[str, float]) -> Mapping[str, Array]:
        """Return what drives the axis, the drive signal with these nuisances of its sampling undone."""
        moved = np.array(self.inputs["torque"])
        for name, value in beside.items():
            moved -= value * self.sampled[name]
        return {**self.inputs, "torque": moved}

    def at(self, values: Array) -> Array:
        """Return samples of a signal of the log, shape (n,), in the stretches, shape (stretches, length)."""
        part: Array = values[self.starts[:, None] + np.arange(self.length)]
        return part


@dataclass(frozen=True, eq=False)
class OpenLoop:
    """What the simulation leaves of the speed's increments, as torques, as a function of the parameters.

    Attributes
    ----------
    design : Design
        What is not fitted is taken from it.
    columns : tuple of Column
        The parameters, with bounds and the design's values.
    steps : array, shape (columns,)
        Differences over which slopes are taken.
    records : tuple
        Every record in stretches, with what drives it.
    chosen : bool array, shape (stretches,), or None
        The stretches that count, of all records in order; all of them where None.
    kept : dict
        What was simulated already, by the parameters.
    """

    design: Design
    columns: tuple[Column, ...]
    steps: Array
    records: tuple[_Record, ...]
    chosen: Mask | None = None
    kept: dict[bytes, Array] = field(default_factory=dict, repr=False)

    @property
    def corrected(self) -> bool:
        """Whether the simulation is corrected at every sample."""
        return any(record.gains is not None for record in self.records)

    @property
    def start(self) -> Array:
        """The design's values, shape (columns,)."""
        return np.array([column.nominal for column in self.columns])

    @property
    def used(self) -> Mask:
        """Which increments count, of all records in order, with one that does not behind every stretch."""
        parts = [np.pad(record.used, ((0, 0), (0, 1))) for record in self.records]
        if self.chosen is not None:
            ends = np.cumsum([len(part) for part in parts])[:-1]
            parts = [part & own[:, None] for part, own in zip(parts, np.split(self.chosen, ends), strict=True)]
        return np.concatenate([part.ravel() for part in parts])

    @property
    def stretch(self) -> NDArray[np.intp]:
        """Number of the stretch that every increment lies in."""
        sizes = [(len(r.used), r.used.shape[1] + 1) for r in self.records]
        counts = np.concatenate([np.full(rows, width) for rows, width in sizes])
        return np.repeat(np.arange(len(counts)), counts)

    @property
    def seconds(self) -> Array:
        """Times at which the stretches begin, s."""
        return np.concatenate([record.prepared.t[record.starts] for record in self.records])

    def with_inertia_held(self, stderr: float) -> OpenLoop:
        """Return the same with the inertia held at the design's.

        Parameters
        ----------
        stderr : float
            Its standard error; it counts as known where that is not finite.
        """
        return replace(self, columns=_inertia_held(self.columns, self.design.J, stderr), kept={})

    def left(self, values: Array) -> Array:
        """Return measured less simulated increments as torques, N m (N); zero between stretches.

        Parameters
        ----------
        values : array, shape (columns,)
        """
        key = values.tobytes()
        if key not in self.kept:
            if len(self.kept) > 2 * len(self.columns):
                self.kept.clear()
            self.kept[key] = np.concatenate([self._left(record, values) for record in self.records])
        return self.kept[key]

    def _left(self, record: _Record, values: Array) -> Array:
        J, parameters = self._parameters(values)
        far = policy.UNSTABLE * self.design.J * float(np.max(np.abs(record.prepared.alpha)))
        mechanics = record.mechanics.with_values(J, parameters)
        beside = {c.name: value for c, value in zip(self.columns, values.tolist(), strict=True) if c.is_nuisance}
        inputs = record.driven(beside)
        try:
            apart = record.apart(mechanics, inputs)
        except DesignError:  # a load that is heavier than the whole axis
            return np.full(record.used.size + len(record.used), far)
        return np.pad(np.clip(np.nan_to_num(apart, nan=far), -far, far), ((0, 0), (0, 1))).ravel()

    def _parameters(self, values: Array) -> tuple[float, list[dict[str, float]]]:
        """Return the inertia and the parameters of the simulated effects."""
        found = [dict(known) for _, known in _simulated(self.design)]
        entries = [entry for entry, _ in _simulated(self.design)]
        J = self.design.J
        for column, value in zip(self.columns, values.tolist(), strict=True):
            if column.is_inertia:
                J = value
            elif column.entry >= 0:
                found[entries.index(column.entry)][column.symbol] = value
        return J, found

    def slopes(self, values: Array) -> Array:
        """Return what a unit of every parameter takes from `left`, shape (increments, columns)."""
        made = np.empty((len(self.used), len(self.columns)))
        for k, (step, column) in enumerate(zip(self.steps.tolist(), self.columns, strict=True)):
            by = step if values[k] + step <= column.upper else -step
            moved = values.copy()
            moved[k] += by
            made[:, k] = (self.left(values) - self.left(moved)) / by
        return made

    def problem(self, values: Array) -> Problem:
        """Return the least squares problem that is linear at these values.

        Parameters
        ----------
        values : array, shape (columns,)
        """
        slopes, used = self.slopes(values), self.used
        columns = tuple(replace(c, values=s) for c, s in zip(self.columns, slopes.T, strict=True))
        rate = self.records[0].prepared.rate / self.records[0].step

        def laid_out(name: str) -> Array:
            middle = [r.at(r.prepared.t if name == "t" else r.prepared.signals[name]) for r in self.records]
            parts = [m[:, r.first :: r.step][:, 1:] for m, r in zip(middle, self.records, strict=True)]
            return np.concatenate([part.ravel() for part in parts])

        return Problem(
            self.left(values) + slopes @ values, columns, used, laid_out("t"), laid_out("omega"), laid_out("torque"),
            axis_unit("N m", self.design.motion), rate, 0.5 * rate,
        )  # fmt: skip


def _simulated(design: Design) -> list[tuple[int, dict[str, float]]]:
    """Return the positions among the design's effects of those that are simulated, and their parameters."""
    return [(k, values) for k, (effect, values) in enumerate(bound_effects(design)) if _acts(effect, values)]


def _acts(effect: Effect, values: Mapping[str, float]) -> bool:
    return effect.enters == "torque" and effect.active(values)


def open_loop(
    design: Design, log: Log, sigma: Mapping[str, float] | None = None, inertia: float = math.nan
) -> OpenLoop:
    """Return the simulation of a log, or of its records, what is known of the sampling of its drive signal undone.

    Parameters
    ----------
    design : Design
        With the values from which a fit starts.
    log : Log
    sigma : dict of str to float, optional
        Of `LATENESS` and `SPREAD`, by how much each may lie beside what was undone; they are known when left out.
    inertia : float
        Standard error of the design's inertia, where it is held at that; it counts as known when left out.

    Raises
    ------
    LogError
        When no record is long enough, or a torque effect of the design needs a channel that the log lacks.
    """
    design = _lighter(design)
    records = [record for part in parts_of(log) if (record := _record(design, part)) is not None]
    if not records:
        raise LogError(f"{log.provenance.file or 'the log'}: no record without gaps that could be simulated")
    columns = (*_columns(design), *_sampling(sigma or {}))
    if any(record.gains is not None for record in records):
        # a torque that is smoothed has less noise, whether or not the drive signal was
        columns = tuple(c for c in columns if c.name != SPREAD)
        columns = _inertia_held(columns, design.J, inertia)
    force = float(np.sqrt(np.mean(np.concatenate([r.prepared.signals["torque"] for r in records]) ** 2)))
    loop = OpenLoop(design, columns, np.array([_first_step(c, force) for c in columns]), tuple(records))
    size = np.array([float(np.sqrt(np.mean(s[loop.used] ** 2))) for s in loop.slopes(loop.start).T])
    alone = force / np.maximum(size, 1e-300)  # what would make the whole torque
    steps = np.maximum(policy.DIFFERENCE * np.abs(loop.start), policy.DIFFERENCE * policy.FIRST_DIFFERENCE * alone)
    steps = np.where(np.array([c.nominal != 0.0 for c in columns]), np.minimum(steps, loop.steps), steps)
    moves = size * loop.steps > policy.NO_EFFECT * force
    steps = np.where(moves, steps, loop.steps)
    free = [k for k in range(len(columns)) if moves[k]]
    free = [k for k in free if not columns[k].is_nuisance] + [k for k, c in enumerate(columns) if c.is_nuisance]
    return replace(loop, columns=tuple(columns[k] for k in free), steps=steps[free], kept={})


def _inertia_held(columns: tuple[Column, ...], value: float, stderr: float) -> tuple[Column, ...]:
    """Return the columns with the inertia held at a value, within its standard error where that is known."""
    known = stderr if math.isfinite(stderr) else policy.INERTIA_KNOWN * value
    return tuple(replace(c, held=True, prior=(value, known)) if c.is_inertia else c for c in columns)


def _lighter(design: Design) -> Design:
    """Return the design with half of the inertia as the load behind a spring, where the load is nearly all of it.

    A regression ends there where its band tells little of the spring, and the motor alone would swing beyond bounds.
    """
    for effect, values in bound_effects(design):
        for symbol in effect.amplitudes if effect.structure.splits_inertia else ():
            if values[symbol] > policy.HEAVIEST * design.J:
                design = design.with_effect(effect.id, {**values, symbol: 0.5 * design.J})
    return design


def _first_step(column: Column, force: float) -> float:
    return policy.DIFFERENCE * (abs(column.nominal) or (column.sigma if column.is_nuisance else force))


def _sampling(sigma: Mapping[str, float]) -> tuple[Column, ...]:
    units = {LATENESS: "s", SPREAD: "s^2"}
    return tuple(Column(n, np.zeros(0), units[n], 0.0, symbol=n, sigma=size) for n, size in sigma.items() if size > 0.0)


def _columns(design: Design) -> tuple[Column, ...]:
    """Return a column without values for the inertia and for every parameter that can be searched."""
    made = [Column("J", np.zeros(0), axis_unit("kg m^2", design.motion), design.J, 1e-3 * design.J, symbol="J")]
    effects = list(bound_effects(design))
    for entry, values in _simulated(design):
        effect = effects[entry][0]
        for known in effect.parameters:
            structure = effect.structure
            if known.symbol in structure.fixed(effect) | structure.absent(effect, values):
                continue
            twins = sum(column.symbol == known.symbol for column in made)
            name = f"{known.symbol}#{twins + 1}" if twins else known.symbol
            unit = axis_unit(known.unit, design.motion)
            made.append(
                Column(
                    name, np.zeros(0), unit, values[known.symbol], known.lower, known.upper, effect.id, entry,
                    known.symbol,
                )
            )  # fmt: skip
    return tuple(made)


def _record(design: Design, log: Log) -> _Record | None:
    """Return one record ready to be simulated; None where it is too short, or has gaps."""
    if not uniform(log)[2].all():
        return None
    try:
        smooth = prepare(design, log, Processing())
        prepared = prepare(design, log, Processing(cutoff=policy.OPEN_LOOP_BAND * log.rate))  # not filtered at all
    except LogError:
        return None
    signals, rate = prepared.signals, prepared.rate
    inputs = {name: signals[name] for name in INPUTS if name in signals}
    mechanics = Mechanics.of(design, 1.0 / rate, float(np.max(np.abs(signals["omega"]))), inputs)
    mechanics = replace(mechanics, steps=min(mechanics.steps, math.ceil(policy.FASTEST_STEP / rate)))
    if mechanics.left_out:
        effect, why = next(iter(mechanics.left_out.items()))
        raise LogError(f"{log.provenance.file or 'the log'}: {effect} cannot be simulated: {why}")
    memory = any(effect.has_state for effect, _ in mechanics.bound)
    motion, sampled = (smooth.signals["omega"], signals["theta"]), sampling_columns(signals["torque"], 1.0 / rate, 0.0)
    kinds = [effect.structure for effect, _ in mechanics.bound]
    if any(kind.replaces_direction for kind in kinds) and not any(kind.splits_inertia for kind in kinds):
        return _corrected(mechanics, inputs, motion, prepared, sampled)
    step = max(1, round(rate / policy.INCREMENTS))
    first = round(policy.RUN_IN * rate) if memory else 0
    scored = step * max(policy.FEWEST_STEPS, round(policy.STRETCH[memory] * rate / step))
    length = first + scored + 1
    count = (len(prepared.t) - 1 - first) // scored
    if count < 2:
        return None
    starts = np.arange(count) * scored
    sure = prepared.moving if memory else prepared.moving & ~_turning(smooth.signals["omega"], rate)
    moving = sure[starts[:, None] + np.arange(first, length)]
    used = np.array([moving[:, k : k + 2 * step + 1].all(axis=1) for k in range(0, scored - step, step)]).T
    return _Record(mechanics, inputs, motion, starts, length, first, step, used, prepared, sampled)


def _corrected(
    mechanics: Mechanics, inputs: Mapping[str, Array], motion: tuple[Array, Array], prepared: Prepared,
    sampled: Mapping[str, Array],
) -> _Record | None:  # fmt: skip
    """Return a record that is simulated as a whole, with the gains by which it predicts the next sample best."""
    rate = prepared.rate
    width, first = round(policy.STRETCH[True] * rate), round(policy.RUN_IN * rate)
    count = (len(prepared.t) - 1 - first) // width
    if count < 2:
        return None
    starts = first + np.arange(count) * width
    used = np.ones((count, width - 1), dtype=bool)  # most of what a bristle does is at rest
    found = []
    for index in policy.TRACKING:
        run = mechanics.run(inputs, np.zeros(1, dtype=np.int64), motion, len(prepared.t), gains=_gains(index, rate))
        apart = (motion[1] - run[0, :, 1])[first:]
        found.append((float(np.mean(np.nan_to_num(apart, nan=np.inf) ** 2)), index))
    gains = _gains(min(found)[1], rate)
    return _Record(mechanics, inputs, motion, starts, width + 1, 0, 1, used, prepared, sampled, gains)


def _gains(index: float, rate: float) -> tuple[float, float]:
    """Return the gains of a steady Kalman filter, 1/s and a number, for noise of torque and angle.

    Parameters
    ----------
    index : float
        How far noise of the torque moves the shaft in a sample, over the noise of the angle.
    rate : float
        Of the samples, Hz.
    """
    root = (4.0 + index - math.sqrt(8.0 * index + index**2)) / 4.0
    of_position = 1.0 - root**2
    return (2.0 * (2.0 - of_position) - 4.0 * root) * rate, of_position


def _turning(omega: Array, rate: float) -> Mask:
    """Return the samples about a reversal, shape (n,): noise of the torque decides there when dry friction lets go."""
    turns = np.flatnonzero(np.diff(np.sign(omega)) != 0.0)
    out, around = np.zeros(len(omega), dtype=bool), math.ceil(policy.TURNING * rate)
    for k in turns.tolist():
        out[max(0, k - around) : k + around + 2] = True
    return out
