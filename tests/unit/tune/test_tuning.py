"""The verb: noise, tolerances, resonance, units, report, refusals."""

from __future__ import annotations

import importlib
import itertools
import json
import math
import re
import subprocess
import sys
from dataclasses import replace

import control as ct
import numpy as np
import pytest
from matplotlib.text import Annotation

from pmsm_ctrl.design import CurrentLoop, Design, Loops, PositionLoop, SpeedLoop
from pmsm_ctrl.effects import Effect, Parameter, kernel
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.section import Picture, Table
from pmsm_ctrl.tune.figures import bode
from pmsm_ctrl.tune.margins import margins, response
from pmsm_ctrl.tune.noise import h2_norm, noise
from pmsm_ctrl.tune.requirements import Criterion, Requirements, Specification
from pmsm_ctrl.tune.resonance import resonance_frequencies
from pmsm_ctrl.tune.result import Tuning, UnstableLoopError
from pmsm_ctrl.tune.robust import corners, robustness, varied, varied_load
from pmsm_ctrl.tune.sampled import Cascade, frequencies
from pmsm_ctrl.tune.speed import open_loop
from pmsm_ctrl.tune.tuning import assess, tune
from tests.unit import tuned as shipped


@pytest.fixture(scope="module")
def root(request):
    return request.config.rootpath / "designs"


@pytest.fixture(scope="module")
def tuned() -> Tuning:
    return shipped.tuned("seed_motor")


@pytest.fixture(scope="module")
def resonant() -> Tuning:
    return shipped.tuned("geared_resonant")


def test_importing_the_package_does_not_import_python_control():
    code = "import sys, pmsm_ctrl, pmsm_ctrl.tune; sys.exit('control' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    package = importlib.import_module("pmsm_ctrl.tune")
    with pytest.raises(AttributeError, match="no attribute 'tun'"):
        package.tun  # noqa: B018
    assert package.tune is tune


@pytest.mark.slow
def test_h2_norm_against_control_and_against_random_numbers():
    system = ct.ss(ct.tf([0.2, 0.1], [1.0, -1.2, 0.5], 1e-3))
    assert h2_norm(system) == pytest.approx(ct.system_norm(system, 2), rel=1e-9)
    rng = np.random.default_rng(5)
    noise_in = rng.standard_normal(200_000)
    _, y = ct.forced_response(system, 1e-3 * np.arange(noise_in.size), noise_in)
    assert np.std(y) == pytest.approx(h2_norm(system), rel=0.01)


@pytest.mark.slow
def test_noise_gain_is_the_integral_over_frequency(tuned):
    system = tuned.cascade.with_gains(position=None).system(("angle_noise",), ("i_q_ref",))
    omega = np.linspace(0.0, math.pi / system.dt, 20001)
    square = np.trapezoid(np.abs(response(system, omega[1:])) ** 2, omega[1:]) * system.dt / math.pi
    assert tuned.noise.encoder_gain == pytest.approx(math.sqrt(square), rel=1e-3)
    step = 2.0 * math.pi / 131072
    assert tuned.noise.encoder_ripple == pytest.approx(tuned.noise.encoder_gain * step / math.sqrt(12.0))


def test_the_current_loop_passes_its_own_noise_as_its_closed_form_says(root):
    # A dead-beat free loop k/(z - 1) without delay: T = k/(z - 1 + k), H2 norm sqrt(k/(2 - k)).
    design = Design.read(root / "seed_motor.toml").replace(drive={"delay_periods": 0})
    R, L, T = 19.0, 49.16e-3, 1.0 / 16000.0
    pole = math.exp(-R * T / L)
    k = 0.3
    # T_n that puts the PI's zero exactly on the winding's pole
    loop = CurrentLoop(K_p=k * R / (1.0 - pole), T_n=T / (1.0 - pole))
    cascade = Cascade.of(design, loop, SpeedLoop(K_p=0.02, T_n=0.05), at=30.0)
    assert noise(cascade).current_gain == pytest.approx(math.sqrt(k / (2.0 - k)), rel=1e-6)


