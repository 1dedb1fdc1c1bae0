"""From logs to frequency responses: stretches of steady motion, spectra, and the instrument.

Noise of the measured torque makes a response that is taken directly too small. A reference has none of it: the response
is that of the speed to the reference over that of the torque to the reference, and the noise drops out. A current
reference inside a closed speed loop contains noise that the controller answers; what is left without that answer
(`excitation`) has none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.errors import NotExcitedError
from pmsm_ctrl.evidence.local_polynomial import REACH, Local, local_polynomial, strongest_lines
from pmsm_ctrl.frf import notices as words
from pmsm_ctrl.frf import policy
from pmsm_ctrl.frf.fit import Axis, fit_axis
from pmsm_ctrl.frf.held import beyond
from pmsm_ctrl.frf.recorder import recorded
from pmsm_ctrl.frf.result import Response
from pmsm_ctrl.frf.stretches import ADDED, Stretch, mean_speed, without_steps
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import drives

__all__ = ["LOOPS", "closed_loop", "counted", "guessed_inertia", "lines_of", "measured_axis", "plant"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

LOOPS = {"current": ("i_q_ref", "i_q"), "speed": ("omega_ref", "omega"), "position": ("theta_ref", "theta")}
PASSES = 3  # at most, in which the steps of an excitation are taken off
DELAYS = 81  # that are tried: at 0.4 of the log's rate they are 4 deg apart
NEIGHBOURS = 7  # windows over which the noise is averaged: it is smooth, and its estimate in one window is not
# The outermost reference that follows the excitation is the instrument; the inner one contains noise that the outer
# controllers answer. ADDED is the current reference without that answer.
REFERENCES = ("theta_ref", "omega_ref", ADDED, "i_q_ref")


def measured_axis(design: Design, records: tuple[Stretch, ...]) -> tuple[Response, Axis, tuple[Notice, ...]]:
    """Return the response from drive torque to speed, from all records, the axis fitted to it, and what is in doubt.

    What the recorder of the design's drive makes of the current is taken off: that of a rigid axis first, and where
    a spring is found that of two masses.

    Raises
    ------
    NotExcitedError
        When no frequency is excited.
    """
    stepped = [without_steps(design, one, 1.0 if design.motor.J is None else design.J) for one in records]
    response, axis, found = _fitted(design, stepped)
    for _ in range(
        PASSES if any(one.held for one in stepped) else 0
    ):  # what the controller answers between the samples is the axis'
        before = axis
        stepped = [without_steps(design, one, axis.J, axis.mass) for one in records]
        response, axis, found = _fitted(design, stepped)
        if axis.near(before):
            break
    return response, axis, found


def _fitted(design: Design, records: Sequence[Stretch]) -> tuple[Response, Axis, tuple[Notice, ...]]:
    taken, found = plant(records, drives(design.motion))
    J = guessed_inertia(taken) if design.motor.J is None else design.J
    periods = [one.period for one in records]

    def fitted(J: float, mass: SecondMass | None) -> tuple[Response, Axis]:
        seen = recorded(design, taken.frequency, periods, J, mean_speed(records), mass)
        response = replace(taken, value=taken.value / seen, stderr=taken.stderr / np.abs(seen))
        return response, fit_axis(response, J, max(periods))

    response, axis = fitted(J, None)
    if axis.mass is not None:
        response, axis = fitted(axis.J, axis.mass)
    return response, axis, found


def plant(records: Sequence[Stretch], quantity: str = "torque") -> tuple[Response, tuple[Notice, ...]]:
    """Return the response from drive torque to speed as it is recorded, and what there is to doubt.

    Raises
    ------
    NotExcitedError
        When no frequency is excited.
    """
    output = "theta" if all("theta" in one.channels for one in records) else "omega"
    instrument = next((name for name in REFERENCES if _follows(records, name)), "")
    points = [_points(one, instrument or "torque", output, "torque") for one in records]
    response, noisy = _passive(_merged("plant", points, instrument), max(one.period for one in records))
    folded = _folded(records, instrument)
    if len(response) < policy.FEWEST_SEEN:
        raise NotExcitedError(_not_seen(len(response), folded))
    found: list[Notice] = []
    if any(one.reverses for one in records):
        found.append(words.REVERSES())
    if not instrument:
        weakest = float(np.quantile(1.0 - response.coherence, 0.9))
        found.append(words.NO_REFERENCE(quantity=quantity, bias=weakest))
    if folded is not None:
        found.append(folded)
    if noisy is not None:
        found.append(words.NOISE_ANSWERED(frequency=noisy))
    return replace(response, held=any(bool(one.held) for one in records) and folded is None), tuple(found)


def _folded(records: Sequence[Stretch], instrument: str) -> Notice | None:
    """Return the doubt that an excitation reaches beyond the log's rate: the instrument, or a reference outside of it.

    Steps that were taken off do not count, nor what every tick of the controller that reads it is logged of.
    """
    for record in records:
        inner = instrument or (ADDED if ADDED in record.channels else REFERENCES[-1])
        for name in REFERENCES[: REFERENCES.index(inner) + 1]:
            if name not in record.channels or name in (record.held if record.explained else "", *record.whole):
                continue
            share = beyond(_content(record, name)) if np.ptp(record.channels[name]) > 0.0 else 0.0
            if share > policy.BEYOND:
                return words.FOLDED(
                    channel=name, percent=100.0 * share, rate=record.rate, highest=policy.HIGHEST * record.rate
                )
    return None


def counted(frequencies: int) -> str:
    """Return a number of frequencies with its noun."""
    return "1 frequency" if frequencies == 1 else f"{frequencies} frequencies"


def _not_seen(count: int, folded: Notice | None) -> str:
    """Return why a response cannot be fitted."""
    if folded is not None:
        return f"the speed follows the torque at {counted(count)} only: {folded}"
    if count:
        return (
            f"the response at {counted(count)} does not determine the inertia; excite more strongly, or over a "
            "wider range, and log the reference that is excited"
        )
    return (
        "no frequency is excited: the speed follows the torque nowhere above the noise; add a multisine, a chirp "
        "or noise to the current or the speed reference"
    )


def _content(record: Stretch, name: str) -> Array:
    """Return a reference, of an angle its rate."""
    values = record.channels[name]
    return np.diff(values) if name == "theta_ref" else values


def guessed_inertia(response: Response) -> float:
    """Return the inertia that the response has without friction and resonance, to begin a fit with."""
    return float(np.median(1.0 / (2.0 * math.pi * response.frequency * np.abs(response.value))))


def closed_loop(name: str, records: tuple[Stretch, ...]) -> Response | None:
    """Return the response of a closed loop, from its reference to what it controls; None where it is not excited."""
    reference, output = LOOPS[name]
    having = [one for one in records if {reference, output} <= one.channels.keys()]
    points = [_points(one, reference, output) for one in having if np.ptp(one.channels[reference]) > 0.0]
    response = _merged(name, points, reference) if points else None
    return response if response is not None and len(response) > 2 * REACH else None


def lines_of(record: Stretch, spectrum: Complex) -> NDArray[np.intp]:
    """Return the lines at which responses are evaluated: none is the skirt of a stronger one beside it."""
    last = int(policy.HIGHEST * 2 * (len(spectrum) - 1))
    lines = strongest_lines(spectrum, 1, min(last, len(spectrum) - 1))
    size = np.abs(spectrum[lines])
    near = np.diff(lines) <= REACH
    weaker = np.zeros(len(lines), dtype=bool)
    weaker[:-1] |= near & (size[:-1] < size[1:])
    weaker[1:] |= near & (size[1:] <= size[:-1])
    return lines[~weaker]


def _follows(records: Sequence[Stretch], name: str) -> bool:
    """Whether a reference has content where the torque has, in every record.

    The current reference without the answer to noise holds all that moves the axis but noise. It need not be compared
    with the torque, in which the answer to a coarse encoder can be larger than the excitation.
    """
    for one in records:
        if name not in one.channels or np.ptp(one.channels[name]) == 0.0:
            return False
        if name == ADDED:
            continue
        sent, torque = one.spectrum(name), one.spectrum("torque")
        lines = lines_of(one, torque)
        seen = local_polynomial(sent, torque[:, None], lines)
        strong = _strong(np.abs(torque[lines]) ** 2)
        clear = np.abs(seen.response[:, 0]) > policy.SEEN * np.sqrt(seen.covariance[:, 0, 0].real)
        if np.mean(clear[strong]) < policy.INSTRUMENT:
            return False
    return True


def _strong(power: Array) -> NDArray[np.bool_]:
    """Return the lines that hold nine tenths of the power."""
    order = np.argsort(power)[::-1]
    held = np.cumsum(power[order]) <= 0.9 * power.sum()
    strong = np.zeros(len(power), dtype=bool)
    strong[order[: int(held.sum()) + 1]] = True
    return strong


@dataclass(frozen=True, eq=False)
class _Points:
    frequency: Array
    value: Complex
    variance: Array
    coherence: Array
    width: float


def _points(record: Stretch, source: str, output: str, through: str = "") -> _Points:
    """Return the response of a channel to a source, or to a channel that the source drives as well."""
    sent = record.spectrum(source)
    outputs = [record.spectrum(output)]
    direct = not through or through == source
    if not direct:
        outputs.append(record.spectrum(through))
    local = local_polynomial(sent, np.stack(outputs, axis=1), lines_of(record, sent))
    width = record.rate / record.count
    value, variance, noise = _direct(local) if direct else _ratio(local)
    seen = _seen(value, variance, noise, local.sine)
    value, variance, noise = value[seen], variance[seen], noise[seen]
    level = _level(local, seen, value, noise)
    explained = np.abs(local.response[seen, 0]) ** 2 * local.power[seen]
    return _Points(
        local.place[seen] * width, value, variance * level / noise, explained / (explained + level),
        (2 * REACH + 1) * width,
    )  # fmt: skip


def _level(local: Local, seen: NDArray[np.bool_], value: Complex, noise: Array) -> Array:
    """Return the noise at the lines that are seen, averaged over neighbouring windows.

    Referred to the input it is smooth, also where the response bends. A sine's neighbours that are seen are other
    sines, far away: around it the noise is that of the windows between them.
    """
    from scipy.ndimage import uniform_filter1d

    smooth = _smooth(noise / np.abs(value) ** 2, local.freedom[seen]) * np.abs(value) ** 2
    width = min(NEIGHBOURS, len(local.noise))
    parts = (uniform_filter1d(part, width, axis=0, mode="nearest") for part in (local.noise.real, local.noise.imag))
    real, imaginary = (part[seen] for part in parts)
    return np.where(local.sine[seen], _beside(value, real + 1j * imaginary), smooth)


def _seen(value: Complex, variance: Array, noise: Array, sine: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the lines whose response is above the noise.

    A line is not judged by its own response, since those that noise makes large would be kept. The content of its
    window, and what such content showed in the neighbouring windows, say what it should show. Beside a sine there is
    no content.
    """
    from scipy.ndimage import uniform_filter1d

    found = np.flatnonzero(np.isfinite(value) & (variance > 0.0))
    content = noise[found] / variance[found]
    shown = np.maximum(np.abs(value[found]) ** 2 / variance[found] - 1.0, 0.0)
    around, total = (uniform_filter1d(one, min(NEIGHBOURS, len(found)), mode="nearest") for one in (shown, content))
    seen = np.zeros(len(value), dtype=bool)
    seen[found] = np.where(sine[found], shown, content * around / total) > policy.SEEN**2
    return seen


