"""The result of `track`: the history of the friction over a log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Span
from pmsm_ctrl.result import Estimate, Result, jsonable
from pmsm_ctrl.section import Notice
from pmsm_ctrl.track import model
from pmsm_ctrl.track.settings import Settings, start
from pmsm_ctrl.units import axis_unit

__all__ = ["Tracking", "mean_of_judged"]

Array = NDArray[np.float64]

UNITS = {"F_c": "N m", "F_v": "N m s/rad", "T_load": "N m", "J": "kg m^2"}


@dataclass(frozen=True, eq=False)
class Tracking(Result):
    """The history of friction over a log.

    Attributes
    ----------
    design : Design
        What the tracker started from.
    settings : Settings
        With the noise that was estimated from the log.
    t : array, shape (n,)
    history : dict of name to array, shape (n,)
        ``F_c`` and ``F_v``, and ``T_load``, ``J`` where asked for.
    stderr : dict of name to array, shape (n,)
        Standard error the filter states at each sample.
    correlation : array, shape (n,)
        Correlation of the errors of F_c and F_v; near -1 only their sum is known.
    nis : array, shape (n,)
        Normalised innovation squared where a measurement was judged, NaN elsewhere.
    normalised : array, shape (n,)
        The innovation over its standard deviation, NaN elsewhere.
    events : int array, shape (n,)
        Positions in `pmsm_ctrl.track.model.EVENTS`.
    omega : array, shape (n,)
        Estimated speed, rad/s.
    torque_noise : float
        Noise of the drive torque per sample that the filter ended up with, N m rms.
    log_name : str
        The log's file.
    notices : tuple of Notice
        Reasons to doubt the numbers.
    records : tuple of Span
        The records, where there are several.
    """

    design: Design
    settings: Settings
    t: Array
    omega: Array
    history: Mapping[str, Array]
    stderr: Mapping[str, Array]
    correlation: Array
    nis: Array
    normalised: Array
    events: NDArray[np.int8]
    torque_noise: float
    log_name: str
    notices: tuple[Notice, ...] = ()
    records: tuple[Span, ...] = ()

    @property
    def estimates(self) -> dict[str, Estimate]:
        """Estimates at the end of the log."""
        return self._estimates_at(-1)

    def _estimates_at(self, k: int) -> dict[str, Estimate]:
        nominal = dict(zip(model.STATES, start(self.design).tolist(), strict=True))
        return {
            name: Estimate(
                float(values[k]),
                axis_unit(UNITS[name], self.design.motion),
                float(self.stderr[name][k]),
                nominal[name],
            )
            for name, values in self.history.items()
        }

    @property
    def by_record(self) -> dict[str, dict[str, Estimate]]:
        """Estimates at the end of each record, by its name; empty for a log that is one record."""
        last = [int(np.searchsorted(self.t, one.stop, side="right")) - 1 for one in self.records]
        return {one.name: self._estimates_at(k) for one, k in zip(self.records, last, strict=True)}

    @property
    def mean_nis(self) -> float | None:
        """Mean normalised innovation squared, 1 where the filter is consistent; None where nothing was judged."""
        return mean_of_judged(self.nis)

    @property
    def counts(self) -> dict[str, int]:
        """Number of samples by event."""
        found = np.bincount(self.events, minlength=len(model.EVENTS))
        return {name: int(n) for name, n in zip(model.EVENTS, found, strict=True) if n}

    def design_at(self, t: float) -> Design:
        """Return the design with the friction at a time of the log.

        Parameters
        ----------
        t : float
            Time, s; the nearest sample before it counts.

        Returns
        -------
        Design
            With F_c and F_v and their standard errors.
        """
        k = min(max(int(np.searchsorted(self.t, t, side="right")) - 1, 0), self.t.size - 1)
        design = self.design
        for effect, name in (("coulomb", "F_c"), ("viscous", "F_v")):
            value = max(float(self.history[name][k]), 0.0)
            design = design.with_effect(effect, {name: value}, {name: float(self.stderr[name][k])})
        return design

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON: the history thinned to at most 2000 samples."""
        step = max(1, self.t.size // 2000)
        found: dict[str, Any] = jsonable({
            "schema": "pmsm-ctrl/tracking/1",
            "log": self.log_name,
            **self.doubts(),
            "estimates": self.estimates,
            "records": self.by_record,
            "correlation_F_c_F_v": float(self.correlation[-1]),
            "mean_nis": self.mean_nis,
            "torque_noise": self.torque_noise,
            "samples": self.counts,
            "t": self.t[::step],
            "history": {name: values[::step] for name, values in self.history.items()},
            "stderr": {name: values[::step] for name, values in self.stderr.items()},
        })  # fmt: skip
        return found


def mean_of_judged(nis: Array) -> float | None:
    """Return the mean over the samples that were judged; None where none was."""
    judged = np.isfinite(nis)
    return float(nis[judged].mean()) if judged.any() else None
