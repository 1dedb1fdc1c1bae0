"""One conditioned log: measured balances on a thinned grid, and the signals from which columns are built.

Up to three balances: torque, u_d and u_q. Every balance and every column goes through the same zero-phase filter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.evidence.linalg import RANK_TOLERANCE, factored
from pmsm_ctrl.log import Log, Span
from pmsm_ctrl.regression.bandwidth import signal_band
from pmsm_ctrl.regression.coarse_angle import without_coarse_angle
from pmsm_ctrl.regression.conditioning import Prepared, Processing, condition, default_cutoff
from pmsm_ctrl.regression.currents import add_slopes, drive_as_logged, intended_i_d
from pmsm_ctrl.regression.direction import acting_torques, direction_of
from pmsm_ctrl.regression.drive_timing import (
    UNDELAYED,
    DriveTiming,
    drive_sampling,
    in_time,
    possible_sampling,
    stated_timing,
)
from pmsm_ctrl.regression.edges import MAD, WRONG_TORQUE
from pmsm_ctrl.regression.encoder_steps import angle_steps, errors_by_steps, rough_acceleration
from pmsm_ctrl.regression.filters import derivative, low_pass, shifted
from pmsm_ctrl.regression.joining import FAST, thinned
from pmsm_ctrl.regression.measurement_correction import known_delay, unscaled
from pmsm_ctrl.regression.notices import ASSUMED_I_D, LONG_LOG, TORQUE_JUMPS
from pmsm_ctrl.regression.reference_steps import with_swings
from pmsm_ctrl.regression.reversals import as_sampled
from pmsm_ctrl.regression.thinning import interpolated
from pmsm_ctrl.regression.timing import ending_steadily, punctual, time_in_gaps
from pmsm_ctrl.regression.weights import Weighing, at_given_rate, error_by_steps, speed_asked, voltage_weights
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit, drives

__all__ = [
    "ALWAYS",
    "CHANNELS",
    "MODELLED",
    "Memo",
    "Record",
    "Rows",
    "in_time",
    "make_record",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
# Columns in each balance, shape (k, m), None where they do not enter it.
Rows = tuple[Array | None, ...]
Memo = dict[tuple[object, ...], Any]

CHANNELS = ("torque", "u_d", "u_q")
# Signals that follow from what a model predicts; all others stay what they were measured.
MODELLED = frozenset({"torque", "i_q", "di_q", "inertia"})

# Below this share of the fast speed the direction is uncertain; see `direction`.
STANDSTILL = 0.0005
# A log of fewer samples tells nothing.
FEWEST_SAMPLES = 32
# Periods of the cutoff at either end that the filters need to start, and the share of a log that is given up at most.
EDGES, SHORTEST_EDGE = (4.0, 10.0), 0.05
FEWEST = 20  # samples of the thinned grid that a balance needs
# Share of a log that the default band has to leave.
USABLE = 0.1
ALWAYS = frozenset(
    {"base", "alpha", "noise of alpha", "emf", "beyond the band", "reference"}
)  # with any friction and weight
# A delay below this share of a sample is met well enough to first order.
LATE = 0.03


@dataclass(frozen=True, eq=False)
class Record:
    """Balances of one log.

    Attributes
    ----------
    design : Design
    prepared : Prepared
        The log, made ready.
    signals : dict of str to array, shape (n,)
        At the log's own rate: what terms read, plus ``alpha``, ``di_d``, ``di_q``.
    channels : tuple of str
        The balances this log has, out of `CHANNELS`.
    target : array, shape (channels, m)
        Filtered measured side.
    mask : bool array, shape (m,)
        Samples that take part.
    weight : array, shape (channels, m)
        Relative inverse noise level, at most 1: fast transients are aliased and count less.
    duration : float
        Of the log, s.
    coarse : array, shape (channels,)
        Error of each balance by the steps of a quantised channel, in its unit; 0 where noise smooths the steps.
    dry : float
        Rough level of the dry friction, N m (N); 0 when there is none.
    notes : tuple of Notice
        Reasons to doubt the balances.
    age : DriveTiming or None
        Corrected delay and filter of the logged speed, where the log has no position: drives filter it. None where it
        has a position, or the drive signal is later than the speed.
    angle : bool
        Whether the log has a position.
    late : float or None
        Delay of the currents about which its column is linearised, s; None while the terms read measured currents.
    delayed : float
        Delay of the drive signal with which its reversals were found, s.
    changes : tuple of float
        Times from which on the dry friction is another one, s.
    timing : DriveTiming
        The corrected part of the drive signal's sampling.
    sampling : float
        Largest possible delay of the drive signal behind the position, s: a period of the log, or of the speed loop.
    early : float
        Largest possible lead, s: a torque or current may be the command, which a current loop follows later.
    sampling_stated : bool
        Whether the design states when the drive signal was sampled.
    commanded : bool
        Whether the drive signal is a command, by what the design states or the log shows.
    in_step : bool
        Whether it was sampled in step with a position reference that is held: a part of it falls with the speed.
    driven : bool
        Whether the axis goes one way, driven by a load: its dry friction is what the design states.
    unseen : float
        Time in gaps of the log, s.
    turning : float
        Share of the moving samples, left out, in which the axis turns too often for its direction to be known.
    found : float
        Inertia that a fit has, kg m^2 (kg); 0 before there is one.
    records : tuple of Span
        The records that it was joined from, where there are several.
    shifts : tuple of (float, float)
        What was added to the position of each record, and its standard error, rad (m); empty where one zero serves all.
    counts : tuple, shape (channels, records)
        By which their weights were multiplied for their noise; empty where they count alike.
    wrong : float
        Assumed model error as a share of the torque, by which edges and reversals were weighted.
    edges : float
        Error of the edges as a share of the one that a period of the log makes, by which they were weighted.
    left_out : tuple of (float, float)
        Stretches of time that take no part, because something happened there once, s.
    step : float
        Step of the logged angle, rad (m); next to nothing of a fine encoder, 0 without an angle.
    rough : float
        Noise of the filtered acceleration by these steps, rms.
    lines : tuple of int
        Lines of the encoder whose errors the log shows; they are part of every fit.
    weighing : Weighing or None
        What the weights follow from, as long as they may be worked out again.
    memo, kept : dict
        Columns that were built: those of this record, and those of the measured motion alone, which are the same
        whatever torque a model predicts.
    """

    design: Design
    prepared: Prepared
    signals: Mapping[str, Array]
    channels: tuple[str, ...]
    target: Array
    mask: Mask
    weight: Array
    duration: float
    coarse: Array
    dry: float = 0.0
    notes: tuple[Notice, ...] = ()
    age: DriveTiming | None = None
    angle: bool = True
    late: float | None = None
    delayed: float = 0.0
    timing: DriveTiming = UNDELAYED
    changes: tuple[float, ...] = ()
    sampling: float = 0.0
    early: float = 0.0
    sampling_stated: bool = False
    commanded: bool = False
    in_step: bool = False
    driven: bool = False
    unseen: float = 0.0
    turning: float = 0.0
    found: float = 0.0
    records: tuple[Span, ...] = ()
    shifts: tuple[tuple[float, float], ...] = ()
    counts: tuple[tuple[float, ...], ...] = ()
    wrong: float = WRONG_TORQUE
    edges: float = 1.0
    left_out: tuple[tuple[float, float], ...] = ()
    step: float = 0.0
    rough: float = 0.0
    lines: tuple[int, ...] = ()
    weighing: Weighing | None = field(default=None, repr=False)
    memo: Memo = field(default_factory=dict, repr=False)
    kept: Memo = field(default_factory=dict, repr=False)

    @property
    def age_elsewhere(self) -> DriveTiming | None:
        """How old a speed is in another log of the same drive; it counts only where that has no position."""
        return UNDELAYED if self.angle else self.age

    @property
    def t(self) -> Array:
        """Time of the thinned grid, s."""
        return self.prepared.t[self.prepared.keep]

    @property
    def rate(self) -> float:
        """Rate of the thinned grid, Hz."""
        return self.prepared.thinned_rate

    @property
    def period(self) -> float:
        """Sampling period of the log, s."""
        return 1.0 / self.prepared.rate

    @property
    def cutoff(self) -> float:
        """Cutoff of the low-pass that every balance and column goes through, Hz."""
        return self.prepared.cutoff

    @property
    def linear(self) -> bool:
        """Whether the axis is linear (m, N)."""
        return self.prepared.motion == "linear"

    @property
    def drive(self) -> str:
        """The word for what drives the axis: torque or force."""
        return drives(self.prepared.motion)

    @property
    def inertia(self) -> float:
        """Total inertia by which an error of the angle becomes one of the torque: that of the fit, or the design's."""
        return self.found if self.found > 0.0 else self.design.J

    @property
    def usable(self) -> float:
        """Share of the samples that take part in the torque balance, each by its weight."""
        return float(np.mean(self.mask * self.weight[0] ** 2))

    def unit(self, channel: str) -> str:
        """Unit of a balance."""
        return axis_unit("N m", self.prepared.motion) if channel == "torque" else "V"

    def shaped(self, values: Array) -> Array:
        """Filter and thin a column given at the log's rate, shape (n,), to shape (m,)."""
        return self.prepared.column(values)

    def at_grid(self, values: Array) -> Array:
        """Thin without filtering, along the last axis."""
        return values[..., self.prepared.keep]

    def at_full_rate(self, values: Array) -> Array:
        """Return what was filtered and thinned, shape (m,), at the log's rate, shape (n,)."""
        return interpolated(values, round(self.prepared.rate / self.rate))[: len(self.prepared.t)]

    def stack_all(self, parts: Sequence[Mapping[str, Array]], filtered: bool = False) -> Rows:
        """Return several columns in the balances that any of them enters, filtered in one go.

        Parameters
        ----------
        parts : sequence of dict of balance to array, shape (n,)
            At the log's rate.
        filtered : bool
            Whether they are linear in what was filtered before: then they are thinned alone.

        Returns
        -------
        per balance array, shape (k, m), or None
        """
        out: list[Array | None] = []
        for name in self.channels:
            places = [k for k, part in enumerate(parts) if name in part]
            if not places:
                out.append(None)
                continue
            values = [parts[k][name] for k in places]
            columns = np.stack([self.at_grid(one) for one in values]) if filtered else self.prepared.columns(values)
            if len(places) < len(parts):
                some, columns = columns, np.zeros((len(parts), columns.shape[1]))
                columns[places] = some
            out.append(columns)
        return tuple(out)

    def rate_of(self, values: Array) -> Array:
        """Time derivative at the log's rate."""
        return derivative(values, self.period)

    def acceleration(self) -> Array:
        """Filtered and thinned acceleration, shape (m,)."""
        key = ("alpha",)
        if key not in self.kept:
            self.kept[key] = self.shaped(self.signals["alpha"])
        shaped: Array = self.kept[key]
        return shaped

    def noise_of(self, values: Array) -> float:
        """Noise of a thinned signal, rms: what it holds in the upper half of the band, as a median."""
        fast = values - low_pass(values, self.rate, 0.5 * self.cutoff)
        return MAD * math.sqrt(2.0) * float(np.median(np.abs(fast)))

    def shaft_noise(self) -> float:
        """Noise of the acceleration, rms."""
        key = ("noise of alpha",)
        if key not in self.kept:
            self.kept[key] = np.array(self.noise_of(self.acceleration()))
        return float(self.kept[key])

    def noise_beside(self, load: Array) -> float:
        """Largest noise of the acceleration, rms, that is allowed by what is left of the torque beside a load.

        Above its own frequency the load stays behind, and the rotor alone turns noise into torque. `load`, shape (m,),
        is its acceleration against the rotor's.
        """
        key, weight = ("plain motion",), self.weight[0] * self.mask
        if key not in self.kept:
            plain = [self.signals[name] for name in ("alpha", "direction", "omega")]
            self.kept[key] = factored((self.prepared.columns([*plain, np.ones_like(plain[0])]) * weight).T)
        rigid, target, column = self.kept[key], self.target[0] * weight, load * weight
        along, shared = rigid.basis.T @ target, rigid.basis.T @ column
        own = column - rigid.basis @ shared
        inertia = float(own @ target / (own @ own)) if own @ own > RANK_TOLERANCE**2 * (column @ column) else 0.0
        left = float(np.linalg.norm(target - rigid.basis @ along - inertia * own) / np.linalg.norm(weight))
        rotor = float(rigid.inverse[0] @ (along - inertia * shared)) - inertia
        return left / rotor if rotor > 0.0 else math.inf

    def slope_behind(self, values: Array) -> Array:
        """Slope over the time from `late` ago until now, at the log's rate: so a delay of `late` is met exactly."""
        if self.late is None or abs(self.late) < LATE * self.period:
            return self.rate_of(values)
        return (values - shifted(values, self.period, -self.late)) / self.late


