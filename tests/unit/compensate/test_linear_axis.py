"""The trials of a linear axis: as long and as fast as it is, in its own units."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.compensate import accept, baseline, compensated, judge, run_trial, study_trials
from pmsm_ctrl.compensate.metrics import Metrics
from pmsm_ctrl.compensate.motions import at_speed
from pmsm_ctrl.compensate.notices import sentence
from pmsm_ctrl.compensate.plants import judged
from pmsm_ctrl.compensate.present import _rest, _runs
from pmsm_ctrl.compensate.result import CompensationStudy, Row, Variant
from pmsm_ctrl.design import Acceptance, Design
from tests import effort
from tests.linear_motors import COUNTS, linear_motor


@pytest.mark.parametrize("seed", range(6))
def test_trials_are_within_what_the_motor_can_do(seed: int) -> None:
    """No trial asks for more than a quarter of the speed and acceleration, and the circle is one of a machine tool."""
    axis = linear_motor(seed)
    trials = study_trials(axis.design)
    for motion in (one for trial in trials.values() for one in trial.motions):
        place, speed, change = motion.inputs(np.arange(0.0, motion.duration, 1e-3))[:, :3].T
        assert np.abs(speed).max() < 0.25 * axis.fastest
        assert np.abs(change).max() < 0.25 * axis.strongest
        assert np.ptp(place) < 0.05 * axis.fastest
    if seed == 0:
        assert trials["circle"].radius == pytest.approx(0.0304, abs=1e-4)


def test_names_of_trials_have_the_unit_of_the_axis(designs) -> None:
    shaft, slide = Design.read(designs / "seed_motor.toml"), linear_motor().design
    assert at_speed("reversal", 2.0, shaft) == "reversal 2 rad/s"
    assert at_speed("reversal", 2.0, slide) == "reversal 0.0191 m/s"
    for design in (shaft, slide):
        assert {one.trial for one in judged(design).values()} <= set(study_trials(design))
    assert not [name for name in study_trials(slide) if "rad" in name]


@pytest.mark.parametrize("seed", effort.seeds(0, 1, 2))
def test_friction_fed_forward_lowers_the_error_of_every_reversal(seed: int) -> None:
    """Where the trials were made for a shaft they saturated the motor, and nothing changed the error."""
    axis = linear_motor(seed)
    base = baseline(axis.design)
    on = compensated(base, ("coulomb", "viscous"))
    for name, trial in study_trials(axis.design).items():
        if not name.startswith("reversal"):
            continue
        off, fed = (run_trial(one, trial, truth=axis.design, seed=seed) for one in (base, on))
        assert np.abs(off[0]["i_q_ref"]).max() < 0.5 * axis.design.drive.i_max
        before, after = (judge(trial, logs, axis.design.encoder_step) for logs in (off, fed))
        assert after.reversal_peak < 0.5 * before.reversal_peak, name


def test_the_limit_of_a_reversal_is_in_metres() -> None:
    design = linear_motor().design
    verdict = accept(design, Acceptance(scenario=at_speed("reversal", 2.0, design), metric="peak", limit=1e-3))
    assert verdict.unit == "m"
    assert f"peak = {verdict.value:.4g} m, limit 0.001 m" in sentence(verdict)
    assert 1.0 / COUNTS < verdict.value < 1e-4


@pytest.mark.parametrize(("linear", "milli"), [(True, "mm"), (False, "mrad")])
def test_limit_cycles_are_told_in_the_unit_of_the_axis(designs, linear: bool, milli: str) -> None:
    design = linear_motor().design if linear else Design.read(designs / "seed_motor.toml")
    metrics = Metrics(1e-4, 2e-4, 2e-4, 0.0, 2.5e-6, 15.0, 0.1, 0.1)
    study = CompensationStudy(design, (Row(Variant.NONE, "positioning", 1.0, metrics),), {})
    (table,) = _rest(study)
    assert table.header[1] == f"amplitude [{milli}]"
    assert table.rows[0][1] == "0.0025"
    assert f"rms [{milli[1:]}]" in _runs(study).header
    assert study.to_dict()["units"]["rms"] == milli[1:]
