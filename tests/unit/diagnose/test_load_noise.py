"""By how much noise the column of a load is judged: by no more than the torque that is left beside it allows.

The axis is integrated here, as two masses in closed form (scipy), not by the package.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record, make_record
from pmsm_ctrl.regression.columns import effect_group, seen_as_candidate
from tests.effort import seeds

RATE, F_A, ZETA, SHARE = 2000.0, 25.0, 0.03, 0.5
SHAPE = {"(w_a)": 2.0 * np.pi * F_A, "(zeta)": ZETA}
NOISE = 2e-5  # rad


@pytest.fixture(scope="module")
def design(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


def two_masses(design: Design, share: float, seed: int) -> Record:
    """Steps of the torque on an axis without dry friction, a share of whose inertia hangs on a spring."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 12.0, 1.0 / RATE)
    torque = 0.02 * np.repeat(rng.choice([-1.0, 0.0, 1.0], 200), len(t) // 200)
    J_load, F_v = share * design.J, 2e-3
    J, k, d = design.J - J_load, J_load * SHAPE["(w_a)"] ** 2, 2.0 * ZETA * SHAPE["(w_a)"] * J_load
    motion = [[0.0, 1.0], [0.0, -F_v / J]]
    if share:
        motion = [
            [0.0, 1.0, 0.0, 0.0], [-k / J, -(d + F_v) / J, k / J, d / J],
            [0.0, 0.0, 0.0, 1.0], [k / J_load, d / J_load, -k / J_load, -d / J_load],
        ]  # fmt: skip
    drive = np.eye(len(motion))[:, 1:2] / J
    axis = StateSpace(motion, drive, np.eye(len(motion))[:1], np.zeros((1, 1)))
    theta = lsim(axis, torque, t, interp=False)[1]
    measured = theta + NOISE * rng.standard_normal(len(t))
    return make_record(design, Log({"t": t, "theta": measured, "torque": torque}))


def noise_of_acceleration(record: Record) -> float:
    """What white noise of the angle makes of the acceleration in the band, rms."""
    rng = np.random.default_rng(99)
    noise = record.rate_of(record.rate_of(NOISE * rng.standard_normal(len(record.prepared.t))))
    return float(np.std(record.shaped(noise)[record.mask]))


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_an_axis_that_swings_is_not_noisy(design: Design, seed: int) -> None:
    """The swings of a load within the band were taken for noise, and its column was left out nearly everywhere."""
    record = two_masses(design, SHARE, seed)
    group = effect_group(record, CATALOGUE["compliance"], SHAPE)
    column = group.rows[0]
    assert column is not None
    assert record.shaft_noise() > 5.0 * record.noise_beside(column[0])
    seen = seen_as_candidate(record, group).rows[0]
    assert seen is not None
    assert np.mean(seen != 0.0) > 0.5


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_the_noise_of_a_rigid_axis_is_no_less_beside_a_load(design: Design, seed: int) -> None:
    """Whatever share of the inertia a load takes that is not there, the rotor turns the noise into torque."""
    record = two_masses(design, 0.0, seed)
    for frequency in (8.0, 15.0, 25.0):
        shape = {"(w_a)": 2.0 * np.pi * frequency, "(zeta)": 0.1}
        column = effect_group(record, CATALOGUE["compliance"], shape).rows[0]
        assert column is not None
        assert record.noise_beside(column[0]) > 0.9 * noise_of_acceleration(record)


def test_a_load_that_resonates_beyond_the_band_takes_part_in_all_noise(design: Design) -> None:
    record = two_masses(design, 0.0, 1)
    beyond = effect_group(
        record, CATALOGUE["compliance"], {"(w_a)": 2.0 * np.pi * 1.05 * record.cutoff, "(zeta)": 0.03}
    )
    seen, whole = seen_as_candidate(record, beyond).rows[0], beyond.rows[0]
    assert seen is not None
    np.testing.assert_array_equal(seen, whole)


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_edges_of_the_torque_are_no_noise_behind_a_gap(design: Design, seed: int) -> None:
    """The axis is rigid and its torque steps: what is fast in its acceleration is the motion."""
    record = two_masses(design, 0.0, seed)
    shape = {"gap": 0.02, "(w_a)": 2.0 * np.pi * 300.0, "(zeta)": 0.4}
    group = effect_group(record, CATALOGUE["backlash"], shape)
    assert group.rows[0] is not None
    assert record.shaft_noise() > 3.0 * record.noise_beside(group.rows[0][0])
    seen, offered = (seen_as_candidate(record, group, offered=way).rows[0] for way in (False, True))
    assert seen is not None
    assert offered is not None
    assert np.mean(seen != 0.0) > 2.0 * np.mean(offered != 0.0)
    np.testing.assert_array_equal(seen[seen != 0.0], group.rows[0][seen != 0.0])
