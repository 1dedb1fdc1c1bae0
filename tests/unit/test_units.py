"""Every unit and every datasheet convention against a closed form."""

from __future__ import annotations

import math

import pytest

from pmsm_ctrl.units import DATASHEET, UNITS, axis_unit, drives, psi_f_from, torque_constant

# spelling, SI unit, what one of it is in SI: definitions, written without the package's constants
DEFINITIONS = [
    ("s", "s", 1.0), ("ms", "s", 1e-3), ("us", "s", 1e-6), ("µs", "s", 1e-6), ("ns", "s", 1e-9), ("min", "s", 60.0),
    ("rad", "rad", 1.0), ("deg", "rad", 0.017453292519943295), ("°", "rad", 0.017453292519943295),
    ("rev", "rad", 6.283185307179586),
    ("rad/s", "rad/s", 1.0), ("rpm", "rad/s", 0.10471975511965977), ("1/min", "rad/s", 0.10471975511965977),
    ("min-1", "rad/s", 0.10471975511965977), ("deg/s", "rad/s", 0.017453292519943295),
    ("rev/s", "rad/s", 6.283185307179586), ("rad/s^2", "rad/s^2", 1.0),
    ("A", "A", 1.0), ("A peak", "A", 1.0), ("mA", "A", 1e-3), ("A rms", "A", 1.4142135623730951),
    ("mA peak", "A", 1e-3), ("mA rms", "A", 1.4142135623730951e-3), ("mrad", "rad", 1e-3), ("mrad/s", "rad/s", 1e-3),
    ("V", "V", 1.0), ("mV", "V", 1e-3),
    ("N m", "N m", 1.0), ("Nm", "N m", 1.0), ("N*m", "N m", 1.0), ("mN m", "N m", 1e-3), ("mNm", "N m", 1e-3),
    ("m", "m", 1.0), ("mm", "m", 1e-3), ("um", "m", 1e-6), ("µm", "m", 1e-6),
    ("m/s", "m/s", 1.0), ("mm/s", "m/s", 1e-3), ("mm/min", "m/s", 1.6666666666666667e-05),
    ("m/min", "m/s", 0.016666666666666666), ("m/s^2", "m/s^2", 1.0), ("N", "N", 1.0), ("kN", "N", 1e3),
    ("degC", "degC", 1.0), ("°C", "degC", 1.0), ("1", "1", 1.0), ("-", "1", 1.0), ("%", "1", 0.01),
]  # fmt: skip


@pytest.mark.parametrize(("spelling", "si", "factor"), DEFINITIONS)
def test_unit(spelling: str, si: str, factor: float) -> None:
    found, value = UNITS[spelling]
    assert found == si
    assert value == pytest.approx(factor, rel=1e-15)


def test_every_unit_has_a_definition_here() -> None:
    assert {spelling for spelling, _, _ in DEFINITIONS} == set(UNITS)


# One motor, p = 4 and psi_f = 0.172 Wb, described in every convention; speeds and amplitudes by hand:
# the phase EMF amplitude is p psi_f omega, line-to-line it is sqrt(3) larger, rms it is sqrt(2) smaller,
# and 1000 rpm are 104.71975511965977 rad/s. Torque is 1.5 p psi_f per ampere of amplitude.
P, PSI = 4, 0.172
PHASE_PEAK = 0.688
KRPM = 104.71975511965977
SAME_MOTOR = {
    "K_t_peak": 1.032,
    "K_t_rms": 1.032 * 1.4142135623730951,
    "K_e_phase_peak_per_rad_s": PHASE_PEAK,
    "K_e_phase_rms_per_rad_s": PHASE_PEAK / 1.4142135623730951,
    "K_e_line_peak_per_rad_s": PHASE_PEAK * 1.7320508075688772,
    "K_e_line_rms_per_rad_s": PHASE_PEAK * 1.224744871391589,
    "K_e_phase_peak_per_krpm": PHASE_PEAK * KRPM,
    "K_e_phase_rms_per_krpm": PHASE_PEAK * KRPM / 1.4142135623730951,
    "K_e_line_peak_per_krpm": PHASE_PEAK * KRPM * 1.7320508075688772,
    "K_e_line_rms_per_krpm": PHASE_PEAK * KRPM * 1.224744871391589,
}
OTHERS = {
    "J_kg_cm2": (0.9, "J", 9e-5), "J_g_cm2": (900.0, "J", 9e-5), "R_line_to_line": (38.0, "R", 19.0),
    "L_d_mH": (49.16, "L_d", 0.04916), "L_q_mH": (49.16, "L_q", 0.04916), "L_mH": (49.16, "L", 0.04916),
    "L_line_to_line_mH": (98.32, "L", 0.04916), "L_d_line_to_line_mH": (98.32, "L_d", 0.04916),
    "L_q_line_to_line_mH": (98.32, "L_q", 0.04916), "i_max_rms": (2.0, "i_max", 2.8284271247461903),
}  # fmt: skip


@pytest.mark.parametrize("name", SAME_MOTOR)
def test_flux_from_every_convention(name: str) -> None:
    sheet = DATASHEET[name]
    assert sheet.field == "psi_f"
    assert sheet.to_si(SAME_MOTOR[name], P) == pytest.approx(PSI, rel=1e-14)


@pytest.mark.parametrize("name", OTHERS)
def test_other_datasheet_values(name: str) -> None:
    value, field, si = OTHERS[name]
    assert DATASHEET[name].field == field
    assert DATASHEET[name].to_si(value, P) == pytest.approx(si, rel=1e-14)


def test_every_datasheet_name_is_tested() -> None:
    assert set(SAME_MOTOR) | set(OTHERS) == set(DATASHEET)


def test_torque_constant_of_the_reference_motor() -> None:
    assert torque_constant(P, PSI) == pytest.approx(1.032, rel=1e-15)
    assert psi_f_from(1.032, P) == pytest.approx(PSI, rel=1e-15)
    assert math.isclose(psi_f_from(torque_constant(7, 0.01), 7), 0.01, rel_tol=1e-15)


@pytest.mark.parametrize(
    ("turning", "moving"),
    [
        ("N m", "N"), ("N m s/rad", "N s/m"), ("kg m^2", "kg"), ("rad/s^2", "m/s^2"), ("(N m)^2", "N^2"),
        ("1/A", "1/A"), ("variance of the gradient, N m", "variance of the gradient, N"),
    ],
)  # fmt: skip
def test_units_of_a_linear_axis(turning: str, moving: str) -> None:
    assert axis_unit(turning, "linear") == moving
    assert axis_unit(turning, "rotary") == turning
    assert (drives("linear"), drives("rotary")) == ("force", "torque")
