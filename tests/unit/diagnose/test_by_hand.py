"""The diagnosis by hand on a log with two hidden effects: what is added brings the truth back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pmsm_ctrl import Design, simulate
from pmsm_ctrl.diagnose import Stepwise, stepwise
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.simulate import scenario
from tests.effort import amount

STRIBECK = {"dF_s": 0.008, "w_s": 8.0, "delta": 2.0}
COGGING = {"a_s": 0.004, "a_c": 0.0, "order": 24.0}


@pytest.fixture(scope="module")
def begun() -> Stepwise:
    design = Design.read("designs/seed_motor.toml")
    truth = design.with_effect("stribeck", STRIBECK).with_effect("cogging", COGGING)
    motion = scenario("identification", design, duration=amount(15, 30))
    log, other = (simulate(design, motion, truth=truth, seed=seed) for seed in (1, 2))
    return stepwise(design, log, holdout=other)


@pytest.fixture(scope="module")
def added(begun: Stepwise) -> Stepwise:
    return begun.add("cogging 24")


def error(model: Stepwise) -> tuple[float, float]:
    last = model.models[-1]
    return last.errors["torque"]["relative"], last.holdout["torque"]["relative"]


@pytest.mark.slow
def test_what_is_hidden_is_ranked_first_and_brings_the_error_down(begun: Stepwise) -> None:
    ranked = begun.rank()
    assert {ranked[0].effect, ranked[1].effect} >= {"cogging 24"}
    assert ranked[0].refusal is None
    assert all(one.refusal is not None for one in ranked[-3:])
    whole = begun.add("cogging").add("stribeck")
    assert whole.names == ("cogging 24", "stribeck")
    assert [one.name for one in whole.models] == ["base parameters", "+ cogging 24", "+ stribeck"]
    for before, after in zip(error(begun), error(whole), strict=True):
        assert after < 0.6 * before
    by_id = {entry.id: entry.parameters for entry in whole.design.effects}
    found = by_id["cogging"]
    assert (found["a_s"] ** 2 + found["a_c"] ** 2) ** 0.5 == pytest.approx(COGGING["a_s"], rel=0.05)
    assert by_id["stribeck"]["dF_s"] == pytest.approx(STRIBECK["dF_s"], rel=0.15)
    # nothing is missing any more
    assert not any(one.refusal is None for one in whole.rank())


def test_the_spectrum_over_the_turn_shows_the_cogging(begun: Stepwise, added: Stepwise) -> None:
    for held_out in (None, 0):
        spectrum = begun.orders(held_out)
        assert spectrum is not None
        amplitude, level = spectrum
        assert amplitude[23] == pytest.approx(COGGING["a_s"], rel=0.05)
        assert amplitude[23] > 3.0 * level[23]
    without = added.orders()
    assert without is not None
    assert without[0][23] < without[1][23]


def test_a_preview_is_what_adding_takes_from_the_residual(begun: Stepwise, added: Stepwise) -> None:
    curve, before = begun.preview("cogging 24"), begun.contributions()
    after = added.contributions()
    used = before.used
    taken = (before.residual() - after.residual())[used]
    assert np.corrcoef(curve[used], taken)[0, 1] > 0.97  # the rest is other parameters that were fitted again
    assert np.std(curve[used]) == pytest.approx(np.std(taken), rel=0.1)
    with pytest.raises(RequestError, match=r"no candidate on this log; did you mean 'cogging 24'"):
        begun.preview("coging")
    with pytest.raises(RequestError, match="unknown balance 'force': this log has torque"):
        begun.preview("cogging", "force")


def test_a_held_out_record_has_the_error_of_its_rung(begun: Stepwise) -> None:
    held = begun.held_out(0)["torque"]
    assert held.error() == pytest.approx(begun.models[0].holdout["torque"]["relative"], rel=1e-9)
    assert held.effects == {}
    assert next(iter(begun.coordinates(0))) == "speed [rad/s]"
    assert all(values.shape == held.t.shape for values in begun.coordinates(0).values())
    with pytest.raises(RequestError, match="held-out record 1: there are 1"):
        begun.held_out(1)


def test_a_held_out_record_shows_what_an_effect_contributes_there(added: Stepwise) -> None:
    parts, over = added.held_out(0)["torque"], added.coordinates(0)
    (cogging,) = parts.effects.values()
    assert parts.rest + cogging == pytest.approx(parts.predicted, abs=1e-15)
    slow = parts.used & (np.abs(over["speed [rad/s]"]) < 1.0)  # the filter of the balances leaves it as it is
    hidden = COGGING["a_s"] * np.sin(24.0 * over["angle in a turn [rad]"])
    assert np.sqrt(np.mean((cogging - hidden)[slow] ** 2)) < 0.1 * COGGING["a_s"]
    independent = np.hypot(parts.error(), np.sqrt(np.mean(cogging[parts.used] ** 2)) / parts.size)
    assert parts.error(("cogging 24",)) == pytest.approx(independent, rel=0.02)
    traces = added.traces()
    assert [list(one.balances[0].parts) for one in (traces, *traces.held_out)] == [["cogging 24"]] * 2
    assert traces.held_out[0].balances[0].measured == pytest.approx(parts.measured)


@pytest.mark.slow
def test_the_search_is_the_diagnosis_and_can_be_ended(begun: Stepwise) -> None:
    seen: list[str] = []
    shares: list[float] = []
    found, diagnosis = begun.find(progress=shares.append, each=lambda one: seen.append(one.name))
    assert {step.effect for step in diagnosis.steps} == {"cogging", "stribeck"}
    assert [f"+ {name}" for name in found.names] == [one.name for one in found.models[1:]]
    assert sorted(seen) == sorted(one.name for one in found.models[1:])
    assert shares == sorted(shares)
    last = found.models[-1].errors["torque"]["relative"]
    assert last == pytest.approx(diagnosis.errors["final"]["torque"]["relative"], rel=1e-5)  # shapes fitted last

    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        begun.find(progress=stop)


def test_steps_are_undone_and_reordered(begun: Stepwise) -> None:
    one, other = begun.add("cogging").add("stribeck"), begun.add("stribeck").add("cogging 24")
    assert error(one) == pytest.approx(error(other), rel=1e-3)
    back = one.remove("stribeck")
    assert back.names == ("cogging 24",)
    assert back.models[-1].name == "- stribeck"
    assert error(back) == pytest.approx(error(begun.add("cogging")), rel=1e-3)
    assert begun.names == ()  # the one before is as it was
    data = json.loads(json.dumps(back.to_dict(), allow_nan=False))
    assert data["effects"] == ["cogging 24"]
    assert str(back).count("\n") == 3


def test_what_cannot_be_added_or_removed_is_told(begun: Stepwise) -> None:
    with pytest.raises(RequestError, match="coging"):
        begun.add("coging")
    with pytest.raises(RequestError, match=r"effect 'stribeck': not added \(added: none\)"):
        begun.remove("stribeck")
    with pytest.raises(RequestError, match="unknown effect 'friktion'"):
        stepwise(Design.read("designs/seed_motor.toml"), simulate(begun.design, "triangle"), candidates=["friktion"])
