"""The diagnosis on logs of a second simulator that shares nothing with the package."""

from __future__ import annotations

import pytest

from pmsm_ctrl.diagnose import Diagnosis, diagnose, final_fit
from pmsm_ctrl.identify import identify
from pmsm_ctrl.log import Log
from tests.benchmarks.other_plant import HIDDEN, other_log, right
from tests.benchmarks.sizes import SIZES, sized
from tests.benchmarks.spoiled import SPOILED
from tests.effort import seeds, slow

COARSE = ("currents in steps of 60 mA", "voltages in steps of 0.5 V")


@pytest.mark.parametrize(("effect", "own_angle"), [slow("", False), (", logged angle alone", True)])
@pytest.mark.slow
def test_eccentricity_of_the_encoder_that_commutates_and_of_another(effect: str, own_angle: bool) -> None:
    found = diagnose(*other_log("encoder_eccentricity" + effect, 40))
    assert right("encoder_eccentricity", found)
    assert ("other_angle" in found.to_dict()["warning_codes"]) is own_angle


@pytest.mark.parametrize("seed", seeds(140, 141, 142))
def test_nothing_is_named_where_nothing_is_missing(seed: int) -> None:
    assert diagnose(*other_log("none", seed, duration=15.0), plan=False).verdict == "consistent"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        slow("stamps that jitter", 1501), slow("stamps that jitter", 1502), slow("samples that jitter", 1501),
        ("currents in steps of 60 mA", 1500), slow("voltages in steps of 0.5 V", 1500),
        slow("voltages in steps of 0.5 V", 1501),
    ],
)  # fmt: skip
def test_what_recorders_do_to_a_log_is_no_missing_effect(kind: str, seed: int) -> None:
    design, log = other_log("none", seed, duration=15.0)
    found = diagnose(design, SPOILED[kind](log, design), plan=False)
    assert found.steps == ()
    # steps too coarse for the residual to reach its floor, or R to be known, allow no better answer
    assert found.verdict in ("consistent", "inconclusive" if kind in COARSE else "")


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(701, 702))
def test_a_filtered_speed_is_no_missing_effect(seed: int) -> None:
    # the drive of this simulator logs a moving average of four differences at 2 kHz: 1 ms old
    design, log = other_log("none", seed)
    speed_alone = Log({name: values for name, values in log.channels.items() if name != "theta"})
    found = diagnose(design, speed_alone, plan=False)
    assert found.verdict == "consistent"
    assert found.record.age is not None
    assert found.record.age.delay == pytest.approx(1e-3, abs=5e-5)
    assert any("lags the torque by" in text and "(corrected)" in text for text in found.warnings)


@pytest.mark.slow
def test_an_angle_of_five_digits_gives_way_to_the_speed() -> None:
    # 0.01 rad from the 16th turn on, which would be taken for a spring
    design, log = other_log("none", 1700)
    spoiled = SPOILED["five digits"](log, design)
    found = diagnose(design, spoiled)
    assert found.verdict == "consistent"
    assert any("few digits, in steps of up to 0.01 rad: the speed is used" in text for text in found.warnings)
    fine, coarse = (identify(design, one) for one in (log, spoiled))
    assert coarse.estimates["J"].value == pytest.approx(fine.estimates["J"].value, rel=0.01)
    assert any("few digits" in text for text in coarse.warnings)


@pytest.mark.slow
def test_an_effect_is_found_from_speed_alone() -> None:
    design, log = other_log("viscous_asymmetry", 702)
    found = diagnose(design, Log({name: values for name, values in log.channels.items() if name != "theta"}))
    assert [step.effect for step in found.steps] == ["viscous_asymmetry"]


# steps of another seed: `test_a_dead_time_of_no_size_is_not_named`
@pytest.mark.parametrize(("kind", "seed"), [("slow ramps", 901), ("staircase", 902), ("cycle", 903), ("steps", 904)])
@pytest.mark.slow
def test_motions_of_machines_raise_no_alarm(kind: str, seed: int) -> None:
    # on slow ramps the acceleration is nearly all noise: a load that took no part in it would lower the error
    assert diagnose(*other_log("none", seed, kind=kind), plan=False).verdict == "consistent"


