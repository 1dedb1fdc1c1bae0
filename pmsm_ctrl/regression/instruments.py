"""Inertia, and delay and variance of the drive signal, by instrumental variables made of the reference.

Noise of the torque that no channel holds moves the axis, and the speed controller responds to it. An example is noise
of the current sensor, which the current loop turns into torque. Least squares is then biased:

- the slope of the modelled torque is correlated with the noise, so that the delay comes out too early, by up to the
  time constant of the loop, and the variance too large;
- the share of noise in the acceleration makes the inertia too small.

The reference is independent of the noise, so that instruments made of it have no such bias.

Source: T. Soderstrom, P. Stoica, Instrumental Variable Methods for System Identification, Springer 1983, ch. 3 and 8;
the test of least squares: J. A. Hausman, Econometrica 46 (1978) 1251.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.blocks import block_sums, no_smaller_than_by_blocks
from pmsm_ctrl.evidence.linalg import in_blocks, triangle
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import EMF, EMF_FILTERED, LATENESS, SPREAD
from pmsm_ctrl.regression.model import Model
from pmsm_ctrl.regression.two_stage import HeldResponse

__all__ = ["ReferenceEstimates", "by_reference"]

Array = NDArray[np.float64]

# Columns that hold noise of the motion.
NOISY = ("J", LATENESS, SPREAD, EMF, EMF_FILTERED)
FOUND = ("J", LATENESS, SPREAD)
# Samples of the thinned grid by which the reference is shifted: 2.5 in a period of the cutoff. A loop of 8 Hz and more
# has settled within the last one.
SHIFTS = (-3, -2, -1, 0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48)
# Times after the reference, s, at which the axis may change its direction.
TURNS = (0.0, 0.01, 0.03)
RANK = 1e-6  # of the largest singular value
MOST_KEPT = 4e6  # bytes of instruments that are kept from one fit to the next


@dataclass(frozen=True)
class ReferenceEstimates:
    """Inertia, delay and half the variance of the impulse response by instruments, with standard errors.

    Attributes
    ----------
    inertia : (float, float)
        kg m^2 (kg).
    late : (float, float)
        s.
    spread : (float, float)
        s^2.
    noise : float
        Share of the acceleration's power, with the weights of the fit, that the reference does not explain. The
        inertia by least squares may be too small by this share.
    responses : dict of name to HeldResponse
        Response of each value to the torque.
    """

    inertia: tuple[float, float]
    late: tuple[float, float]
    spread: tuple[float, float]
    noise: float
    responses: Mapping[str, HeldResponse]


def by_reference(record: Record, model: Model, sigma: float) -> ReferenceEstimates | None:
    """Estimate the inertia, and how the drive signal was sampled, by instruments made of the reference.

    Parameters
    ----------
    record : Record
        With modelled torque in its signals.
    model : Model
    sigma : float
        Noise of a sample of full weight, N m (N).

    Returns
    -------
    ReferenceEstimates or None
        None where the log has no reference of the motion, or the model no delay and variance.
    """
    if "omega_ref" not in record.signals or not {LATENESS, SPREAD} <= set(model.names) or sigma <= 0.0:
        return None
    weight = record.weight[0] * record.mask / sigma
    entering = model.entering[0]
    names = [model.names[k] for k in entering]
    noisy = [k for k, name in enumerate(names) if name in NOISY or model.group_of(int(entering[k])).delays]
    seen, target = model.matrix[0][:, entering] * weight[:, None], record.target[0] * weight
    size = np.linalg.norm(seen, axis=0)
    seen /= size
    measured = seen[:, noisy]
    seen[:, noisy] = _projected(record, measured, lambda: _weighted_instruments(record, model, names, entering, weight))
    known = np.where(np.isfinite(model.sigma[entering]), model.sigma[entering], np.inf)
    known[[k for k, name in enumerate(names) if name == "J" or (name == LATENESS and not record.sampling_stated)]] = (
        np.inf
    )
    prior = 1.0 / (known * size) ** 2
    products = seen.T @ seen + np.diag(prior)
    products[:, noisy] += seen.T @ (measured - seen[:, noisy])
    inverse = np.linalg.pinv(products, rcond=RANK**2)
    scaled = inverse @ (seen.T @ target + prior * size * model.nominal[entering])
    rest = target - seen @ scaled - (measured - seen[:, noisy]) @ scaled[noisy]
    values, stderr = scaled / size, _errors(seen, prior, inverse, (rest, _place(record.mask))) / size
    found = {name: (float(values[names.index(name)]), float(stderr[names.index(name)])) for name in FOUND}
    noise = 1.0 - float(np.sum(seen[:, names.index("J")] ** 2))
    responses = {name: _response(seen, inverse, size, weight, names.index(name)) for name in FOUND}
    return ReferenceEstimates(found["J"], found[LATENESS], found[SPREAD], noise, responses)


def _response(seen: Array, inverse: Array, size: Array, weight: Array, k: int) -> HeldResponse:
    """Return the response of a column's value to the torque, and the projection of the column on the instruments."""
    column = np.divide(seen[:, k] * size[k], weight, out=np.zeros(len(weight)), where=weight > 0.0)
    return HeldResponse(column, (seen @ inverse[k]) * weight / size[k])


