"""The axis driven by a torque alone, against closed forms and against the simulated drive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.compare.free_run import whole_run
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, prepare
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.simulate.mechanics import Mechanics
from tests.benchmarks.emps import Model, official
from tests.effort import slow

J = 1e-4
T = np.arange(0.0, 1.0, 1e-3)


def axis(*effects: dict[str, float | str]) -> Design:
    return Design.from_dict({"motor": {"J": J, "K_t": 1.0}, "effects": list(effects)})


def run(design: Design, torque: np.ndarray, omega: float = 0.0, period: float = 1e-3) -> np.ndarray:
    start = np.zeros(1, dtype=np.int64)
    mechanics = Mechanics.of(design, period, 100.0, ("torque",))
    return mechanics.run({"torque": torque}, start, (np.full_like(torque, omega), np.zeros_like(torque)), len(torque))[
        0
    ]


def test_a_load_on_a_spring_under_constant_torque() -> None:
    """The whole axis accelerates by T / J, and the twist is T / (J_m w^2) (1 - cos w t)."""
    J_load, k = 4e-5, 20.0
    t = T[:200]
    torque = np.full_like(t, 0.02)
    got = run(axis({"id": "compliance", "J_load": J_load, "k": k, "d": 0.0}), torque)
    motor = J - J_load
    w = np.sqrt(k * (1.0 / J_load + 1.0 / motor))
    twist = 0.02 / (motor * w**2) * (1.0 - np.cos(w * t))
    exact = 0.02 * t**2 / (2.0 * J) + J_load / J * twist
    assert np.max(np.abs(got[:, 1] - exact)) < 1e-2 * 0.02 / (motor * w**2)


@pytest.mark.parametrize("k", [5.0, 20.0])
def test_a_load_whose_friction_holds_it_is_a_wall(k: float) -> None:
    """With all of the friction at the load the shaft swings about T / k for ever while the spring pulls by less."""
    J_load, T_0, F_c = 4e-5, 0.01, 0.021
    design = axis(
        {"id": "coulomb", "F_c": F_c}, {"id": "compliance", "J_load": J_load, "k": k, "d": 0.0, "F_load": F_c}
    )
    t = 1e-4 * np.arange(4000)
    got = run(design, np.full_like(t, T_0), period=1e-4)
    w = np.sqrt(k / (J - J_load))
    assert np.max(np.abs(got[:, 1] - T_0 / k * (1.0 - np.cos(w * t)))) < 1e-3 * T_0 / k


def test_a_load_that_rubs_takes_energy_as_its_friction_says() -> None:
    """A blow to an axis with friction at the load alone: both masses come to rest after the way of one rigid mass.

    What is left of the energy is in the spring, at most by what the friction holds, F_load^2 / (2 k).
    """
    J_load, k, F_c, omega = 4e-5, 20.0, 0.02, 50.0
    design = axis(
        {"id": "coulomb", "F_c": F_c}, {"id": "compliance", "J_load": J_load, "k": k, "d": 1e-3, "F_load": F_c}
    )
    t = 1e-4 * np.arange(10000)
    got = run(design, np.zeros_like(t), omega=omega, period=1e-4)
    assert np.max(np.abs(got[8000:, 0])) < 0.01 * omega
    rigid = 0.5 * J * omega**2 / F_c
    assert rigid * 0.9 < got[-1, 1] < rigid  # the damper has the rest


@pytest.mark.parametrize("omega", [20.0, 50.0])
def test_a_load_behind_a_gap_slows_down_alone_until_it_meets_the_flank(omega: float) -> None:
    """Both turn, and the friction is the load's: it has half of the gap, (F_load / J_load) t^2 / 2, to itself."""
    gap, J_load, F_c = 0.04, 5e-5, 0.02
    entry = {"id": "backlash", "gap": gap, "J_load": J_load, "k": 60.0, "d": 0.1, "F_load": F_c}
    design = axis({"id": "coulomb", "F_c": F_c}, entry)
    t = 1e-4 * np.arange(10000)
    got = run(design, np.zeros_like(t), omega=omega, period=1e-4)
    met = np.sqrt(gap * J_load / F_c)
    assert got[t < met - 2e-4, 0] == pytest.approx(omega, rel=1e-12)
    assert np.all(got[(t > met + 5e-4) & (t < met + 2e-2), 0] < omega)
    rigid = 0.5 * J * omega**2 / F_c
    assert np.max(np.abs(got[9000:, 0])) < 0.05 * omega
    assert rigid * 0.9 < got[-1, 1] < rigid + gap  # the damper has the rest