def make_record(
    design: Design, log: Log, processing: Processing | None = None, age: DriveTiming | None = UNDELAYED,
    timing: DriveTiming | None = None, wrong: float = WRONG_TORQUE, edges: float = 1.0,
) -> Record:  # fmt: skip
    """Prepare a log for the diagnosis.

    In the default band, unless that leaves next to nothing: edges and jumping time stamps ring for a few periods of the
    cutoff, and where there are many a wider band is the better one.

    Parameters
    ----------
    design : Design
    log : Log
    processing : Processing, optional
        The default band, or one as wide as the drive signal's where that leaves more, when left out.
    age : DriveTiming or None
        Of a speed beyond what the design knows of it; it counts only where the log has no position. None for a speed
        that is as old as the design says.
    timing : DriveTiming, optional
        How the drive signal was sampled; it is undone. What the design states of the log when left out.
    wrong : float
        Share of the torque's scatter up to which errors at edges and reversals need no care.
    edges : float
        Error of the edges as a share of the one that a period of the log makes.

    Raises
    ------
    LogError
        When a channel is missing, or the axis never moves.
    """
    log.check_evaluable(FEWEST_SAMPLES)
    timing = stated_timing(drive_sampling(design, log), log.period) if timing is None else timing
    if processing is not None:
        return _made(design, log, processing, age, timing, wrong, edges)
    usual, short = Processing(standstill=STANDSTILL), None
    try:
        record = _made(design, log, usual, age, timing, wrong, edges)
        if record.usable >= USABLE:
            return record
    except LogError as error:
        short = error
    try:
        wide = _made(design, log, replace(usual, cutoff=signal_band(thinned(log))), age, timing, wrong, edges)
    except LogError as error:
        raise short or error from None
    return wide if short is not None or wide.usable > record.usable else record


