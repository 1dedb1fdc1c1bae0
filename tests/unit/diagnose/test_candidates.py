"""Which shapes a log lets the search of an effect try."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import TWO_PERIODS, candidates_for
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import make_record


def test_an_order_of_which_the_motion_spans_less_than_two_periods_is_not_tried() -> None:
    # a joint that swings over a part of a turn, however often, with a torque that depends on its angle
    t = np.arange(4000) / 200.0
    theta = 0.6 * np.sin(2.0 * np.pi * 0.11 * t) + 0.3 * np.sin(2.0 * np.pi * 0.29 * t)
    torque = 0.5 * np.sign(np.gradient(theta, t)) + np.sin(3.0 * theta + 0.4)
    torque += np.random.default_rng(1).normal(0.0, 0.05, t.size)
    design = Design.from_dict({"motor": {"J": 1.0, "K_t": 1.0}, "effects": [{"id": "coulomb", "F_c": 0.5}]})
    record = make_record(design, Log({"t": t, "theta": theta, "torque": torque}))
    residual = record.target[0] - 0.5 * record.shaped(record.signals["direction"])
    (found,) = candidates_for(record, {"cogging": catalogue_of(design)["cogging"]}, residual, ())
    assert found.grid
    assert min(shape["order"] for shape in found.grid) * np.ptp(theta) > TWO_PERIODS
