"""The scale of a residual is that of nearly all of its samples; how many lie outside is said."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pmsm_ctrl.identify.figures import scaled_by_most


def test_a_few_samples_do_not_set_the_scale_and_are_counted() -> None:
    residual = np.random.default_rng(3).normal(0.0, 0.01, 4000)
    residual[[1000, 2000, -1]] = (5.0, -3.0, 1.0)
    axes = Figure().subplots()
    assert scaled_by_most(axes, residual) == 3
    assert 0.03 < axes.get_ylim()[1] < 0.06
    assert [text.get_text() for text in axes.texts] == ["3 of 4000 samples outside, up to 5"]


def test_noise_is_shown_whole_and_nothing_is_said() -> None:
    axes = Figure().subplots()
    residual = np.random.default_rng(3).normal(0.0, 0.01, 4000)
    assert scaled_by_most(axes, residual) == 0
    assert axes.get_ylim()[1] > np.abs(residual).max()
    assert not axes.texts
    assert scaled_by_most(axes, residual, least=1.0) == 0  # a fitted curve that is larger than the residual
    assert scaled_by_most(axes, np.zeros(10)) == 0