def _assumed_i_d(log: Log, channels: Sequence[str]) -> tuple[Notice, ...]:
    """Say what stands for the d-current in the voltage balances of a log without it: most drives keep it at zero."""
    if "i_d" in log or len(channels) == 1:
        return ()
    return (ASSUMED_I_D(assumed="its reference" if "i_d_ref" in log else "i_d = 0"),)


def _made(
    design: Design, log: Log, processing: Processing, age: DriveTiming | None, timing: DriveTiming,
    wrong: float, edges: float,
) -> Record:  # fmt: skip
    log, few = without_coarse_angle(design, unscaled(design, log), processing.cutoff or default_cutoff(log.rate))
    finest, resolution = angle_steps(log)
    whole, given = in_time(design, ending_steadily(log), age or UNDELAYED), log
    log = timing.undone(thinned(whole))
    prepared = with_swings(design, given, condition(design, log, processing, as_logged=True))
    raw = dict(prepared.signals)
    signals: dict[str, Array] = {name: np.asarray(values) for name, values in raw.items()}
    signals["alpha"] = prepared.alpha
    if "i_q" in signals:
        signals.setdefault("i_d", np.zeros_like(signals["i_q"]))
    else:
        signals["i_q"] = signals["torque"] / design.K_t_assumed
    signals["torque_meas"], signals["i_q_meas"] = signals["torque"], signals["i_q"]
    signals |= drive_as_logged(design, log, prepared, signals)
    signals["i_q_wide"] = signals["i_q"]
    if "i_d" in signals:
        signals["i_d_meas"] = signals["i_d"]
        signals["i_d"] = intended_i_d(log, prepared, signals["i_d"])
    signals |= speed_asked(log, prepared)
    add_slopes(signals, prepared, raw)
    driving = signals["torque"] - (load := signals.get("T_load", np.zeros_like(prepared.t)))
    smooth, fast = (torque - load for torque in acting_torques(design, log, prepared, timing.reversals))
    measured = punctual(log, prepared.t, prepared.cutoff, jumps=False)
    steps = errors_by_steps(prepared, finest, resolution) if finest > 0.0 else None
    seen = partial(direction_of, smooth, fast, prepared, measured, STANDSTILL, steps)
    direction, sure, kink, turning = seen(resolution * prepared.cutoff)
    if int((sure & _edges(prepared))[prepared.keep].sum()) < FEWEST:  # no speed is left that the encoder resolves
        direction, sure, kink, turning = seen()
    finer, moved = round(given.rate / log.rate), timing.late * given.rate
    signals["direction"] = as_sampled(direction, signals["omega"], timing.stepped, finer, moved)
    electrical = design.motor.electrical and all(name in raw for name in ("i_q", "u_d", "u_q"))
    channels = ["torque", "u_d", "u_q"] if electrical else ["torque"]
    target = np.array([prepared.column(driving if name == "torque" else signals[name]) for name in channels])
    moving = (sure & _edges(prepared) & measured)[prepared.keep]
    level = np.hypot(*target[1:]) if len(channels) > 1 else np.zeros(0)
    voltages = voltage_weights(design, prepared, signals, level, log, channels[1:])
    source = "torque" if "torque" in log else "i_q"
    # thinned, or its filter undone, a channel shows its steps no more
    levels = [error_by_steps(given[name], given.rate, prepared.cutoff) for name in (source, *channels[1:])]
    levels[0] *= 1.0 if source == "torque" else design.K_t_assumed
    log = replace(log, channels={n: log[n] for n in ("t", "theta", source) if n in log})  # the rest of it is large
    at_all = at_given_rate(whole, log, timing, prepared, source)
    late = known_delay(design) + timing.reversals
    weighing = Weighing(log, at_all, prepared, signals, kink, moving, steps, tuple(voltages), late)
    weight, mask = weighing.weights(wrong, edges)
    _require_samples(mask, prepared, given)
    notes = (note for note in prepared.notes if note.code != TORQUE_JUMPS.code)  # edges are weighed here, not left out
    return Record(
        design, prepared, signals, tuple(channels), target, mask, weight, float(prepared.t[-1] - prepared.t[0]),
        np.array(levels), kink[0], (*few, *_too_long(given, log), *_assumed_i_d(given, channels), *notes),
        None if "theta" in log else age, "theta" in log, delayed=late, timing=timing,
        **_sampled(design, given, timing), unseen=time_in_gaps(log), records=log.records, wrong=wrong, edges=edges,
        step=resolution, weighing=weighing, turning=turning,
        rough=rough_acceleration(resolution, given.rate, prepared.cutoff),
    )  # fmt: skip


