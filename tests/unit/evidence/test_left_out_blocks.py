"""Gains on left-out blocks against fits made one by one without them."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.evidence.blocks import left_out_gains


@pytest.mark.parametrize("gap", [0.0, 0.4])
@pytest.mark.parametrize("channels", [1, 2])
def test_gains_are_those_of_fits_that_have_not_seen_the_block_nor_the_gap(
    rng: np.random.Generator, channels: int, gap: float
) -> None:
    n, base = 1200, 2
    t = np.arange(n) * 0.01
    x = rng.standard_normal((channels, n, 3))
    y = x @ [1.0, -0.5, 0.1] + rng.standard_normal((channels, n))
    rows = np.concatenate([y[:, :, None], x], axis=2)
    full = sum(one.T @ one for one in rows)
    edges = [(2.0 * k, 2.0 * k + 2.0) for k in range(6)]
    found, total = left_out_gains(rows, full, t, edges, gap, base)
    expected, there = [], 0.0
    for start, stop in edges:
        fitted, judged = (t < start - gap) | (t >= stop + gap), (t >= start) & (t < stop)
        left = []
        for columns in (base, 3):
            a, b = x[:, fitted, :columns].reshape(-1, columns), y[:, fitted].ravel()
            left.append(y[:, judged] - x[:, judged, :columns] @ np.linalg.lstsq(a, b, rcond=None)[0])
        expected.append(np.sum(left[0] ** 2) - np.sum(left[1] ** 2))
        there += max(float(np.sum(y[:, judged] ** 2)), float(np.sum(left[0] ** 2)))
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert total == pytest.approx(there, rel=1e-9)


def test_too_few_blocks_say_nothing(rng: np.random.Generator) -> None:
    rows = rng.standard_normal((1, 300, 2))
    full = rows[0].T @ rows[0]
    gains, _ = left_out_gains(rows, full, np.arange(300) * 0.01, [(0.0, 1.5), (1.5, 3.0)], 0.0, 0)
    assert len(gains) == 0
