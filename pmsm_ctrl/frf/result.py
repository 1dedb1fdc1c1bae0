"""Measured frequency responses, what was fitted to them, and where the design's own differs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.result import Estimate, Result, jsonable
from pmsm_ctrl.section import Notice

__all__ = ["Band", "Curves", "FrequencyResponse", "Response"]

# Codes of the notices that the fitted axis is not to be taken.
NO_EXCITATION, NOT_LINEAR = "frf_no_excitation", "frf_axis_not_linear"
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Response:
    """A measured frequency response.

    Attributes
    ----------
    name : {"plant", "current", "speed", "position"}
        The axis, from drive torque to speed, or a closed loop.
    frequency : array, shape (n,)
        Hz, rising.
    value : complex array, shape (n,)
    stderr : array, shape (n,)
        Standard error of the complex value's modulus: that of its real part and of its imaginary part, times sqrt(2).
    coherence : array, shape (n,)
        Share of the output that the input explains, 0 to 1.
    instrument : str
        Channel whose content was followed through both; empty where the input was taken as exact.
    resolution : float
        Width of the window in which the response is smoothed, Hz.
    held : bool
        Whether the excitation is held between the samples; what its steps fold onto the current is taken off.
    records : int
        Over how many records it is averaged.
    """

    name: str
    frequency: Array
    value: Complex
    stderr: Array
    coherence: Array
    instrument: str
    resolution: float
    held: bool = False
    records: int = 1

    def __len__(self) -> int:
        return len(self.frequency)

    @property
    def frd(self) -> Any:
        """The response as control.FrequencyResponseData, in rad/s."""
        from pmsm_ctrl.tune.margins import measured

        return measured(self.value, 2.0 * math.pi * self.frequency)

    @property
    def open_loop(self) -> Complex:
        """Open loop of a closed one under negative feedback, shape (n,)."""
        return np.asarray(self.value / (1.0 - self.value))

    def to_dict(self) -> dict[str, Any]:
        """Return the response as lists."""
        return {
            "frequency_hz": self.frequency.tolist(), "real": self.value.real.tolist(),
            "imaginary": self.value.imag.tolist(), "stderr": self.stderr.tolist(),
            "coherence": self.coherence.tolist(), "instrument": self.instrument, "resolution_hz": self.resolution,
            "held_between_samples": self.held, "records": self.records,
        }  # fmt: skip


@dataclass(frozen=True)
class Band:
    """A range of frequencies in which the measured response is not the design's.

    Attributes
    ----------
    low, high : float
        Hz.
    ratio : float
        Measured over the design's modulus, geometric mean.
    phase : float
        Measured less the design's phase, deg.
    """

    low: float
    high: float
    ratio: float
    phase: float


@dataclass(frozen=True, eq=False)
class Curves:
    """Both models between the measured points, to be drawn: a resonance may lie between two of them.

    Attributes
    ----------
    frequency : array, shape (n,)
        Hz.
    model, fitted : complex array, shape (n,)
        As those of `FrequencyResponse`.
    """

    frequency: Array
    model: Complex
    fitted: Complex


@dataclass(frozen=True, eq=False)
class FrequencyResponse(Result):
    """Result of `frf`.

    Attributes
    ----------
    design : Design
        As given.
    measured : Design
        With the inertia and the resonance that were fitted, for `tune`; as given where these are not to be trusted.
    log_name : str
    speed : float
        Mean speed, rad/s (m/s); of a Bode diagram, which states none, the one at which the design's response is taken.
    responses : dict of name to Response
        ``plant`` and the closed loops whose reference was excited.
    model : complex array, shape (n,)
        The design's own response at the frequencies of ``plant``, (rad/s)/(N m).
    fitted : complex array, shape (n,)
        That of the fitted axis.
    curves : Curves
        Both, close enough to be drawn as lines.
    estimates : dict of name to Estimate
        Inertia, friction slope, delay; antiresonance, resonance, damping, load inertia, stiffness where there is one.
    bands : tuple of Band
        Where the design's response differs.
    margins : dict of name to (Estimate, float)
        Margins of the speed loop with the fitted axis, and with the design's.
    point_margins : dict of name to Estimate
        The same from the measured points around each crossover, with errors from those of the points alone; without
        those that lie outside of the measured range.
    window_bias : dict of name to float
        By how much the width of the windows changes inertia, antiresonance, resonance and damping, relative to each.
    widths : tuple of float
        Of antiresonance and resonance between half the power, Hz; empty where there is none.
    misfit : float
        Residual of the fit over the noise: 1 where the fit explains the measurement.
    notices : tuple of Notice
    """

    design: Design
    measured: Design
    log_name: str
    speed: float
    responses: Mapping[str, Response]
    model: Complex
    fitted: Complex
    curves: Curves
    estimates: Mapping[str, Estimate]
    bands: tuple[Band, ...] = ()
    margins: Mapping[str, tuple[Estimate, float]] = field(default_factory=dict)
    misfit: float = float("nan")
    notices: tuple[Notice, ...] = ()
    point_margins: Mapping[str, Estimate] = field(default_factory=dict)
    window_bias: Mapping[str, float] = field(default_factory=dict)
    widths: tuple[float, ...] = ()

    def __repr__(self) -> str:
        found = ", ".join(f"{name}: {len(one)} frequencies" for name, one in self.responses.items())
        return f"FrequencyResponse({self.log_name or 'log'}: {found}; {len(self.bands)} deviations)"

    @property
    def trusted(self) -> bool:
        """Whether the fitted axis may be taken: false where nothing is excited, or the response is that of no axis."""
        return not {notice.code for notice in self.notices} & {NO_EXCITATION, NOT_LINEAR}

    @property
    def verdict(self) -> str:
        """Whether the fitted axis may be taken: "trusted", "doubted" without an excitation, or "not_linear"."""
        if self.trusted:
            return "trusted"
        return "not_linear" if any(notice.code == NOT_LINEAR for notice in self.notices) else "doubted"

    @property
    def plant(self) -> Response:
        """The response from drive torque to speed."""
        return self.responses["plant"]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        margins = {
            name: {
                "measured": jsonable(found),
                "points": jsonable(self.point_margins.get(name)),
                "design": jsonable(of_design),
            }
            for name, (found, of_design) in self.margins.items()
        }
        return {
            **self.doubts(),
            "log": self.log_name,
            "trusted": self.trusted,
            "speed": self.speed,
            "estimates": jsonable(self.estimates),
            "misfit": jsonable(self.misfit),
            "window_bias": jsonable(self.window_bias),
            "widths_hz": list(self.widths),
            "deviations": [vars(band) for band in self.bands],
            "margins": margins,
            "responses": {name: one.to_dict() for name, one in self.responses.items()},
            "design_response": {"real": self.model.real.tolist(), "imaginary": self.model.imag.tolist()},
            "fitted_response": {"real": self.fitted.real.tolist(), "imaginary": self.fitted.imag.tolist()},
        }
