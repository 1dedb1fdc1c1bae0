"""Filters of the current reference: against scipy and python-control, and as a design states them."""

import math

import control as ct
import numpy as np
import pytest
from scipy import signal

from pmsm_ctrl import Design
from pmsm_ctrl.biquads import lead, low_pass, notch
from pmsm_ctrl.design import Filter
from pmsm_ctrl.errors import DesignError

T = 1.0 / 4000.0
EACH = {
    "narrow": notch(300.0, 20.0), "wide": notch(300.0, 300.0, 12.0), "close to Nyquist": notch(1900.0, 400.0, 30.0),
    "low-pass": low_pass(500.0), "damped": low_pass(120.0, 2, 1.3), "first order": low_pass(250.0, 1),
    "lead": lead(150.0, 40.0),
}  # fmt: skip


@pytest.mark.parametrize("one", EACH.values(), ids=EACH)
def test_the_sampled_filter_is_that_of_python_control(one):
    b_0, b_1, b_2, a_1, a_2 = one.sampled(T)
    continuous = ct.tf(np.trim_zeros(one.numerator, "f"), np.trim_zeros(one.denominator, "f"))
    w = 2.0 * math.pi * one.frequency
    theirs = ct.sample_system(continuous, T, "bilinear", prewarp_frequency=w)
    z = np.exp(1j * np.geomspace(1.0, 0.999 * math.pi / T, 200) * T)
    ours = (b_0 + b_1 / z + b_2 / z**2) / (1.0 + a_1 / z + a_2 / z**2)
    np.testing.assert_allclose(ours, theirs(z), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one.sampled_at(z, T), theirs(z), rtol=1e-9, atol=1e-12)
    assert one.sampled_at(np.exp(1j * w * T), T) == pytest.approx(one.at(1j * w), rel=1e-9, abs=1e-12)
    assert one.sampled_at(1.0, T) == pytest.approx(1.0)
    assert np.abs(np.roots([1.0, a_1, a_2])).max() < 1.0


@pytest.mark.parametrize(("frequency", "width"), [(300.0, 20.0), (300.0, 300.0), (1200.0, 100.0)])
def test_a_complete_notch_is_that_of_scipy(frequency, width):
    """`iirnotch` prewarps the width as well, so that they agree as the width becomes small beside the rate."""
    b, a = signal.iirnotch(frequency, frequency / width, 1.0 / T)
    b_0, b_1, b_2, a_1, a_2 = notch(frequency, width).sampled(T)
    assert np.roots([b_0, b_1, b_2]) == pytest.approx(np.roots(b), rel=1e-6)  # the same zeros on the unit circle
    fine = 1e-3 * T
    b, a = signal.iirnotch(frequency, frequency / width, 1.0 / fine)
    assert notch(frequency, width).sampled(fine) == pytest.approx([*b, *a[1:]], rel=1e-6)


def test_a_butterworth_is_that_of_scipy():
    for order in (1, 2):
        b, a = signal.butter(order, 500.0, fs=1.0 / T)
        ours = low_pass(500.0, order).sampled(T)
        assert ours == pytest.approx([*b, *[0.0] * (2 - order), *a[1:], *[0.0] * (2 - order)], rel=1e-12)


def test_the_figures_that_name_a_filter_are_those_it_has():
    deep = notch(300.0, 100.0, 20.0)
    assert abs(deep.at(2j * math.pi * 300.0)) == pytest.approx(0.1)
    complete = notch(300.0, 100.0)
    edges = [math.hypot(300.0, 50.0) - 50.0, math.hypot(300.0, 50.0) + 50.0]  # 100 Hz apart, their product 300^2
    assert np.abs(complete.at(2j * math.pi * np.array(edges))) == pytest.approx([math.sqrt(0.5)] * 2)
    element = lead(150.0, 40.0)
    f = np.linspace(140.0, 160.0, 2001)
    phase = np.degrees(np.angle(element.at(2j * math.pi * f)))
    assert phase.max() == pytest.approx(40.0)
    assert f[phase.argmax()] == pytest.approx(150.0, abs=0.1)
    with pytest.raises(ValueError, match="not below half the sampling rate"):
        notch(2000.0, 10.0).sampled(T)


def test_a_design_keeps_its_filters_and_refuses_what_does_not_belong(designs, tmp_path):
    design = Design.read(designs / "seed_motor.toml")
    filters = [
        {"kind": "notch", "frequency": 300.0, "width": 60.0, "depth": 25.0},
        {"kind": "lead", "frequency": 150.0, "phase": 20.0},
        {"kind": "low_pass", "frequency": 800.0, "order": 1},
    ]  # fmt: skip
    speed = {**design.loops.speed.model_dump(), "filters": filters}
    filtered = design.replace(loops={"speed": speed})
    again = Design.read(filtered.write(tmp_path / "filtered.toml"))
    assert again == filtered
    assert again.loops.speed.filters[1] == Filter(kind="lead", frequency=150.0, phase=20.0)
    assert [one.biquad for one in again.loops.speed.filters] == [
        notch(300.0, 60.0, 25.0),
        lead(150.0, 20.0),
        low_pass(800.0, 1),
    ]
    for wrong, message in (
        ({"kind": "notch", "frequency": 300.0}, "width is missing"),
        (
            {"kind": "lead", "frequency": 300.0, "phase": 20.0, "width": 3.0},
            "width does not belong to a filter of kind lead",
        ),
        (
            {"kind": "low_pass", "frequency": 300.0, "order": 1, "damping": 0.7},
            "damping belongs to a low_pass of order 2",
        ),
        ({"kind": "low_pass", "frequency": 2000.0}, "below 2000 Hz, half the rate of the speed loop"),
        ({"kind": "low_pas", "frequency": 200.0}, "loops.speed.filters.0.kind"),
    ):
        with pytest.raises(DesignError, match=message):
            design.replace(loops={"speed": {**speed, "filters": [wrong]}})