@pytest.mark.parametrize("F_load", [-0.01, 0.03])
@pytest.mark.parametrize("entry", [{"id": "compliance"}, {"id": "backlash", "gap": 0.01}])
def test_the_friction_of_a_load_is_a_part_of_all(entry: dict[str, object], F_load: float) -> None:
    entry = {"J_load": 4e-5, "k": 20.0, "d": 0.01, "F_load": F_load} | entry
    with pytest.raises(DesignError, match="F_load"):
        run(axis({"id": "coulomb", "F_c": 0.02}, entry), np.zeros(10))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_elastic_bristle_is_a_spring(seed: int) -> None:
    """Below the elastic share of breakaway the axis swings about T z_s / F_c, and comes back to where it was."""
    rng = np.random.default_rng(seed)
    F_c, z_s, level = 0.02, rng.uniform(1e-3, 5e-3), rng.uniform(0.1, 0.4)
    t = np.arange(0.0, 4.0, 1e-3)
    torque = F_c * level * np.interp(t, [0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 1.0, 0.0, 0.0])
    bristle = {"id": "presliding", "z_s": z_s, "z_b": 0.9, "tau_z": 0.05}
    got = run(axis({"id": "coulomb", "F_c": F_c}, bristle), torque)
    assert np.mean(got[1500:2000, 1]) == pytest.approx(level * z_s, rel=2e-3)
    assert abs(np.mean(got[3800:, 1])) < 2e-3 * level * z_s


def test_dry_friction_holds_exactly_and_stops_where_it_should() -> None:
    """Held below breakaway; 50 rad/s at 200 rad/s^2 stop after omega^2 / (2 alpha)."""
    design = axis({"id": "coulomb", "F_c": 0.02})
    assert np.all(run(design, np.full_like(T, 0.0199)) == 0.0)
    stopped = run(design, np.zeros_like(T), omega=50.0)
    assert stopped[-1, 0] == 0.0
    assert stopped[-1, 1] == pytest.approx(50.0**2 / 400.0, rel=1e-9)


def test_unstable_friction_is_reported_as_not_finite() -> None:
    growing = run(axis({"id": "viscous_asymmetry", "dF_v": -1.0}), np.full_like(T, 0.1), omega=100.0)
    assert not np.isfinite(growing).all()


# Motion, effects, and the share of the error without them that is left.
CASES = {
    "gap": ("reversal", {"backlash": {"gap": 0.02, "J_load": 5e-5, "k": 60.0, "d": 0.03}}, 0.2),
    "bristle": ("reversal", {"presliding": {"z_s": 0.003, "z_b": 0.5, "tau_z": 0.002}}, 0.05),
    "terms": ("triangle", {"load_dependent_friction": {"mu": 0.05}, "viscous_power": {"k": 1e-3, "n": 0.5}}, 1e-3),
}


@pytest.mark.parametrize("name", [name if name == "bristle" else slow(name) for name in CASES])
def test_the_torque_of_the_simulated_drive_moves_the_axis_alike(designs: Path, name: str) -> None:
    """A position that only drifts by what a torque sampled at 4 kHz leaves out."""
    motion, effects, left = CASES[name]
    ideal = Design.read(designs / "seed_motor.toml").replace(
        sensor={"current_noise": 0.0, "encoder_counts": 0, "log_divider": 4}
    )
    truth = ideal
    for effect, values in effects.items():
        truth = truth.with_effect(effect, values)
    log = simulate(ideal, motion, truth=truth)
    prepared = prepare(truth, log, Processing(cutoff=1000.0))
    found, bare = whole_run(truth, prepared), whole_run(ideal, prepared)
    assert found is not None
    assert bare is not None
    assert found.fit > 0.999
    assert found.rms < left * bare.rms


@pytest.mark.parametrize("late", [0.0, -5e-4])
def test_the_official_task_of_emps_is_solved_by_the_axis_itself(late: float) -> None:
    """An axis that moved as the model says, from a speed that nobody is told, has no error."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 4.0, 1e-3)
    force = 60.0 * np.sin(2.0 * np.pi * 0.5 * t) + 20.0 * np.sin(2.0 * np.pi * rng.uniform(1.0, 3.0) * t)
    effects = [{"id": "coulomb", "F_c": 20.0}, {"id": "viscous", "F_v": 200.0}]
    design = Design.from_dict({"motion": "linear", "motor": {"J": 95.0, "K_t": 1.0}, "effects": effects})
    bare = Log({"t": t, "theta": np.zeros_like(t), "torque": force}, "linear")
    truth = Model(design, late)
    theta = truth.run(bare, [0], (np.full_like(t, 0.037), np.full_like(t, 0.1)), len(t))[0, :, 1]
    log = Log({"t": t, "theta": theta, "torque": force}, "linear")
    assert official(truth, log) < 1e-3
    assert official(Model(design.with_effect("coulomb", {"F_c": 21.0}), late), log) > 0.5
