"""The C twin of the benchmarks computes what the kernel computes, so that their times can be compared."""

import sys

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import scenario
from tests.effort import seeds

pytest.importorskip("numba")


@pytest.fixture(scope="module")
def twin(project_root):
    sys.path.insert(0, str(project_root))
    try:
        from tests.benchmarks import twin
    finally:
        sys.path.remove(str(project_root))
    if twin.gcc() is None:
        pytest.skip("GCC ABSENT: the C twin of the drive cannot be compiled and stays unchecked")
    return twin


@pytest.mark.parametrize("six", seeds(False, True))
def test_kernel_and_c_agree_over_thousands_of_periods(twin, tmp_path, project_root, six):
    """From rest through a reversal: sticking, landing, six effects; rounding apart, the same numbers."""
    design = Design.read(project_root / "designs/seed_motor.toml")
    design = twin.with_six(design) if six else design
    motion = scenario("triangle", speed=5.0, period=0.3, cycles=1)
    pair = twin.Pair(design, motion, 4800, twin.compile_twin(tmp_path, six=six))
    rows, states = pair.kernel()
    rows = rows.copy()
    rows_c, states_c = pair.c()
    assert rows.shape == rows_c.shape
    scale = np.abs(rows).max(axis=0)
    assert np.all(np.abs(rows - rows_c) <= 1e-9 * scale)
    assert np.allclose(states, states_c, rtol=1e-9, atol=1e-9)
    assert np.abs(rows[:, 13]).max() > 4.0  # it did turn
