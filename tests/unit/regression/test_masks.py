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


def test_edges_and_gaps_are_cut() -> None:
    good = ~samples("..........xx............")
    kept = without_edges(np.ones(24, dtype=bool), good, 2)
    assert (kept == samples("..xxxxxx......xxxxxxxx..")).all()
