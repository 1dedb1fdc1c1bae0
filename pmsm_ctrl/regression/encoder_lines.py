"""The periodic error of an encoder's lines, or of a resolver. It is part of every fit where a log shows it.

An encoder that interpolates the signals of its lines has a periodic error of up to a few per cent of a line. After two
derivatives it is an oscillation of the acceleration that grows with the square of the speed, as long as the lines pass
slowly enough for the filters. On a smooth motion this is just before a stop and just after a start, where it looks like
friction.

A resolver whose windings differ, or are not at right angles, has an error of twice as many periods as it has pole
pairs, of minutes of arc. It passes the filters at all speeds, and looks like a cogging that grows with the speed.

Source of the resolver's error: D. C. Hanselman, IEEE Trans. Ind. Electron. 37 (1990) 556.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.structures.interface import LINE_ERROR
from pmsm_ctrl.effects.structures.paths import swings_of_angle
from pmsm_ctrl.regression.balances import Record

__all__ = ["LINES", "RESOLVER", "likely_error", "line_swings", "shown_lines"]

Array = NDArray[np.float64]

# Lines of a turn that are looked for: those of encoders with interpolated signals are a power of two.
LINES = tuple(64 << k for k in range(8))
# Cutoffs of the evaluation from which on lines that pass leave nothing in it, and are not followed.
FOLLOWED = 2.0
# Gain on stretches left out, in units of the noise, from which on a log shows the lines: by chance it is below zero,
# but reversals whose moments are wrong imitate few lines. A false one costs the fit two parameters of a small prior.
SHOWN = 25.0
LARGEST = 5.0  # of the error that is likely: none is as wrong as that, so a larger wave is something else
# Orders of a turn of a resolver's error, with one to five pole pairs, and how large it is likely to be, rad: 10 minutes
# of arc, which datasheets state.
RESOLVER, RESOLVER_ERROR = (2, 4, 6, 8, 10), 0.003
# Of its gain that a wave of the torque of the same order may have: at nearly one speed the two are the same. Of most
# resolvers the order is two, as hardly any wave of a motor's torque is: there the wave has to explain that much more.
# Of four resolvers in clean logs the waves explain 0.46, 0.62, 0.90 and 1.07 of it.
BESIDE, BESIDE_TWO = 0.75, 4.0 / 3.0
# Of its gain that another number of lines may have beside it: what else is wrong with a model resembles many of them.
# Of 16 logs of *worlds* that show lines one has 0.3, for which the first accounts, the others 0.07 at most; of three
# logs without lines 0.39 to 0.85.
BESIDE_IT = 0.25
# Stretches of a log, every other one of which is held against the rest.
PIECES = 16


def likely_error(lines: int) -> float:
    """Return the greatest error of the angle that is likely, rad.

    Parameters
    ----------
    lines : int
        Of a turn, or the order of a resolver's error.
    """
    return RESOLVER_ERROR if lines in RESOLVER else LINE_ERROR * 2.0 * np.pi / lines


def line_swings(record: Record, lines: int) -> tuple[Array, Array]:
    """Return the apparent torque of the error of so many lines, shape (n,): of its sine, and of its cosine.

    Parameters
    ----------
    record : Record
    lines : int
        Of a turn.

    Returns
    -------
    (array, array)
        For the greatest error that is likely, at the log's rate.
    """
    frequency = lines * np.abs(record.signals["omega"]) / (2.0 * np.pi)
    slow = np.clip(2.0 - frequency / (FOLLOWED * record.cutoff), 0.0, 1.0)
    sine, cosine = swings_of_angle(record, lines, likely_error(lines))
    return slow * sine, slow * cosine


def shown_lines(record: Record, residual: Array, matrix: Array, sigma: float, sure: Array) -> dict[int, float]:
    """Return the lines that a log shows, or the order of a resolver's error, and the amplitude of the error, rad.

    A wave of the torque of the same order has to explain less than a resolver's error.

    Parameters
    ----------
    record : Record
    residual : array, shape (m,)
        Of the torque balance.
    matrix : array, shape (m, columns)
        Of the model that leaves it.
    sigma : float
        Noise of a sample of full weight, N m.
    sure : array, shape (m,)
        Weight of the samples beside that of the record.

    Returns
    -------
    dict of int to float
    """
    if record.linear or (record.records and not record.angle):
        return {}  # no turn, or speeds whose integral begins anew with each record
    weight = (record.weight[0] * sure)[record.mask]
    known = np.linalg.qr(_scaled(matrix[record.mask] * weight[:, None]))[0]
    left = residual[record.mask] * weight / max(sigma, 1e-300)
    omega = np.abs(record.at_grid(record.signals["omega"])[record.mask])

    def columns(waves: Sequence[Array]) -> Array:
        own = np.stack([record.shaped(one)[record.mask] * weight for one in waves]).T
        return np.asarray(own - known @ (known.T @ own))

    def like_torque(lines: int, gain: float) -> bool:
        if lines not in RESOLVER:
            return False
        waves = [wave(lines * record.signals["theta"]) for wave in (np.sin, np.cos)]
        rivals = (waves, [record.signals["torque"] * wave for wave in waves])
        share = BESIDE_TWO if lines == min(RESOLVER) else BESIDE
        return max(_held_out(columns(some), left)[0] for some in rivals) > share * gain

    gains: dict[int, float] = {}
    amplitudes: dict[int, float] = {}
    turned = float(np.ptp(record.signals["theta"])) > 2.0 * np.pi  # in part of a turn any curve is a part of a wave
    for lines in (*(RESOLVER if turned else ()), *LINES):
        if float(np.min(omega)) * lines > 2.0 * np.pi * record.cutoff:
            break
        gain, values = _held_out(columns(line_swings(record, lines)), left)
        if (amplitude := float(np.hypot(*values)) * sigma) < LARGEST:
            gains[lines], amplitudes[lines] = gain, amplitude
    best = max(gains, key=lambda lines: gains[lines], default=0)  # an encoder has one number of lines
    if not best or gains[best] < SHOWN or like_torque(best, gains[best]):
        return {}
    own = np.linalg.qr(columns(line_swings(record, best)))[0]
    for lines, gain in gains.items():
        if lines != best and gain > BESIDE_IT * gains[best]:
            others = columns(line_swings(record, lines))
            others -= own @ (own.T @ others)
            if _held_out(others, left - own @ (own.T @ left))[0] > BESIDE_IT * gains[best]:
                return {}
    return {best: amplitudes[best] * likely_error(best)}


def _held_out(columns: Array, left: Array) -> tuple[float, Array]:
    """Return what two columns explain of each half of a residual with the values of the other half, and their values.

    The phase of an encoder's lines is the same in the whole log. Friction around a reversal has another phase at each.
    """
    pieces = [slice(*ends) for ends in itertools.pairwise(np.linspace(0, len(left), PIECES + 1).astype(int))]
    parts = [(columns[at].T @ columns[at], columns[at].T @ left[at]) for at in pieces]
    halves = [tuple(sum(part[k] for part in parts[first::2]) for k in range(2)) for first in range(2)]
    gain = 0.0
    for (gram, along), (other, beside) in (halves, halves[::-1]):
        values = np.linalg.lstsq(other, beside, rcond=1e-12)[0]
        gain += float(2.0 * values @ along - values @ gram @ values)
    gram, along = (first + second for first, second in zip(*halves, strict=True))
    whole = np.asarray(np.linalg.lstsq(gram, along, rcond=1e-12)[0], dtype=np.float64)
    return gain, whole


def _scaled(matrix: Array) -> Array:
    size = np.linalg.norm(matrix, axis=0)
    inside: Array = matrix[:, size > 0.0] / size[size > 0.0]
    return inside