def test_corners_and_variation(root):
    design = Design.read(root / "geared_resonant.toml")
    # two masses: the load's inertia and the stiffness vary beside J, psi_f, R and L_q
    assert len(corners(design)) == 64
    assert len(corners(design.replace(motor={"tolerance": {"J": 0.1}}))) == 8
    assert len(corners(Design.read(root / "seed_motor.toml"))) == 16
    apart = {"J": 0.1, "J_load": -0.2, "k": 0.3}
    load = varied_load(design, apart)
    assert load.J_load == pytest.approx(0.8 * 2.0e-4)
    assert load.k == pytest.approx(1.3 * 230.0)
    assert pytest.approx(1.1 * (design.J - 2.0e-4) + 0.8 * 2.0e-4) == varied(design, apart).J
    soft = Cascade.of(design, CurrentLoop(K_p=20.0, T_n=7e-3), truth=varied(design, apart), mass=load, at=40.0)
    mechanics = [soft.model.states.index(name) for name in ("omega", "omega_load", "twist")]
    mode = np.abs(np.linalg.eigvals(soft.model.A[np.ix_(mechanics, mechanics)]).imag).max()
    J_m = 1.1 * (design.J - 2.0e-4)
    assert mode == pytest.approx(math.sqrt(load.k * (1.0 / load.J_load + 1.0 / J_m)), rel=5e-3)
    plant = varied(design, {"J": -0.1, "psi_f": 0.05, "R": 0.2, "L_q": -0.2})
    assert pytest.approx(0.9 * design.J) == plant.J
    assert plant.K_t == pytest.approx(1.05 * design.K_t)
    assert plant.motor.L_d == pytest.approx(0.8 * design.motor.L_d)
    assert plant.parameters("compliance")["J_load"] == pytest.approx(0.9 * 2.0e-4)


def test_the_worst_corner_is_named_and_no_point_inside_is_worse(tuned):
    found = tuned.robustness
    assert found.corners == 20
    assert found.worst_speed.name.startswith("J ")
    need = tuned.requirements
    design = tuned.design
    more = robustness(design, requirements=need, at=40.0, inside=12, seed=3)
    assert need.shortfall(more.worst_speed.speed) == pytest.approx(need.shortfall(found.worst_speed.speed), abs=0.01)
    # A winding with less inductance and resistance makes the current loop faster and its margin smaller.
    assert found.worst_current.deviations["L_q"] < 0.0
    assert found.worst_current.current.phase_margin < found.nominal.current.phase_margin


@pytest.mark.slow
def test_robust_gains_keep_the_worst_corner(root):
    design = Design.read(root / "seed_motor.toml")
    need = Requirements(phase_margin=48.0, gain_margin_db=8.0, sensitivity_peak=1.8)
    found = tune(design, Specification(robust=True, requirements=need), prove=False)
    assert not found.robustness.missed
    assert found.robustness.slowed > 1.0
    assert found.robustness.worst_speed.speed.phase_margin >= 48.0
    assert found.robustness.worst_current.current.phase_margin >= 48.0
    assert found.slowed["speed"] == found.robustness.slowed
    assert "slowed down" in found.summary()
    with pytest.raises(RequestError, match="no gains keep the margins over the tolerances"):
        tune(design, Specification(robust=True, requirements=Requirements(phase_margin=89.0)), prove=False)


def test_resonance_frequencies_are_the_textbooks(root):
    design = Design.read(root / "geared_resonant.toml")
    anti, peak = resonance_frequencies(design)
    assert anti == pytest.approx(math.sqrt(230.0 / 2e-4) / (2 * math.pi))
    assert peak / anti == pytest.approx(math.sqrt(1.0 + 2e-4 / (design.J - 2e-4)))
    assert resonance_frequencies(Design.read(root / "seed_motor.toml")) is None


@pytest.mark.slow
def test_a_resonance_gets_a_filter_proposed_with_margins_before_and_after(resonant):
    found = resonant.resonance
    assert resonant.requirements.missed(found.before)
    assert found.slowed
    proposed = found.proposed
    assert proposed is not None
    assert proposed.filter.kind == "notch"
    assert proposed.filter.frequency == pytest.approx(found.resonance)
    assert proposed.margins.sensitivity_peak < found.before.sensitivity_peak
    assert not resonant.requirements.missed(resonant.margins["speed"])
    # Over the tolerances of the load it is worth a tenth of the crossover.
    assert proposed.crossover > 1.1 * found.plain.crossover
    slowed = next(notice for notice in resonant.notices if notice.code == "slowed_by_resonance")
    assert "up to a crossover of 49.9 Hz with the best filter, a notch at 256 Hz" in slowed.text
    # The gains without it are faster, though they keep the requirements on the nominal axis alone: it is not taken.
    assert found.used is None
    assert found.unfiltered == pytest.approx(resonant.margins["speed"].crossover, rel=1e-3)
    assert not resonant.loops.speed.filters
    assert "and up to 43.3 Hz without one" in slowed.text
    assert "the gains chosen without a filter keep them nominally at 56.1 Hz" in slowed.text


