"""The spread of friction between records, against the likelihood it maximises and against records of known friction."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl.identify import identify
from pmsm_ctrl.plausibility import doubts_about
from pmsm_ctrl.regression.base_fit import Estimated, base_fit
from pmsm_ctrl.regression.records import COUNTS, LEVELS, contrasts
from pmsm_ctrl.regression.spread import _spread, disagreement, levels_of
from pmsm_ctrl.regression.timed_record import timed_record
from tests.effort import amount
from tests.unit.several import DESIGN, F_C, J, record, records


def fitted(logs: list) -> Estimated:  # type: ignore[type-arg]
    return base_fit(DESIGN, timed_record(DESIGN, doubts_about(DESIGN, logs).log))


def test_contrasts_are_orthonormal_and_add_up_to_zero() -> None:
    for count in (2, 3, 7):
        c = contrasts(count)
        assert c @ c.T == pytest.approx(np.eye(count - 1))
        assert c @ np.ones(count) == pytest.approx(np.zeros(count - 1))


@pytest.mark.parametrize("spread", [0.0, 0.3, 2.0])
def test_spread_is_where_the_restricted_likelihood_with_its_prior_is_largest(spread: float) -> None:
    """Deviations known with one variance: the marginal likelihood is that of normal numbers, in closed form."""
    from scipy.optimize import minimize_scalar

    rng = np.random.default_rng(3)
    count, variance, usual = 8, 0.04, 0.2
    z = rng.normal(0.0, np.hypot(spread, np.sqrt(variance)), (3, count - 1))
    own = np.eye(3 * (count - 1)) / variance
    found = _spread(own, z.ravel() / variance, dict.fromkeys(LEVELS, usual), count)

    def cost(log_s: float, values: np.ndarray) -> float:
        s = np.exp(2.0 * log_s)
        likelihood = np.sum(np.log(s + variance) + values**2 / (s + variance))
        return float(likelihood + COUNTS * (np.log(s) + usual**2 / s))

    for values, got in zip(z, found.values(), strict=True):
        best = minimize_scalar(cost, bounds=(-5.0, 3.0), args=(values,), method="bounded", options={"xatol": 1e-6})
        assert got == pytest.approx(np.exp(best.x), rel=5e-3)


DEVIATIONS = [
    {"dF_c": 0.003, "offset": 0.001},
    {"dF_c": -0.002, "offset": -0.002},
    {"dF_c": 0.0, "offset": 0.003},
    {"dF_c": 0.002, "offset": -0.001},
    {"dF_c": -0.003, "offset": -0.001},
]


def test_friction_and_offset_of_each_record_are_told_apart() -> None:
    fit = fitted(records(DEVIATIONS))
    levels = levels_of(fit.record, fit.plain, fit.weights, fit.whitener)
    true = {name: np.array([one.get(name, 0.0) for one in DEVIATIONS]) for name in LEVELS}
    for name in LEVELS:
        apart = (levels.deviation[name] - true[name] + true[name].mean()) / levels.stderr[name]
        assert float(np.max(np.abs(apart))) < 4.0
    assert levels.spread["dF_c"] == pytest.approx(np.std(true["dF_c"], ddof=1), rel=0.5)
    assert fit.value("F_c")[0] == pytest.approx(F_C, rel=0.01)
    assert min(disagreement(fit.record, fit.model, fit.weights, fit.whitener)) > 0.01


def test_ten_records_alike_reach_the_bound_of_all_of_them_and_beat_each_alone() -> None:
    """Cramer and Rao's bound in closed form: the noise is white and the columns are known."""
    logs = [record(k, 3.0) for k in range(1, 11)]
    joint = fitted(logs)
    information = np.zeros((3, 3))
    for log in logs:
        omega = np.gradient(log["theta"], log.t)
        columns = np.array([np.gradient(omega, log.t), np.sign(omega), omega])
        information += columns @ columns.T / 1e-3**2
    bound = np.sqrt(np.diag(np.linalg.inv(information)))
    single = [fitted([log]) for log in logs[:4]]
    for k, (name, true) in enumerate((("J", J), ("F_c", F_C), ("F_v", 2e-4))):
        value, stderr = joint.value(name)
        # both ends of every record and its reversals are not used, and the time of the reversals is fitted as well
        assert bound[k] < stderr < 2.0 * bound[k], name
        assert abs(value - true) < 3.0 * stderr, name
        alone = np.sqrt(np.mean([(one.value(name)[0] - true) ** 2 for one in single]))
        assert abs(value - true) < alone, name
    levels = levels_of(joint.record, joint.plain, joint.weights, joint.whitener)
    assert float(np.max(np.abs(levels.deviation["dF_c"]))) < 0.02 * F_C


def test_a_record_of_another_inertia_disagrees_and_no_other_does() -> None:
    p_values = []
    for first in range(amount(1, 20)):
        own = [{"dF_c": 0.001 * np.cos(k + first)} for k in range(5)]
        own[3] = {"inertia": 1.1 * J}
        fit = fitted([record(10 * first + k + 1, **one) for k, one in enumerate(own)])
        p_values.append(disagreement(fit.record, fit.model, fit.weights, fit.whitener))
    assert max(p[3] for p in p_values) < 0.01
    assert all(int(np.argmin(p)) == 3 for p in p_values)


def test_a_noisier_record_counts_less() -> None:
    fit = fitted([record(1), record(2), record(3, noise=1e-2)])
    weight = [fit.record.weight[0][fit.record.mask & here].max() for here in _members(fit)]
    assert weight[2] == pytest.approx(0.1 * weight[0], rel=0.5)  # the noise is known from a few hundred samples
    assert weight[1] == pytest.approx(weight[0], rel=0.25)


def _members(fit: Estimated) -> np.ndarray:
    from pmsm_ctrl.regression.records import members

    return members(fit.record)


def test_records_that_do_not_differ_have_a_bound_and_no_spread() -> None:
    alike = identify(DESIGN, records([{}, {}]))
    bounds = {one.symbol: one.below for one in alike.spreads}
    assert set(bounds) == {"dF_c", "dF_v", "offset"}
    for one in alike.spreads:
        errors = [row.deviations[one.symbol] for row in alike.records]
        assert one.below is not None
        assert one.below == pytest.approx(max(abs(e.value) + 1.96 * e.stderr for e in errors))
    text = alike.summary(width=250)
    assert "Standard deviation between records" not in text
    assert "Deviation of each record from all: dry friction below " in text
    json_rows = alike.to_dict()["spread_between_records"]
    assert all(row["below"] is not None for row in json_rows)


def test_records_that_differ_have_a_spread() -> None:
    own = [{"dF_c": 0.004}, {"dF_c": -0.004}, {"dF_c": 0.001}, {}]
    found = identify(DESIGN, records(own))
    assert {one.symbol: one.below for one in found.spreads}["dF_c"] is None
    text = found.summary(width=250)
    assert "Standard deviation between records: dry friction " in text
