"""Frequency responses of one record by the local polynomial method.

In a window of neighbouring lines of the spectrum a response and the transient of a finite record are smooth, so that
both are polynomials of the frequency there: ``Y(k) = G(k) X(k) + T(k) + V(k)``. What the polynomials leave is noise,
from which the covariance follows. Neither periods nor windows in time are needed. The skirt of a single sine, however,
times the distance from its line is a constant: slope and transient could not be told apart, so that its window has a
constant response.

Source: R. Pintelon, J. Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., Wiley 2012, ch. 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["REACH", "Local", "local_polynomial", "strongest_lines"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Lines = NDArray[np.intp]

REACH = 6  # lines on either side: 13 lines leave seven degrees of freedom beside six coefficients
ORDER = 2  # of both polynomials
SINE = 0.8  # share of a window's power in three neighbouring lines from which on it is a sine's


@dataclass(frozen=True, eq=False)
class Local:
    """Responses of several outputs to one input at some lines of a record's spectrum.

    Attributes
    ----------
    place : array, shape (n,)
        Lines to which the responses belong: those asked for, or where the power of a sine lies, between two lines.
    response : complex array, shape (n, q)
    covariance : complex array, shape (n, q, q)
        Of the responses of one line; that of a real part is half of it.
    power : array, shape (n,)
        Mean square of the input in the window.
    noise : complex array, shape (n, q, q)
        Covariance of what is left of the outputs in the window.
    freedom : int array, shape (n,)
        Complex degrees of freedom of each covariance.
    sine : bool array, shape (n,)
        Whether the window's content is a single sine.
    """

    place: Array
    response: Complex
    covariance: Complex
    power: Array
    noise: Complex
    freedom: Lines
    sine: NDArray[np.bool_]


def strongest_lines(spectrum: Complex, first: int, last: int) -> Lines:
    """Return the strongest line of each window between two lines, in order: sines, if there are any, are met.

    Parameters
    ----------
    spectrum : complex array, shape (m,)
    first, last : int
        Lines, both within.

    Returns
    -------
    int array, shape (n,)
    """
    width = 2 * REACH + 1
    count = max(0, (last - first + 1) // width)
    inside = np.abs(spectrum[first : first + count * width]).reshape(count, width)
    return np.asarray(first + np.arange(count) * width + inside.argmax(axis=1), dtype=np.intp)


def local_polynomial(inputs: Complex, outputs: Complex, lines: Lines, first: int = 1) -> Local:
    """Return the responses of outputs to an input at some lines of their spectra.

    Parameters
    ----------
    inputs : complex array, shape (m,)
        Spectrum of the input.
    outputs : complex array, shape (m, q)
        Spectra of the outputs.
    lines : int array, shape (n,)
        Where the responses are wanted.
    first : int
        The lowest line that is used: line 0 holds offsets.

    Returns
    -------
    Local

    Raises
    ------
    ValueError
        When the spectra have fewer lines than a window.
    """
    width = 2 * REACH + 1
    if len(inputs) - first < width:
        raise ValueError(f"{len(inputs)} lines found; at least {width + first} were expected")
    middle = np.clip(lines, first + REACH, len(inputs) - 1 - REACH)
    window = middle[:, None] + np.arange(-REACH, REACH + 1)
    share = np.abs(inputs[window]) ** 2
    share /= np.maximum(share.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    sine = np.lib.stride_tricks.sliding_window_view(share, 3, axis=1).sum(axis=2).max(axis=1) > SINE
    place = np.where(sine, _between(np.abs(inputs[window]), window), lines)
    parts = [(np.flatnonzero(~sine), ORDER), (np.flatnonzero(sine), 0)]
    solved = [
        _solved(inputs[window[k]], outputs[window[k]], (window[k] - place[k, None]).astype(np.float64), order)
        for k, order in parts
    ]
    back = np.argsort(np.concatenate([k for k, _ in parts]))
    response, covariance, power, noise, freedom = (np.concatenate(one)[back] for one in zip(*solved, strict=True))
    return Local(place, response, covariance, power, noise, freedom, sine)


def _between(size: Array, window: Lines) -> Array:
    """Return where between its two strongest lines a sine lies: its skirt falls with the reciprocal of the distance."""
    first = np.argmax(size[:, :-1] + size[:, 1:], axis=1)[:, None]
    left, right = (np.take_along_axis(size, first + k, axis=1)[:, 0] for k in (0, 1))
    total = np.maximum(left + right, np.finfo(float).tiny)
    return np.asarray(np.take_along_axis(window, first, axis=1)[:, 0] + right / total)


def _solved(x: Complex, y: Complex, away: Array, order: int) -> tuple[Complex, Complex, Array, Complex, Lines]:
    """Return response to freedom of a `Local`, for windows of the input, shape (n, w), and of the outputs."""
    size = np.sqrt(np.mean(np.abs(x) ** 2, axis=1))
    scaled = x / np.where(size > 0.0, size, 1.0)[:, None]
    powers = (away / REACH)[..., None] ** np.arange(ORDER + 1)
    columns = np.concatenate([scaled[..., None] * powers[..., : order + 1], powers.astype(np.complex128)], axis=2)
    inverse = np.linalg.pinv(columns, rcond=1e-9)
    left = y - columns @ (inverse @ y)
    freedom = columns.shape[1] - columns.shape[2]
    spread = np.einsum("nwq,nwr->nqr", left, left.conj()) / freedom
    gain = inverse[:, :1, :]
    scale = np.where(size > 0.0, size, math.inf)
    variance = np.sum(np.abs(gain[:, 0, :]) ** 2, axis=1) / scale**2
    return (
        (gain @ y)[:, 0, :] / scale[:, None], spread * variance[:, None, None], size**2, spread,
        np.full(len(x), freedom, dtype=np.intp),
    )  # fmt: skip
