"""Left-out blocks taken off the whole, against fits that never saw them."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.evidence.blocks import BLOCKS, LEAK, block_sums, equal_blocks, left_out_gains


def test_gains_are_those_of_fits_without_the_block_and_its_gap(rng: np.random.Generator) -> None:
    channels, n, base, own, gap = 2, 400, 3, 2, 0.3
    t = np.arange(n) * 0.05
    columns = rng.standard_normal((channels, n, base + own))
    target = columns @ [1.0, -2.0, 0.5, 0.2, 0.1] + rng.standard_normal((channels, n))
    prior = np.diag([10.0, 0.0, 0.0, 0.0, 0.0])[:1]
    rows = np.concatenate([target[..., None], columns], axis=2)
    flat = rows.reshape(-1, 1 + base + own)
    prior_rows = np.concatenate([[[15.0]], prior], axis=1)
    full = flat.T @ flat + prior_rows.T @ prior_rows
    edges = equal_blocks(np.ones((channels, n)), t, 8)
    gains, total = left_out_gains(rows, full, t, edges, gap, base)
    expected = []
    for start, stop in edges:
        weight = np.where((t < start - gap) | (t >= stop + gap), 1.0, np.sqrt(LEAK))
        test = (t >= start) & (t < stop)
        errors = []
        for k in (base, base + own):
            x = np.vstack([(columns[..., :k] * weight[:, None]).reshape(-1, k), prior[:, :k]])
            y = np.concatenate([(target * weight).ravel(), [15.0]])
            left = target[:, test] - columns[:, test, :k] @ np.linalg.lstsq(x, y)[0]
            errors.append(float(np.sum(left**2)))
        expected.append(errors[0] - errors[1])
    assert gains == pytest.approx(expected, rel=1e-7)
    assert total == pytest.approx(float(np.sum(target**2)))


def test_a_column_that_shows_in_one_block_alone_gains_nothing(rng: np.random.Generator) -> None:
    n = 320
    t = np.arange(n) * 1.0
    spike = np.where((t >= 100.0) & (t < 110.0), 1.0, 0.0)
    rows = np.stack([rng.standard_normal(n) + 5.0 * spike, np.ones(n), spike], axis=1)[None]
    full = rows[0].T @ rows[0]
    edges = [(20.0 * k, 20.0 * (k + 1)) for k in range(16)]
    gains, _ = left_out_gains(rows, full, t, edges, 2.0, 1)
    assert gains[5] == pytest.approx(0.0, abs=1e-6)


def test_too_few_blocks_are_none(rng: np.random.Generator) -> None:
    rows = rng.standard_normal((1, 100, 3))
    full = rows[0].T @ rows[0]
    gains, _ = left_out_gains(rows, full, np.arange(100.0), [(0.0, 30.0), (30.0, 60.0), (60.0, 100.0)], 0.0, 1)
    assert len(gains) == 0


def test_blocks_share_the_information_equally(rng: np.random.Generator) -> None:
    t = np.linspace(0.0, 10.0, 4001)
    weight = np.where(t < 1.0, 9.0, 1.0) * rng.uniform(0.5, 1.5, t.size)
    blocks = equal_blocks(weight, t, 8)
    shares = [weight[(t >= a) & (t < b)].sum() / weight.sum() for a, b in blocks]
    assert len(blocks) == 8
    assert shares == pytest.approx([1 / 8] * 8, abs=0.01)
    assert equal_blocks(np.zeros_like(t), t, 8) == []


def test_block_sums_of_white_noise_are_what_least_squares_states(rng: np.random.Generator) -> None:
    # over all unit vectors of noise the sums of squares add up to the identity: no bias, whatever the leverage
    n, k = 120, 4
    basis = np.linalg.qr(rng.standard_normal((n, k)) * np.linspace(0.1, 3.0, n)[:, None])[0]
    left = np.eye(n) - basis @ basis.T
    place = np.linspace(0.0, 1.0, n)
    total = sum(sums.T @ sums for sums in (block_sums(basis, column, place) for column in left.T))
    assert total == pytest.approx(np.eye(k), abs=1e-9)


def test_block_sums_of_a_mean_are_the_standard_error_of_the_mean_of_blocks(rng: np.random.Generator) -> None:
    each = 10
    noise = np.repeat(rng.standard_normal(BLOCKS), each)  # one error a block: a model of white noise finds it surer
    n = len(noise)
    sums = block_sums(np.full((n, 1), n**-0.5), noise - noise.mean(), (np.arange(n) + 0.5) / n)
    expected = np.var(noise[::each], ddof=1) / BLOCKS
    assert float(np.sum(sums**2)) / n == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_one_block_alone_tells_is_not_extrapolated(seed: int) -> None:
    # a bump over the whole record that all blocks tell of, and one that the last block alone has but for rounding
    rng = np.random.default_rng(seed)
    t = np.arange(800.0)
    common, alone = np.sin(t / 7.0), np.where(t >= 700.0, 1.0, 1e-6)
    columns = np.column_stack([np.ones_like(t), common, alone])
    target = columns @ [0.3, 1.0, 2.0] + rng.standard_normal(len(t))
    rows = np.column_stack([target, columns])[None]
    edges = [(100.0 * k, 100.0 * (k + 1)) for k in range(8)]
    gains, _ = left_out_gains(rows, rows[0].T @ rows[0], t, edges, 5.0, 1)
    # the common one gains about half a square a sample; of the other nothing is known where it is left out
    assert gains[-1] > 0.0
    assert np.mean(gains) == pytest.approx(50.0, rel=0.4)


def test_what_one_block_alone_tells_of_the_base_is_not_extrapolated(rng: np.random.Generator) -> None:
    """Without the base's spike, a block whose model nothing else determines would lose or gain a million."""
    n = 800
    t = np.arange(n) * 1.0
    only = np.where((t >= 200.0) & (t < 260.0), 1.0, 1e-6 * rng.standard_normal(n))
    own = rng.standard_normal(n)
    target = rng.standard_normal(n) + 50.0 * only + 0.5 * own
    rows = np.stack([target, only, own], axis=1)[None]
    full = rows[0].T @ rows[0]
    gains, _ = left_out_gains(rows, full, t, equal_blocks(own**2, t, 16), 2.0, 1)
    assert len(gains) == 16
    assert np.all(np.abs(gains) < 100.0)
    assert gains.mean() > 2.8 * gains.std(ddof=1) / 4.0