def _sampled(design: Design, log: Log, timing: DriveTiming) -> dict[str, Any]:
    """Return what a record says of how its drive signal may have been sampled beside the motion."""
    sampling, early = possible_sampling(design, log)
    if timing.late < -early:  # the command of a slow current loop, which may be as far ahead
        early -= timing.late
    stated = drive_sampling(design, log)
    commanded = stated.sampling == "command"
    return {"sampling": sampling, "early": early, "commanded": commanded, "sampling_stated": stated.stated}


def _require_samples(mask: Mask, prepared: Prepared, log: Log) -> None:
    """Refuse a band whose filters ring over nearly all of a log: gaps and false stamps cut it into short pieces."""
    left = int(mask.sum())
    if left < FEWEST:
        where = f"{log.provenance.file}: " if log.provenance.file else ""
        raise LogError(f"{where}{left} samples are usable below {prepared.cutoff:.3g} Hz; {FEWEST} were expected")


def _too_long(given: Log, thin: Log) -> tuple[Notice, ...]:
    """Say that a log was thinned because of its length; what a fast log loses, no evaluation uses."""
    if thin.rate > 0.9 * min(FAST, given.rate):
        return ()
    return (LONG_LOG(samples=len(given), rate=thin.rate, given=given.rate, fastest=thin.rate / 8.0),)


def _edges(prepared: Prepared) -> Mask:
    """False near both ends, where the filters start: their ringing is down to 0.15 %, or a twentieth is gone."""
    inside = np.ones(len(prepared.t), dtype=bool)
    periods = max(EDGES[0], min(EDGES[1], SHORTEST_EDGE * len(inside) / prepared.rate * prepared.cutoff))
    edge = round(periods / prepared.cutoff * prepared.rate)
    inside[:edge] = False
    inside[-edge:] = False
    return inside
