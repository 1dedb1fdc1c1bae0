"""The diagnosis by hand on a log with two hidden effects: what is added brings the truth back."""

from __future__ import annotations

import json

import pytest

from pmsm_ctrl import Design, simulate
from pmsm_ctrl.diagnose import Stepwise, stepwise
from pmsm_ctrl.errors import RequestError

STRIBECK = {"dF_s": 0.008, "w_s": 8.0, "delta": 2.0}
COGGING = {"a_s": 0.004, "a_c": 0.0, "order": 24.0}


@pytest.fixture(scope="module")
def begun() -> Stepwise:
    design = Design.read("designs/seed_motor.toml")
    truth = design.with_effect("stribeck", STRIBECK).with_effect("cogging", COGGING)
    log, other = (simulate(design, "identification", truth=truth, seed=seed) for seed in (1, 2))
    return stepwise(design, log, holdout=other)


def error(model: Stepwise) -> tuple[float, float]:
    last = model.rungs[-1]
    return last.errors["torque"]["relative"], last.holdout["torque"]["relative"]


def test_what_is_hidden_is_ranked_first_and_brings_the_error_down(begun: Stepwise) -> None:
    ranked = begun.rank()
    assert {ranked[0].effect, ranked[1].effect} >= {"cogging 24"}
    assert ranked[0].refusal is None
    assert all(one.refusal is not None for one in ranked[-3:])
    whole = begun.add("cogging").add("stribeck")
    assert whole.names == ("cogging 24", "stribeck")
    assert [rung.name for rung in whole.rungs] == ["base parameters", "+ cogging 24", "+ stribeck"]
    for before, after in zip(error(begun), error(whole), strict=True):
        assert after < 0.6 * before
    by_id = {entry.id: entry.parameters for entry in whole.design.effects}
    found = by_id["cogging"]
    assert (found["a_s"] ** 2 + found["a_c"] ** 2) ** 0.5 == pytest.approx(COGGING["a_s"], rel=0.05)
    assert by_id["stribeck"]["dF_s"] == pytest.approx(STRIBECK["dF_s"], rel=0.15)
    # nothing is missing any more
    assert not any(one.refusal is None for one in whole.rank())


def test_steps_are_undone_and_reordered(begun: Stepwise) -> None:
    one, other = begun.add("cogging").add("stribeck"), begun.add("stribeck").add("cogging 24")
    assert error(one) == pytest.approx(error(other), rel=1e-3)
    back = one.remove("stribeck")
    assert back.names == ("cogging 24",)
    assert back.rungs[-1].name == "- stribeck"
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
