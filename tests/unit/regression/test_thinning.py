"""The low-pass that works out the kept samples alone, against the one that works out all of them."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.thinning import thinned


@pytest.mark.parametrize("n", [90, 300, 6003, 30_000])
@pytest.mark.parametrize(("cutoff", "step"), [(40.0, 10), (65.0, 6), (150.0, 2), (5.0, 7), (100.0, 1), (20.0, 60)])
def test_what_is_kept_is_the_whole_filter_but_for_rounding(
    rng: np.random.Generator, n: int, cutoff: float, step: int
) -> None:
    x = np.cumsum(rng.standard_normal((3, n)), axis=1)
    expected = low_pass(x, 1000.0, cutoff, steep=True)[:, ::step]
    found = thinned(list(x), 1000.0, cutoff, step)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


def test_a_read_only_or_strided_signal_is_filtered_as_well(rng: np.random.Generator) -> None:
    x = rng.standard_normal((1000, 2))
    x.flags.writeable = False
    found = thinned([x[:, 0], x[:, 1]], 1000.0, 40.0, 10)
    np.testing.assert_allclose(found, low_pass(x.T.copy(), 1000.0, 40.0, steep=True)[:, ::10], rtol=0.0, atol=1e-12)
