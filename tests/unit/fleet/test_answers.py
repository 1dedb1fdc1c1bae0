"""The answers of a fleet on rows whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import false_discovery_control

from pmsm_ctrl.evidence.trends import FALSE_DISCOVERIES
from pmsm_ctrl.fleet.answers import answered
from pmsm_ctrl.fleet.present import verdict_of
from tests.effort import amount
from tests.unit.fleet.rows import FIRST, a_fleet, of_record


def test_what_is_true_of_each_axis_is_found() -> None:
    report = answered("r", a_fleet(40, 10, 1), {"F_c": 0.03})
    assert [one.name for one in report.missing] == ["axis0001", "axis0021"]
    (found,) = report.missing[0].findings
    assert (found.effect, found.records, found.of) == ("cogging", 5, 10)
    assert ((found.since - FIRST).days, (found.before - FIRST).days) == (5, 4) if found.before else False
    drifting = {one.axis for one in report.changes if one.trend is not None}
    stepping = {one.axis: (one.when - FIRST).days for one in report.changes if one.step is not None and one.when}
    assert drifting == {"axis0002", "axis0022"}
    assert stepping == {"axis0003": 5, "axis0023": 5}
    assert {one.axis for one in report.worthless} == {"axis0004", "axis0024"}
    assert not [one.name for one in report.axes if one.consistent and one.name in ("axis0001", "axis0021")]


def test_a_step_at_the_day_of_an_effect_is_counted_as_the_effect() -> None:
    """Of two axes whose F_c steps on the same day, one lacks cogging from that day on, the other one never did."""
    rng, rows = np.random.default_rng(5), []
    for axis in ("a", "b", "c"):
        for day in range(16):
            later = day >= 9
            F_c = 0.02 * (1.0 + 0.01 * rng.standard_normal()) * (1.2 if later and axis != "c" else 1.0)
            rows += of_record(axis, day, F_c, effects={"cogging": 1e-9} if later and axis == "a" else {})
    report = answered("r", rows, {})
    assert {one.axis: one.beside for one in report.changes} == {"a": ("cogging",), "b": ()}
    assert report.changing == ("b",)
    text = " ".join(report.summary(width=400).split())
    assert "1 lacks an effect" in text
    assert "1 change over time" in text
    assert "is counted as that effect" in text
    assert {one["axis"]: one["beside"] for one in report.to_dict()["changes"]} == {"a": ["cogging"], "b": []}


def test_an_effect_that_appears_changes_no_friction() -> None:
    """Identified without the effect, F_c is 10 % off and has twenty times its error; the scatter is 2 %."""
    false, fleets = 0, amount(30, 60)
    for seed in range(fleets):
        rng, rows = np.random.default_rng([seed, 61]), []
        for axis in ("a", "b", "c", "d"):
            for day in range(40):
                F_c, shows = 0.02 * (1.0 + 0.02 * rng.standard_normal()), axis != "d" and day >= 20
                known = {"stderr": 1e-3, "effects": {"cogging": 1e-9}, "whole": (F_c, 5e-5)}
                rows += of_record(axis, day, 1.1 * F_c if shows else F_c, **(known if shows else {}))  # type: ignore[arg-type]
        report = answered("r", rows, {})
        assert len(report.missing) == 3
        false += bool(report.changes)
    assert false <= 8 * fleets // 60, "one fleet of twenty without a change has a false one"


def test_a_trend_says_when_a_limit_is_reached() -> None:
    """F_c = 0.02 (1 + 0.03 day) reaches 0.03 on day 16.7, 7.7 days after the last record."""
    rows = [row for day in range(10) for row in of_record("a", day, 0.02 * (1 + 0.03 * day) + 1e-5 * (-1) ** day)]
    (change,) = answered("r", rows, {"F_c": 0.03}).changes
    assert change.reached == pytest.approx(0.5 / 0.03 - 9, abs=3 * change.reached_stderr)
    assert change.reached_stderr < 0.3


def test_an_effect_that_shows_once_is_no_property_of_an_axis() -> None:
    rows = [row for day in range(5) for row in of_record("a", day, 0.02, effects={"cogging": 1e-9} if day == 2 else {})]
    assert not answered("r", rows, {}).missing
    once = list(of_record("b", 0, 0.02, effects={"cogging": 1e-9}))
    assert answered("r", once, {}).missing, "an axis with a single record has no second one"


def test_a_log_that_is_a_copy_confirms_nothing() -> None:
    """Three logs, of which the one that shows cogging is there twice under two dates."""
    rows = [row for day in range(4) for row in of_record("a", day, 0.02, effects={"cogging": 1e-9} if day > 1 else {})]
    digests = {f"logs/a/2026-03-{1 + day:02d}.csv": f"hash {min(day, 2)}" for day in range(4)}
    assert answered("r", rows, {}).missing
    report = answered("r", rows, {}, digests)
    assert not report.missing
    assert report.axes[0].records == 3
    (notice,) = (one for one in report.notices if one.code == "logs_are_copies")
    assert "2026-03-04.csv" in notice.text
    assert answered("r", rows, {}, dict.fromkeys(digests, "")).missing, "a hash that is not known is no hash"


def test_a_log_that_no_effect_explains_is_named_and_the_odd_one_is_known() -> None:
    rows = [
        row for day in range(3) for row in of_record("b", day, 0.02, verdict="unexplained" * (day == 1), text="why")
    ]
    report = answered("r", rows, {})
    assert [(one.axis, one.reason) for one in report.unexplained] == [("b", "why")]
    assert "Unexplained logs" in report.summary(width=400)
    assert report.odd_log == ""
    rows += [row for day in range(4) for row in of_record("c", day, 0.02, effects={"cogging": 1e-9} if day < 3 else {})]
    report = answered("r", rows, {}, designs={"c": "c.toml"})
    assert (report.odd_log, report.odd_design) == ("logs/c/2026-03-03.csv", "c.toml")


def test_the_rate_of_false_discoveries_over_the_fleet() -> None:
    """200 axes with one record, 180 of which lack nothing, with p-values as they are then: uniform."""
    shares = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        p = np.concatenate((rng.uniform(0, 1e-4, 20), rng.uniform(0, 1, 180)))
        rows = [row for k in range(200) for row in of_record(f"a{k:03d}", 0, 0.02, effects={"cogging": p[k]})]
        report = answered("r", rows, {})
        named = {int(one.name[1:]) for one in report.missing}
        assert named == set(np.flatnonzero(false_discovery_control(p) <= FALSE_DISCOVERIES))
        shares.append(sum(k >= 20 for k in named) / max(1, len(named)))
    assert np.mean(shares) <= FALSE_DISCOVERIES


def test_the_newest_evaluation_of_a_log_counts() -> None:
    from dataclasses import replace
    from datetime import timedelta

    old = [replace(row, key="old") for row in of_record("a", 0, 0.05, effects={"cogging": 1e-9})]
    new = [replace(row, evaluated=row.evaluated + timedelta(hours=1)) for row in of_record("a", 0, 0.02)]
    for rows in (old + new, new + old):
        (axis,) = answered("r", rows, {}).axes
        assert (axis.records, axis.missing) == (1, False)


def test_an_axis_far_from_the_others_is_named() -> None:
    rng = np.random.default_rng(4)
    levels = 0.02 * (1 + 0.02 * rng.standard_normal((12, 3)))
    levels[7] *= 1.5
    rows = [row for (k, day), F_c in np.ndenumerate(levels) for row in of_record(f"a{k:02d}", day, float(F_c))]
    assert [one.axis for one in answered("r", rows, {}).unlike] == ["a07"]


def test_friction_over_temperature() -> None:
    """F_c falls by 1e-4 N m per degree."""
    rng = np.random.default_rng(2)
    degrees = rng.uniform(15, 35, 12)
    levels = 0.02 - 1e-4 * (degrees - 20) + 1e-5 * rng.standard_normal(12)
    records = enumerate(zip(levels, degrees, strict=True))
    rows = [row for day, (F_c, degree) in records for row in of_record("a", day, F_c, temperature=degree)]
    (axis,) = answered("r", rows, {}).axes
    assert axis.per_degree is not None
    low, high = axis.per_degree.interval()
    assert low <= -1e-4 <= high
    assert high - low < 1e-5


def test_the_answer_says_how_many_axes_were_tested_for_changes() -> None:
    short = [row for axis in ("a", "b") for day in range(2) for row in of_record(axis, day, 0.02)]
    long = [row for day, F_c in enumerate((0.02, 0.0201, 0.0199, 0.02)) for row in of_record("c", day, F_c)]
    assert "none has the 4 records that a test for changes over time takes" in verdict_of(answered("r", short, {}))
    assert "0 change over time of the 1 with the 4 records" in verdict_of(answered("r", [*short, *long], {}))
    assert "design, 0 change over time; at most" in verdict_of(answered("r", long, {}))
