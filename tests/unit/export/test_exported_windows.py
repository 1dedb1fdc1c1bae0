"""The exported C in the loop of drawn drives keeps the windows that were declared (short form of the benchmark)."""

from __future__ import annotations

import pytest

from tests.benchmarks.exported import check
from tests.effort import amount


@pytest.mark.slow
def test_the_exported_c_is_at_rest_where_the_window_says_so() -> None:
    rows = check(range(1, 1 + amount(1, 30)), report=lambda text: None)
    assert not [row for row in rows if row.wrong or row.other]
    assert all(row.apart < 0.01 for row in rows)
