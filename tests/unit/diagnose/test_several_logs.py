"""A diagnosis from several records, in closed form: each has its row, and what it has of its own names nothing."""

from __future__ import annotations

import numpy as np
import pytest

from pmsm_ctrl import Design
from pmsm_ctrl.compare import compare
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.identify import identify
from pmsm_ctrl.track import track
from tests.effort import seeds, slow
from tests.unit.several import DESIGN, F_C, F_V, J, record, records

OWN = [{"dF_c": 0.002, "offset": 0.002}, {"dF_c": -0.002, "offset": -0.001}, {"offset": -0.002}, {"dF_c": 0.001}]
FEW = ("cogging", "constant_load", "viscous_asymmetry", "quadratic_drag")


def test_friction_and_offsets_that_differ_are_no_missing_effect() -> None:
    found = diagnose(DESIGN, records(OWN), holdout=[record(9, dF_c=-0.003)], candidates=FEW, plan=False)
    assert found.steps == ()
    assert [row.held_out for row in found.records] == [False] * 4 + [True]
    assert [row.name for row in found.records] == [f"record_{k}.csv" for k in (1, 2, 3, 4, 9)]
    held = found.records[-1]
    assert held.level_after["torque"]["relative"] < 0.5 * held.after["torque"]["relative"]
    offsets = [row.deviations["offset"].value for row in found.records[:4]]
    assert offsets == pytest.approx([one.get("offset", 0.0) for one in OWN], abs=3e-4)
    assert {one.symbol for one in found.spreads} == {"dF_c", "dF_v", "offset"}
    data = found.to_dict()
    assert [row["name"] for row in data["records"]] == [row.name for row in found.records]
    assert data["log"] == "4 logs"
    text = found.summary(width=250)
    assert "Standard deviation between records: dry friction" in text
    assert "record_9.csv (held out)" in text
    # no table of steps holds the error of the held-out record: a terminal shows that of the records
    assert "record_9.csv (held out)" in found.summary(width=250, brief=True)
    simulated = compare(found.design, records(OWN)).to_dict()["simulation"]
    whole = [one["errors"]["theta"]["rms"] for one in simulated if one["method"] == "free run"]
    assert len(whole) == 4
    assert found.free_run["final"]["rms"] == pytest.approx(np.sqrt(np.mean(np.square(whole))), rel=0.05)


def test_a_load_that_all_records_share_is_named_and_judged_on_records_left_out() -> None:
    logs = records([{"offset": 0.004 + 1e-4 * k} for k in range(4)])
    found = diagnose(DESIGN, logs, candidates=FEW, plan=False)
    assert found.steps[0].effect == "constant_load"
    (load,) = found.steps[0].parameters.values()
    assert load.value == pytest.approx(0.00415, rel=0.05)


def test_a_load_of_two_records_is_named() -> None:
    """Two records that share a torque of a fifth of the friction were taken for two that differ from a mean of 0."""
    found = diagnose(DESIGN, records([{"offset": 0.004}] * 2), candidates=FEW, plan=False)
    assert [step.effect for step in found.steps] == ["constant_load"]
    (load,) = found.steps[0].parameters.values()
    assert load.value == pytest.approx(0.004, rel=0.02)
    assert [row.deviations["offset"].value for row in found.records] == pytest.approx([0.0, 0.0], abs=2e-4)


def test_records_that_lack_the_same_effect_agree() -> None:
    """Both were said to differ from the other, with deviations of zero: a load was missing in either."""
    found = identify(DESIGN, records([{"offset": 0.006}] * 2))
    assert "record_disagrees" not in {notice.code for notice in found.notices}
    assert min(row.p_value for row in found.records) > 0.01
    other = identify(DESIGN, records([{}, {"offset": 0.006}]))
    assert max(row.deviations["offset"].value for row in other.records) == pytest.approx(0.006, rel=0.1)


