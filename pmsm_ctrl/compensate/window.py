"""The safe window of the compensation's gain, by time simulation, and the describing function's hint beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compensate.metrics import Metrics
from pmsm_ctrl.design import Design

__all__ = ["GAINS", "GainWindow", "describing_function_limit", "gain_window"]

Array = NDArray[np.float64]

GAINS = tuple(round(0.1 * k, 2) for k in range(16))
WORSE = 1.05  # RMS error as a share of that without
Run = Callable[[float, float, str], Metrics]  # gain, factor on the parameters, motion


@dataclass(frozen=True, eq=False)
class GainWindow:
    """What a sweep of the gain found.

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
        Largest gain of the sweep up to which nothing cycles and no RMS error is worse; else 0.
    best : float
        Gain with the smallest worst RMS error inside the window.
    hint : float or None
        Gain from which the describing function predicts a limit cycle; a hint, not a limit.
    """

    source: str
    gains: Array
    rms: Array
    reversal_peak: Array
    cycle: Array
    safe: float
    best: float
    hint: float | None


def gain_window(
    run: Run, motions: Iterable[str], source: str, *, gains: Iterable[float] = GAINS,
    factors: Iterable[float] = (0.8, 1.0, 1.2), hint: float | None = None,
    at_rest: Iterable[str] = (),
) -> GainWindow:  # fmt: skip
    """Sweep the gain over motions and parameter errors.

    Parameters
    ----------
    run : function of gain, factor on the compensated parameters, and motion
        Returns the metrics of that simulation.
    at_rest : iterable of str
        Motions judged by their limit cycles alone: their RMS error is mostly where the axis happens to stop.
    """
    names, off, resting = tuple(motions), tuple(factors), set(at_rest)
    swept = np.array(sorted(set(gains) | {0.0}))
    plain = {name: run(0.0, 1.0, name) for name in names}
    rms, peak, cycle = np.ones(swept.size), np.ones(swept.size), np.zeros(swept.size)
    cycle[0] = max(metrics.cycle_amplitude for metrics in plain.values())
    for k, gain in enumerate(swept.tolist()):
        if gain == 0.0:
            continue
        pairs = [(name, plain[name], run(gain, factor, name)) for name in names for factor in off]
        found = [(without, with_it) for _, without, with_it in pairs]
        moving = [(without, with_it) for name, without, with_it in pairs if name not in resting]
        rms[k] = max(_ratio(with_it.rms, without.rms) for without, with_it in moving)
        peak[k] = max(_ratio(with_it.reversal_peak, without.reversal_peak) for without, with_it in moving)
        # A cycle that is there without compensation as well is not the compensation's fault.
        cycle[k] = max(
            (with_it.cycle_amplitude for without, with_it in found
             if with_it.cycle_amplitude > 1.5 * without.cycle_amplitude), default=0.0,
        )  # fmt: skip
    good = (cycle == 0.0) & (rms <= WORSE)
    good[0] = True
    reach = int(np.argmin(good)) - 1 if not good.all() else swept.size - 1
    best = int(np.argmin(rms[: reach + 1]))
    return GainWindow(source, swept, rms, peak, cycle, float(swept[reach]), float(swept[best]), hint)


def _ratio(value: float, reference: float) -> float:
    return value / reference if reference > 0.0 else 1.0


def describing_function_limit(design: Design, source: str, gains: Iterable[float] = GAINS) -> float | None:
    """Smallest gain at which a compensation should cycle at rest, by describing functions; None when at none.

    Friction is a relay ``-F_c sgn(omega)`` on the true speed, the compensation a relay of `gain` F_c on what is
    acted on: the measured speed, a lag ``H`` later, or the commanded speed, which at rest is ``-K_v theta``, so
    ``H = -K_v / (j w)`` times its lag. Both see the same sine of amplitude A: a cycle needs
    ``Z(j w) + 4 F_c / (pi A) (1 - gain sgn H(j w)) = 0`` with Z the axis under speed and position control, torque
    over speed; of H only the phase counts, a relay does not see amplitudes. Where the sign is smoothed, a cycle
    whose amplitude stays within the width is none. The reference speed rests, so its relay does nothing.

    Source: K. J. Astrom, IEEE Trans. Automat. Contr. 43 (1998); A. Gelb, W. E. Vander Velde, Multiple-Input
    Describing Functions, McGraw-Hill 1968. Armstrong and Amin (Automatica 32 (1996) 679) show that it misleads for
    stiction under integral control, so it is given beside the simulation and never instead.
    """
    if design.loops is None or source not in ("measured", "commanded"):
        return None
    speed, position = design.loops.speed, design.loops.position
    T_s = design.drive.speed_period
    lag = design.sensor.speed_filter + 0.5 * T_s
    act = T_s + 2.0 / design.drive.f_control
    w = np.geomspace(1.0, 0.5 / T_s, 4000)
    s = 1j * w
    seen, acted = np.exp(-0.5 * T_s * s) / (1.0 + (lag - 0.5 * T_s) * s), np.exp(-act * s)
    control = speed.K_p * (1.0 + 1.0 / (speed.T_n * s)) * acted
    Z = design.J * s + design.K_t * control * (seen + position.K_v / s)
    H = seen * acted if source == "measured" else -position.K_v / s * acted
    F_c = design.parameters("coulomb").get("F_c", 0.0)
    for gain in sorted(gains):
        needed = -(1.0 - gain * H / np.abs(H)) / Z
        crossing = np.flatnonzero(np.diff(np.sign(needed.imag)) != 0)
        for k in crossing.tolist():
            amplitude = 4.0 * F_c / np.pi * needed.real[k]
            width = design.compensation.smoothing if source == "commanded" else 0.0
            if needed.real[k] > 0.0 and amplitude * position.K_v / w[k] >= width:
                return float(gain)
    return None


def rows(window: GainWindow) -> list[tuple[str, ...]]:
    """Return the sweep as rows of a table."""
    return [
        (f"{100 * gain:.0f} %", f"{100 * rms:.0f} %", f"{100 * peak:.0f} %", f"{cycle:.2g}" if cycle else "none",
         "safe" if gain <= window.safe else "not safe")
        for gain, rms, peak, cycle in zip(window.gains, window.rms, window.reversal_peak, window.cycle, strict=True)
    ]  # fmt: skip


def to_plain(window: GainWindow) -> Mapping[str, Any]:
    """Return plain values."""
    return {name: getattr(window, name) for name in window.__dataclass_fields__}
