"""Columns of effects: which of them follow from the motion alone, and may be kept from one fit to the next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.regression.balances import Record, make_record
from pmsm_ctrl.regression.base_fit import SETTLED, base_fit
from pmsm_ctrl.regression.columns import candidate_groups, effect_group
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.made import Made
from pmsm_ctrl.regression.modelled import with_direction, with_modelled_torque
from pmsm_ctrl.regression.timed_record import with_friction
from pmsm_ctrl.simulate import simulate


@pytest.fixture(scope="module")
def record(designs) -> Record:
    design = Design.read(designs / "seed_motor.toml")
    return make_record(design, simulate(design, "identification", seed=1))


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_columns_that_are_kept_are_those_of_the_record_that_is_asked(record: Record, name: str) -> None:
    effect = CATALOGUE[name]
    shape = effect.structure.shape(effect, effect.example)
    slow = record.shaped(record.signals["torque"]) * 0.5 + 0.1
    others = (
        lambda r: with_modelled_torque(r, slow),
        lambda r: with_direction(r, np.clip(r.signals["omega"], -1.0, 1.0)),
    )
    for build in (effect_group, lambda record, effect, shape: candidate_groups(record, effect, [shape])[0]):
        build(record, effect, shape)  # remembered, whatever comes next
        for other in others:
            fresh = replace(other(record), memo={}, kept={})
            asked = build(other(record), effect, shape).values
            np.testing.assert_array_equal(asked, build(fresh, effect, shape).values)


def test_a_kind_of_columns_that_was_forgotten_is_made_again(record: Record, monkeypatch: pytest.MonkeyPatch) -> None:
    """A log of ten minutes fills what is kept between the two kinds of a spring's columns: a diagnosis ended there."""
    effect, fresh = CATALOGUE["compliance"], replace(record, memo={}, kept={})
    shape = effect.structure.shape(effect, effect.example)
    monkeypatch.setattr("pmsm_ctrl.regression.columns.MOST_KEPT", 0.5 * record.target[0].nbytes)
    candidate_groups(fresh, effect, [shape])
    (again,) = candidate_groups(replace(fresh, memo={}), effect, [shape])
    (alone,) = candidate_groups(replace(record, memo={}, kept={}), effect, [shape])
    np.testing.assert_array_equal(again.values, alone.values)


def test_no_columns_outlive_the_diagnosis(designs) -> None:
    design = Design.read(designs / "seed_motor.toml")
    found = diagnose(design, simulate(design, "identification", seed=2), candidates=("stribeck", "presliding"))
    assert not found.record.kept
    assert all(not fit.record.memo and not fit.record.kept for fit in found.selection.fits)
    *earlier, last = found.selection.fits
    assert not any(fit.trials for fit in earlier)
    assert last.trials
    assert not any(trial.group.rows for trial in last.trials)


def test_the_model_of_the_design_stays_with_the_record_in_use_alone(designs) -> None:
    design = with_friction(Design.read(designs / "seed_motor.toml"))
    made = Made.kept(simulate(design, "identification", seed=3))
    usual, half = (made.record(design, processing) for processing in (None, Processing(cutoff=20.0)))
    for record in (usual, half):
        base_fit(design, record)
    made.forget_models(half)
    held = [[key for key in record.kept if key[0] == SETTLED] for record in (usual, half)]
    assert not held[0]
    assert held[1]
    assert usual.kept  # columns of the measured motion are those of any design


def test_shapes_filtered_side_by_side_are_the_same_to_the_last_bit(record: Record) -> None:
    effect = CATALOGUE["stribeck"]
    shapes = [{"w_s": w, "delta": d} for w in (1.0, 3.0, 9.0) for d in (1.0, 2.0)]
    together = candidate_groups(replace(record, memo={}, kept={}), effect, shapes)
    for shape, group in zip(shapes, together, strict=True):
        (alone,) = candidate_groups(replace(record, memo={}, kept={}), effect, [shape])
        np.testing.assert_array_equal(group.values, alone.values)
        assert [columns is None for columns in group.rows] == [False, True, True]


def test_a_contact_as_stiff_as_one_likes_is_followed_in_few_steps(record: Record) -> None:
    """A refinement had led to 72 MHz, and to a million steps for each sample: the diagnosis did not end."""
    gap = CATALOGUE["backlash"]

    def followed(hertz: float) -> np.ndarray:
        (columns,) = effect_group(record, gap, {"gap": 0.01, "(w_a)": 2.0 * np.pi * hertz, "(zeta)": 2.0}).rows[0]
        return columns[record.mask]

    assert np.array_equal(followed(72e6), followed(3000.0))
    assert gap.structure.inside(gap, {}, "(w_a)", 1e9) == 2.0 * np.pi * 3000.0