def test_without_a_load_its_torque_is_left_and_not_taken_up_by_what_records_differ_in() -> None:
    logs = records([{"offset": 0.03 + 0.004 * k} for k in (-1.0, 0.2, 0.8)])
    fit = diagnose(DESIGN, logs, candidates=["constant_load"], plan=False).selection.fit
    bare = fit.without_last()
    assert bare is not None
    left = [float(np.sqrt(np.mean(one.residual[0][one.record.mask] ** 2))) for one in (bare, fit)]
    assert left[0] == pytest.approx(0.03, rel=0.15)
    assert left[1] < 5e-4


def test_a_wave_is_found_across_other_zeros_of_the_angle() -> None:
    logs = records([{"zero": zero} for zero in (0.0, 0.3, -0.2, 0.1)], wave=0.004)
    found = diagnose(DESIGN, logs, candidates=FEW, plan=False)
    assert [step.name for step in found.steps] == ["cogging 8"]
    assert any(row.angle is not None and row.angle.value for row in found.records)
    assert "other_zero" in {notice.code for notice in found.notices}
    assert found.errors["final"]["torque"]["rms"] < 0.3 * 0.004 / np.sqrt(2.0)


def test_a_held_out_record_may_have_another_zero() -> None:
    """Its wave has another phase there: the right effect raised its error, and was refused for it."""
    logs = records([{"zero": zero} for zero in (0.0, 0.1, 0.2)], wave=0.008)
    for number in (1, 2):
        found = diagnose(DESIGN, logs[:number], holdout=logs[number], candidates=FEW, plan=False)
        assert [step.name for step in found.steps] == ["cogging 8"]
        row = found.records[-1]
        assert row.held_out
        assert row.angle is not None
        assert row.angle.value == pytest.approx(-0.1 * number, abs=4.0 * row.angle.stderr)
        assert row.after["torque"]["rms"] < 0.15 * row.before["torque"]["rms"]
        compared = compare(found.design, logs[:number], holdout=logs[number])
        assert compared.holdouts[0].errors["torque"].relative == pytest.approx(
            row.after["torque"]["relative"], rel=0.02
        )


def test_an_effect_that_the_held_out_record_refuses_is_no_structure_without_a_name() -> None:
    """The log was said to have a structure that no effect of the catalogue explains."""
    found = diagnose(DESIGN, record(1, wave=0.008), holdout=record(2), candidates=FEW, plan=False)
    assert found.steps == ()
    assert found.verdict == "inconclusive"
    assert any("increases the error on the held-out record" in reason.text for reason in found.reasons)


@pytest.mark.parametrize(("inertia", "said"), [(J, False), (2.0 * J, True)])
def test_a_held_out_record_of_another_axis_is_said_to_be_one(inertia: float, said: bool) -> None:
    other = record(3, wave=0.008, dF_c=0.004, inertia=inertia)
    found = diagnose(DESIGN, record(1, wave=0.008), holdout=other, candidates=FEW, plan=False)
    assert [step.name for step in found.steps] == ["cogging 8"]
    assert ["record_3.csv" in n.text for n in found.notices if n.code == "held_out_disagrees"] == [True] * said


@pytest.mark.parametrize("zeros", [slow((0.0, 0.1)), (0.0, 0.1, 0.2)])
def test_the_written_design_is_compared_with_the_same_zeros(zeros: tuple[float, ...]) -> None:
    """A wave that is fitted to all records alike hides their zeros, and what they leave of it is none."""
    logs = records([{"zero": zero} for zero in zeros], wave=0.008)
    found = diagnose(DESIGN, logs, candidates=FEW, plan=False)
    compared = compare(found.design, logs)
    judged = found.errors["final"]["torque"]["relative"]
    assert compared.log.errors["torque"].relative == pytest.approx(judged, rel=1e-6)
    assert [row.angle for row in compared.records] == [row.angle for row in found.records]
    rows = [[row.after["torque"]["relative"] for row in found.records]]
    rows += [[row.before["torque"]["relative"] for row in compared.records]]
    assert rows[0] == pytest.approx(rows[1], rel=1e-6)
    again = diagnose(found.design, logs, candidates=FEW, plan=False)
    assert (again.verdict, again.steps) == ("consistent", ())
    assert again.errors["nominal"]["torque"]["relative"] < 0.01
    a_s, a_c = (identify(found.design, logs).estimates[name] for name in ("a_s", "a_c"))
    assert np.hypot(a_s.value, a_c.value) == pytest.approx(0.008, rel=0.02)


