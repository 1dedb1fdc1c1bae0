"""Numbers with the digits they deserve."""

from __future__ import annotations

import math

import pytest

from pmsm_ctrl.rendering.numbers import fit, number, percent, probability, with_error, with_prefix


def test_plain_numbers() -> None:
    assert [number(x) for x in (0.0213, 12345.678, -1.68e-4, 0.0, math.inf, math.nan)] == [
        "0.0213", "1.235e+04", "-0.000168", "0", "inf", "-",
    ]  # fmt: skip
    assert [percent(x) for x in (0.1234, math.nan)] == ["12.34 %", "-"]
    assert percent(0.9, 0) == "90 %"


def test_p_values_stop_where_they_say_nothing_more() -> None:
    assert [probability(p) for p in (0.0, 1e-300, 9.9e-13, 1.23e-5, 0.5, math.nan)] == [
        "< 1e-12", "< 1e-12", "< 1e-12", "1.2e-05", "0.5", "-",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("value", "stderr", "unit", "expected"),
    [
        (5228.7, 262.1, "", "5230 ± 260"),
        (0.0213004, 0.000123, "N m", "0.02130 ± 0.00012 N m"),
        (8.99e-5, 1.234e-8, "kg m^2", "8.9900e-05 ± 1.2e-08 kg m^2"),
        (0.0, 0.5, "1", "0.00 ± 0.50"),
        (-3.0, 0.012, "A", "-3.000 ± 0.012 A"),
        (3.14159, math.nan, "s", "3.142 s"),
        (3.14159, 0.0, "s", "3.142 s"),
        (math.nan, 1.0, "", "-"),
        (-1e-5, 0.0021, "N m", "0.0000 ± 0.0021 N m"),
        (-1e-9, 1e-5, "N m", "0.0e+00 ± 1.0e-05 N m"),
        (-0.0, 0.0, "N m", "0 N m"),
        (45.07177, 0.00027, "deg", "45.07177 ± 0.00027 deg"),
    ],
)
def test_a_value_is_rounded_to_its_error(value: float, stderr: float, unit: str, expected: str) -> None:
    assert with_error(value, stderr, unit) == expected


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (0.00041, "N m", "0.41 mN m"),
        (0.00059, "N m", "0.59 mN m"),
        (1.7e-4, "s", "0.17 ms"),
        (0.0, "s", "0 s"),
        (16000.0, "Hz", "16 kHz"),
        (8.99e-5, "kg m^2", "9e-05 kg m^2"),
        (-0.0021, "N m s/rad", "-2.1 mN m s/rad"),
        (0.3, "1", "0.3"),
        (math.nan, "N m", "- N m"),
    ],
)
def test_prefixes(value: float, unit: str, expected: str) -> None:
    assert with_prefix(value, unit) == expected


def test_a_simulation_that_drifts_away_has_no_share() -> None:
    assert [fit(share) for share in (1.0, 0.9881, 0.0, -123.11)] == ["100.00 %", "98.81 %", "0.00 %", "drifts away"]


def test_a_zero_has_no_sign() -> None:
    assert [number(-0.0), percent(-1e-9), with_prefix(-0.0, "N m"), fit(0.0)] == ["0", "0.00 %", "0 N m", "0.00 %"]


def test_an_interval_that_is_a_point_is_left_out() -> None:
    assert with_error(0.0, math.nan, "N m", (0.0, 0.0)) == "0 N m"
    assert with_error(0.522, math.nan, "", (0.359, 0.757)) == "0.522 (95 %: 0.359 to 0.757)"
    assert with_error(0.5, math.nan, "", (-math.inf, math.inf)) == "0.5 (95 %: not bounded)"
    assert with_error(0.5, math.nan, "", (0.2, math.inf)) == "0.5 (95 %: above 0.2)"
