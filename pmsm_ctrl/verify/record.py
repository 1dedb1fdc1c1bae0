"""One log, ready to be fitted, and what stands in it for the sign of the speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.verify import policy

__all__ = ["Record", "Sign", "Unsigned", "averaged", "cropped", "delayed", "rounding_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Sign:
    """What a drive takes for the sign of the speed; it is 0 at rest.

    Attributes
    ----------
    width : float
        rad/s (m/s): half width of a straight line through zero, or the scale of a hyperbolic tangent.
    curved : bool
        Whether it is the hyperbolic tangent.
    """

    width: float
    curved: bool = False

    @property
    def shape(self) -> str:
        """``line`` or ``tanh``."""
        return "tanh" if self.curved else "line"

    @property
    def reach(self) -> float:
        """Speed from which on it is the sign, within a tenth, rad/s (m/s)."""
        return self.width * (1.5 if self.curved else 1.0)

    def of(self, speed: Array) -> Array:
        """Return it for each speed."""
        scaled = speed / self.width
        return np.tanh(scaled) if self.curved else np.clip(scaled, -1.0, 1.0)


@dataclass(frozen=True, eq=False)
class Unsigned:
    """The compensator's currents before a sign of the speed is put in.

    Attributes
    ----------
    speed : array, shape (n,)
        That the compensator reads, rad/s (m/s).
    offset, slope : dict of effect to array, shape (n,)
        Current at a sign of 0, and what it gains per sign, A.
    """

    speed: Array
    offset: Mapping[str, Array]
    slope: Mapping[str, Array]

    @property
    def peak(self) -> float:
        """Highest speed, rad/s (m/s)."""
        return float(np.abs(self.speed).max())

    def samples_within(self, sign: Sign) -> float:
        """Return how many samples a reversal spends, on average, where this is not yet the sign of the speed."""
        moving = self.speed[np.abs(self.speed) > policy.AT_REST * self.peak]
        reversals = np.count_nonzero(np.diff(np.signbit(moving)))
        return np.count_nonzero(np.abs(moving) < sign.reach) / max(1, int(reversals))

    def fed(self, sign: Sign) -> dict[str, Array]:
        """Return the currents with this sign, A."""
        direction = sign.of(self.speed)
        return {name: offset + self.slope[name] * direction for name, offset in self.offset.items()}


@dataclass(frozen=True, eq=False)
class Record:
    """One log, ready to be fitted.

    Attributes
    ----------
    t : array, shape (n,)
        s, from 0.
    current : array, shape (n,)
        Current that the law explains, A.
    columns : array, shape (n, k)
        What the controller reads.
    integral : int
        Column of the integral of its error, summed over the samples of the log.
    fed : dict of effect to array, shape (n,)
        Currents of the compensator at a gain of 1, A.
    used : bool array, shape (n,)
    unsigned : Unsigned or None
        Its currents for another sign of the speed, sample by sample; None where the friction turns over a travel.
    mean : int
        Samples of the log whose mean is one sample here.
    rounding : float
        Rms of what a sample of the controller's error differs by from a smooth course, in its unit.
    measured : bool
        Whether the current is a measured one, with a noise of its own, and not the controller's output.
    slower : bool
        Whether the log lacks cycles of the controller, so that the sum of its samples is not the controller's.
    """

    t: Array
    current: Array
    columns: Array
    integral: int
    fed: Mapping[str, Array]
    used: Mask
    unsigned: Unsigned | None = None
    mean: int = 1
    rounding: float = 0.0
    measured: bool = False
    slower: bool = False

    @property
    def period(self) -> float:
        """Of the samples, s."""
        return float(self.t[1] - self.t[0])

    @property
    def total(self) -> Array:
        """Current of all parts of the compensator, A."""
        return np.asarray(np.sum(list(self.fed.values()), axis=0))

    def signed(self, sign: Sign | None) -> Record:
        """Return the record of a drive with this sign of the speed; with that of the design for None."""
        if sign is None or self.unsigned is None:
            return self
        return replace(self, fed={name: _means(one, self.mean) for name, one in self.unsigned.fed(sign).items()})


def rounding_of(integral: Array, period: float) -> float:
    """Return the rms of what a sample of an integrand differs by from a smooth course.

    Third differences, whose variance is 20 times that of independent samples, are free of a smooth course.

    Parameters
    ----------
    integral : array, shape (n,)
        Sum of the samples times the period.
    period : float
        s.
    """
    return float(np.std(np.diff(integral, 4)) / period / np.sqrt(20.0))


def delayed(record: Record, values: Array, delay: float) -> Array:
    """Return values of a record later by `delay` (s), shape (n,)."""
    return np.interp(record.t - delay, record.t, values)


def _means(values: Array, width: int) -> Array:
    whole = len(values) // width * width
    return np.asarray(values[:whole].reshape(whole // width, width, *values.shape[1:]).mean(axis=1))


def averaged(record: Record, width: int) -> Record:
    """Return the means of neighbouring samples of a record, `width` each."""
    return Record(
        _means(record.t, width), _means(record.current, width), _means(record.columns, width),
        record.integral, {name: _means(values, width) for name, values in record.fed.items()},
        _means(record.used.astype(float), width) > 0.999, record.unsigned, width,
        record.rounding / float(np.sqrt(width)), record.measured, record.slower,
    )  # fmt: skip


def cropped(record: Record) -> Record:
    """Return the first `policy.MOST` samples of a record."""
    kept = slice(0, policy.MOST)

    def of(parts: Mapping[str, Array]) -> dict[str, Array]:
        return {name: values[kept] for name, values in parts.items()}

    own = record.unsigned
    return replace(
        record, t=record.t[kept], current=record.current[kept], columns=record.columns[kept], fed=of(record.fed),
        used=record.used[kept],
        unsigned=None if own is None else Unsigned(own.speed[kept], of(own.offset), of(own.slope)),
    )  # fmt: skip
