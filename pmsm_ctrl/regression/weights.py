"""The weight of each sample of a balance: aliased edges, uncertain reversals and steep currents count less."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log, Span
from pmsm_ctrl.regression.conditioning import PREFILTER, Prepared
from pmsm_ctrl.regression.encoder_steps import StepErrors
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.timing import punctual

__all__ = [
    "EDGE_PERIODS",
    "WRONG_TORQUE",
    "Weighing",
    "edge_weight",
    "on_grid",
    "prefilter",
    "quantisation_error",
    "reversal_weight",
    "scatter",
    "torque_noise",
    "uneven_weight",
    "voltage_weight",
    "weight_of_torque",
]

Array = NDArray[np.float64]

STEADY = 0.02  # weight below which a sample's time cannot be believed
MAD = 1.4826  # standard deviation of normal noise over the median of its magnitude
# A channel's own noise is what it holds above this share of its rate: no motion reaches there.
UPPER = 0.25
UNSURE = 0.1  # of a sample: the moment of a reversal is known no better
# Noise beyond this share of a step smooths the steps; differences below this share of a channel's range are rounding.
DITHER, ROUNDING = 0.4, 1e-6
# A quantised signal: most changes are of one step; a share of the stays on a level lasts a sample or two, or there are
# many levels, of which most are left within 20 ms. Fewer stays than these tell neither.
SINGLE_STEPS, FLICKER, FLICKERING, MANY_LEVELS, PASSING, FEWEST_STAYS = 0.5, 2, 0.1, 8, 0.02, 20
# Height of the highest of a few hundred samples of noise, in its standard deviation.
NOISE_PEAK = 4.5
EDGE_PERIODS = 3.0
# What the steep filter still rings of an edge so many periods of its cutoff further away: 8th order, run twice.
RINGING = ((1.0, 0.035), (3.0, 0.023), (5.0, 0.009), (9.0, 0.004), (13.0, 0.0007))
# Share of the rounded kink that stays as an error of the moment of reversal.
ROUNDED = 0.15
# Share of the torque's scatter below which its errors need no care, as long as nobody knows how well a model fits.
WRONG_TORQUE = 0.02
# How far a voltage balance can be trusted: shares of the inductive drop and of the voltage.
WRONG_INDUCTIVE, WRONG_VOLTAGE = 0.2, 0.001


@dataclass(frozen=True, eq=False)
class Weighing:
    """What the weights of the balances of a log follow from, beside the errors that need no care.

    Attributes
    ----------
    log : Log
        As it was conditioned; angle and drive signal are enough.
    prepared : Prepared
    signals : dict of str to array, shape (n,)
    kink : (float, float)
        Level of the dry friction, N m (N), and the inertia.
    used : bool array, shape (m,)
        Samples that may take part.
    steps : StepErrors or None
    voltages : tuple of array, shape (m,)
        Weights of the voltage balances beside that of the torque.
    """

    log: Log
    prepared: Prepared
    signals: Mapping[str, Array]
    kink: tuple[float, float]
    used: NDArray[np.bool_]
    steps: StepErrors | None
    voltages: tuple[Array, ...]

    def weights(self, least: float) -> tuple[Array, NDArray[np.bool_]]:
        """Return the weights, shape (channels, m), and the samples that take part, shape (m,).

        Parameters
        ----------
        least : float
            Share of the torque's scatter up to which errors need no care.
        """
        torque, used = weight_of_torque(self.log, self.prepared, self.signals, self.kink, self.used, self.steps, least)
        return np.array([torque, *(torque * one for one in self.voltages)]), used


def weight_of_torque(
    log: Log, prepared: Prepared, signals: Mapping[str, Array], kink: tuple[float, float], used: NDArray[np.bool_],
    steps: StepErrors | None, least: float,
) -> tuple[Array, NDArray[np.bool_]]:  # fmt: skip
    """Return the weight of each thinned sample of the torque balance, shape (m,), and which of those `used` remain.

    Edges of the drive signal, reversals and slow steps of the angle count less; a sample whose time stamp lies is left
    out. `kink` holds the level of the dry friction and the inertia; errors up to the share `least` need no care.
    """
    source = "torque" if "torque" in log else "i_q"
    slow = edge_weight(on_grid(log, prepared, source), prepared, EDGE_PERIODS, log.records, least)
    if "theta" in log and not punctual(log, prepared.t, prepared.cutoff, jumps=False).all():
        # a speed that jumps from sample to sample is a lying time stamp or a lost count
        speed = np.gradient(np.unwrap(on_grid(log, prepared, "theta")))
        steady = edge_weight(speed, prepared, EDGE_PERIODS, log.records)
        slow, used = slow * steady, used & (steady > STEADY)
    noise = torque_noise(log, prepared, signals, least)
    weight = slow * reversal_weight(prepared, signals, kink, noise, None if steps is None else steps.speed)
    return (weight if steps is None else weight * uneven_weight(kink[1] * steps.filtered, noise, used)), used


def torque_noise(log: Log, prepared: Prepared, signals: Mapping[str, Array], least: float = WRONG_TORQUE) -> float:
    """Noise of the filtered torque, rms, N m (N): what the drive signal holds beyond any motion, in the band.

    Errors up to the share `least` of the torque's scatter need no care and count as noise.
    """
    rate = prepared.rate
    source = "torque" if "torque" in log else "i_q"
    scale = float(np.std(signals["torque_meas"]) / max(float(np.std(signals["i_q_meas"])), 1e-300))
    noise = scatter(on_grid(log, prepared, source), rate) * (1.0 if source == "torque" else scale)
    noise *= np.sqrt(4.0 * prepared.cutoff / rate)
    return max(float(np.hypot(noise, least * np.std(signals["torque_meas"]))), 1e-300)


def reversal_weight(
    prepared: Prepared, signals: Mapping[str, Array], kink: tuple[float, float], noise: float,
    speed_error: Array | None = None,
) -> Array:  # fmt: skip
    """Weight around reversals by the uncertainty of the moment at which the friction changes its sign.

    Friction changes by twice its level F, the acceleration by 2 F / J, and the low-pass before differentiation rounds
    off that kink. To this error of the moment a tenth of a sample is added, and the error of the speed, shape (n,),
    over the acceleration. During this time the torque is wrong by 2 F.
    """
    level, J = kink
    rate, omega = prepared.rate, signals["omega"]
    if level <= 0.0 or J <= 0.0:
        return np.ones(len(prepared.keep))
    wide = prefilter(prepared)
    rounded = ROUNDED * 2.0 * level / J / (2.0 * np.pi * wide)
    turns = np.flatnonzero(np.diff(np.sign(omega)) != 0)
    slope = np.abs(low_pass(prepared.alpha, rate, prepared.cutoff))[turns]
    error = rounded if speed_error is None else np.hypot(rounded, speed_error[turns])
    unsure = UNSURE / rate + np.minimum(error / np.maximum(slope, 1e-12), 1.0 / prepared.cutoff)
    wrong = np.zeros(len(omega))
    np.maximum.at(wrong, turns, 2.0 * level * unsure * 2.0 * prepared.cutoff)
    wrong = _highest(wrong, 2 * round(rate / prepared.cutoff) + 1)[prepared.keep]
    return 1.0 / (1.0 + (wrong / noise) ** 2)


def uneven_weight(error: Array, noise: float, used: NDArray[np.bool_]) -> Array:
    """Weight by an error whose size changes along the log, rms, shape (m,).

    The usual one, of the samples `used`, is in the noise.
    """
    usual = float(np.median(error[used])) ** 2 if used.any() else 0.0
    other = max(noise**2 - usual, 0.0)
    return np.asarray(np.sqrt(np.minimum(1.0, (other + usual) / np.maximum(other + error**2, 1e-300))))


def edge_weight(
    raw: Array, prepared: Prepared, periods: float, records: Sequence[Span] = (), least: float = WRONG_TORQUE
) -> Array:
    """Weight of each thinned sample from the drive signal's content above a quarter of the rate.

    An edge that is faster than the sampling is logged up to one period too early or too late, always the same way
    where the drive and the log share a clock. Its error in the filtered balance, against the noise there, is about
    the height of the edge over the noise times the root of what the filter lets through; weights fall
    steeply with that, for so many periods of the filter's cutoff on either side as it rings. What is below the share
    `least` of the signal's scatter counts as noise. Each of several records has a noise of its own.
    """
    rate = prepared.rate
    # the filters mirror a log in its last value: an edge there is a step of twice its height
    beyond = min(len(raw) - 1, round((periods + RINGING[-1][0]) * rate / prepared.cutoff))
    inside = slice(beyond, beyond + len(raw))
    whole = np.pad(raw, beyond, mode="reflect", reflect_type="odd")
    fast = np.abs(whole - low_pass(whole, rate, UPPER * rate))
    pieces = [slice(*np.searchsorted(prepared.t, [one.start, one.stop])) for one in records] or [slice(None)]
    level = np.zeros(len(raw))
    for piece in pieces:
        level[piece] = np.hypot(MAD * np.median(fast[inside][piece]), least * np.std(raw[piece]))
    level[level == 0.0] = float(np.min(level[level > 0.0], initial=np.inf))
    if not np.isfinite(level).all():
        return np.ones(len(prepared.keep))
    noise = level[prepared.keep]

    def highest(periods: float) -> Array:
        return _highest(fast, 2 * round(periods * rate / prepared.cutoff) + 1)[inside][prepared.keep] / noise

    peaks = highest(periods)
    # where every stretch has such peaks they are the drive's ripple, not single edges
    usual = np.full(len(peaks), NOISE_PEAK)
    for piece in pieces:
        here = slice(*np.searchsorted(prepared.keep, [piece.start or 0, piece.stop or len(raw)]))
        usual[here] = max(NOISE_PEAK, float(np.median(peaks[here])) if here.stop > here.start else 0.0)
    edge = np.maximum(peaks - usual, 0.0)
    for further, left in RINGING:
        edge = np.maximum(edge, left * (highest(periods + further) - usual))
    passed = np.sqrt(2.0 * prepared.cutoff / rate)
    return np.asarray(1.0 / (1.0 + (passed * edge) ** 2) ** 2)


def scatter(raw: Array, rate: float) -> float:
    """Return the robust rms of what a channel holds above a quarter of its rate.

    Parameters
    ----------
    raw : array, shape (n,)
    rate : float
        Hz.
    """
    return MAD * float(np.median(np.abs(raw - low_pass(raw, rate, UPPER * rate))))


def quantisation_error(raw: Array, rate: float) -> float:
    """Largest error of a channel that is logged in steps: half of one, and 0 where noise beyond 0.4 steps smooths it.

    The steps of a command are no error, since the drive makes them; see `_quantised`.
    Source: B. Widrow, I. Kollar, Quantization Noise, Cambridge 2008, ch. 4 and 19 (dither).
    """
    least = ROUNDING * float(np.ptp(raw))
    steps = np.diff(np.unique(raw))
    steps = steps[steps > least]
    if len(steps) == 0:
        return 0.0
    step = float(steps.min())
    if not _quantised(np.abs(np.diff(raw)), step, len(steps) + 1, rate):
        return 0.0
    return 0.5 * step if scatter(raw, rate) < DITHER * step else 0.0


def _quantised(change: Array, step: float, levels: int, rate: float) -> bool:
    """Whether levels are those of a quantised signal, not of a command; `change` is that from sample to sample.

    A command leaves a level at once for any other and stays there. A signal passes from level to level by single
    steps, at times of its own: noise plays about a threshold from one sample to the next, and what moves through many
    levels stays briefly on each.
    """
    turns = np.flatnonzero(change > 0.5 * step)
    stays = np.diff(turns)
    if len(stays) < FEWEST_STAYS or np.mean(change[turns] < 1.5 * step) < SINGLE_STEPS:
        return False
    passing = levels >= MANY_LEVELS and float(np.median(stays)) <= PASSING * rate
    return passing or bool(np.mean(stays <= FLICKER) >= FLICKERING)


def on_grid(log: Log, prepared: Prepared, name: str) -> Array:
    """A channel as logged, on the uniform grid."""
    same = len(log) == len(prepared.t)
    return np.array(log[name] if same else np.interp(prepared.t, log.t, log[name]))


def _highest(values: Array, reach: int) -> Array:
    from scipy.ndimage import maximum_filter1d

    return maximum_filter1d(values, reach)


def voltage_weight(design: Design, prepared: Prepared, signals: Mapping[str, Array], u: Array, raw: Array) -> Array:
    """Weight of a voltage balance: its model is off by shares of the inductive drop and of the voltage itself."""
    rate = prepared.rate
    noise = float(np.std(raw - low_pass(raw, rate, UPPER * rate))) * np.sqrt(2.0 * prepared.cutoff / rate) + 1e-12
    L = max(design.motor.L_d or 0.0, design.motor.L_q or 0.0)
    slope = np.hypot(signals["di_d"], signals["di_q"])
    steep = _highest(low_pass(slope, rate, prepared.cutoff), 2 * round(0.5 * rate / prepared.cutoff) + 1)
    wrong = np.hypot(WRONG_INDUCTIVE * L * steep[prepared.keep], WRONG_VOLTAGE * np.abs(u))
    return np.asarray(1.0 / (1.0 + (wrong / noise) ** 2))


def prefilter(prepared: Prepared) -> float:
    """Cutoff of the low-pass before differentiation, Hz."""
    return PREFILTER * prepared.cutoff
