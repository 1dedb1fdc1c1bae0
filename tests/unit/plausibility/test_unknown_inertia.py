"""An inertia that the design does not know: a log tells it, without a prior; without a log it is asked for."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import app
from pmsm_ctrl.console import run
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import add, diagnose, stepwise
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.errors import DesignError, LogError
from pmsm_ctrl.identify import identify
from pmsm_ctrl.importers.plausibility import check
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import with_inertia
from pmsm_ctrl.regression.signals import missing_signals, term_signals
from pmsm_ctrl.simulate import simulate

T = np.zeros(1)
PLAIN = {"effects": [{"id": "coulomb", "F_c": 0.01}, {"id": "viscous", "F_v": 1e-4}]}


def toml(fields: dict[str, float]) -> str:
    return "".join(f"{name} = {value}\n" for name, value in fields.items())


EFFECTS = '[[effects]]\nid = "coulomb"\nF_c = 0.01\n\n[[effects]]\nid = "viscous"\nF_v = 1e-4\n'


def recorded(J: float, seed: int = 3, seconds: float = 10.0) -> Log:
    """Return a log of an axis by closed form: two sines, dry and viscous friction, K_t = 0.5 N m/A."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(1e3 * seconds)) * 1e-3
    omega = 60 * np.sin(2 * np.pi * 0.4 * t) + 20 * np.sin(2 * np.pi * 1.3 * t + 0.5)
    alpha = 48 * np.pi * np.cos(2 * np.pi * 0.4 * t) + 52 * np.pi * np.cos(2 * np.pi * 1.3 * t + 0.5)
    theta = -75 / np.pi * np.cos(0.8 * np.pi * t) - 20 / (2.6 * np.pi) * np.cos(2.6 * np.pi * t + 0.5)
    torque = J * alpha + 0.02 * np.sign(omega) + 2e-4 * omega
    return Log({"t": t, "theta": theta, "i_q": torque / 0.5 + rng.normal(0, 0.004, t.size)})


@pytest.mark.parametrize("J", [8e-5, 3e-4, 5e-3])
def test_identify_finds_what_the_design_does_not_know(J: float) -> None:
    unknown = Design.from_dict({"motor": {"J": "unknown", "K_t": 0.5}, **PLAIN})
    found = identify(unknown, recorded(J))
    assert found.estimates["J"].value == pytest.approx(J, rel=0.01)
    assert found.estimates["F_c"].value == pytest.approx(0.02, rel=0.02)
    assert pytest.approx(J, rel=0.01) == found.design.motor.J


def test_a_diagnosis_by_hand_begins_without_an_inertia() -> None:
    unknown = Design.from_dict({"motor": {"J": "unknown", "K_t": 0.5}, **PLAIN})
    found = stepwise(unknown, recorded(3e-4)).design
    assert pytest.approx(3e-4, rel=0.01) == found.motor.J


def test_no_prior_is_left() -> None:
    log = recorded(3e-4)
    unknown = Design.from_dict({"motor": {"J": "unknown", "K_t": 0.5}, **PLAIN})
    free = with_inertia(unknown, log)
    assert pytest.approx(3e-4, rel=0.05) == free.motor.J
    assert free.tolerance("J", 0.15) > 0.99
    # an inertia twice as large to start from leads to the same one
    twice = free.starting_from(2 * free.J)
    assert identify(twice, log).estimates["J"].value == pytest.approx(
        identify(free, log).estimates["J"].value, rel=1e-3
    )
    known = Design.from_dict({"motor": {"J": 1e-4, "K_t": 0.5}})
    assert with_inertia(known, log) is known


@pytest.mark.parametrize("stated", [{}, {"J": 0.08}, {"psi_f": 0.1}])
@pytest.mark.parametrize("load", [{}, {"J": 2.5e-4}])
def test_a_written_design_has_the_tolerance_that_was_stated(
    tmp_path: Path, stated: dict[str, float], load: dict[str, float]
) -> None:
    path, table = tmp_path / "axis.toml", f"[motor.tolerance]\n{toml(stated)}" if stated else ""
    path.write_text(f'[motor]\nJ = "unknown"\nK_t = 0.5\n{table}[load]\n{toml(load)}{EFFECTS}')
    given, log = Design.read(path), recorded(3e-4)
    for found in (
        identify(given, log).design, add(given, log, "stribeck"), stepwise(given, log).design,
        diagnose(given, log, plan=False).design,
    ):  # fmt: skip
        written = tomllib.loads(found.write(tmp_path / "found.toml").read_text())["motor"]
        assert written.get("tolerance", {}) == stated
        assert pytest.approx(3e-4, rel=0.01) == found.J
        assert found.motor.tolerance == given.motor.tolerance
        # it is a known one from now on
        assert found.tolerance("J", 0.15) == given.motor.tolerance.get("J", 0.15)


