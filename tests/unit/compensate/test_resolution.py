"""What an encoder does not resolve: it shows no improvement, and is no reason to call a gain worse."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.compensate import baseline, compensate, compensated, gain_window, judge, run_trial, study_trials
from pmsm_ctrl.compensate.metrics import Metrics
from pmsm_ctrl.compensate.plants import judged
from pmsm_ctrl.compensate.recommendation import finer_may_help, recommended
from pmsm_ctrl.compensate.result import CompensationStudy, Row, Variant
from pmsm_ctrl.compensate.window import GainWindow, resolves
from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import Compensation
from pmsm_ctrl.next_steps import next_step
from pmsm_ctrl.report import headline_of
from pmsm_ctrl.section import Table
from tests.effort import seeds

COUNT = 1e-3  # rad
GAINS = (0.25, 0.5, 1.0)


@pytest.fixture(scope="module")
def seed_motor(request: pytest.FixtureRequest) -> Design:
    """Return the reference motor."""
    return Design.read(request.config.rootpath / "designs" / "seed_motor.toml")


def error(rms: float, peak: float, cycle: float = 0.0) -> Metrics:
    """Return metrics in encoder counts."""
    return Metrics(rms * COUNT, peak * COUNT, peak * COUNT, 0.0, cycle * COUNT, 0.0, 0.1, 0.01)


def window(**motions: Callable[[float], tuple[float, float]]) -> GainWindow:
    """Return the window of motions whose RMS and largest error, in counts, are functions of the gain."""

    def run(gain: float, factor: float, name: str) -> Metrics:
        return error(*motions[name](gain))

    return gain_window(run, motions, "reference", gains=GAINS, resolution=COUNT)


def fast(gain: float) -> tuple[float, float]:
    return 5.0 - 4.0 * gain, 20.0


def chosen(found: GainWindow) -> float | None:
    one = recommended({"reference": found}, ("coulomb",), Compensation(), {"reference": lambda gains: found})
    return None if one is None else one.rms


def test_a_motion_below_a_count_does_not_vote_against_an_improvement() -> None:
    """5 counts become 1, 20 %; the other motion stays at 0.2 counts, and was the worst with a ratio of 1."""
    found = window(fast=fast, slow=lambda gain: (0.2, 0.7))
    assert found.rms.tolist() == pytest.approx([1.0, 0.8, 0.6, 0.2])
    assert found.judged.tolist() == [1.0, 1.0, 1.0, 1.0]
    assert found.worst == ("", "fast", "fast", "fast")
    assert (found.safe, found.best) == (1.0, 1.0)
    ((motion, rms, peak),) = [(one.motion, one.rms, one.peak) for one in found.unresolved]
    assert (motion, rms, peak) == ("slow", pytest.approx(0.2), pytest.approx(0.7))
    assert chosen(found) == pytest.approx(0.2)


def test_it_has_a_veto_where_its_error_grows_above_a_count() -> None:
    """0.2 counts become 0.7 at half gain, which no encoder shows, and 1.2 at full gain."""
    found = window(fast=fast, slow=lambda gain: (0.2 + gain, 0.7))
    assert found.judged.tolist() == pytest.approx([1.0, 1.0, 1.0, 1.2])
    assert (found.safe, found.limited_by) == (0.5, "slow")
    assert chosen(found) == pytest.approx(0.6)


def test_an_rms_below_a_count_is_resolved_where_its_largest_value_is_counts() -> None:
    """Stiff loops leave spikes at reversals: 0.5 counts RMS, 6 counts large. Compensated 0.2 counts are 40 %."""
    found = window(spikes=lambda gain: (0.5 - 0.3 * gain, 6.0))
    assert found.resolved
    assert found.unresolved == ()
    assert found.rms.tolist() == pytest.approx([1.0, 0.85, 0.7, 0.4])
    assert found.judged.tolist() == [1.0, 1.0, 1.0, 1.0]


def test_an_error_that_grows_below_a_count_is_safe_and_no_improvement() -> None:
    found = window(spikes=lambda gain: (0.5 + 0.3 * gain, 6.0))
    assert (found.safe, found.best) == (1.0, 0.0)
    assert found.rms.tolist() == pytest.approx([1.0, 1.15, 1.3, 1.6])
    assert chosen(found) is None


def test_where_the_encoder_resolves_no_motion_nothing_is_recommended() -> None:
    found = window(one=lambda gain: (0.28, 3.0), other=lambda gain: (0.5 - 0.4 * gain, 0.9))
    assert not found.resolved
    assert found.rms[0] == 1.0
    assert np.isnan(found.rms[1:]).all()
    assert [one.motion for one in found.unresolved] == ["one", "other"]
    assert (found.safe, found.best, found.worst) == (1.0, 0.0, ("", "", "", ""))
    assert chosen(found) is None
    assert not finer_may_help(found)


@pytest.mark.parametrize("seed", range(4))
def test_the_error_of_rounding_to_counts_is_not_resolved(seed: int) -> None:
    """Of positions all over a count the rounding leaves 1/sqrt(12) counts RMS: 1 % below is not resolved, above is."""
    places = np.random.default_rng(seed).uniform(0.0, 1000.0, 200_000)
    rms = float(np.sqrt(np.mean((places - np.round(places)) ** 2)))
    assert not resolves(error(0.99 * rms, 2.0), COUNT)
    assert resolves(error(1.01 * rms, 2.0), COUNT)
    assert not resolves(error(1.01 * rms, 0.99), COUNT)
    assert resolves(error(1e-6, 1e-6), 0.0)  # an ideal encoder resolves all


@pytest.mark.parametrize(
    ("rms", "gains", "safe", "may"),
    [
        ((1.0, 1.0, 3.0), (0.0, 0.5, 1.0), 1.0, True),  # the line through the last two falls to -1 at a gain of 0
        ((1.0, 1.5, 2.0), (0.0, 0.5, 1.0), 1.0, False),  # straight: between them it is above 1
        ((1.0, 1.0, 1.0), (0.0, 0.5, 1.0), 1.0, False),
        ((1.0, 1.1, 4.0), (0.0, 0.02, 0.04), 0.0, False),  # no gain lies between
        ((1.0, 1.1, 4.0), (0.0, 0.1, 0.2), 0.0, True),  # a gain of 8 % may leave 92 %
        ((1.0, 1.1, 4.0), (0.0, 0.05, 0.2), 0.0, False),  # one of 4 % leaves 96 % at least
        ((1.0, np.nan, np.nan), (0.0, 0.5, 1.0), 1.0, False),
    ],
)
def test_a_finer_step_is_offered_where_it_can_find_a_gain(
    rms: tuple[float, ...], gains: tuple[float, ...], safe: float, may: bool
) -> None:
    values = np.array(rms)
    found = GainWindow("reference", np.array(gains), values, values, values, 0.0 * values, safe, 0.0)
    assert finer_may_help(found) is may


def study_of(
    design: Design, errors: dict[Variant, tuple[float, float]], found: GainWindow, safe: float = 1.0
) -> CompensationStudy:
    """Return a study with the same RMS and largest error, in counts, in all motions."""
    motions = ("reversal 2 rad/s", "triangle", "creep 1 rad/s", "circle", "warm-up", "positioning")
    rows = [
        Row(variant, motion, factor, error(*values))
        for variant, values in errors.items()
        for motion in motions
        for factor in ((1.0,) if variant == Variant.NONE else (0.8, 1.0, 1.2))
    ]
    loop = SimpleNamespace(phase_margin=30.0, sensitivity_peak=1.9)
    corner = SimpleNamespace(name="J +15 %", speed=loop)
    observer: Any = SimpleNamespace(bandwidth=300.0, before=loop, after=loop, worst=corner, worst_before=loop)
    windows = {"reference": replace(found, safe=safe), "observer": replace(found, source="observer", safe=safe)}
    return CompensationStudy(design, tuple(rows), windows, observer=observer)


def lines(study: CompensationStudy) -> str:
    return " ".join(study.summary().split())


@pytest.mark.parametrize(
    ("left", "observed", "said"),
    [
        ((6.55, 31.6), (7.3, 26.8), "not worth its model here, since it does not lower both errors"),  # 131 and 158 %
        ((4.9, 20.0), (7.3, 26.8), "not worth its model here, since it does not lower both errors"),  # 98 %
        ((3.0, 31.6), (7.3, 26.8), "not worth its model here, since it does not lower both errors"),  # a larger peak
        ((2.0, 8.0), (4.0, 12.0), "worth its model here:"),
        ((4.0, 12.0), (2.0, 8.0), "not worth its model here:"),
    ],
)
def test_feedforward_is_worth_its_model_only_where_it_lowers_the_error(
    seed_motor: Design, left: tuple[float, float], observed: tuple[float, float], said: str
) -> None:
    errors = {Variant.NONE: (5.0, 20.0), Variant.ALL: left, Variant.OBSERVER: observed}
    text = lines(study_of(seed_motor, errors, window(fast=fast)))
    assert f"Friction feedforward is {said}" in text
    assert f"with the right parameters {20.0 * left[0]:.0f} % of the RMS error" in text
    assert "in brackets" not in text


def test_a_study_whose_encoder_shows_nothing_says_so_and_offers_no_finer_step(seed_motor: Design) -> None:
    """0.20 counts become 0.26, +30 %: neither unsafe nor better nor worth a model, and no gain changes that."""
    found = window(**{"creep 1 rad/s": lambda gain: (0.2, 0.7)})
    errors = {Variant.NONE: (0.2, 0.7), Variant.ALL: (0.26, 0.9), Variant.OBSERVER: (0.3, 0.9)}
    study = study_of(seed_motor, errors, found)
    text = lines(study)
    assert "creep 1 rad/s, RMS 0.20 and largest 0.70 encoder counts" in text
    assert "Why no compensation: the encoder does not resolve the error due to friction" in text
    assert "Whether friction feedforward is worth its model cannot be told" in text
    assert "is worth its model here" not in text
    tables = {block.header: block.rows for block in study.section().blocks if isinstance(block, Table)}
    changes = next(rows for header, rows in tables.items() if header[:2] == ("compensated", "reversals"))
    assert all(cell.startswith("(+") and cell.endswith("0 %)") for cell in changes[0][1:2])
    assert "in brackets: without compensation below what the encoder resolves" in text
    told = study.to_dict()
    assert told["verdict"] == "not_resolved"
    assert told["warning_codes"].count("friction_not_resolved") == 1
    (one,) = told["unresolved"]
    assert one == {"motion": "creep 1 rad/s", "rms_counts": pytest.approx(0.2), "peak_counts": pytest.approx(0.7)}
    assert told["windows"]["reference"]["rms"] == [1.0, None, None, None]
    headline = headline_of(study)
    assert headline is not None
    assert [number for number, _ in headline.numbers] == ["none", "(+30 %)", "(+29 %)"]  # 0.9 of 0.7 counts
    assert headline.numbers[0][1].startswith("recommended gain: the encoder does not resolve the error due to friction")
    given = {"design": "axis.toml", "step": 50.0}
    assert next_step("compensate", given, study.verdict) == ""


def test_one_motion_that_shows_nothing_is_named_and_has_no_part_in_the_changes(seed_motor: Design) -> None:
    """Reversals at 2 rad/s go from 5 to 1 counts; those at 0.5 rad/s from 0.2 to 0.3, which is no +50 %."""
    found = window(fast=fast, **{"creep 1 rad/s": lambda gain: (0.2, 0.7)})
    errors = {Variant.NONE: (5.0, 20.0), Variant.ALL: (1.0, 4.0), Variant.OBSERVER: (2.0, 8.0)}
    study = study_of(seed_motor, errors, found)
    small = [Row(Variant.NONE, "reversal 0.5 rad/s", 1.0, error(0.2, 0.7))]
    small += [Row(Variant.ALL, "reversal 0.5 rad/s", factor, error(0.3, 0.9)) for factor in (0.8, 1.0, 1.2)]
    study = replace(study, table=(*study.table, *small))
    assert study.change(Variant.ALL) == pytest.approx(-0.8)
    assert study.resolved_motions() == ("reversal 2 rad/s",)
    text = lines(study)
    said = "without compensation below what the encoder resolves, so it cannot show an improvement"
    assert f"creep 1 rad/s, RMS 0.20 and largest 0.70 encoder counts: {said}" in text
    assert study.to_dict()["warning_codes"].count("motion_not_resolved") == 1


def test_json_has_no_highest_safe_gain_where_the_first_gain_is_not_safe(seed_motor: Design) -> None:
    """The text says "below 25 %, and not 0 %"."""
    errors = {Variant.NONE: (5.0, 20.0), Variant.ALL: (1.0, 4.0), Variant.OBSERVER: (2.0, 8.0)}
    unsafe = study_of(seed_motor, errors, window(fast=fast), safe=0.0)
    assert "below 25 % (smallest gain of the sweep) with reference-speed feedforward" in lines(unsafe)
    told = unsafe.to_dict()["windows"]["reference"]
    assert (told["safe"], told["safe_below"]) == (None, 0.25)
    told = study_of(seed_motor, errors, window(fast=fast)).to_dict()["windows"]["reference"]
    assert (told["safe"], told["safe_below"]) == (1.0, None)


def test_the_table_of_the_sweep_has_the_error_by_which_a_gain_is_judged(seed_motor: Design) -> None:
    """0.5 counts become 0.65 and 0.8: 130 and 160 %, judged as 100 % and safe."""
    errors = {Variant.NONE: (0.5, 6.0), Variant.ALL: (0.8, 9.0), Variant.OBSERVER: (0.8, 9.0)}
    study = study_of(seed_motor, errors, window(spikes=lambda gain: (0.5 + 0.3 * gain, 6.0)))
    (sweep,) = [block for block in study.section().blocks if isinstance(block, Table) and block.header[0] == "speed"]
    rows = [row[1:4] + row[-1:] for row in sweep.rows if row[0] == "reference"]
    assert rows == [
        ("0 %", "100 %", "100 %", "safe"), ("25 %", "115 %", "100 %", "safe"),
        ("50 %", "130 %", "100 %", "safe"), ("100 %", "160 %", "100 %", "safe"),
    ]  # fmt: skip
    assert "errors below one encoder count taken as one count" in lines(study)


@pytest.mark.parametrize(("counts", "shown"), [(20000, True), (4096, False)])
@pytest.mark.parametrize("seed", seeds(0, 1, 2))
def test_a_coarser_encoder_of_the_reference_motor(seed_motor: Design, counts: int, shown: bool, seed: int) -> None:
    """Reversals of 5.6 counts (0.5 RMS) show an improvement by commanded speed; of 1.1 counts (0.2 RMS) none."""
    axis = seed_motor.replace(sensor={"encoder_counts": counts})
    base, trials, motions = baseline(axis), study_trials(axis), judged(axis)

    def run(gain: float, factor: float, name: str) -> Metrics:
        on = base if gain == 0.0 else compensated(base, ["coulomb", "viscous"], factor=factor, source="commanded")
        trial = trials[motions[name].trial]
        return judge(trial, run_trial(on, trial, truth=motions[name].plant, seed=seed), axis.encoder_step)

    moving = [name for name in motions if not motions[name].at_rest]
    found = gain_window(run, moving, "commanded", gains=(1.0,), resolution=axis.encoder_step)
    assert found.safe == 1.0
    assert found.resolved is shown
    assert found.best == float(shown)
    assert 0.5 < found.rms[1] < 0.95 if shown else np.isnan(found.rms[1])


@pytest.mark.slow
@pytest.mark.parametrize(("counts", "verdict"), [(20000, "recommended"), (4096, "not_resolved")])
@pytest.mark.parametrize("seed", range(3))
def test_the_study_of_a_coarser_encoder(seed_motor: Design, counts: int, verdict: str, seed: int) -> None:
    study = compensate(seed_motor.replace(sensor={"encoder_counts": counts}), gains=(0.5, 1.0), seed=seed)
    assert study.verdict == verdict
    assert ("is worth its model here" in lines(study)) is (verdict == "recommended")