def test_the_proposed_filter_keeps_the_requirements_at_every_corner_of_the_load(resonant):
    """Stiffness and both inertias at the ends of their tolerances, where the narrow notch alone does not."""
    design, proposed = resonant.design, resonant.resonance.proposed
    # K_p = J / (a K_t T_sigma) and T_n = a^2 T_sigma with a larger a
    gains, f = proposed.gains, proposed.slowed
    slower = gains.model_copy(update={"K_p": gains.K_p / f, "T_n": gains.T_n * f**2})
    for k, J_load, J in itertools.product((-0.2, 0.0, 0.2), (-0.15, 0.15), (-0.15, 0.15)):
        apart = {"J": J, "J_load": J_load, "k": k}
        axis = Cascade.of(
            design, resonant.loops.current, truth=varied(design, apart), mass=varied_load(design, apart),
            at=resonant.cascade.model.point.speed,
        )  # fmt: skip
        loop = open_loop(axis, slower)
        grid = frequencies(axis.period, 1e-3, 4000)
        assert np.abs(1.0 / (1.0 + response(loop, grid))).max() < 2.02
    narrow = min(resonant.resonance.options, key=lambda option: option.margins.sensitivity_peak)
    # It was 6.1 with the gains of the rigid axis; the rule now counts the filter's delay, which makes them lower.
    assert narrow.worst.sensitivity_peak > 3.0 > resonant.requirements.sensitivity_peak
    assert narrow is not proposed


def test_the_gains_in_the_units_of_the_drives(root):
    loops = Loops(
        current=CurrentLoop(K_p=20.0, T_n=4e-3),
        speed=SpeedLoop(K_p=0.05, T_n=8e-3, reference_filter=8e-3),
        position=PositionLoop(K_v=100.0),
    )
    design = Design.read(root / "seed_motor.toml").model_copy(update={"loops": loops})
    units = assess(design, prove=False).gains
    assert units["Siemens"]["p1460 speed controller K_p [N m s/rad]"] == pytest.approx(0.05 * 1.032)
    assert units["Siemens"]["p1462 speed controller T_n [ms]"] == pytest.approx(8.0)
    assert units["Siemens"]["MD32200 K_v [1000/min]"] == pytest.approx(6.0)
    assert units["Beckhoff"]["AX5000 S-0-0100 velocity loop K_p [A/(rad/s)] rms"] == pytest.approx(0.05 / math.sqrt(2))
    assert units["Beckhoff"]["EL72xx current loop K_p [0.1 V/A]"] == pytest.approx(200.0)
    assert units["B&R"]["SCTRL_KV [A s] rms"] == pytest.approx(0.05 * 2 * math.pi / math.sqrt(2))


def test_the_result_goes_back_into_the_design(tuned, tmp_path):
    path = tuned.design.write(tmp_path / "new.toml")
    again = Design.read(path)
    assert again.loops == tuned.loops
    assert again == tuned.design
    same = assess(again, prove=False)
    assert same.margins["speed"] == tuned.margins["speed"]
    assert same.to_dict()["methods"]["speed"] == "as_given"


def test_summary_dict_and_section(tuned, resonant):
    for result in (tuned, resonant):
        text = result.summary(width=1000)
        assert "loops tuned; all margins are met; not checked in simulation." in text
        told = json.loads(json.dumps(result.to_dict(), allow_nan=False))
        assert told["warnings"] == list(result.warnings)
        blocks = result.section().blocks
        for table in (block for block in blocks if isinstance(block, Table)):
            assert all(len(row) == len(table.header) for row in table.rows)
        assert sum(isinstance(block, Picture) for block in blocks) == 3 + (result is resonant)
    assert {"slowed_by_resonance", "margin_missed_at_corner"} <= set(resonant.to_dict()["warning_codes"])
    assert "Resonance" in resonant.summary()
    for axis in tuned.plot().axes:
        assert "[" in axis.get_ylabel() or axis.get_ylabel() == ""