def _smooth(noise: Array, freedom: NDArray[np.intp]) -> Array:
    """Return the noise averaged over neighbouring windows; a logarithm of few degrees of freedom is too low."""
    from scipy.ndimage import uniform_filter1d
    from scipy.special import digamma

    if not len(noise):
        return noise
    logarithm = np.log(np.maximum(noise, np.finfo(float).tiny)) - digamma(freedom) + np.log(freedom)
    return np.asarray(np.exp(uniform_filter1d(logarithm, min(NEIGHBOURS, len(noise)), mode="nearest")))


def _direct(local: Local) -> tuple[Complex, Array, Array]:
    value = local.response[:, 0]
    return value, _beside(value, local.covariance), _beside(value, local.noise)


def _ratio(local: Local) -> tuple[Complex, Array, Array]:
    """Return a response over the other, the variance of the ratio, and the noise that is not common to both.

    Numerator and denominator are multiplied by the denominator's conjugate, and what noise adds to these products is
    subtracted. The plain ratio, weighted by the power of its denominator, is too small by the noise in that power.
    """
    above, below = local.response.T
    with np.errstate(all="ignore"):  # a line without content is dropped by its variance
        power = np.abs(below) ** 2 - local.covariance[:, 1, 1].real
        value = (above * below.conj() - local.covariance[:, 0, 1]) / power
        error = _beside(value, local.covariance)
        return value, np.where(power > 0.0, error / power, np.nan), _beside(value, local.noise)


