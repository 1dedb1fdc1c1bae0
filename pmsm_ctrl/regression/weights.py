"""The weight of each sample of a balance: aliased edges, uncertain reversals and steep currents count less."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import PREFILTER, Prepared
from pmsm_ctrl.regression.drive_timing import DriveTiming
from pmsm_ctrl.regression.edges import MAD, UPPER, WRONG_TORQUE, by_variance, edge_error, highest, steep
from pmsm_ctrl.regression.encoder_steps import StepErrors
from pmsm_ctrl.regression.filters import derivative, low_pass, low_pass_each
from pmsm_ctrl.regression.reversals import ROUNDED
from pmsm_ctrl.regression.timing import punctual

__all__ = [
    "Weighing",
    "at_given_rate",
    "error_by_steps",
    "on_grid",
    "prefilter",
    "quantisation_error",
    "reversal_weight",
    "scatter",
    "torque_noise",
    "uneven_weight",
    "voltage_weights",
]

Array = NDArray[np.float64]

STEADY = 0.02  # weight below which a sample's time cannot be believed
UNSURE = 0.1  # of a sample: the moment of a reversal is known no better
# Noise beyond this share of a step smooths the steps; differences below this share of a channel's range are rounding.
DITHER, ROUNDING = 0.4, 1e-6
# A quantised signal: most changes are of one step; a share of the stays on a level lasts a sample or two, or there are
# many levels, of which most are left within 20 ms. Fewer stays than these tell neither.
SINGLE_STEPS, FLICKER, FLICKERING, MANY_LEVELS, PASSING, FEWEST_STAYS = 0.5, 2, 0.1, 8, 0.02, 20
PART = 65536  # samples of the logged rate that are worked out at once
# How far a voltage balance can be trusted: shares of the inductive drop and of the voltage.
WRONG_INDUCTIVE, WRONG_VOLTAGE = 0.2, 0.001


@dataclass(frozen=True, eq=False)
class Weighing:
    """What the weights of the balances of a log follow from, beside the errors that need no care.

    Attributes
    ----------
    log : Log
        As it was conditioned; angle and drive signal are enough.
    raw : array, shape (n * times,)
        The drive signal at the rate at which it was logged, so many times that of the uniform grid.
    prepared : Prepared
    signals : dict of str to array, shape (n,)
    kink : (float, float)
        Level of the dry friction, N m (N), and the inertia.
    used : bool array, shape (m,)
        Samples that may take part.
    steps : StepErrors or None
    voltages : tuple of array, shape (m,)
        Weights of the voltage balances beside that of the torque.
    delayed : float
        Delay of the drive signal that is known, s: what is wrong about a reversal is in it so much later.
    kept : dict of float to array, shape (m,)
        Errors by edges that were worked out.
    """

    log: Log
    raw: Array
    prepared: Prepared
    signals: Mapping[str, Array]
    kink: tuple[float, float]
    used: NDArray[np.bool_]
    steps: StepErrors | None
    voltages: tuple[Array, ...]
    delayed: float = 0.0
    kept: dict[float, Array] = field(default_factory=dict, repr=False)

    def edges(self, least: float) -> Array:
        """Return the error of each thinned sample by edges, in units of its noise, shape (m,).

        Parameters
        ----------
        least : float
            Share of the torque's scatter up to which errors count as noise.
        """
        if least not in self.kept:
            self.kept[least] = edge_error(self.raw, self.prepared, self.log.records, least)
        return self.kept[least]

    def weights(self, least: float, share: float) -> tuple[Array, NDArray[np.bool_]]:
        """Return the weights, shape (channels, m), and the samples that take part, shape (m,).

        Parameters
        ----------
        least : float
            Share of the torque's scatter up to which errors need no care.
        share : float
            Error of the edges as a share of the one that a period of the log makes.
        """
        torque, used = _weight_of_torque(self, least, share)
        return np.array([torque, *(torque * one for one in self.voltages)]), used


def _weight_of_torque(known: Weighing, least: float, share: float) -> tuple[Array, NDArray[np.bool_]]:
    """Return the weight of each thinned sample of the torque balance, shape (m,), and which of those used remain.

    Edges of the drive signal, reversals and slow steps of the angle count less; a sample whose time stamp lies is left
    out.
    """
    log, prepared, used, steps = known.log, known.prepared, known.used, known.steps
    slow = by_variance(share * known.edges(least))
    if "theta" in log and not punctual(log, prepared.t, prepared.cutoff, jumps=False).all():
        # a speed that jumps from sample to sample is a lying time stamp or a lost count
        speed = np.gradient(np.unwrap(on_grid(log, prepared, "theta")))
        steady = steep(edge_error(speed, prepared, log.records))
        slow, used = slow * steady, used & (steady > STEADY)
    noise = torque_noise(log, prepared, known.signals, least)
    speed_error = None if steps is None else steps.speed
    weight = slow * reversal_weight(prepared, known.signals, known.kink, noise, speed_error, known.delayed)
    return (weight if steps is None else weight * uneven_weight(known.kink[1] * steps.filtered, noise, used)), used


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
    speed_error: Array | None = None, delayed: float = 0.0,
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
    later = np.minimum(turns + round(delayed * rate), len(omega) - 1)
    np.maximum.at(wrong, later, 2.0 * level * unsure * 2.0 * prepared.cutoff)
    wrong = highest(wrong, 2 * round(rate / prepared.cutoff) + 1)[prepared.keep]
    return 1.0 / (1.0 + (wrong / noise) ** 2)


def uneven_weight(error: Array, noise: float, used: NDArray[np.bool_]) -> Array:
    """Weight by an error whose size changes along the log, rms, shape (m,).

    The usual one, of the samples `used`, is in the noise.
    """
    usual = float(np.median(error[used])) ** 2 if used.any() else 0.0
    other = max(noise**2 - usual, 0.0)
    return np.asarray(np.sqrt(np.minimum(1.0, (other + usual) / np.maximum(other + error**2, 1e-300))))


def scatter(raw: Array, rate: float) -> float:
    """Return the robust rms of what a channel holds above a quarter of its rate.

    Parameters
    ----------
    raw : array, shape (n,)
    rate : float
        Hz.
    """
    return MAD * float(np.median(np.abs(raw - low_pass(raw, rate, UPPER * rate))))


def at_given_rate(whole: Log, log: Log, timing: DriveTiming, prepared: Prepared, name: str) -> Array:
    """Return a channel of the drive at the rate at which it was logged, a whole number of times that of the grid.

    Parameters
    ----------
    whole, log : Log
        Before and after it was thinned; `log` with its filter undone.
    timing : DriveTiming
        What of the sampling is undone.
    prepared : Prepared
    name : str
    """
    times = round(whole.rate / prepared.rate)
    if len(whole) == len(log) or times < 2:
        return on_grid(log, prepared, name)
    fast = timing.undone(replace(whole, channels={"t": whole.t, name: whole[name]}))
    out = np.empty(times * len(prepared.t))
    for start in range(0, len(out), PART):  # a fast log is long
        some = np.arange(start, min(start + PART, len(out)))
        out[some[0] : some[-1] + 1] = np.interp(prepared.t[0] + some / (times * prepared.rate), fast.t, fast[name])
    return out


def quantisation_error(raw: Array, rate: float) -> float:
    """Largest error of a channel that is logged in steps: half of one, and 0 where noise beyond 0.4 steps smooths it.

    The steps of a command are no error, since the drive makes them; see `_quantised`.
    Source: B. Widrow, I. Kollar, Quantization Noise, Cambridge 2008, ch. 4 and 19 (dither).
    """
    change = np.abs(np.diff(raw))
    if np.all(change > 0.0):  # in steps some neighbours are equal; sorting a long signal takes a third of a second
        return 0.0
    least = ROUNDING * float(np.ptp(raw))
    steps = np.diff(np.unique(raw))
    steps = steps[steps > least]
    if len(steps) == 0:
        return 0.0
    step = float(steps.min())
    if not _quantised(change, step, len(steps) + 1, rate):
        return 0.0
    return 0.5 * step if scatter(raw, rate) < DITHER * step else 0.0


def error_by_steps(raw: Array, rate: float, cutoff: float) -> float:
    """Return the error that the steps of a channel leave in a band: the largest, for the time in which it stays there.

    What passes from level to level faster than the filter forgets has errors of every size, and the filter takes them
    out. On a level on which it stays the error is the same for all of that time.

    Parameters
    ----------
    raw : array, shape (n,)
    rate, cutoff : float
        Of the log and of the band, Hz.
    """
    largest = quantisation_error(raw, rate)
    if largest == 0.0:
        return 0.0
    stays = np.diff(np.concatenate([[-1], np.flatnonzero(np.diff(raw)), [len(raw) - 1]]))
    return largest * float(np.sqrt(stays[stays > 0.5 * rate / cutoff].sum() / len(raw)))


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


def speed_asked(log: Log, prepared: Prepared) -> dict[str, Array]:
    """Return the speed reference of a log that has one, or one of the position, on the uniform grid."""
    if "omega_ref" in log:
        return {"omega_ref": on_grid(log, prepared, "omega_ref")}
    if "theta_ref" in log:
        return {"omega_ref": derivative(on_grid(log, prepared, "theta_ref"), 1.0 / prepared.rate)}
    return {}


def voltage_weights(
    design: Design, prepared: Prepared, signals: Mapping[str, Array], u: Array, log: Log, names: Sequence[str]
) -> list[Array]:
    """Weights of the voltage balances: their model is off by shares of the inductive drop and of the voltage itself."""
    raw = [on_grid(log, prepared, name) for name in names]
    if not raw:
        return []
    rate = prepared.rate
    L = max(design.motor.L_d or 0.0, design.motor.L_q or 0.0)
    slope = low_pass(np.hypot(signals["di_d"], signals["di_q"]), rate, prepared.cutoff)
    steep = highest(slope, 2 * round(0.5 * rate / prepared.cutoff) + 1)
    wrong = np.hypot(WRONG_INDUCTIVE * L * steep[prepared.keep], WRONG_VOLTAGE * np.abs(u))
    band = np.sqrt(2.0 * prepared.cutoff / rate)
    smooth = low_pass_each(raw, rate, UPPER * rate)
    noises = (float(np.std(whole - slow)) * band + 1e-12 for whole, slow in zip(raw, smooth, strict=True))
    return [np.asarray(1.0 / (1.0 + (wrong / noise) ** 2)) for noise in noises]


def prefilter(prepared: Prepared) -> float:
    """Cutoff of the low-pass before differentiation, Hz."""
    return PREFILTER * prepared.cutoff
