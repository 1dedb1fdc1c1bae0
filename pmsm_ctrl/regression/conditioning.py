"""From a log to clean signals: one time grid, one zero-phase filter for both sides, derivatives, masks.

The chain has two stages. A wide low-pass cleans the signals from which speed, acceleration and the terms of
the effects are evaluated; a narrower one is then applied to *every* column of the regression, the measured
side and the nonlinear terms included, and the result is thinned to the rate its band needs. Both are
zero-phase, so that nothing shifts against anything else. With the default figures on a 1 kHz log this is the
processing of A. Janot, M. Gautier, M. Brunot, Nonlinear Benchmarks Workshop 2019 (EMPS), better differentiated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, NextCommand, RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression import notices as words
from pmsm_ctrl.regression.coarse_angle import without_coarse_angle
from pmsm_ctrl.regression.drive_timing import Sampling
from pmsm_ctrl.regression.filters import derivative, low_pass_each
from pmsm_ctrl.regression.masks import count_reversals, resting, slow_speed, torque_jumps, without_edges
from pmsm_ctrl.regression.measurement_correction import undone
from pmsm_ctrl.regression.signals import logged_torque
from pmsm_ctrl.regression.thinning import thinned
from pmsm_ctrl.regression.timing import between_records, own_time, uniform, unwrapped
from pmsm_ctrl.section import Notice

__all__ = ["PREFILTER", "Prepared", "Processing", "condition", "default_cutoff", "prepare"]

Array = NDArray[np.float64]
Clean = Callable[[Sequence[Array]], list[Array]]  # the low-pass before differentiation
Mask = NDArray[np.bool_]

# Least samples of a log that is evaluated.
FEWEST = 100
# SI units; no sensor resolves less.
SMALLEST = 1e-15
# Low-pass of the signals before they are differentiated, in cutoffs.
PREFILTER = 2.5
# Time cut at both ends and around gaps, in periods of the cutoff: the filter's transient has fallen to 0.4 % by then.
EDGE = 4.0
# Default low-pass, Hz: friction and inertia of a servo axis show below it.
USUAL = 40.0
# Low-pass of the speed, Hz, in which rests and reversals are found for blanking: a narrower one rounds off the kink
# that dry friction makes at a reversal, and the rounded speed changes its sign too late.
REST_BAND = 250.0
# Reversals over those in the band of the evaluation, from which on they are taken for noise.
MOST_REVERSALS = 1.5
# Multiples of the speed below which the axis rests that are tried in turn, until noise reverses it no more.
RAISED = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Processing:
    """How a log becomes a regression.

    Attributes
    ----------
    cutoff : float or None
        Low-pass of both sides, Hz. None: 40 Hz, or an eighth of the log's rate where that is less.
    inertia_cutoff : float or None
        Low-pass of the acceleration as an instrument, Hz, where that is less than `cutoff`: the inertia is then found
        from this band alone, since the noise of a measured acceleration grows with the square of the frequency.
        None: it is found from the whole band.
    derivative : {"nine_point", "central"}
        "central" loses 1 % at 30 Hz on a 1 kHz log; it reproduces published figures.
    standstill : float
        Speeds below this share of the 99 % quantile are masked: friction is set-valued there.
    through_reversals : bool
        Whether samples at rest take part where the rest is shorter than the filter's memory, as at a reversal:
        for an evaluation that simulates the rest. Longer rests never take part.
    blank : bool or None
        Whether rests and reversals are set to zero on both sides before the low-pass. Masked after it, they have
        spread to their neighbours: friction at rest is whatever balances the drive, not the level in its column. Not
        done where the encoder is so coarse that its noise reverses the axis. None: `identify` does, `prepare` does
        not.
    sampling : Sampling or None
        How the drive signal was sampled, a nuisance of the regression. None: with the motion, exactly.
    """

    cutoff: float | None = None
    inertia_cutoff: float | None = None
    derivative: Literal["nine_point", "central"] = "nine_point"
    standstill: float = 0.002
    through_reversals: bool = False
    blank: bool | None = None
    sampling: Sampling | None = None


@dataclass(frozen=True, eq=False)
class Prepared:
    """Signals of one log at its own rate, ready for the terms of effects.

    Attributes
    ----------
    t : array, shape (n,)
        Uniform time, s.
    signals : dict of str to array, shape (n,)
        ``omega``, ``theta``, ``direction``, ``torque`` (the drive's; a load torque is not subtracted here) and,
        where the log has them, ``i_d``, ``i_q``, ``u_d``, ``u_q``, ``T_load``, ``temperature``; pre-filtered.
    alpha : array, shape (n,)
        Acceleration, rad/s^2 (m/s^2).
    moving : bool array, shape (n,)
        False at standstill, at the edges and around gaps.
    keep : int array, shape (m,)
        Indices of the thinned grid, moving or not.
    rate, cutoff : float
        Of the log and of the low-pass, Hz.
    motion : {"rotary", "linear"}
    notes : tuple of Notice
    weight : array, shape (n,), or None
        What every column is multiplied by before it is filtered: 0 where nothing is to be explained, 1 elsewhere.
    inertia_cutoff : float or None
        As in `Processing`.
    acting : array, shape (n,), or None
        Torque that terms read, where it is not the measured one.
    sampling : Sampling or None
        As in `Processing`.
    swings : dict of str to (float, float)
        How far voltages swing over the period of a held reference: see `reference_steps.swings`.
    """

    t: Array
    signals: Mapping[str, Array]
    alpha: Array
    moving: Mask
    keep: NDArray[np.int64]
    rate: float
    cutoff: float
    motion: str
    notes: tuple[Notice, ...] = ()
    weight: Array | None = None
    inertia_cutoff: float | None = None
    acting: Array | None = None
    sampling: Sampling | None = None
    swings: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def column(self, values: Array) -> Array:
        """Weight a column over the log's own grid, shape (n,), filter it, and thin it to shape (m,)."""
        return np.asarray(self.columns([values])[0])

    def columns(self, several: Sequence[Array] | Array) -> Array:
        """Do the same with several, to shape (k, m)."""
        if self.weight is None:
            return self._smooth(several)
        return np.concatenate([self._smooth([self.weight * values]) for values in several])

    def smooth(self, values: Array) -> Array:
        """Filter a signal over the log's own grid, shape (n,), and thin it to shape (m,)."""
        return np.asarray(self._smooth([values])[0])

    def _smooth(self, several: Sequence[Array] | Array) -> Array:
        step = int(self.keep[1] - self.keep[0]) if len(self.keep) > 1 else len(self.t)
        return thinned(several, self.rate, self.cutoff, step)

    @property
    def mask(self) -> Mask:
        """Samples of the thinned grid that take part, shape (m,); none of which the weight leaves less than half."""
        mask = self.moving[self.keep]
        return mask if self.weight is None else mask & (self.smooth(self.weight) > 0.5)

    def blanked(self, weight: Array | None) -> Prepared:
        """Return a copy with this weight in addition to its own."""
        if weight is None:
            return self
        return replace(self, weight=weight if self.weight is None else self.weight * weight)

    @property
    def thinned_rate(self) -> float:
        """Rate of the thinned grid, Hz."""
        return self.rate / float(self.keep[1] - self.keep[0])


def prepare(design: Design, log: Log, processing: Processing | None = None, *, as_logged: bool = False) -> Prepared:
    """Check a log, then filter, differentiate and mask it.

    The design gives the torque constant and, for an electrical motor, the reluctance torque. `as_logged` leaves in what
    its measurement effects put into the channels, for who models it.

    Raises
    ------
    LogError
        When a channel is missing, the log is too short, a number is beyond reason, or the axis never moves.
    RequestError
        When the cutoff is not below half the log's rate.
    """
    processing = processing or Processing()
    log.check_evaluable()
    log, coarse = without_coarse_angle(design, log, _cutoff(processing, log.rate))
    prepared = condition(design, log, processing, as_logged)
    return replace(prepared, notes=(*coarse, *prepared.notes))


def condition(design: Design, log: Log, processing: Processing, as_logged: bool = False) -> Prepared:
    """Filter, differentiate and mask a log that was checked and whose angle is fine enough; see `prepare`.

    Raises
    ------
    LogError
        When a channel is missing, the log is too short, or the axis never moves.
    RequestError
        When the cutoff is not below half the log's rate.
    """
    where = f"{log.provenance.file}: " if log.provenance.file else ""
    if len(log) < FEWEST:
        raise LogError(f"{where}{len(log)} samples; at least {FEWEST} were expected")
    t, raw, good, notes = uniform(log)
    raw, notes = _without_dead_voltages(raw, notes)
    if not as_logged:
        angle = {"theta": unwrapped(raw["theta"])} if "theta" in raw else {}
        raw, left_in = undone(design, t, raw | angle)
        notes = (*notes, *left_in)
    rate = (len(t) - 1) / float(t[-1] - t[0])
    cutoff = _cutoff(processing, rate)
    if not 0 < cutoff < rate / 2:
        raise RequestError(f"cutoff {cutoff:g} Hz: it should lie between 0 and half the log's rate, {rate / 2:g} Hz")
    signals, alpha, clean, slow = _moved(raw, rate, cutoff, processing, where)
    blank = slow is not None
    names = [name for name in ("i_d", "i_q", "u_d", "u_q", "T_load", "temperature", "torque") if name in raw]
    signals |= zip(names, clean([raw[name] for name in names]), strict=True)
    if "torque" not in signals:
        signals["torque"] = logged_torque(design, signals, where)
    _require_motion(signals, where)
    signals["t"] = own_time(log, t)  # terms that drift count from the begin of the record
    for name in {"i_d", "i_q"} & signals.keys():
        signals[f"d{name}"] = derivative(signals[name], 1.0 / rate, processing.derivative)
    slow = slow if slow is not None else slow_speed(signals["omega"], processing.standstill)
    rest = resting(signals["omega"], slow, round(rate / cutoff), blank, processing.through_reversals)
    moving = np.ones(len(t), dtype=bool) if blank else ~rest
    moving = without_edges(moving, good & ~between_records(log, t, 0.0), round(EDGE * rate / cutoff))
    # A drive that runs at the log's own rate holds its torque between samples: nothing is missed then.
    decimated = design.motor.electrical and design.drive.f_control > 1.5 * rate
    around = round(2.0 * rate / cutoff)  # samples before and after a jump; of more jumps nothing would be left
    drive = raw["torque"] if "torque" in raw else raw["i_q"]
    spikes = torque_jumps(drive, 0.5 / around) if decimated else np.arange(0)
    for k in spikes:
        moving[max(0, k - around) : k + around] = False
    if len(spikes):
        notes = (*notes, words.TORQUE_JUMPS(percent=100.0 * len(spikes) / len(t)))
    keep = np.arange(0, len(t), _step(rate, cutoff))
    weight = np.where(rest, 0.0, 1.0) if blank else None
    prepared = Prepared(
        t, signals, alpha, moving, keep, rate, cutoff, log.motion, notes, weight, processing.inertia_cutoff,
        sampling=processing.sampling,
    )  # fmt: skip
    if int(prepared.mask.sum()) < 20:
        usable = int((moving & ~rest).sum()) / rate
        raise LogError(f"{where}the axis moves for too short a time: {usable:.3g} s usable")
    return prepared


def default_cutoff(rate: float) -> float:
    """Return the default low-pass, Hz, for a log of this rate, Hz."""
    return min(USUAL, rate / 8.0)


def _cutoff(processing: Processing, rate: float) -> float:
    return processing.cutoff if processing.cutoff is not None else default_cutoff(rate)


def _step(rate: float, cutoff: float) -> int:
    """Return the factor by which a band is thinned: to a rate near 2.5 times its width, and never below twice.

    A band that leaves much of its grid's spectrum empty has a residual whose correlation no short model describes.
    """
    wanted = rate / (2.5 * cutoff)
    allowed = [k for k in (math.floor(wanted), math.ceil(wanted)) if k >= 1 and rate >= 2.0 * cutoff * k]
    return min(allowed, key=lambda k: abs(math.log(k / wanted)), default=1)


def _without_dead_voltages(
    raw: dict[str, Array], notes: tuple[Notice, ...]
) -> tuple[dict[str, Array], tuple[Notice, ...]]:
    """Leave out voltages that the drive did not record, but whose columns it wrote all the same."""
    dead = [name for name in ("u_d", "u_q") if name in raw]
    if not dead or any(float(np.max(np.abs(raw[name]))) >= SMALLEST for name in dead):
        return raw, notes
    return (
        {name: values for name, values in raw.items() if name not in dead},
        (*notes, words.DEAD_VOLTAGES(channels=" and ".join(dead))),
    )


def _require_motion(signals: Mapping[str, Array], where: str) -> None:
    """Refuse a log without motion or without torque; rounding errors are neither."""
    for name, what in (("omega", "the axis stands still"), ("torque", "the drive makes no torque")):
        if float(np.max(np.abs(signals[name]))) < SMALLEST:
            raise LogError(
                f"{where}{what} throughout ({name} below {SMALLEST:g} SI units); a driven motion was expected"
            )


def _moved(
    raw: Mapping[str, Array], rate: float, cutoff: float, processing: Processing, where: str
) -> tuple[dict[str, Array], Array, Clean, float | None]:
    """Return the motion, the acceleration, the low-pass that made them, and the speed up to which rests are blanked.

    Where noise would reverse the axis, that speed is raised until it does not; None where that is not enough.
    """

    def made(wide: float) -> tuple[dict[str, Array], Array, Clean]:
        clean = (lambda some: low_pass_each(some, rate, wide)) if wide < 0.45 * rate else list
        return *_motion(raw, 1.0 / rate, clean, processing.derivative, where), clean

    usual = PREFILTER * cutoff
    if not processing.blank:
        return *made(usual), None
    narrow = made(cutoff)[0]["omega"]
    tried = [
        (processing.standstill, max(usual, REST_BAND)),
        *((share * processing.standstill, usual) for share in RAISED),
    ]
    for standstill, wide in tried:
        signals, alpha, clean = made(wide)
        slow = slow_speed(signals["omega"], standstill)
        if count_reversals(signals["omega"], slow) <= MOST_REVERSALS * count_reversals(
            narrow, slow_speed(narrow, standstill)
        ):
            return signals, alpha, clean, slow
    return signals, alpha, clean, None


def _motion(
    raw: Mapping[str, Array], period: float, clean: Clean, method: str, where: str
) -> tuple[dict[str, Array], Array]:
    if "theta" in raw:
        theta = clean([unwrapped(raw["theta"])])[0]
        omega = derivative(theta, period, method)
    elif "omega" in raw:
        omega = clean([raw["omega"]])[0]
        theta = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) * period])
    else:
        raise LogError(f"{where}neither theta nor omega (present: {', '.join(raw)})", next_command=NextCommand.IMPORT)
    return {"theta": theta, "omega": omega, "direction": np.sign(omega)}, derivative(omega, period, method)
