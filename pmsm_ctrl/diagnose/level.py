"""How much of a balance a fit explains, beside how much of it is noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.regression.records import members

__all__ = ["Level", "floor_of", "known_noise", "level_of"]


@dataclass(frozen=True)
class Level:
    """Sizes in one balance, by the weights of the estimate and in units of its noise.

    Attributes
    ----------
    measured : float
        Rms of the measured side.
    left : float
        Rms that the model leaves; 1 where that is noise alone.
    """

    measured: float
    left: float

    @property
    def explained(self) -> float:
        """Share of the mean square that the model explains."""
        return 1.0 - (self.left / self.measured) ** 2 if self.measured > 0.0 else 0.0

    @property
    def explicable(self) -> float:
        """Share of the mean square that is not noise."""
        return 1.0 - 1.0 / max(self.measured, 1.0) ** 2

    def above_floor(self, policy: Policy) -> bool:
        """Whether most of what the model leaves is no noise."""
        return self.left**2 * (1.0 - policy.explained_torque) > 1.0


def known_noise(fit: Fitted, row: int) -> float:
    """Return the noise that a balance is known to have: of the steps of the angle, in the torque of the inertia.

    Columns that are made of the acceleration hold the same noise, so that all candidates together explain much of it.
    What they leave, the floor, is then less than the noise.

    Parameters
    ----------
    fit : Fitted
    row : int
        Of the balance.
    """
    names = fit.model.names
    if row != 0 or "J" not in names:
        return 0.0
    return abs(float(fit.plain.values[names.index("J")])) * fit.record.rough


def floor_of(fit: Fitted, row: int) -> float:
    """Return the rms of the noise in a balance over all samples: of each record its own, where several were joined.

    Parameters
    ----------
    fit : Fitted
    row : int
        Of the balance.
    """
    record, sigma = fit.record, float(fit.whitener.sigma[row])
    if record.counts:
        inside = members(record) & record.mask
        louder = np.array([1.0 / count**2 for count in record.counts[row]])
        sigma *= float(np.sqrt(louder @ inside.sum(axis=1) / max(int(inside.sum()), 1)))
    return max(sigma, known_noise(fit, row))


def level_of(fit: Fitted, row: int) -> Level:
    """Return the sizes in a balance.

    Parameters
    ----------
    fit : Fitted
    row : int
        Of the balance.
    """
    record = fit.record
    scale = record.weight[row][record.mask] / max(float(fit.weights.sigma[row]), known_noise(fit, row), 1e-300)

    def rms(values: NDArray[np.float64]) -> float:
        return float(np.sqrt(np.mean((values[record.mask] * scale) ** 2)))

    return Level(rms(record.target[row]), rms(fit.residual[row]))