def _beside(value: Complex, covariance: Complex) -> Array:
    """Return the variance of an output, or of an output less `value` times the other, shape (n,)."""
    if covariance.shape[1] == 1:
        return covariance[:, 0, 0].real
    slope = np.stack([np.ones_like(value), -value], axis=1)
    return np.asarray(np.einsum("nq,nqr,nr->n", slope, covariance, slope.conj()).real)


def _merged(name: str, points: list[_Points], instrument: str) -> Response:
    """Return one response from all records: those at the same frequency are averaged by their variances."""
    frequency, value, variance, coherence = (
        np.concatenate([getattr(one, key) for one in points]) for key in ("frequency", "value", "variance", "coherence")
    )
    width = max(one.width for one in points)
    cell = np.floor(frequency / width) if len(points) > 1 else np.arange(len(frequency))
    _, where = np.unique(cell, return_inverse=True)
    weight = 1.0 / variance
    total = np.bincount(where, weight)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(where, weight * values) / total)

    merged = mean(value.real) + 1j * mean(value.imag) if len(value) else value
    order = np.argsort(mean(frequency)) if len(value) else np.arange(0)
    return Response(
        name, mean(frequency)[order], merged[order], np.sqrt(1.0 / total)[order], mean(coherence)[order],
        "" if instrument == "torque" else instrument, width, records=len(points),
    )  # fmt: skip


