"""Stability margins of a loop, modelled or measured.

Gain, phase and delay margins are those of `control.stability_margins`, on the same spline through the response; the
disk margin follows from its definition for one loop. A measured response goes through the same function as an FRD.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from pmsm_ctrl.tune.sampled import frequencies, responses

__all__ = ["Margins", "first_crossing", "margins", "measured", "resolved", "response"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
LIGHT = 0.1  # damping ratio below which a mode gets its own frequencies


@dataclass(frozen=True)
class Margins:
    """Stability margins and speed of a loop.

    Attributes
    ----------
    stable : bool or None
        Whether the closed loop is stable; None for a measured response, from which this cannot be told.
    gain_margin, gain_reduction : float
        Factors to which the gain may rise, or fall, before the closed loop oscillates; inf and 0 without a limit.
    phase_margin : float
        Smallest over all crossings of abs(L) = 1, deg.
    delay_margin : float
        Smallest over all crossings of abs(L) = 1, s.
    disk_margin : float
        Balanced disk margin alpha (Seiler, Packard, Gahinet 2020): gain and phase vary together inside a disk.
    sensitivity_peak, complementary_peak : float
        Largest abs(S) and abs(T).
    crossover : float
        Lowest frequency with abs(L) = 1, Hz. A resonance may cross again further up.
    phase_margin_crossover : float
        The one of these frequencies at which the phase margin is, Hz.
    phase_crossover : float
        Frequency of the gain margin: phase -180 deg, Hz.
    bandwidth : float
        -3 dB frequency of the closed loop, Hz.
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
    phase_margin_crossover: float
    phase_crossover: float
    bandwidth: float

    @property
    def gain_margin_db(self) -> float:
        """Gain margin in dB."""
        return 20.0 * math.log10(self.gain_margin) if self.gain_margin > 0.0 else -math.inf

    def to_dict(self) -> dict[str, Any]:
        """Return the margins by name, units in the name."""
        return {
            "stable": self.stable, "gain_margin_db": self.gain_margin_db, "gain_reduction": self.gain_reduction,
            "phase_margin_deg": self.phase_margin, "delay_margin_s": self.delay_margin,
            "disk_margin": self.disk_margin, "sensitivity_peak": self.sensitivity_peak,
            "complementary_peak": self.complementary_peak, "crossover_hz": self.crossover,
            "phase_margin_crossover_hz": self.phase_margin_crossover,
            "phase_crossover_hz": self.phase_crossover, "bandwidth_hz": self.bandwidth,
        }  # fmt: skip


def response(system: Any, omega: Array) -> Complex:
    """Return the frequency response of a SISO system at omega (rad/s), shape (n,); an FRD returns its own points."""
    if isinstance(system, ct.FrequencyResponseData):
        return np.asarray(system.complex).reshape(-1)
    first: Complex = responses(system, omega)[0]
    return first


def measured(values: Complex, omega: Array) -> Any:
    """Return a measured response at rising angular frequencies (rad/s), both shape (n,), as control.FRD."""
    return ct.frd(values, omega)


def margins(loop: Any, omega: Array | None = None) -> Margins:
    """Return the margins of an open loop under negative feedback.

    Parameters
    ----------
    loop : control.StateSpace, TransferFunction or FRD
        The open loop, continuous or discrete. A pure delay is given as an FRD.
    omega : array, shape (n,), optional
        Angular frequencies, rad/s; by default 2000 up to the Nyquist frequency. An FRD uses its own.

    Returns
    -------
    Margins

    Raises
    ------
    ValueError
        When a continuous loop is given without frequencies.
    """
    given = isinstance(loop, ct.FrequencyResponseData)
    if given:
        omega = np.asarray(loop.omega)
    elif omega is None:
        if not loop.dt:
            raise ValueError("a continuous loop needs its frequencies")
        omega = frequencies(loop.dt)
    if not given:
        omega = resolved(loop, omega)
    L = response(loop, omega)
    gain, phase, w_phase, w_gain = _crossings(L, omega)
    lag = np.where(phase >= 0.0, phase, phase + 360.0)
    up, down = gain > 1.0, gain < 1.0
    S, T = 1.0 / (1.0 + L), L / (1.0 + L)
    nearest = int(np.argmin(np.abs(phase))) if phase.size else -1
    return Margins(
        stable=None if given else _stable(loop),
        gain_margin=float(gain[up].min()) if up.any() else math.inf,
        gain_reduction=float(gain[down].max()) if down.any() else 0.0,
        phase_margin=float(phase[nearest]) if phase.size else math.inf,
        delay_margin=float((np.radians(lag) / w_gain).min()) if phase.size else math.inf,
        disk_margin=float(1.0 / np.abs(0.5 * (S - T)).max()),
        sensitivity_peak=float(np.abs(S).max()),
        complementary_peak=float(np.abs(T).max()),
        crossover=float(np.min(w_gain)) / (2.0 * math.pi) if phase.size else math.nan,
        phase_margin_crossover=float(w_gain[nearest]) / (2.0 * math.pi) if phase.size else math.nan,
        phase_crossover=float(w_phase[up][np.argmin(gain[up])]) / (2.0 * math.pi) if up.any() else math.nan,
        bandwidth=first_crossing(omega, np.abs(T), math.sqrt(0.5)) / (2.0 * math.pi),
    )


