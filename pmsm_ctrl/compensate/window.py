"""The range of safe gains of the compensation, by time simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compensate.metrics import Metrics

__all__ = [
    "FACTORS", "FULL", "GAINS", "LESS", "ROUNDING", "WORSE", "WRONG", "GainWindow", "Unresolved", "best_place",
    "gain_window", "resolves", "sweep_gains",
]  # fmt: skip

Array = NDArray[np.float64]

HIGHEST = 1.5  # gain at which a sweep ends
FULL = 1.0  # largest gain that is recommended: above it only parameters that are too low gain
FACTORS = (0.8, 1.0, 1.2)  # on the compensated parameters, for which a safe gain is safe
WRONG = 0.2  # the same as a share
WORSE = 1.05  # largest RMS error of a safe gain, as a share of that without compensation
LESS = 0.95  # largest RMS error of an improvement, as a share of that without compensation
ROUNDING = 12.0**-0.5  # RMS error of a position that is rounded to encoder counts, in counts
LARGER = 1.5  # amplitude from which a limit cycle is attributed to the compensation, relative to that without
Run = Callable[[float, float, str], Metrics]  # gain, factor on the parameters, motion


@dataclass(frozen=True)
class Unresolved:
    """A motion whose error the encoder does not resolve even without compensation, so that nothing can lower it.

    Attributes
    ----------
    motion : str
    rms, peak : float
        Its error without compensation, encoder counts.
    """

    motion: str
    rms: float
    peak: float


@dataclass(frozen=True, eq=False)
class GainWindow:
    """Result of a sweep of the gain.

    Attributes
    ----------
    source : str
        "reference", "commanded" or "measured".
    gains : array, shape (n,)
    rms : array, shape (n,)
        Worst RMS error over the motions of the design's plant that the encoder resolves, and parameter errors, as a
        share of that without compensation. NaN above a gain of 0 where it resolves none.
    judged : array, shape (n,)
        The same over all motions, those with the assumed presliding too, errors below an encoder count taken as one
        count, parameters 20 % wrong: what a safe gain is judged by.
    reversal_peak : array, shape (n,)
        The same as `judged` for the peak after a change of direction.
    cycle : array, shape (n,)
        Largest limit cycle at rest over motions and parameter errors, rad; 0 when there was none.
    safe : float
        Highest gain of the sweep up to which there is no limit cycle and no `judged` error above 1.05; else 0.
    best : float
        Safe gain, at most 1, with the smallest `rms`; 0 where none lowers it.
    hint : float or None
        Gain from which the describing function predicts a limit cycle; a hint, not a limit.
    limited_by : str
        The motion on which the next gain of the sweep is not safe; empty at the end of the sweep.
    count : float
        Angle of an encoder count, rad (m), in which limit cycles are measured; 0 for an ideal encoder.
    worst : tuple of str
        For each gain the motion with the largest `rms`; "" without compensation or where the encoder resolves none,
        and empty where it is not known.
    unresolved : tuple of Unresolved
        Motions of the design's plant that have no part in `rms`.
    assumed : array, shape (n,), or None
        As `rms`, on the plant with the presliding that is assumed; None where there is none, and NaN where the encoder
        does not resolve its error.
    """

    source: str
    gains: Array
    rms: Array
    judged: Array
    reversal_peak: Array
    cycle: Array
    safe: float
    best: float
    hint: float | None = None
    limited_by: str = ""
    count: float = 0.0
    worst: tuple[str, ...] = ()
    unresolved: tuple[Unresolved, ...] = ()
    assumed: Array | None = None

    @property
    def assumed_rms(self) -> Array:
        """`assumed`, NaN where nothing is assumed."""
        return np.full(self.gains.shape, np.nan) if self.assumed is None else self.assumed

    @property
    def resolved(self) -> bool:
        """Whether the encoder resolves the error of a motion without compensation."""
        return not bool(np.isnan(self.rms).any())

    @property
    def cycle_counts(self) -> Array:
        """The limit cycles in encoder counts; in rad for an ideal encoder."""
        return self.cycle / self.count if self.count > 0.0 else self.cycle


def resolves(plain: Metrics, count: float) -> bool:
    """Return whether an encoder resolves the error of a motion.

    Its largest value is above a count, and its RMS value above that of the rounding to counts. An ideal encoder
    resolves every error.

    Parameters
    ----------
    plain : Metrics
        Without compensation.
    count : float
        Angle of an encoder count, rad (m); 0 for an ideal encoder.
    """
    return count == 0.0 or (plain.peak > count and plain.rms > ROUNDING * count)


def best_place(gains: Array, rms: Array, safe: float) -> int:
    """Return where the safe gain stands that leaves the least error, at most 1.

    Parameters
    ----------
    gains, rms : array, shape (n,)
        As in a `GainWindow`.
    safe : float
    """
    allowed = (gains <= min(safe, FULL)) & ~np.isnan(rms)
    return int(np.argmin(np.where(allowed, rms, np.inf)))


def sweep_gains(step: float) -> tuple[float, ...]:
    """Return the gains of a sweep from 0 to 1.5.

    Parameters
    ----------
    step : float
        Between two gains.
    """
    return tuple(round(step * k, 6) for k in range(int(HIGHEST / step + 1e-9) + 1))


GAINS = sweep_gains(0.1)


def gain_window(
    run: Run,
    motions: Iterable[str],
    source: str,
    *,
    gains: Iterable[float] = GAINS,
    at_rest: Iterable[str] = (),
    resolution: float = 0.0,
    assumed: Iterable[str] = (),
    factors: Iterable[float] = FACTORS,
) -> GainWindow:
    """Sweep the gain over motions, each with its plant, and parameter errors: for a safe gain those of `FACTORS`.

    Parameters
    ----------
    run : callable
        Returns the metrics of a simulation, from gain, factor on the compensated parameters, and motion.
    motions : iterable of str
    source : str
        Only named in the result.
    gains : iterable of float
    at_rest : iterable of str
        Motions judged by their limit cycles alone: their RMS error depends mostly on where the axis happens to stop.
    resolution : float
        Angle of an encoder count, rad (m): a safe gain is judged with errors below it taken as it, since the drive
        cannot tell them apart. A motion whose error it does not resolve without compensation is judged, but cannot
        show an improvement.
    assumed : iterable of str
        Motions on a plant of which a part is assumed: they have no part in `rms`.
    factors : iterable of float
        On the compensated parameters, for the error that is left.

    Returns
    -------
    GainWindow
    """
    names, resting, supposed = tuple(motions), set(at_rest), set(assumed)
    swept = np.array(sorted(set(gains) | {0.0}))
    plain = {name: run(0.0, 1.0, name) for name in names}
    moving = [name for name in names if name not in resting]
    shown = [name for name in moving if name not in supposed and resolves(plain[name], resolution)]
    beside = [name for name in moving if name in supposed and resolves(plain[name], resolution)]
    rms, judged, peak, other = (np.ones(swept.size) for _ in range(4))
    cycle = np.full(swept.size, max(metrics.cycle_amplitude for metrics in plain.values()))
    limits, worst_on = [""] * swept.size, [""] * swept.size
    for k, gain in enumerate(swept[1:].tolist(), start=1):
        worst = {name: _worst([run(gain, f, name) for f in FACTORS], plain[name], resolution) for name in names}
        tried = {name: max(run(gain, f, name).rms for f in factors) for name in (*shown, *beside)}
        left = {name: _ratio(rms_of, plain[name].rms, 0.0) for name, rms_of in tried.items()}
        worst_on[k] = max(shown, key=lambda name: left[name], default="")
        rms[k] = left[worst_on[k]] if shown else np.nan
        other[k] = max((left[name] for name in beside), default=np.nan)
        judged[k], peak[k] = max(worst[n].judged for n in moving), max(worst[n].reversal_peak for n in moving)
        cycle[k] = max(found.cycle for found in worst.values())
        by_cycle = max(worst, key=lambda name: worst[name].cycle)
        limits[k] = by_cycle if worst[by_cycle].cycle > 0.0 else max(moving, key=lambda name: worst[name].judged)
    good = (cycle == 0.0) & (judged <= WORSE)
    good[0] = True
    reach = int(np.argmin(good)) - 1 if not good.all() else swept.size - 1
    safe, limited = float(swept[reach]), limits[reach + 1] if reach + 1 < swept.size else ""
    best = float(swept[best_place(swept, rms, safe)])
    own = [name for name in moving if name not in supposed]
    return GainWindow(
        source, swept, rms, judged, peak, cycle, safe, best, limited_by=limited, count=resolution,
        worst=tuple(worst_on), unresolved=_unresolved(plain, own, resolution), assumed=other if supposed else None,
    )  # fmt: skip


def _unresolved(plain: dict[str, Metrics], moving: Iterable[str], count: float) -> tuple[Unresolved, ...]:
    found = ((name, plain[name]) for name in moving if not resolves(plain[name], count))
    return tuple(Unresolved(name, metrics.rms / count, metrics.peak / count) for name, metrics in found)


@dataclass(frozen=True)
class _Worst:
    """The worst of a motion over parameter errors: errors as shares of those without, the limit cycle in rad (m)."""

    judged: float
    reversal_peak: float
    cycle: float


def _worst(found: list[Metrics], plain: Metrics, resolution: float) -> _Worst:
    """Return the worst of a motion; a limit cycle that the axis has anyway does not count."""
    return _Worst(
        max(_ratio(m.rms, plain.rms, resolution) for m in found),
        max(_ratio(m.reversal_peak, plain.reversal_peak, resolution) for m in found),
        max((m.cycle_amplitude for m in found if m.cycle_amplitude > LARGER * plain.cycle_amplitude), default=0.0),
    )


def _ratio(value: float, reference: float, least: float) -> float:
    value, reference = max(value, least), max(reference, least)
    return value / reference if reference > 0.0 else 1.0
