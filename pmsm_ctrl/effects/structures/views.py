"""What a structure sees of the simulated plant, and of the balances of a log."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design

__all__ = ["Balances", "Machine"]

Array = NDArray[np.float64]


class Machine(Protocol):
    """What a structure has to know of the simulated plant."""

    @property
    def J(self) -> float:
        """Total inertia, kg m^2."""

    @property
    def period(self) -> float:
        """Control period, s."""

    @property
    def steps(self) -> int:
        """Integration steps in a control period."""


class Balances(Protocol):
    """The balances of one log as columns need them; `pmsm_ctrl.regression.balances.Record` is one."""

    @property
    def design(self) -> Design:
        """What is believed about the axis."""

    @property
    def inertia(self) -> float:
        """Total inertia by which an error of the angle becomes one of the torque, kg m^2 (kg)."""

    @property
    def signals(self) -> Mapping[str, Array]:
        """What terms read and ``alpha``, shape (n,), at the log's rate."""

    @property
    def channels(self) -> tuple[str, ...]:
        """The balances this log has: torque, u_d, u_q."""

    @property
    def kept(self) -> dict[tuple[object, ...], Any]:
        """What was made of the measured motion alone; what begins with ``seen`` is forgotten after the search."""

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Samples of the thinned grid that take part, shape (m,)."""

    @property
    def weight(self) -> Array:
        """Relative inverse noise level, shape (channels, m)."""

    @property
    def angle(self) -> bool:
        """Whether the log has a position."""

    @property
    def late(self) -> float | None:
        """Delay about which the column of a delay is taken, s; None while the terms read measured currents."""

    @property
    def period(self) -> float:
        """Sampling period of the log, s."""

    @property
    def rate(self) -> float:
        """Rate of the thinned grid, Hz."""

    @property
    def cutoff(self) -> float:
        """Cutoff of the low-pass that balances and columns go through, Hz."""

    @property
    def duration(self) -> float:
        """Length of the log, s."""

    @property
    def unseen(self) -> float:
        """Time in gaps of the log, s."""

    @property
    def linear(self) -> bool:
        """Whether the axis is linear (m, N)."""

    @property
    def step(self) -> float:
        """Step of the logged angle, rad (m): of a coarse encoder, and next to nothing of any other."""

    def shaped(self, values: Array) -> Array:
        """Filter and thin a column given at the log's rate, shape (n,), to shape (m,)."""

    def rate_of(self, values: Array) -> Array:
        """Time derivative at the log's rate."""

    def slope_behind(self, values: Array) -> Array:
        """Slope over the time from `late` ago until now."""

    def acceleration(self) -> Array:
        """Filtered and thinned acceleration, shape (m,)."""

    def noise_of(self, values: Array) -> float:
        """Noise of a thinned signal, rms."""

    def noise_beside(self, load: Array) -> float:
        """Noise of the acceleration that is allowed by what is left beside a load, rms."""

    def shaft_noise(self) -> float:
        """Noise of the acceleration, rms."""