def test_blocks_of_a_single_burst_are_no_shorter_than_half_of_equal_ones() -> None:
    t = np.linspace(0.0, 16.0, 16001)
    burst = np.where(np.abs(t - 5.0) < 0.05, 1.0, 1e-6)
    plain, even = (np.array(equal_blocks(burst, t, 16, part)) for part in (0.0, 0.5))
    assert np.sum(np.diff(plain) < 0.1) >= 12
    assert np.sum(np.diff(even) < 0.1) <= 8
    shares = [burst[(t >= a) & (t < b)].sum() / burst.sum() for a, b in even]
    assert max(shares) < 2.1 / 16.0


def test_a_column_that_one_block_alone_tells_gains_nothing_there() -> None:
    """Without a base no direction is left in that block: it was a division by none."""
    t, rng = np.arange(4000) * 1e-2, np.random.default_rng(6)
    edges = [(k * 5.0, (k + 1) * 5.0 - 0.01) for k in range(8)]
    column = np.where((t >= 10.0) & (t < 15.0), rng.standard_normal(len(t)), 0.0)
    rows = np.stack([3.0 * column + rng.standard_normal(len(t)), column], axis=1)[None]
    gains, _ = left_out_gains(rows, rows[0].T @ rows[0], t, edges, 0.0, 0, 1e-6)
    assert len(gains) == 8
    assert gains[2] == 0.0
