"""Units at the edges: inside, the package uses SI; this module converts.

Two tables live here. `UNITS` maps the spelling of a unit in a file to its SI unit and factor.
`DATASHEET` maps the name of a datasheet value, which carries its unit and its convention,
to the SI field it determines.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

__all__ = [
    "DATASHEET", "UNITS", "DatasheetValue", "axis_unit", "drives", "encoder_span", "encoder_step", "psi_f_from",
    "rounded", "torque_constant",
]  # fmt: skip

DIGITS = 2  # of the standard error that a rounded value keeps, as the GUM (7.2.6) has it
RPM = 2.0 * math.pi / 60.0
KRPM = 1000.0 * RPM
DEGREE = math.pi / 180.0

# spelling -> (SI unit, factor): value_SI = factor * value
UNITS: dict[str, tuple[str, float]] = {
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "µs": ("s", 1e-6), "ns": ("s", 1e-9), "min": ("s", 60.0),
    "rad": ("rad", 1.0), "deg": ("rad", DEGREE), "°": ("rad", DEGREE), "rev": ("rad", 2 * math.pi),
    "mrad": ("rad", 1e-3), "mrad/s": ("rad/s", 1e-3),
    "rad/s": ("rad/s", 1.0), "rpm": ("rad/s", RPM), "1/min": ("rad/s", RPM), "min-1": ("rad/s", RPM),
    "deg/s": ("rad/s", DEGREE), "rev/s": ("rad/s", 2 * math.pi),
    "rad/s^2": ("rad/s^2", 1.0),
    "A": ("A", 1.0), "A peak": ("A", 1.0), "mA": ("A", 1e-3), "A rms": ("A", math.sqrt(2.0)),
    "mA rms": ("A", 1e-3 * math.sqrt(2.0)), "mA peak": ("A", 1e-3),
    "V": ("V", 1.0), "mV": ("V", 1e-3),
    "N m": ("N m", 1.0), "Nm": ("N m", 1.0), "mN m": ("N m", 1e-3), "mNm": ("N m", 1e-3), "N*m": ("N m", 1.0),
    "m": ("m", 1.0), "mm": ("m", 1e-3), "um": ("m", 1e-6), "µm": ("m", 1e-6),
    "m/s": ("m/s", 1.0), "mm/s": ("m/s", 1e-3), "mm/min": ("m/s", 1e-3 / 60.0), "m/min": ("m/s", 1.0 / 60.0),
    "m/s^2": ("m/s^2", 1.0),
    "N": ("N", 1.0), "kN": ("N", 1e3),
    "degC": ("degC", 1.0), "°C": ("degC", 1.0),
    "1": ("1", 1.0), "-": ("1", 1.0), "%": ("1", 0.01),
}  # fmt: skip


# A rotary unit and its linear equivalent; longer ones first.
_ALONG_A_LINE = ((r"\(N m\)\^2", "N^2"), (r"N m", "N"), (r"kg m\^2", "kg"), (r"\brad\b", "m"))


def axis_unit(text: str, motion: str) -> str:
    """Return a rotary unit, or a text that holds some, for this kind of axis: N m s/rad becomes N s/m.

    Parameters
    ----------
    text : str
    motion : {"rotary", "linear"}

    Returns
    -------
    str
    """
    for turning, moving in _ALONG_A_LINE if motion == "linear" else ():
        text = re.sub(turning, moving, text)
    return text


def axis_words(text: str, motion: str) -> str:
    """Return a text of a shaft with the units and the words of this kind of axis: a force in place of a torque.

    Parameters
    ----------
    text : str
    motion : {"rotary", "linear"}

    Returns
    -------
    str
    """
    if motion != "linear":
        return text
    return axis_unit(text, motion).replace("torque", "force").replace("Torque", "Force")


def drives(motion: str) -> str:
    """Return the word for what drives this kind of axis.

    Parameters
    ----------
    motion : {"rotary", "linear"}

    Returns
    -------
    str
        "torque" or "force".
    """
    return "force" if motion == "linear" else "torque"


def encoder_span(motion: str) -> float:
    """Return what the stated counts of an encoder divide: a turn, 2 pi rad, or a metre.

    Parameters
    ----------
    motion : {"rotary", "linear"}

    Returns
    -------
    float
        rad (m).
    """
    return 1.0 if motion == "linear" else 2.0 * math.pi


def encoder_step(counts: int, motion: str) -> float:
    """Return the step of an encoder.

    Parameters
    ----------
    counts : int
        Per turn (per metre); 0 for an ideal encoder.
    motion : {"rotary", "linear"}

    Returns
    -------
    float
        rad (m); 0 for an ideal encoder.
    """
    return encoder_span(motion) / counts if counts else 0.0


def torque_constant(p: float, psi_f: float) -> float:
    """Torque constant K_t = 3/2 p psi_f in N m per ampere peak (amplitude-invariant dq scaling).

    Parameters
    ----------
    p : float
        Pole pairs, of a linear axis in 2 pi m.
    psi_f : float
        Permanent-magnet flux linkage, Wb.

    Returns
    -------
    float
    """
    return 1.5 * p * psi_f


def psi_f_from(K_t: float, p: float) -> float:
    """Permanent-magnet flux linkage in Wb from the torque constant in N m per ampere peak.

    Parameters
    ----------
    K_t : float
        N m/A peak.
    p : float
        Pole pairs, of a linear axis in 2 pi m.

    Returns
    -------
    float
    """
    return K_t / (1.5 * p)


@dataclass(frozen=True)
class DatasheetValue:
    """How one datasheet number becomes an SI field: ``field = factor * value`` (``/ p`` where flux needs it).

    Attributes
    ----------
    field : str
        The SI field.
    factor : float
    meaning : str
        Unit and convention of the sheet.
    per_pole_pair : bool
        Whether the value is divided by the pole pairs.
    """

    field: str
    factor: float
    meaning: str
    per_pole_pair: bool = False

    def to_si(self, value: float, p: float) -> float:
        """Return the SI value; `p` is the number of pole pairs.

        Parameters
        ----------
        value : float
            As the sheet states it.
        p : float
            Pole pairs.

        Returns
        -------
        float
        """
        return self.factor * value / (p if self.per_pole_pair else 1)


# K_t in N m per A rms is sqrt(2) larger than per A peak, and psi_f = K_t,peak / (1.5 p).
# An EMF constant is a voltage amplitude per mechanical speed: psi_f = E_phase,peak / (p omega).
_FLUX_FROM_KT = 1.0 / 1.5
_LINE = 1.0 / math.sqrt(3.0)
_RMS = math.sqrt(2.0)


def _emf(convention: float, speed: float, meaning: str) -> DatasheetValue:
    return DatasheetValue("psi_f", convention / speed, meaning, per_pole_pair=True)


DATASHEET: dict[str, DatasheetValue] = {
    "K_t_peak": DatasheetValue("psi_f", _FLUX_FROM_KT, "N m per A peak", per_pole_pair=True),
    "K_t_rms": DatasheetValue("psi_f", _FLUX_FROM_KT / _RMS, "N m per A rms", per_pole_pair=True),
    "K_e_phase_peak_per_rad_s": _emf(1.0, 1.0, "V peak, phase, per rad/s mechanical"),
    "K_e_phase_rms_per_rad_s": _emf(_RMS, 1.0, "V rms, phase, per rad/s mechanical"),
    "K_e_line_peak_per_rad_s": _emf(_LINE, 1.0, "V peak, line-to-line, per rad/s mechanical"),
    "K_e_line_rms_per_rad_s": _emf(_RMS * _LINE, 1.0, "V rms, line-to-line, per rad/s mechanical"),
    "K_e_phase_peak_per_krpm": _emf(1.0, KRPM, "V peak, phase, per 1000 rpm"),
    "K_e_phase_rms_per_krpm": _emf(_RMS, KRPM, "V rms, phase, per 1000 rpm"),
    "K_e_line_peak_per_krpm": _emf(_LINE, KRPM, "V peak, line-to-line, per 1000 rpm"),
    "K_e_line_rms_per_krpm": _emf(_RMS * _LINE, KRPM, "V rms, line-to-line, per 1000 rpm"),
    "J_kg_cm2": DatasheetValue("J", 1e-4, "kg cm^2"),
    "J_g_cm2": DatasheetValue("J", 1e-7, "g cm^2"),
    "R_line_to_line": DatasheetValue("R", 0.5, "Ohm between two terminals (star equivalent)"),
    "L_d_mH": DatasheetValue("L_d", 1e-3, "mH, phase"),
    "L_q_mH": DatasheetValue("L_q", 1e-3, "mH, phase"),
    "L_mH": DatasheetValue("L", 1e-3, "mH, phase, both axes"),
    "L_line_to_line_mH": DatasheetValue("L", 0.5e-3, "mH between two terminals, both axes"),
    "L_d_line_to_line_mH": DatasheetValue("L_d", 0.5e-3, "mH between two terminals, d axis aligned"),
    "L_q_line_to_line_mH": DatasheetValue("L_q", 0.5e-3, "mH between two terminals, q axis aligned"),
    "i_max_rms": DatasheetValue("i_max", _RMS, "A rms"),
}


def rounded(value: float, stderr: float) -> float:
    """Return a value without the digits that its standard error makes meaningless.

    Parameters
    ----------
    value, stderr : float
        Where the standard error is not known (NaN, infinite or 0) the value stays as it is.

    Returns
    -------
    float
    """
    if not (math.isfinite(stderr) and stderr > 0.0 and math.isfinite(value)):
        return value
    return round(value, DIGITS - 1 - math.floor(math.log10(stderr)))