def _passive(response: Response, period: float) -> tuple[Response, float | None]:
    """Return the response of a passive axis: what leads more is noise that the controller answered; from where on.

    The phase of a passive axis lies within 90 deg of zero. A phase wraps, so that it is judged after one delay has
    been taken off at all frequencies: the one of those allowed that leaves the fewest points outside.
    """
    omega = 2.0 * math.pi * response.frequency
    wrong, fewest = np.ones(len(omega), dtype=bool), len(omega) + 1
    for late in np.linspace(0.0, policy.APART * period, DELAYS):
        outside = np.abs(np.angle(response.value * np.exp(1j * omega * late))) > 0.5 * math.pi + policy.LEAD
        if (count := int(outside.sum())) < fewest:
            wrong, fewest = outside, count
    if not wrong.any():
        return response, None
    # a cut where most of what follows is wrong, and single ones dropped
    share = np.cumsum(wrong[::-1])[::-1] / np.arange(len(wrong), 0, -1)
    above = np.flatnonzero(share > 0.5)
    cut = int(above[0]) if above.size else len(wrong)
    kept = ~wrong & (np.arange(len(wrong)) < cut)
    found = {key: getattr(response, key)[kept] for key in ("frequency", "value", "stderr", "coherence")}
    return replace(response, **found), float(response.frequency[cut]) if cut < len(wrong) else None