def test_of_several_zeros_that_of_the_design_is_kept() -> None:
    """The records are compared with the zero of the one that the waves of the design suit."""
    logs = records([{"zero": zero, "seconds": seconds} for zero, seconds in ((0.0, 3.0), (0.2, 6.0))], wave=0.008)
    wave = {"id": "cogging", "a_s": 0.008 * np.cos(1.0), "a_c": 0.008 * np.sin(1.0), "order": 8}
    design = Design.from_dict({
        "name": "axis", "motor": {"J": J, "K_t": 1.0},
        "effects": [{"id": "coulomb", "F_c": F_C}, {"id": "viscous", "F_v": F_V}, wave],
    })  # fmt: skip
    compared = compare(design, logs)
    assert compared.log.errors["torque"].relative < 0.01
    first, second = (row.angle for row in compared.records if row.angle is not None)
    assert first.value == 0.0
    assert second.value == pytest.approx(-0.2, abs=4.0 * second.stderr)


@pytest.mark.slow
def test_the_other_verbs_take_the_same_records() -> None:
    logs = records(OWN, seconds=3.0)
    identified = identify(DESIGN, logs)
    assert identified.estimates["J"].value == pytest.approx(J, rel=0.01)
    assert identified.estimates["F_c"].value == pytest.approx(F_C + 0.00025, rel=0.02)
    assert len(identified.records) == 4
    assert "Standard deviation between records" in identified.summary(width=200)
    compared = compare(identified.design, logs[:2], holdout=[record(8, 2.0), record(9, 2.0)])
    assert [row.held_out for row in compared.records] == [False] * 2 + [True] * 2
    assert len(compared.holdouts) == 2
    assert all(row.level_before["torque"]["rms"] <= row.before["torque"]["rms"] for row in compared.records)
    tracked = track(DESIGN, logs[:2])
    assert list(tracked.by_record) == [f"record_{k}.csv" for k in (1, 2)]


def test_what_simulates_one_log_refuses_several() -> None:
    with pytest.raises(RequestError, match="2 logs, but it simulates one"):
        identify(DESIGN, records(OWN[:2]), method="iv")
    with pytest.raises(RequestError, match="found 2 logs; one"):
        diagnose(DESIGN, records(OWN[:2]), calibrate=1)


@pytest.mark.parametrize("number", seeds(1, 3, 5))
def test_the_noise_floor_is_that_of_all_records(number: int) -> None:
    """A loud record beside a quiet one had the floor of the quiet one: its noise was an error of five times that."""
    logs = [record(number, 12.0, noise=1e-3), record(number + 1, 12.0, noise=2e-2)]
    found = diagnose(DESIGN, logs, plan=False)
    error, floor = (found.errors[which]["torque"]["relative"] for which in ("final", "noise_floor"))
    alone = [diagnose(DESIGN, one, plan=False).errors["noise_floor"]["torque"]["rms"] for one in logs]
    assert found.errors["noise_floor"]["torque"]["rms"] == pytest.approx(np.sqrt(np.mean(np.square(alone))), rel=0.15)
    assert floor <= error
    assert found.verdict == "consistent"


def test_a_design_that_explains_a_log_with_other_parameters_is_not_said_to_explain_it() -> None:
    given = diagnose(DESIGN, record(2, 12.0), plan=False)
    assert "with refitted parameters the design explains this log" in given.summary().replace("\n", " ")
    right = diagnose(given.design, record(2, 12.0), plan=False)
    assert "No missing effect: the design explains this log (error" in right.summary().replace("\n", " ")
