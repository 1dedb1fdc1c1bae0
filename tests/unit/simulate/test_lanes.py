"""Drives side by side give what they give alone: rest is exact, reversals are split, the noise is the same."""

import numpy as np
import pytest

from pmsm_ctrl.design import Design, Filter
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.errors import SimulationError
from pmsm_ctrl.simulate import scenario, simulate, simulate_batch
from pmsm_ctrl.simulate.lanes import LANES, WORTH, groups
from pmsm_ctrl.simulate.run import prepare
from tests.effort import slow

# What rounding may do: the two are compiled separately, so multiply-adds are fused differently.
ROUNDING = 1e-9


@pytest.fixture(scope="module")
def seed_motor(project_root):
    return Design.read(project_root / "designs/seed_motor.toml")


def with_friction(design, F_c):
    """The design with this Coulomb friction, its effects in the order of the reference motor: the same kernel."""
    return design.with_effect("coulomb", {"F_c": F_c}).with_effect("viscous", design.parameters("viscous"))


def varied(design, count):
    """Drives with inertia, resistance and Coulomb friction of their own."""
    rng = np.random.default_rng(5)
    drives = []
    for _ in range(count):
        J, R, F_c = rng.uniform(0.7, 1.3, 3)
        drive = design.with_parameters(J=design.J * J, R=design.motor.R * R)
        drives.append(with_friction(drive, 0.0213 * F_c))
    return drives


def assert_alike(logs, alone, bound=ROUNDING):
    for k, (one, other) in enumerate(zip(logs, alone, strict=True)):
        assert list(one) == list(other)
        assert one.segments == other.segments
        for name in one:
            scale = max(np.abs(other[name]).max(), 1e-3)
            assert np.abs(one[name] - other[name]).max() <= bound * scale, f"drive {k}, {name}"


@pytest.mark.parametrize("seed", [0, 7])
@pytest.mark.parametrize("count", [LANES, LANES + 3])
def test_side_by_side_is_one_by_one_through_reversals(seed_motor, seed, count):
    """Half a minute of reversals in all, noise and encoder on: every step that meets zero is split as it is alone."""
    drives = varied(seed_motor, count)
    motion = scenario("triangle", period=0.4, cycles=2)
    arguments = {"seed": seed, "keep_truth": True}
    assert_alike(
        simulate_batch(drives, motion, lanes=True, **arguments),
        simulate_batch(drives, motion, lanes=False, **arguments),
    )


@pytest.mark.parametrize("name", ["positioning", "breakaway", slow("identification")])
def test_position_control_and_references_of_its_own(seed_motor, name):
    drives = varied(seed_motor, 5)
    arguments = {"seed": 3, "keep_truth": True}
    assert_alike(
        simulate_batch(drives, name, lanes=True, **arguments), simulate_batch(drives, name, lanes=False, **arguments)
    )


def test_rest_is_exact(seed_motor):
    """A shaft that friction holds has a speed of exactly zero, in every lane, noise in the currents or not."""
    motion = scenario("hold", seed_motor, duration=0.3)
    drives = varied(seed_motor.replace(sensor={"log_divider": 1}), LANES)
    for log in simulate_batch(drives, motion, lanes=True, keep_truth=True):
        assert np.all(log["omega_true"][log.t > 0.1] == 0.0)


def with_every_term(design, count):
    """Drives with every term of the catalogue, each with a value of its own in every drive, and a compensation."""
    drives = []
    for k, drive in enumerate(varied(design, count)):
        for effect in CATALOGUE.values():
            if not effect.has_state:
                values = {symbol: value * (1.0 + 0.02 * k) for symbol, value in effect.example.items()}
                drive = drive.with_effect(effect.id, values)
        drives.append(drive.replace(compensation={"gain": 0.5}))
    return drives


@pytest.mark.slow
def test_every_term(seed_motor):
    drives = with_every_term(seed_motor, 5)
    motion = scenario("triangle", period=0.2, cycles=1)
    arguments = {"seed": 1, "keep_truth": True}
    assert_alike(
        simulate_batch(drives, motion, lanes=True, **arguments),
        simulate_batch(drives, motion, lanes=False, **arguments),
    )


@pytest.mark.slow
def test_mixed_batches(seed_motor):
    """Drives that do not fit together are simulated apart, and come back in order."""
    spring = {"k": 500.0, "d": 0.01, "J_load": 3e-5}
    drives = [drive.with_effect("compliance", spring) if k % 4 == 3 else drive
              for k, drive in enumerate(varied(seed_motor, 8))]  # fmt: skip
    drives[1:1] = with_every_term(seed_motor, 1)
    motion = scenario("triangle", period=0.2, cycles=1)
    assert_alike(simulate_batch(drives, motion, lanes=True), simulate_batch(drives, motion, lanes=False))


def test_drives_with_filters_in_a_batch_are_what_they_are_alone(seed_motor):
    """They are simulated one by one, bit for bit, between drives that run side by side."""
    motion = scenario("triangle", period=0.1, cycles=1)
    drives = varied(seed_motor, 4)
    speed = seed_motor.loops.speed.model_copy(update={"filters": (Filter(kind="notch", frequency=300.0, width=120.0),)})
    for k in (1, 2):
        drives[k] = drives[k].model_copy(update={"loops": seed_motor.loops.model_copy(update={"speed": speed})})
    together = groups({k: prepare(drive, motion) for k, drive in enumerate(drives)}, always=True)
    assert [group.numbers for group in together] == [(0, 3)]
    logs = simulate_batch(drives, motion, lanes=True, seed=11)
    for k in (1, 2):
        alone = simulate(drives[k], motion, seed=11 + k)
        plain = simulate(drives[k].model_copy(update={"loops": seed_motor.loops}), motion, seed=11 + k)
        assert all(np.array_equal(logs[k][name], alone[name]) for name in alone)
        assert not np.array_equal(alone["omega"], plain["omega"])
    assert_alike([logs[0], logs[3]], [simulate(drives[k], motion, seed=11 + k) for k in (0, 3)])


def test_which_drives_go_side_by_side(seed_motor):
    motion = scenario("hold", duration=WORTH / (2 * LANES) / 16000.0)
    alike = {k: prepare(seed_motor, motion) for k in range(2 * LANES + 3)}
    assert [group.numbers for group in groups(alike)] == [tuple(range(16)), tuple(range(16, 32))]
    few = {k: alike[k] for k in range(LANES - 1)}
    assert groups(few) == []
    assert [len(group.numbers) for group in groups(few, always=True)] == [LANES - 1]


def test_a_drive_that_diverges_is_named(seed_motor):
    drives = varied(seed_motor, 4)
    drives[2] = drives[2].replace(loops={"current": {"K_p": 1e5, "T_n": 1e-5}}, drive={"u_dc": 1e15})
    with pytest.raises(SimulationError, match=r"^drive 2 of 4: .*diverged at t = .* s"):
        simulate_batch(drives, scenario("sweep", dwell=0.02), lanes=True)
