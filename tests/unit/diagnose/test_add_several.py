"""`add` to several records tells of each what the other verbs tell; a hold-out that is one of the logs is said."""

from __future__ import annotations

import pytest

from pmsm_ctrl.compare import compare
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.diagnose.adding import added
from tests.unit.several import DESIGN, records


def test_add_has_a_row_for_every_record_and_says_the_zeros() -> None:
    logs = records([{"zero": zero} for zero in (0.0, 0.1, 0.2)], wave=0.008)
    made = added(DESIGN, logs[:2], "cogging", holdout=logs[2])
    assert [row.name for row in made.records] == [f"record_{k}.csv" for k in (1, 2, 3)]
    assert [row.angle is not None and row.angle.value != 0.0 for row in made.records].count(True) == 2
    assert "other_zero" in {notice.code for notice in made.notices}
    assert {one.symbol for one in made.spreads} == {"dF_c", "dF_v", "offset"}
    # the same friction in all of them
    assert "Deviation of each record from all: dry friction below" in made.summary(width=200)
    assert [row["name"] for row in made.to_dict()["records"]] == [row.name for row in made.records]


def test_add_names_the_record_that_disagrees() -> None:
    logs = records([{}, {}, {}, {"inertia": 1.3e-4}])
    made = added(DESIGN, logs, "constant_load")
    assert [row.name for row in made.records if row.disagrees] == ["record_4.csv"]
    assert "record_disagrees" in {notice.code for notice in made.notices}


@pytest.mark.parametrize("verb", [compare, diagnose])
def test_a_hold_out_that_is_one_of_the_logs_validates_nothing(verb: object) -> None:
    first, second = records([{}, {}])
    codes = {notice.code for notice in verb(DESIGN, [first, second], holdout=second).notices}  # type: ignore[operator]
    assert "holdout_is_log" in codes
    assert "holdout_is_log" in {n.code for n in added(DESIGN, first, "constant_load", holdout=first).notices}