def resolved(loop: Any, omega: Array) -> Array:
    """Return frequencies with more of them around the lightly damped modes of a sampled loop, rad/s, rising.

    A resonance is as narrow as its damping, and a fixed grid steps over its peak.
    """
    if not (isinstance(loop, ct.StateSpace) and loop.dt):
        return omega
    poles = np.linalg.eigvals(loop.A)
    modes = np.log(poles[(np.abs(poles) > 0.0) & (poles.imag > 0.0)]) / loop.dt
    modes = modes[(-modes.real < LIGHT * np.abs(modes)) & (modes.imag < omega[-1])]
    if not modes.size:
        return omega
    half = np.maximum(np.abs(modes.real), 1e-6 * modes.imag)
    around = modes.imag[:, None] + half[:, None] * np.sinh(np.linspace(-6.0, 6.0, 49))
    inside = around[(around > omega[0]) & (around < omega[-1])]
    return np.unique(np.concatenate([omega, inside]))


def _crossings(L: Complex, omega: Array) -> tuple[Array, Array, Array, Array]:
    """Return all gain margins, phase margins in deg to the nearer side, and the frequencies of both.

    What `control.stability_margins` returns of an FRD, which takes 20 times as long over a scalar of its two splines.
    """
    mod, arg = np.abs(L) - 1.0, np.angle(-L)
    at_gain = np.flatnonzero(np.diff(np.sign(mod)))
    at_phase = np.flatnonzero(np.diff(np.sign(arg)))
    at_phase = at_phase[L[at_phase].real <= 0.0]
    if not at_gain.size and not at_phase.size:
        none = np.empty(0)
        return none, none, none, none
    through = CubicSpline(omega, L)

    def roots(of: Callable[[complex], float], places: NDArray[np.intp]) -> Array:
        return np.array([brentq(lambda w: of(complex(through(w))), omega[k], omega[k + 1]) for k in places])

    w_gain = roots(lambda value: abs(value) - 1.0, at_gain)
    w_phase = roots(lambda value: cmath.phase(-value), at_phase)
    with np.errstate(divide="ignore"):
        gain = 1.0 / np.abs(through(w_phase))
    return gain, np.degrees(np.angle(-through(w_gain))), w_phase, w_gain


def _stable(loop: Any) -> bool:
    poles = ct.feedback(ct.ss(loop), 1).poles()
    return bool(np.all(np.abs(poles) < 1.0) if loop.dt else np.all(poles.real < 0.0))


def first_crossing(omega: Array, magnitude: Array, level: float) -> float:
    """Return the frequency at which a magnitude first falls below a level, interpolated on logarithmic axes; or NaN.

    `control.bandwidth` does the same for a model, but searches beyond the Nyquist frequency and takes no FRD.
    """
    below = np.flatnonzero((magnitude[1:] < level) & (magnitude[:-1] >= level))
    if not below.size:
        return math.nan
    k = int(below[0])
    x, y = np.log(omega[k : k + 2]), np.log(magnitude[k : k + 2])
    return float(np.exp(x[0] + (math.log(level) - y[0]) * (x[1] - x[0]) / (y[1] - y[0])))
