"""What a log shows of an excitation that is held between its samples, as a binary sequence is.

The log then holds the whole excitation, but the steps of the current fold onto the frequencies below half its rate,
coherently, and a held value acts half a period later than a smooth one. What the speed controller answers is smooth.
Where the two nearly cancel, below the crossover of a closed loop, this is a large part of the torque. It follows from
the excitation and the design's loops, and is taken off the samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.frf import policy
from pmsm_ctrl.frf.recorder import free_cascade, stated
from pmsm_ctrl.tune.sampled import Cascade, responses

__all__ = ["Steps", "beyond", "steps_of"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

OFFSET = 3  # lines that the mean reaches through the window
SETTLED = 12  # time constants until a filter's answer is below 1e-5
UNEXPLAINED = 0.5  # share of the current's power that may be left: what leaves more explains nothing
CHANGES, FEWEST_CHANGES = 2000, 20  # of a sequence, the largest, by which its clock is found
LONGEST = 100  # samples for which a value is held
ON_GRID = 0.98  # share of the changes' power on the grid of a clock
BAND = 100  # lines, in which what is left is compared with the excitation
# Share of it that may follow the excitation: chance makes 2 %, values between the samples make 13 % and more.
FOLLOWS = 0.05
BLOCKED = 1e-6  # power of a filter's answer below which what it was before is not asked for
SAMPLED = ("i_q", "theta", "i_q_ref", "omega_hat")
COARSE = 1000  # frequencies at which the loops are evaluated: they are smooth


def beyond(values: Array) -> float:
    """Return the share of a channel's power above `policy.HIGHEST` of its rate; its mean does not count.

    Parameters
    ----------
    values : array, shape (n,)
        Of an even rate.
    """
    power = np.abs(_spectrum(values)) ** 2
    first = math.ceil(policy.HIGHEST * len(values))
    return float(power[first:].sum() / max(power[OFFSET:].sum(), np.finfo(float).tiny))


@dataclass(frozen=True, eq=False)
class Steps:
    """What the samples show of a held excitation beyond what they show of a smooth one.

    Attributes
    ----------
    torque : array, shape (n,)
        In the current beside the measured angle: what moves the axis is the current less this, A.
    current : array, shape (n,)
        In the current beside its reference, A.
    speed : array, shape (n,)
        In the measured speed beside the reference, rad/s; zeros of an excitation of the current.
    explained : bool
        Whether nothing of the excitation is left in the current.
    """

    torque: Array
    current: Array
    speed: Array
    explained: bool


def steps_of(
    design: Design, channels: Mapping[str, Array], source: str, sent: Array, period: float, *, J: float, speed: float,
    mass: SecondMass | None = None,
) -> Steps | None:  # fmt: skip
    """Return what the samples show of an excitation that is held between them beyond what they show of a smooth one.

    None where the measured current agrees better with an excitation that is smooth between the samples, or where the
    design does not tell what a sample shows of either.

    Parameters
    ----------
    design : Design
        Its loops, and how its log is taken.
    channels : mapping of str to array, shape (n,)
        With ``i_q`` and ``i_q_ref``.
    source : {"i_q_add", "omega_ref", "i_q_ref"}
        Where it enters; the last one without a speed loop.
    sent : array, shape (n,)
        The excitation, A or rad/s.
    period : float
        Of the samples, s.
    J : float
        kg m^2: how much the controller answers between the samples.
    speed : float
        rad/s.
    mass : SecondMass, optional
        A load behind a spring; part of `J`.
    """
    assert design.loops is not None or not stated(design, [period])
    ticks, left = divmod(design.sensor.log_divider, design.drive.speed_divider)
    cascade = free_cascade(design, J, speed, mass) if stated(design, [period]) and ticks > 1 and not left else None
    if cascade is None:
        return None
    if source != "omega_ref":
        sent = _settled(design, sent, channels.get("omega_ref"), period)
    n = len(sent)
    alone = _Ticks.of(cascade, "i_q_ref", n, ticks)
    smooth, moved = (alone.below(k) for k in range(2))
    loop = cascade if source == "i_q_ref" else _closed(design, cascade, "theta_ref" in channels)
    seen = _Ticks.of(loop, source, n, ticks)
    current, reference = (_spectrum(channels[name]) for name in ("i_q", "i_q_ref"))
    rest = current - smooth * reference
    inside = slice(OFFSET, math.floor(policy.HIGHEST * n))

    def size(spectrum: Complex) -> float:
        return float(_power(spectrum[inside]))

    found, least = None, min(size(rest), UNEXPLAINED * size(current))
    for held in _before_filters(design, sent, ticks) if source == "i_q_add" else _candidates(sent, ticks):
        i_q, theta, i_q_ref, omega = seen.sampled(held)
        beside = _over_time(i_q - smooth * i_q_ref, n)
        left_over = rest - _spectrum(beside)
        if size(left_over) < least:
            found, least = (i_q - theta * smooth / moved, beside, omega, left_over), size(left_over)
    if found is None:
        return None
    beyond_moved, beside, omega, left_over = found
    follows = np.zeros(n) if source != "omega_ref" else _over_time(omega - seen.below(3) * np.fft.rfft(sent), n)
    share = _coherent(left_over[inside], _spectrum(sent)[inside])
    explained = share < FOLLOWS or share * least < policy.BEYOND * size(current)
    return Steps(_over_time(beyond_moved, n), beside, follows, explained)


def _over_time(spectrum: Complex, n: int) -> Array:
    return np.asarray(np.fft.irfft(np.where(np.arange(len(spectrum)) > 0, spectrum, 0.0), n))


@dataclass(frozen=True, eq=False)
class _Ticks:
    """What the loops make of a source in every tick of the speed loop: `SAMPLED` per unit.

    Attributes
    ----------
    response : complex array, shape (4, m)
        At the frequencies of a record of `count` samples with `ticks` each.
    """

    response: Complex
    count: int
    ticks: int

    @classmethod
    def of(cls, cascade: Cascade, source: str, count: int, ticks: int) -> _Ticks:
        omega = 2.0 * math.pi * np.fft.rfftfreq(count * ticks, cascade.period)
        coarse = np.linspace(omega[1], omega[-1], min(COARSE * ticks, len(omega)))
        at = responses(cascade.system((source,), SAMPLED), coarse)
        found = [np.interp(omega, coarse, one.real) + 1j * np.interp(omega, coarse, one.imag) for one in at]
        return cls(np.array(found), count, ticks)

    def below(self, number: int) -> Complex:
        """Return one of `SAMPLED` below half the log's rate, for what is smooth between its samples."""
        return self.response[number, : self.count // 2 + 1]

    def sampled(self, steps: Array) -> Complex:
        """Return the spectra of the samples for a source that is known in every tick, shape (4, count // 2 + 1)."""
        over = self.response * np.fft.rfft(steps)
        over[:, 0] = 0.0
        if len(steps) % 2 == 0:
            over[:, -1] = over[:, -1].real  # of a real signal
        # a sample in every so many ticks adds up what lies a whole number of its rates apart
        every, n = len(steps), self.count
        place = np.arange(n // 2 + 1) + n * np.arange(self.ticks)[:, None]
        mirrored = place > every // 2
        folded = over[:, np.where(mirrored, every - place, place)]
        return np.asarray(np.where(mirrored, folded.conj(), folded).sum(axis=1) / self.ticks)


def _candidates(sent: Array, ticks: int) -> Iterator[Array]:
    """Yield what an excitation may have been in every tick, shape (n * ticks,).

    Each of its values is held for a period of the log, from any tick on, or for another whole number of ticks that its
    samples do not contradict.
    """
    held = np.repeat(sent, ticks)
    for late in range(ticks):  # a sample may be taken at any tick while the value is held
        yield np.roll(held, -late)
    length, grid = _clock(sent, ticks)
    for first in grid:
        chip = (np.arange(len(held)) - first) // length
        chip -= chip[0]
        of_samples = chip[::ticks]
        count = np.bincount(of_samples, minlength=chip[-1] + 1)
        values = np.bincount(of_samples, sent, minlength=chip[-1] + 1) / np.maximum(count, 1)
        yield values[chip]


def _clock(sent: Array, ticks: int) -> tuple[int, NDArray[np.intp]]:
    """Return for how many ticks the values of a sequence are held, and the ticks in which the first may begin.

    It is the longest that leaves all changes between two samples on its grid. None begins where that is a whole number
    of samples, or where there is no grid.
    """
    none = 1, np.empty(0, dtype=np.intp)
    change = np.diff(sent) ** 2
    strongest = np.argsort(change)[::-1][:CHANGES]
    strongest = strongest[change[strongest] > 0.0]
    if len(strongest) < FEWEST_CHANGES:
        return none
    weight = change[strongest]
    after = strongest[:, None] * ticks + np.arange(1, ticks + 1)  # ticks in which it may have changed
    for length in range(LONGEST * ticks, ticks, -1):
        at = np.bincount((after % length).ravel(), np.repeat(weight, ticks), minlength=length)
        if at.max() >= ON_GRID * weight.sum():
            # samples and values that share a divisor leave several beginnings open
            return (length, np.flatnonzero(at >= ON_GRID * weight.sum())) if length % ticks else none
    return none


def _coherent(rest: Complex, content: Complex) -> float:
    """Return the share of what is left that follows the excitation, in bands of `BAND` lines."""
    bands = max(1, len(rest) // BAND)
    x, y = (one[: bands * BAND].reshape(bands, -1) for one in (content, rest))
    common = np.abs(np.sum(y * x.conj(), axis=1)) ** 2
    return float(np.mean(common / np.maximum(_power(x) * _power(y), np.finfo(float).tiny)))


def _power(lines: Complex) -> Array:
    return np.asarray(np.sum(np.abs(lines) ** 2, axis=-1))


def _before_filters(design: Design, sent: Array, ticks: int) -> Iterator[Array]:
    """Yield what an excitation may have been in every tick in front of the filters of the current reference.

    Behind them it is not held; what it was follows from its samples and from the filters' answer to a held value.
    """
    assert design.loops is not None
    behind = design.loops.speed.filters
    if not behind:
        yield from _candidates(sent, ticks)
        return
    n, T_s = len(sent), design.drive.speed_period
    z = np.exp(2j * math.pi * np.fft.rfftfreq(n * ticks))
    passed = np.prod([one.biquad.sampled_at(z, T_s) for one in behind], axis=0)
    for late in range(ticks):
        value = np.zeros(n * ticks)
        value[np.arange(-late, ticks - late)] = 1.0
        answer = np.fft.rfft(np.fft.irfft(passed * np.fft.rfft(value), n * ticks)[::ticks])
        before = np.fft.rfft(sent) * answer.conj() / (np.abs(answer) ** 2 + BLOCKED)
        yield np.roll(np.repeat(np.fft.irfft(before, n), ticks), -late)


def _closed(design: Design, cascade: Cascade, in_position: bool) -> Cascade:
    assert design.loops is not None
    position = design.loops.position if in_position and design.loops.position.K_v > 0.0 else None
    return cascade.with_gains(speed=design.loops.speed, position=position)


def _settled(design: Design, added: Array, reference: Array | None, period: float) -> Array:
    """Return an excitation constant where a speed reference moves, and its filter settles: its answer is no excitation.

    A reference that moves most of the time is the excitation itself.
    """
    from scipy.ndimage import binary_dilation

    assert design.loops is not None
    if reference is None:
        return added
    moves = np.diff(reference) != 0.0
    behind = math.ceil(SETTLED * design.loops.speed.reference_filter / period) if moves.any() else 0
    moves = binary_dilation(moves, np.arange(-behind, behind + 1) >= 0) if behind else moves
    if np.mean(moves) > 0.5:
        return added
    return np.concatenate([added[:1], added[0] + np.cumsum(np.where(moves, 0.0, np.diff(added)))])


def _spectrum(values: Array) -> Complex:
    """Return the spectrum through a window, without the mean: a step from the end to the start is no content."""
    return np.asarray(np.fft.rfft((values - values.mean()) * np.hanning(len(values))))