def test_a_start_value_stays_one_until_an_inertia_is_set() -> None:
    free = Design.from_dict({"motor": {"J": "unknown", "K_t": 0.5}, "load": {"J": 1e-3}}).starting_from(1e-4)
    copies = (free, free.replace(name="b"), free.with_effect("coulomb", {"F_c": 0.1}), free.with_parameters(K_t=0.6))
    assert all(copy.tolerance("J", 0.15) > 0.99 for copy in copies)
    known = (free.with_parameters(J=1.2e-3), free.replace(motor={"J": 2e-4}), Design.from_dict(free.to_dict()))
    assert all(copy.tolerance("J", 0.15) == 0.15 for copy in known)


def test_a_log_that_does_not_tell_it_is_refused() -> None:
    t = 1e-3 * np.arange(5000)
    steady = Log({"t": t, "theta": 20.0 * t, "i_q": 0.1 + 0.01 * np.random.default_rng(1).normal(size=t.size)})
    with pytest.raises(LogError, match=r"motor\.J is unknown and the log does not tell it"):
        with_inertia(Design.from_dict({"motor": {"J": "unknown", "K_t": 0.5}}), steady)


def swinging(J: float, weight: float = 2.8, seed: int = 1) -> Log:
    """Return a log of a pendulum by closed form: two sines up to 1.9 rad, with friction, K_t = 0.5 N m/A."""
    t = np.arange(4000) * 2e-3
    parts = [(1.4, np.pi, 0.0), (0.5, 2.2 * np.pi, 1.0)]
    theta, omega, alpha = (
        sum(size * rate**k * np.sin(rate * t + at + k * np.pi / 2) for size, rate, at in parts) for k in range(3)
    )
    torque = J * alpha + weight * np.sin(theta) + 0.1 * np.sign(omega) + 0.05 * omega
    return Log({"t": t, "theta": theta, "i_q": torque / 0.5 + np.random.default_rng(seed).normal(0, 0.02, t.size)})


@pytest.mark.parametrize("J", [0.05, 0.15])
def test_the_inertia_of_a_pendulum_shows_beside_its_weight(J: float) -> None:
    found = with_inertia(Design.from_dict({"motor": {"J": "unknown", "K_t": 0.5}}), swinging(J))
    assert pytest.approx(J, rel=0.03) == found.motor.J


def test_the_weight_of_a_pendulum_is_no_doubt_about_its_inertia() -> None:
    design = Design.from_dict({"motor": {"J": 0.15, "K_t": 0.5}})
    assert [notice.code for notice in check(swinging(0.15), design)] == []


def test_what_needs_a_number_asks_for_it(tmp_path: Path, designs: Path) -> None:
    design = Design.read(designs / "seed_motor.toml")
    data = design.to_dict()
    data["motor"]["J"] = "unknown"
    unknown = Design.from_dict(data)
    with pytest.raises(DesignError, match=r"motor\.J is unknown"):
        simulate(unknown, "triangle")
    written = unknown.write(tmp_path / "unknown.toml")
    assert 'J = "unknown"' in written.read_text()
    assert Design.read(written) == unknown


def test_pole_pairs_alone_are_enough_for_electrical_orders() -> None:
    design = Design.from_dict({"motor": {"J": 1e-4, "K_t": 0.5, "p": 5}, **PLAIN})
    assert not design.motor.electrical
    assert design.K_t == 0.5
    assert Design.from_dict(design.to_dict()) == design
    assert term_signals(design, {})["p"] == 5.0
    torque_ripple = CATALOGUE["torque_ripple"]
    assert (
        missing_signals(torque_ripple, term_signals(design, dict.fromkeys(("omega", "theta", "torque", "i_q"), T)))
        == ""
    )


def test_init_takes_an_unknown_inertia_and_pole_pairs(tmp_path: Path) -> None:
    path = tmp_path / "axis.toml"
    words = ["init", "axis", "--machine", "plain", "--torque-constant", "0.5 N m/A peak", "--inertia", "unknown"]
    assert run(app, [*words, "--pole-pairs", "5", "--output", str(path)]) == 0
    motor = tomllib.loads(path.read_text())["motor"]
    assert (motor["J"], motor["p"]) == ("unknown", 5)
    assert Design.read(path).motor.J is None
