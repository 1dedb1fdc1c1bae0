"""A log of another kind of axis than the design's is refused by every verb that holds the two against each other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from pmsm_ctrl import Log, compare, diagnose, identify, track
from pmsm_ctrl.errors import LogError
from tests.slides import slide


@pytest.mark.parametrize("verb", [compare, diagnose, identify, track])
def test_a_rotary_log_of_a_linear_axis_is_refused(verb: Callable[..., Any]) -> None:
    one = slide("sines", 1, {})
    rotary = Log(dict(one.log.channels))  # in Python a log is rotary unless it is told otherwise
    with pytest.raises(LogError, match=r"found a log of a rotary axis; one of a linear axis, as design 'slide' is"):
        verb(one.design, rotary)


def test_so_is_a_hold_out_record() -> None:
    one = slide("sines", 1, {})
    with pytest.raises(LogError, match=r"of a rotary axis"):
        diagnose(one.design, one.log, holdout=Log(dict(one.log.channels)), plan=False)
