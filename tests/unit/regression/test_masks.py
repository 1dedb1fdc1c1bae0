"""Rests, reversals, torque jumps and edges, on samples written by hand."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.regression.masks import count_reversals, resting, slow_speed, torque_jumps, without_edges


def samples(text: str) -> np.ndarray:
    """True where the text has an x."""
    return np.array([letter == "x" for letter in text])


#                     0         1         2
#                     012345678901234567890123
OMEGA = np.array([{"+": 1.0, "-": -1.0, "0": 0.0}[c] for c in "++++000000++++00----++++"])


def test_rests_contaminate_their_neighbours_only_after_the_filter() -> None:
    after = resting(OMEGA, 0.1, memory=3, blank=False, through_reversals=False)
    assert (after == samples(".xxxxxxxxxxxx.xx........")).all()
    before = resting(OMEGA, 0.1, memory=3, blank=True, through_reversals=False)
    assert (before == samples("...xxxxxxxx..xxxx..xx...")).all()


def test_short_rests_take_part_where_they_are_simulated() -> None:
    rest = resting(OMEGA, 0.1, memory=3, blank=True, through_reversals=True)
    assert (rest == samples("....xxxxxx..............")).all()


def test_reversals_of_noise_below_the_slow_speed_do_not_count() -> None:
    omega = np.array([1.0, 0.05, -0.05, 0.05, 1.0, -1.0, 1.0])
    assert slow_speed(np.full(50, 2.0), 0.05) == 0.1
    assert count_reversals(omega, 0.1) == 2
    assert count_reversals(omega, 0.01) == 4


def test_a_jump_of_the_torque_is_no_slope() -> None:
    ramp = np.linspace(-1.0, 1.0, 400)
    assert len(torque_jumps(ramp)) == 0
    assert torque_jumps(ramp + np.where(np.arange(400) >= 100, 1.0, 0.0)).tolist() == [99]


def test_what_jumps_at_every_seventh_sample_is_noise_and_no_jump() -> None:
    """The answer of a drive to steps of its encoder: a whole record was left out, and "moves for 0 s"."""
    torque = 1e-3 * np.sin(0.01 * np.arange(4000)) + np.where(np.arange(4000) % 7 == 0, 0.4, 0.0)
    assert len(torque_jumps(torque)) > 1000
    assert len(torque_jumps(torque, 0.02)) == 0
    torque[700:] = 1.0
    assert len(torque_jumps(torque, 0.1)) == 200  # two at each of 99 pulses, one behind the first, one at the end


def test_edges_and_gaps_are_cut() -> None:
    good = ~samples("..........xx............")
    kept = without_edges(np.ones(24, dtype=bool), good, 2)
    assert (kept == samples("..xxxxxx......xxxxxxxx..")).all()
