"""The delay of the drive signal from the reference alone: what noise that moves the axis cannot bias.

Noise of the torque that no channel holds (the current sensor's, which the current loop turns into torque) moves the
axis, and the speed controller answers it. Slopes of the modelled torque go with it: least squares finds a delay that is
too early by up to the loop's time constant, and a variance that is too large, the more so where the weights leave
little else. The reference knows nothing of the noise: instruments made of it have no such bias.

Source: T. Soderstrom, P. Stoica, Instrumental Variable Methods for System Identification, Springer 1983, ch. 3 and 8;
the test of least squares: J. A. Hausman, Econometrica 46 (1978) 1251.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import EMF, LATENESS, SPREAD
from pmsm_ctrl.regression.model import Model

__all__ = ["Referred", "sampling_by_reference"]

Array = NDArray[np.float64]

# Columns that hold noise of the motion.
NOISY = ("J", LATENESS, SPREAD, EMF)
# Samples of the thinned grid by which the reference is shifted: 2.5 in a period of the cutoff. A loop of 8 Hz and more
# has settled within the last one.
SHIFTS = (-3, -2, -1, 0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48)
# Times after the reference, s, at which the axis may change its direction.
TURNS = (0.0, 0.01, 0.03)
RANK = 1e-6  # of the largest singular value


@dataclass(frozen=True)
class Referred:
    """Delay and half the variance of the impulse response by instruments, with their standard errors.

    Attributes
    ----------
    late, late_stderr : float
        s.
    spread, spread_stderr : float
        s^2.
    """

    late: float
    late_stderr: float
    spread: float
    spread_stderr: float


def sampling_by_reference(record: Record, model: Model, sigma: float) -> Referred | None:
    """Estimate how the drive signal was sampled by instruments made of the reference.

    Parameters
    ----------
    record : Record
        With modelled torque in its signals.
    model : Model
    sigma : float
        Noise of a sample of full weight, N m (N).

    Returns
    -------
    Referred or None
        None where the log has no reference of the motion, or the model no delay and variance.
    """
    if "omega_ref" not in record.signals or not {LATENESS, SPREAD} <= set(model.names) or sigma <= 0.0:
        return None
    weight = record.weight[0] * record.mask / sigma
    entering = np.flatnonzero(np.any(model.matrix[0], axis=0))
    names = [model.names[k] for k in entering]
    noisy = [k for k, name in enumerate(names) if name in NOISY]
    columns, target = model.matrix[0][:, entering] * weight[:, None], record.target[0] * weight
    instruments = np.column_stack([*_instruments(record), *_of_speed(model, names, entering)]) * weight[:, None]
    size = np.linalg.norm(instruments, axis=0)
    left, singular, _ = np.linalg.svd(instruments[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    basis = left[:, singular > RANK * singular[0]]
    seen = columns.copy()
    seen[:, noisy] = basis @ (basis.T @ columns[:, noisy])
    size = np.linalg.norm(columns, axis=0)
    known = np.where(np.isfinite(model.sigma[entering]), model.sigma[entering], np.inf)
    known[[k for k, name in enumerate(names) if name in ("J", LATENESS)]] = np.inf
    prior = 1.0 / (known * size) ** 2
    products = (seen / size).T @ (columns / size) + np.diag(prior)
    inverse = np.linalg.pinv(products, rcond=RANK**2)
    values = inverse @ ((seen / size).T @ target + prior * size * model.nominal[entering]) / size
    covariance = inverse @ ((seen / size).T @ (seen / size) + np.diag(prior)) @ inverse.T
    stderr = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / size
    late, spread = names.index(LATENESS), names.index(SPREAD)
    return Referred(float(values[late]), float(stderr[late]), float(values[spread]), float(stderr[spread]))


def _instruments(record: Record) -> Iterator[Array]:
    """Yield the reference's speed, its acceleration and its direction at several times, each of shape (m,)."""
    reference = record.signals["omega_ref"]
    speed = record.shaped(reference)
    for values in (speed, np.gradient(speed)):
        for shift in SHIFTS:
            yield _shifted(values, shift)
    for late in TURNS:
        yield record.shaped(np.sign(_shifted(reference, round(late * record.prepared.rate))))


def _of_speed(model: Model, names: list[str], entering: NDArray[np.int64]) -> Iterator[Array]:
    """Yield the column of viscous friction: noise of the speed is small beside the speed."""
    for name, column in zip(names, entering.tolist(), strict=True):
        effect = model.group_of(column).effect
        if effect is not None and effect.id == "viscous" and "#" not in name:
            yield model.matrix[0][:, column]


def _shifted(values: Array, shift: int) -> Array:
    """Return values later by so many samples, the ends continued."""
    at = np.clip(np.arange(len(values)) - shift, 0, len(values) - 1)
    return values[at]
