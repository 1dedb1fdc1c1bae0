"""How far off edges are: against drawn residuals, and on logs in closed form that hold means or instants."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from pmsm_ctrl import Design, Log
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.edge_share import likeliest_share
from pmsm_ctrl.regression.timed_record import timed_record
from tests.effort import seeds

J, F_C, F_V, RATE = 2e-3, 0.1, 1e-3, 250.0
DESIGN = Design.from_toml(
    f"name = 'axis'\n[motor]\nJ = {1.05 * J}\nK_t = 1.0\n"
    f"[[effects]]\nid = 'coulomb'\nF_c = {F_C}\n[[effects]]\nid = 'viscous'\nF_v = {F_V}\n"
)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_the_share_of_drawn_residuals_is_found(share: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    edges = np.where(rng.random(4000) < 0.2, rng.uniform(0.0, 20.0, 4000), 0.0)
    left = 0.3 * np.sqrt(1.0 + (share * edges) ** 2) * rng.standard_normal(4000)
    assert likeliest_share(left, edges) == pytest.approx(share, rel=0.3, abs=0.02)


def staircase(mean: bool, seed: int) -> Log:
    """Return speeds that change within 12 ms, anywhere between two samples; the torque is a mean or an instant."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(60.0 * RATE)) / RATE
    starts = 1.0 + 2.0 * np.arange(29) + rng.uniform(0.0, 0.5, 29)
    levels = rng.uniform(20.0, 160.0, 30)
    corners, speeds = np.sort(np.r_[0.0, starts, starts + 0.012, 61.0]), np.r_[np.repeat(levels, 2)]

    def speed(at: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(at, corners, speeds)

    ways = np.concatenate([[0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(corners))])
    place = np.searchsorted(corners, t, side="right") - 1
    theta = ways[place] + 0.5 * (speeds[place] + speed(t)) * (t - corners[place])
    if mean:
        before = np.maximum(t - 1.0 / RATE, 0.0)
        alpha, omega = (speed(t) - speed(before)) * RATE, np.gradient(theta, t)
    else:
        alpha, omega = (np.diff(speeds) / np.diff(corners))[place], speed(t)
    torque = J * alpha + F_C * np.sign(omega) + F_V * omega + 0.003 * rng.standard_normal(len(t))
    return Log({"t": t, "theta": theta, "torque": torque})


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_edges_of_means_tell_the_inertia(seed: int) -> None:
    """Edges have their place in a mean: without them the inertia of such a log was off by per cents."""
    record = timed_record(DESIGN, staircase(True, seed))
    value, stderr = base_fit(DESIGN, record).value("J")
    assert record.usable > 0.75
    assert "torque_jumps" not in {note.code for note in record.notes}
    assert stderr < 0.004 * J
    assert value == pytest.approx(J, rel=0.01)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_edges_of_instants_keep_little_weight(seed: int) -> None:
    record = timed_record(DESIGN, staircase(False, seed))
    assert np.quantile(record.weight[0][record.mask], 0.1) < 0.1
    (said,) = [note for note in record.notes if note.code == "torque_edges"]
    assert 5.0 < said.detail["percent"] < 30.0
    assert base_fit(DESIGN, record).value("F_c")[0] == pytest.approx(F_C, rel=0.02)
