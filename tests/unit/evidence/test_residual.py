"""What columns explain of a residual, against a plain least-squares fit."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.evidence.residual import _beyond, bench, noise_of

N = 4000
T = np.arange(N) * 0.01


def laid_out(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    columns = np.column_stack([np.ones(N), np.sin(T), np.sin(T) + 0.3 * np.cos(3.1 * T), np.cos(3.1 * T)])
    return columns, columns @ [0.2, 0.5, 0.4, 0.0] + rng.standard_normal(N)


def test_gain_beyond_a_base_is_that_of_two_fits(rng: np.random.Generator) -> None:
    columns, y = laid_out(rng)
    both = np.column_stack([y, columns])
    weights, rank, gain = _beyond(both.T @ both, [1, 2], [3])
    small, large = (float(np.linalg.lstsq(columns[:, k], y, rcond=None)[1][0]) for k in ([0, 1], [0, 1, 2]))
    assert (rank, gain) == (1, pytest.approx(small - large, rel=1e-9))
    # what they explain is orthogonal to the base
    along = both[:, [3, 1, 2]] @ weights
    assert np.abs(along @ columns[:, :2]).max() < 1e-8 * np.linalg.norm(along) * np.sqrt(N)


def test_a_column_that_the_base_has_is_nothing_new(rng: np.random.Generator) -> None:
    columns, y = laid_out(rng)
    both = np.column_stack([y, columns])
    assert _beyond(both.T @ both, [2, 3], [4])[1] == 0


def test_noise_level_and_samples_that_do_not_count(rng: np.random.Generator) -> None:
    columns, y = laid_out(rng)
    mask = (np.arange(N) % 500) > 50
    noise = noise_of(np.where(mask, y, 1e6), [columns[:, :2], columns[:, 2:]], mask, 100.0)
    assert noise.rms == pytest.approx(1.0, rel=0.05)
    assert noise.rank == 3  # the fourth column is a sum of two others
    assert not noise.left[~mask].any()
    made = bench(noise, T, np.where(mask, y, 1e6), columns.T, 0.1)
    assert len(made.t) == int(mask.sum())
    outcome = made.judge([1], [2])
    assert outcome is not None
    assert outcome.p_value < 1e-12
    assert outcome.gain > 3.0 * outcome.stderr