def test_the_margins_that_are_marked_end_where_the_loop_would_oscillate(tuned):
    """Both come from elsewhere: the curve from the response, the length of the arrow from the margins."""
    upper, lower = bode(tuned).axes
    ends = [mark.xyann[1] for mark in lower.texts if isinstance(mark, Annotation)]
    assert len(ends) == 3
    assert ends == pytest.approx([-180.0] * 3, abs=1.5)  # deg; the curve is drawn on a grid of frequencies
    for mark in (mark for mark in upper.texts if isinstance(mark, Annotation)):
        line = min(upper.lines, key=lambda one: abs(np.interp(mark.xy[0], *one.get_data()) - mark.xyann[1]))
        assert np.interp(mark.xy[0], *line.get_data()) == pytest.approx(mark.xyann[1], abs=0.3)  # dB


def test_an_unstable_loop_says_which_and_shows_it(root):
    design = Design.read(root / "seed_motor.toml")
    fast = design.replace(loops={"speed": {"K_p": 1.0, "T_n": 5e-3}})
    with pytest.raises(UnstableLoopError, match="speed loop: unstable with the gains given") as caught:
        assess(fast, prove=False)
    assert caught.value.loop == "speed"
    assert caught.value.section().blocks[-1].draw().axes
    hot = design.replace(loops={"current": {"K_p": 1500.0, "T_n": 2.6e-3}})
    with pytest.raises(UnstableLoopError, match="current loop: unstable"):
        assess(hot, prove=False)


def test_designs_that_cannot_be_tuned_say_why(root):
    with pytest.raises(DesignError, match="this design knows only K_t"):
        tune(Design.read(root / "emps.toml"))
    with pytest.raises(DesignError, match="loops: missing"):
        assess(Design.read(root / "small_servo.toml").model_copy(update={"loops": None}))


def test_requirements_name_what_is_missed(root):
    design = Design.read(root / "seed_motor.toml")
    cascade = Cascade.of(design, CurrentLoop(K_p=262.0, T_n=2.6e-3), at=40.0)
    found = margins(open_loop(cascade, SpeedLoop(K_p=0.11, T_n=2e-3)))
    missed = Requirements().missed(found)
    assert Criterion.PHASE_MARGIN in {item.criterion for item in missed}
    assert Requirements().shortfall(found) > 0.0
    strict = tune(design, Specification(requirements=Requirements(phase_margin=70.0)), prove=False)
    assert not strict.defended
    assert "NOT all margins are met" in strict.summary()
    assert {notice.code for notice in strict.notices} >= {"margin_missed", "margin_missed_at_corner"}


@pytest.mark.parametrize(
    "options",
    [
        {"current": "pole_cancellation", "speed": "pole_placement"},
        {"current": "bandwidth", "current_bandwidth": 300.0, "speed": "bandwidth", "speed_bandwidth": 40.0},
    ],
)
def test_every_method_tunes_a_whole_cascade(root, options):
    found = tune(Design.read(root / "servo_2kw.toml"), Specification(**options), prove=False)
    assert all(m.stable is not False for m in found.margins.values())
    assert found.defended


@kernel
def seal_drag(omega: float, direction: float, k_seal: float) -> float:
    """k_seal sqrt(abs(omega)) sgn(omega)."""
    return k_seal * math.sqrt(abs(omega)) * direction


@pytest.mark.slow
def test_a_users_own_effect_is_in_the_model_and_in_the_proof(root):
    own = Effect(
        id="seal_drag", title="Wiper seal", equation=r"k\sqrt{|\omega|}", source="a user", enters="torque",
        parameters=(Parameter("k_seal", "N m", 0.0, 0.0, 1.0, "drag", linear=True),), term=seal_drag, needs="speeds",
    )  # fmt: skip
    design = Design.read(root / "seed_motor.toml").with_own_effects(own)
    design = design.with_effect("seal_drag", {"k_seal": 0.004})
    found = tune(design)
    slope = 0.000168 + 0.5 * 0.004 / math.sqrt(found.cascade.model.point.speed)
    assert found.cascade.model.point.friction_slope == pytest.approx(slope, rel=1e-6)
    assert found.defended


def test_a_drive_without_computation_delay(root):
    design = Design.read(root / "small_servo.toml").replace(drive={"delay_periods": 0})
    found = tune(design, prove=False)
    assert found.delays.computation == 0.0
    assert found.margins["current"].stable


def test_a_phase_margin_at_a_further_crossing_says_where(tuned):
    assert "found at" not in tuned.summary()
    speed = replace(tuned.margins["speed"], phase_margin_crossover=331.0)
    again = replace(tuned, margins={**tuned.margins, "speed": speed})
    assert re.search(r"phase margin, found at \[Hz\].* 331", again.summary(width=200))
