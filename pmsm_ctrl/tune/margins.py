"""Margins of a loop, of a model or measured: one table either way.

The margins are python-control's own (`stability_margins`, `disk_margins`); a measured frequency response goes
through the same functions as an FRD.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.tune.sampled import frequencies

__all__ = ["Margins", "first_crossing", "margins", "response"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
REACH = 16  # points on either side of a crossing: what one bends of a cubic spline falls to a quarter with each


@dataclass(frozen=True)
class Margins:
    """What a loop tolerates, and how fast it is.

    Attributes
    ----------
    stable : bool or None
        Whether the closed loop is stable; None for a measured response, which alone cannot tell.
    gain_margin, gain_reduction : float
        Factors by which the gain may rise, or fall to, before the loop oscillates; inf and 0 where nothing does.
    phase_margin : deg
    delay_margin : s
    disk_margin : float
        Balanced disk margin alpha (Seiler, Packard, Gahinet 2020): gain and phase vary together inside a disk.
    sensitivity_peak, complementary_peak : largest abs(S) and abs(T)
    crossover, phase_crossover, bandwidth : Hz
        The first abs(L) = 1; phase -180 deg; closed loop at -3 dB. A resonance may cross again further up: the
        phase and delay margins are the worst of all crossings.
    """

    stable: bool | None
    gain_margin: float
    gain_reduction: float
    phase_margin: float
    delay_margin: float
    disk_margin: float
    sensitivity_peak: float
    complementary_peak: float
    crossover: float
    phase_crossover: float
    bandwidth: float

    @property
    def gain_margin_db(self) -> float:
        """Gain margin in dB."""
        return 20.0 * math.log10(self.gain_margin) if self.gain_margin > 0.0 else -math.inf

    def to_dict(self) -> dict[str, Any]:
        """Return the figures by name, units in the name."""
        return {
            "stable": self.stable, "gain_margin_db": self.gain_margin_db, "gain_reduction": self.gain_reduction,
            "phase_margin_deg": self.phase_margin, "delay_margin_s": self.delay_margin,
            "disk_margin": self.disk_margin, "sensitivity_peak": self.sensitivity_peak,
            "complementary_peak": self.complementary_peak, "crossover_hz": self.crossover,
            "phase_crossover_hz": self.phase_crossover, "bandwidth_hz": self.bandwidth,
        }  # fmt: skip


def response(system: Any, omega: Array) -> Complex:
    """Frequency response of a SISO system or FRD at omega in rad/s, shape (n,)."""
    if isinstance(system, ct.FrequencyResponseData):
        return np.asarray(system.complex).reshape(-1)
    period = system.dt
    at = np.exp(1j * omega * period) if period else 1j * omega
    if isinstance(system, ct.StateSpace) and system.nstates:
        # all frequencies in one call: python-control solves them one by one
        pencil = at[:, None, None] * np.eye(system.nstates) - system.A
        inner = system.C @ np.linalg.solve(pencil, np.broadcast_to(system.B, (len(at), *system.B.shape)))
        return np.asarray(inner[:, 0, 0] + system.D[0, 0], dtype=np.complex128)
    return np.asarray(system(at, squeeze=True), dtype=np.complex128).reshape(-1)


def margins(loop: Any, omega: Array | None = None, *, brief: bool = False) -> Margins:
    """Return the margins of an open loop (negative feedback is understood).

    Parameters
    ----------
    loop : control.StateSpace, TransferFunction or FRD
        The open loop, continuous or discrete. A pure delay is given as an FRD.
    omega : array, optional
        Frequencies in rad/s; for an FRD its own are used.
    brief : bool
        Take the disk margin from its definition for one loop instead of from `control.disk_margins`, which
        computes it frequency by frequency; the same number, found faster, for scans over many plants.

    Returns
    -------
    Margins
    """
    measured = isinstance(loop, ct.FrequencyResponseData)
    if measured:
        omega = np.asarray(loop.omega)
    elif omega is None:
        if not loop.dt:
            raise ValueError("a continuous loop needs its frequencies")
        omega = frequencies(loop.dt)
    L = response(loop, omega)
    near = _near_crossings(L)
    data = ct.frd(L[near], omega[near])
    gain, phase, _, w_phase, w_gain, _ = ct.stability_margins(data, returnall=True)
    gain, phase = np.asarray(gain, float), np.asarray(phase, float)
    # A phase margin is counted to the nearer side; crossings far above are kept, they count as well.
    phase = (phase + 180.0) % 360.0 - 180.0
    up, down = gain[gain > 1.0], gain[gain < 1.0]
    S, T = 1.0 / (1.0 + L), L / (1.0 + L)
    worst = int(np.argmin(np.abs(phase))) if phase.size else -1
    lag = np.where(phase >= 0.0, phase, phase + 360.0)
    return Margins(
        stable=None if measured else _stable(loop),
        gain_margin=float(up.min()) if up.size else math.inf,
        gain_reduction=float(down.max()) if down.size else 0.0,
        phase_margin=float(phase[worst]) if phase.size else math.inf,
        delay_margin=float((np.radians(lag) / w_gain).min()) if phase.size else math.inf,
        disk_margin=_disk_margin(loop, S, T, omega, measured or brief),
        sensitivity_peak=float(np.abs(S).max()),
        complementary_peak=float(np.abs(T).max()),
        crossover=float(np.min(w_gain)) / (2.0 * math.pi) if phase.size else math.nan,
        phase_crossover=float(w_phase[int(np.argmin(np.where(gain > 1.0, gain, math.inf)))]) / (2.0 * math.pi)
        if up.size
        else math.nan,
        bandwidth=first_crossing(omega, np.abs(T), math.sqrt(0.5)) / (2.0 * math.pi),
    )


def _near_crossings(L: Complex) -> NDArray[np.intp]:
    """Places around which abs(L) crosses 1 or the phase -180 deg, or the first few where nothing does.

    `control.stability_margins` evaluates its spline point by point; so far from a crossing no point bends it there.
    """
    near = np.arange(len(L)) < 2 * REACH
    for crossing in (np.abs(L) - 1.0, np.angle(-L)):
        for k in np.flatnonzero(np.diff(np.sign(crossing))):
            near[max(0, k - REACH) : k + REACH + 2] = True
    return np.flatnonzero(near)


def _stable(loop: Any) -> bool:
    poles = ct.feedback(ct.ss(loop), 1).poles()
    if loop.dt:
        return bool(np.all(np.abs(poles) < 1.0))
    return bool(np.all(poles.real < 0.0))


def _disk_margin(loop: Any, S: Complex, T: Complex, omega: Array, direct: bool) -> float:
    if direct:
        # control.disk_margins takes no FRD; for one loop it is the largest disk around (S - T)/2 by definition.
        return float(1.0 / np.abs(0.5 * (S - T)).max())
    return float(ct.disk_margins(ct.ss(loop), omega)[0])


def first_crossing(omega: Array, magnitude: Array, level: float) -> float:
    """Frequency at which a magnitude first falls below a level, interpolated on logarithmic axes; NaN if never.

    `control.bandwidth` does the same for a model but searches beyond the Nyquist frequency and takes no FRD.
    """
    below = np.flatnonzero((magnitude[1:] < level) & (magnitude[:-1] >= level))
    if not below.size:
        return math.nan
    k = int(below[0])
    x, y = np.log(omega[k : k + 2]), np.log(magnitude[k : k + 2])
    return float(np.exp(x[0] + (math.log(level) - y[0]) * (x[1] - x[0]) / (y[1] - y[0])))