@pytest.fixture
def without_profiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the intervals of nonlinear parameters, which tests/unit/diagnose/test_profiles.py looks at."""
    monkeypatch.setattr(final_fit, "with_profiles", lambda design, fit: fit)


@pytest.mark.slow
@pytest.mark.usefixtures("without_profiles")
@pytest.mark.parametrize(
    ("effect", "kind", "seed"),
    [
        slow("thermal_drift", "steps", 900),  # u_q is off while the speed steps, and no drift would ever mend that
        ("stribeck", "steps", 901),  # a third of a per cent of the torque beside such accelerations
    ],
)
def test_motions_of_machines_show_effects(effect: str, kind: str, seed: int) -> None:
    offered = {effect, "stribeck", "presliding", "viscous_power", "load_dependent_friction", "compliance", "delay"}
    found = diagnose(*other_log(effect, seed, kind=kind), candidates=sorted(offered), plan=False)
    assert [step.effect for step in found.steps] == [effect]


# of the seeds 901 to 905 four name it; in 902 timing explains it as well
@pytest.mark.parametrize("seed", seeds(901, 903))
@pytest.mark.slow
def test_a_spring_above_the_band_is_known_by_its_give(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    # J_load 1.1e-4 kg m^2 on 15 N m/rad rings at 59 Hz; the log's band ends at 40 Hz
    found = diagnosed_spring(monkeypatch, 15.0, seed)
    assert [step.effect for step in found.steps] == ["compliance"]
    assert "resonance_beyond_band" in found.to_dict()["warning_codes"]
    spring = {symbol: e.value for symbol, e in found.steps[0].parameters.items()}
    assert spring["J_load"] ** 2 / spring["k"] == pytest.approx(1.1e-4**2 / 15.0, rel=0.1)


@pytest.mark.parametrize("seed", seeds(902, 901))
def test_a_give_that_the_sampling_of_the_current_may_have_is_no_spring(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    # over the inertia the give is 0.8e-6 s^2 at 60 N m/rad, 3.4e-6 s^2 at 15; a current that is sampled over
    # one log period of 2 ms spreads it by 0.7e-6 s^2, one standard deviation of what is held possible
    found = diagnosed_spring(monkeypatch, 60.0, seed)
    assert (found.verdict, found.steps) == ("consistent", ())


def diagnosed_spring(monkeypatch: pytest.MonkeyPatch, k: float, seed: int) -> Diagnosis:
    """Return the diagnosis of trapezoids that move a load of 1.1e-4 kg m^2 on a spring, N m/rad."""
    monkeypatch.setitem(HIDDEN, "compliance", {14: 1.1e-4, 15: k})
    return diagnose(*other_log("compliance", seed, kind="trapezoids"), plan=False)


@pytest.mark.parametrize("size", seeds("large", "small"))
@pytest.mark.slow
def test_a_diagnosis_has_no_units_of_its_own(size: str) -> None:
    design, log = other_log("unbalance", 981, duration=10.0)
    torque, current, time = SIZES[size]
    usual, other = diagnose(design, log), diagnose(*sized(design, log, torque, current, time))
    assert [step.effect for step in other.steps] == [step.effect for step in usual.steps] == ["unbalance"]
    found, scaled = (result.steps[0].parameters["a_s"] for result in (usual, other))
    assert scaled.value == pytest.approx(torque * found.value, rel=1e-3)
    assert scaled.stderr == pytest.approx(torque * found.stderr, rel=0.02)


@pytest.mark.parametrize(
    ("kind", "seed", "size"),
    [
        slow(None, 981, "slow"),  # the drive's own noise moves the axis: what is left depends on small accelerations
        ("two sines", 1082, "fast"),  # a bend of the friction that is passed within a sample
        ("two sines", 1282, "fast"),  # a lag that is over within a sample
        ("cycle", 1180, "fast"),  # u_d is known no better than the whole voltage
    ],
)
@pytest.mark.slow
def test_drives_of_other_sizes_raise_no_alarm(kind: str | None, seed: int, size: str) -> None:
    assert diagnose(*sized(*other_log("none", seed, kind=kind), *SIZES[size])).verdict == "consistent"


@pytest.mark.slow
def test_a_dead_time_of_no_size_is_not_named() -> None:
    # 0.02 V would lower the error of u_q, and raise that of u_d by a fifth
    assert diagnose(*other_log("none", 1081, kind="steps"), plan=False).verdict == "consistent"


@pytest.mark.slow
def test_noise_that_moves_the_axis_is_no_load_on_a_spring() -> None:
    slow = sized(*other_log("constant_load", 980), *SIZES["slow"])
    found = diagnose(*slow, candidates=["constant_load", "compliance"])
    assert [step.effect for step in found.steps] == ["constant_load"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(1751, 1750))
def test_noise_around_a_constant_acceleration_is_no_dependence(seed: int) -> None:
    assert diagnose(*sized(*other_log("none", seed, kind="triangle"), *SIZES["slow"])).verdict == "consistent"
