"""What two logs say of a downloaded compensator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.result import Estimate, Result, jsonable
from pmsm_ctrl.section import Notice
from pmsm_ctrl.verify.errors import Tracking

__all__ = ["Outcome", "Verification"]

Array = NDArray[np.float64]


class Outcome(StrEnum):
    """What became of the feedforward, in one word; the value stands in the JSON."""

    APPLIED = "applied"
    PARTLY_APPLIED = "partly_applied"
    NOT_APPLIED = "not_applied"
    WRONG_GAIN = "wrong_gain"
    WRONG_SIGN = "wrong_sign"
    LATE = "late"
    LIMIT_CYCLE = "limit_cycle"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True, eq=False)
class Verification(Result):
    """Result of `verify`.

    Attributes
    ----------
    verdict : Outcome
    design : Design
    before_name, after_name : str
        Of the logs.
    expected : float
        Gain that the design states.
    gain : Estimate
        What the second log has more, as a share of the modelled friction.
    before_gain : Estimate
        What acted before already.
    interval : tuple of float
        Of the gain, 95 %.
    delay : Estimate or None
        Of the feedforward behind the reference, s; None where nothing was added.
    delay_interval : tuple of float
        s, 95 %.
    smoothing : Estimate or None
        Width of what the drive takes for the sign of the speed, rad/s (m/s): that of a straight line through zero, or
        the scale of a hyperbolic tangent (`smoothing_shape`); None where it is that of the design.
    smoothing_interval : tuple of float
        95 %.
    smoothing_shape : str
        ``line`` or ``tanh``; empty without a smoothing.
    parts : dict of effect to Estimate
        Gain by part of the friction.
    implausible : tuple of str
        Parts whose gain does not belong to one download: no gain of a drive.
    weight : dict of effect to float
        Share of the compensated current (rms) that each part makes in this motion.
    channel : str
        Channel of the current in which it was looked for.
    before, after : Tracking
    measured, promised : dict of str to float
        Change of rms, peak and reversal_peak, -0.8 for -80 %; `promised` by the simulated drive, empty where it cannot
        be simulated.
    explained : float
        Share of the current that the controller's law explains.
    advice : str
        What to change.
    t, added, predicted : array, shape (n,)
        Current of the second log beside its controller, A, and the compensator's share of it.
    notices : tuple of Notice
    """

    verdict: Outcome
    design: Design
    before_name: str
    after_name: str
    expected: float
    gain: Estimate
    before_gain: Estimate
    interval: tuple[float, float]
    delay: Estimate | None
    delay_interval: tuple[float, float]
    smoothing: Estimate | None
    smoothing_interval: tuple[float, float]
    smoothing_shape: str
    parts: Mapping[str, Estimate]
    implausible: tuple[str, ...]
    weight: Mapping[str, float]
    channel: str
    before: Tracking
    after: Tracking
    measured: Mapping[str, float]
    promised: Mapping[str, float]
    explained: float
    advice: str
    t: Array = field(repr=False)
    added: Array = field(repr=False)
    predicted: Array = field(repr=False)
    notices: tuple[Notice, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""

        def errors(one: Tracking) -> dict[str, Any]:
            names = ("rms", "peak", "reversal_peak", "cycle_amplitude", "cycle_frequency")
            return {name: getattr(one, name) for name in names} | {"unit": one.unit}

        return dict(jsonable({
            "schema": "pmsm-ctrl/verification/1",
            "verdict": str(self.verdict),
            "advice": self.advice,
            **self.doubts(),
            "before": self.before_name,
            "after": self.after_name,
            "expected_gain": self.expected,
            "gain": self.gain,
            "gain_interval_95": list(self.interval),
            "gain_before": self.before_gain,
            "delay": self.delay,
            "delay_interval_95": list(self.delay_interval),
            "smoothing": self.smoothing,
            "smoothing_interval_95": list(self.smoothing_interval),
            "smoothing_shape": self.smoothing_shape,
            "parts": dict(self.parts),
            "implausible": list(self.implausible),
            "weight": dict(self.weight),
            "channel": self.channel,
            "errors": {"before": errors(self.before), "after": errors(self.after)},
            "change": {"measured": dict(self.measured), "promised": dict(self.promised)},
            "explained": self.explained,
        }))  # fmt: skip