def _weighted_instruments(
    record: Record, model: Model, names: list[str], entering: NDArray[np.int64], weight: Array
) -> Array:
    """Return the instruments with the weights of the samples, each of unit length, shape (m, instruments)."""
    made, count = np.empty((2 * len(SHIFTS) + len(TURNS) + len(names), len(weight))), 0
    for one in chain(_instruments(record), _of_speed(model, names, entering)):  # kept once: dozens of columns
        np.multiply(one, weight, out=made[count])
        if (size := float(np.linalg.norm(made[count]))) > 0.0:
            made[count] /= size
            count += 1
    return made[:count].T


def _projected(record: Record, columns: Array, instruments: Callable[[], Array]) -> Array:
    """Return the projection of columns on the instruments, shape (m, k).

    The instruments follow from the reference, the speed and the weights alone, and are the same in every fit.
    """
    key = ("instruments",)
    if key not in record.kept:
        made = instruments()
        _, singular, turn = np.linalg.svd(triangle(made[some] for some in in_blocks(len(columns))), full_matrices=False)
        told = singular > RANK * singular[0]
        turned = turn[told].T / singular[told]
        if made.nbytes > MOST_KEPT:
            return np.asarray(made @ (turned @ (turned.T @ (made.T @ columns))))
        record.kept[key] = made @ turned
    basis: Array = record.kept[key]
    return np.asarray(basis @ (basis.T @ columns))


def _errors(seen: Array, prior: Array, inverse: Array, left: tuple[Array, Array]) -> Array:
    """Return the standard errors by the noise of the samples, or by leaving out blocks, whichever is larger."""
    covariance = inverse @ (seen.T @ seen + np.diag(prior)) @ inverse.T
    upper = triangle(chain([np.diag(np.sqrt(prior))], (seen[some] for some in in_blocks(len(seen)))))
    back = np.linalg.pinv(upper)
    changes = block_sums(lambda rows: seen[rows] @ back, *left) @ upper @ inverse.T
    sure = inverse * np.sqrt(prior)
    larger = no_smaller_than_by_blocks(covariance, changes, np.sum(sure**2, axis=1))
    return np.asarray(np.sqrt(np.diag(larger)))


def _place(mask: NDArray[np.bool_]) -> Array:
    """Return where each sample stands between the first and the last that are used, from 0 to 1."""
    first, last = np.flatnonzero(mask)[[0, -1]]
    return np.asarray(np.clip((np.arange(len(mask)) - first) / max(last - first, 1), 0.0, 1.0))


def _instruments(record: Record) -> Iterator[Array]:
    """Yield the reference's speed, its acceleration and its direction at several times, each of shape (m,)."""
    key = ("reference",)
    if key not in record.kept:
        reference = record.signals["omega_ref"]
        turns = (np.sign(_shifted(reference, round(late * record.prepared.rate))) for late in TURNS)
        record.kept[key] = record.prepared.columns([reference, *turns])
    speed, *directions = record.kept[key]
    for values in (speed, np.gradient(speed)):
        for shift in SHIFTS:
            yield _shifted(values, shift)
    yield from directions


def _of_speed(model: Model, names: list[str], entering: NDArray[np.int64]) -> Iterator[Array]:
    """Yield the column of viscous friction: noise of the speed is small beside the speed."""
    for name, column in zip(names, entering.tolist(), strict=True):
        effect = model.group_of(column).effect
        if effect is not None and effect.id == "viscous" and "#" not in name:
            yield model.matrix[0][:, column]


def _shifted(values: Array, shift: int) -> Array:
    """Return values later by so many samples, the ends continued."""
    out, by = np.empty_like(values), min(abs(shift), len(values) - 1)
    if shift >= 0:
        out[:by], out[by:] = values[0], values[: len(values) - by]
    else:
        out[: len(values) - by], out[len(values) - by :] = values[by:], values[-1]
    return out
