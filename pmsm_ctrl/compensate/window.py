"""The range of safe gains of the compensation, by time simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compensate.metrics import Metrics

__all__ = ["FACTORS", "GAINS", "GainWindow", "gain_window", "sweep_gains"]

Array = NDArray[np.float64]

HIGHEST = 1.5  # gain at which a sweep ends
FACTORS = (0.8, 1.0, 1.2)  # on the compensated parameters
WORSE = 1.05  # largest RMS error of a safe gain, as a share of that without compensation
LARGER = 1.5  # amplitude from which a limit cycle is attributed to the compensation, relative to that without
Run = Callable[[float, float, str], Metrics]  # gain, factor on the parameters, motion


@dataclass(frozen=True, eq=False)
class GainWindow:
    """Result of a sweep of the gain.

    Attributes
    ----------
    source : str
        "reference", "commanded" or "measured".
    gains : array, shape (n,)
    rms : array, shape (n,)
        Worst RMS error over motions and parameter errors, as a share of that without compensation.
    reversal_peak : array, shape (n,)
        The same for the peak after a change of direction.
    cycle : array, shape (n,)
        Largest limit cycle at rest over motions and parameter errors, rad; 0 when there was none.
    safe : float
        Highest gain of the sweep up to which there is no limit cycle and no RMS error is worse; else 0.
    best : float
        Safe gain with the smallest worst RMS error.
    hint : float or None
        Gain from which the describing function predicts a limit cycle; a hint, not a limit.
    limited_by : str
        The motion on which the next gain of the sweep is not safe; empty at the end of the sweep.
    count : float
        Angle of an encoder count, rad (m), in which limit cycles are measured; 0 for an ideal encoder.
    worst : tuple of str
        For each gain the motion with the worst RMS error; "" without compensation, and empty where it is not known.
    """

    source: str
    gains: Array
    rms: Array
    reversal_peak: Array
    cycle: Array
    safe: float
    best: float
    hint: float | None = None
    limited_by: str = ""
    count: float = 0.0
    worst: tuple[str, ...] = ()

    @property
    def cycle_counts(self) -> Array:
        """The limit cycles in encoder counts; in rad for an ideal encoder."""
        return self.cycle / self.count if self.count > 0.0 else self.cycle


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
) -> GainWindow:
    """Sweep the gain over motions, each with its plant, and parameter errors (`FACTORS`).

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
        Angle of an encoder count, rad (m): errors below it count as it, since the drive cannot tell them apart.

    Returns
    -------
    GainWindow
    """
    names, resting = tuple(motions), set(at_rest)
    swept = np.array(sorted(set(gains) | {0.0}))
    plain = {name: run(0.0, 1.0, name) for name in names}
    rms, peak, cycle = np.ones(swept.size), np.ones(swept.size), np.zeros(swept.size)
    cycle[0] = max(metrics.cycle_amplitude for metrics in plain.values())
    limits, worst_on = [""] * swept.size, [""] * swept.size
    for k, gain in enumerate(swept[1:].tolist(), start=1):
        worst = {name: _worst([run(gain, f, name) for f in FACTORS], plain[name], resolution) for name in names}
        moving = {name: found for name, found in worst.items() if name not in resting}
        rms[k], peak[k] = (max(found[n] for found in moving.values()) for n in (0, 1))
        cycle[k] = max(found[2] for found in worst.values())
        by_cycle = max(worst, key=lambda name: worst[name][2])
        worst_on[k] = max(moving, key=lambda name: moving[name][0])
        limits[k] = by_cycle if worst[by_cycle][2] > 0.0 else worst_on[k]
    good = (cycle == 0.0) & (rms <= WORSE)
    good[0] = True
    reach = int(np.argmin(good)) - 1 if not good.all() else swept.size - 1
    best = int(np.argmin(rms[: reach + 1]))
    limited = limits[reach + 1] if reach + 1 < swept.size else ""
    return GainWindow(
        source, swept, rms, peak, cycle, float(swept[reach]), float(swept[best]), limited_by=limited, count=resolution,
        worst=tuple(worst_on),
    )  # fmt: skip


def _worst(found: list[Metrics], plain: Metrics, resolution: float) -> tuple[float, float, float]:
    """Return the worst RMS error and reversal peak as shares of those without, and the largest limit cycle, rad (m).

    A limit cycle that the axis has anyway does not count.
    """
    return (
        max(_ratio(m.rms, plain.rms, resolution) for m in found),
        max(_ratio(m.reversal_peak, plain.reversal_peak, resolution) for m in found),
        max((m.cycle_amplitude for m in found if m.cycle_amplitude > LARGER * plain.cycle_amplitude), default=0.0),
    )


def _ratio(value: float, reference: float, resolution: float) -> float:
    value, reference = max(value, resolution), max(reference, resolution)
    return value / reference if reference > 0.0 else 1.0
