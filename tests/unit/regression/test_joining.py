"""Several records as one log, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.errors import LogError, RequestError
from pmsm_ctrl.log import Log, Provenance, as_logs
from pmsm_ctrl.regression.conditioning import default_cutoff, prepare
from pmsm_ctrl.regression.joining import APART, joined, parts_of, thinned, with_records
from pmsm_ctrl.regression.timing import own_time, uniform
from tests.unit.several import DESIGN, record


def sines(rate: float, name: str, phase: float = 0.0) -> Log:
    t = np.arange(round(2.0 * rate)) / rate
    slow = 2.0 * np.pi * 3.0 * t
    theta, torque = 4.0 * np.sin(slow + phase), 0.3 * np.cos(slow)
    return Log({"t": t, "theta": theta, "torque": torque}, provenance=Provenance(name))


def test_rates_meet_at_the_lowest_without_a_delay_of_any_channel() -> None:
    whole, notices = joined(DESIGN, [sines(2000.0, "fast"), sines(250.0, "slow"), sines(1000.0, "usual")])
    assert notices == ()
    assert whole.rate == pytest.approx(250.0)
    assert [one.name for one in whole.records] == ["fast", "slow", "usual"]
    assert [one.rate for one in whole.records] == pytest.approx([2000.0, 250.0, 1000.0])
    for part in parts_of(whole):
        t = part.t - part.t[0]
        inside = (t > 0.2) & (t < 1.8)  # the filter starts at either end
        theta = part["theta"] - 2.0 * np.pi * np.round(np.mean(part["theta"]) / (2.0 * np.pi))
        assert theta[inside] == pytest.approx(4.0 * np.sin(6.0 * np.pi * t[inside]), abs=4e-3)
        assert part["torque"][inside] == pytest.approx(0.3 * np.cos(6.0 * np.pi * t[inside]), abs=4e-4)


def test_aliases_of_a_fast_record_are_filtered_before_it_is_resampled() -> None:
    fast = sines(2000.0, "fast")
    wave = np.sin(2.0 * np.pi * 240.0 * fast.t)  # 10 Hz at 250 Hz
    whole, _ = joined(DESIGN, [fast.with_channels(torque=wave), sines(250.0, "slow")])
    part = parts_of(whole)[0]
    assert float(np.max(np.abs(part["torque"][25:-25]))) < 2e-3


def test_angles_are_shifted_by_whole_turns_and_the_way_between_is_short() -> None:
    logs = [record(1), record(2).with_channels(theta=record(2)["theta"] + 800.0)]
    whole, _ = joined(DESIGN, logs)
    first, second = parts_of(whole)
    assert np.array_equal(first["theta"], logs[0]["theta"])
    turns = (second["theta"] - logs[1]["theta"]) / (2.0 * np.pi)
    assert turns == pytest.approx(np.full(len(turns), round(turns[0])), abs=1e-9)
    between = whole.records[1].start - whole.records[0].stop
    assert between >= APART / default_cutoff(1000.0)
    speed = abs(second["theta"][0] - first["theta"][-1]) / between
    assert speed < 2.0 * float(np.max(np.abs(np.gradient(logs[0]["theta"], 1e-3))))


def test_channels_are_those_that_all_records_have() -> None:
    full = record(1)
    full = full.with_channels(temperature=np.full(len(full), 30.0))
    slow = record(2)
    speed = np.gradient(slow["theta"], slow.t)
    slow = Log({"t": slow.t, "omega": speed, "torque": slow["torque"]}, provenance=Provenance("speed.csv"))
    current = record(3)
    current = Log({"t": current.t, "theta": current["theta"], "i_q": current["torque"]})
    whole, notices = joined(DESIGN, [full, slow, current])
    assert set(whole) == {"t", "omega", "torque"}
    assert {notice.code for notice in notices} == {"channel_left_out"}
    assert sum("temperature" in notice.text and "speed.csv" in notice.text for notice in notices) == 1
    last = parts_of(whole)[2]
    assert last["torque"] == pytest.approx(current["i_q"] * DESIGN.K_t_assumed)
    assert last["omega"][50:-50] == pytest.approx(np.gradient(current["theta"], 1e-3)[50:-50], abs=0.05)


def test_a_load_that_one_record_knows_is_zero_in_the_others() -> None:
    loaded = record(1)
    loaded = loaded.with_channels(T_load=np.full(len(loaded), 0.5))
    whole, notices = joined(DESIGN, [loaded, record(2)])
    assert notices == ()
    first, second = parts_of(whole)
    assert np.all(first["T_load"] == 0.5)
    assert np.all(second["T_load"] == 0.0)


def test_records_of_different_axes_are_refused_by_name() -> None:
    t = np.arange(200) * 1e-3
    linear = Log({"t": t, "theta": t, "torque": t}, "linear", provenance=Provenance("belt.csv"))
    with pytest.raises(LogError, match=r"belt.csv: a linear axis, but record_1.csv is a rotary one"):
        joined(DESIGN, [record(1), linear])
    nothing = Log({"t": t, "theta": t, "u_q": t}, provenance=Provenance("half.csv"))
    with pytest.raises(LogError, match=r"half.csv: neither torque nor i_q"):
        joined(DESIGN, [record(1), nothing])
    with pytest.raises(LogError, match=r"short.csv: 60 samples; at least 100"):
        joined(DESIGN, [record(1), Log({"t": t[:60], "theta": t[:60], "torque": t[:60]},
                                       provenance=Provenance("short.csv"))])  # fmt: skip
    with pytest.raises(RequestError, match="no log"):
        as_logs([])
    with pytest.raises(RequestError, match="log 2: str found"):
        as_logs([record(1), "file.csv"])  # type: ignore[list-item]


def gapped(gap: float) -> Log:
    one, two = record(1, 2.0), record(2, 2.0)
    both = {name: np.concatenate([one[name], two[name]]) for name in ("theta", "torque")}
    t = np.concatenate([one.t, one.t[-1] + gap + two.t])
    return Log({"t": t, **both}, provenance=Provenance("day.csv"))


def test_a_gap_in_a_file_separates_two_records_and_lost_samples_do_not() -> None:
    log = with_records(gapped(3.0))
    assert [one.name for one in log.records] == ["day.csv, part 1", "day.csv, part 2"]
    assert log.records[1].begin == pytest.approx(1.999 + 3.0)
    assert [len(part) for part in parts_of(log)] == [2000, 2000]
    assert with_records(gapped(0.2)).records == ()
    assert with_records(record(1)).records == ()


def test_what_drifts_counts_from_the_begin_of_its_own_record() -> None:
    whole, _ = joined(DESIGN, [record(1, 2.0), with_records(gapped(3.0))])
    t = uniform(whole)[0]
    own = own_time(whole, t)
    for span, begin in zip(whole.records, (0.0, 0.0, 4.999), strict=True):
        first = int(np.searchsorted(t, span.start - 1e-9))
        assert own[first] == pytest.approx(begin, abs=1e-6)


def test_what_lies_between_records_takes_no_part_however_short_they_are() -> None:
    logs = [record(k, 0.6) for k in range(1, 8)]
    whole, _ = joined(DESIGN, logs)
    prepared = prepare(DESIGN, whole)
    t = prepared.t[prepared.keep][prepared.mask]
    inside = [np.any([(x >= s.start + 0.09) & (x <= s.stop - 0.09) for s in whole.records]) for x in t]
    assert np.all(inside)
    assert np.max(np.abs(prepared.signals["omega"])) < 200.0


def test_a_fast_joined_log_is_thinned_record_by_record_to_one_grid() -> None:
    logs = [sines(8000.0, "a"), sines(8000.0, "b", 1.0)]
    whole, _ = joined(DESIGN, logs)
    slow = thinned(whole)
    assert slow.rate == pytest.approx(1000.0)
    steps = np.diff(slow.t) * 1000.0
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    part = parts_of(slow)[0]
    assert part["theta"][20:-20] == pytest.approx(4.0 * np.sin(6.0 * np.pi * part.t[20:-20]), abs=1e-3)
