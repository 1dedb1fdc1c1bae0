"""What `[log]` and the design state of the measurement is known to every verb, and no fault of the log."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from pmsm_ctrl import Design
from pmsm_ctrl.compare import compare
from pmsm_ctrl.frf import frf
from pmsm_ctrl.identify import identify, sweep
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.track import track

J, F_C, F_V, K_T, FINER = 9e-5, 0.0213, 1.68e-4, 1.032, 16
F = np.array([0.05, 0.11, 0.37, 0.83, 1.7, 3.1, 5.3])
A = np.array([40.0, 90.0, 60.0, 30.0, 15.0, 8.0, 4.0])
T = np.arange(12000) / 1000.0


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, speed, and the current that they take, in closed form."""
    x = 2.0 * np.pi * np.outer(t, F) + np.arange(7.0)
    omega, alpha = (A * np.sin(x)).sum(1), (A * 2.0 * np.pi * F * np.cos(x)).sum(1)
    current = (J * alpha + F_C * np.sign(omega) + F_V * omega) / K_T
    return (-A / (2.0 * np.pi * F) * np.cos(x)).sum(1), omega, current


def log_of(i_q: np.ndarray) -> Log:
    noise = 1e-3 * np.random.default_rng(1).normal(size=T.size)
    return Log({"t": T, "theta": motion(T)[0], "i_q": i_q + noise})


def filtered(tau: float) -> np.ndarray:
    """The current behind a filter of first order."""
    fine = np.arange(-1000 * FINER, 12000 * FINER) / (1000.0 * FINER)
    a = 1.0 - np.exp(-1.0 / (1000.0 * FINER * tau))
    return np.asarray(lfilter([a], [1.0, a - 1.0], motion(fine)[2])[1000 * FINER :: FINER])


def design(**parts: Any) -> Design:
    dry = [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 1.8e-4}]
    motor = {"J": 9.4e-5, "p": 4, "psi_f": K_T / 6.0, "R": 19.0, "L_d": 0.05, "L_q": 0.05}
    return Design.from_dict({"motor": motor, "effects": dry, **parts})


@pytest.mark.parametrize(
    ("log", "stated"),
    [(log_of(motion(T - 2e-3)[2]), {"late": 2e-3}), (log_of(filtered(5e-3)), {"filter": 5e-3})],
    ids=["late", "filter"],
)
def test_a_stated_sampling_is_undone_and_no_doubt(log: Log, stated: dict[str, float]) -> None:
    known = design(log={"sampling": "instant", **stated})
    found = identify(known, log)
    assert found.notices == ()
    tracked = track(known, log).to_dict()["estimates"]
    for name, true, within in (("J", J, 0.005), ("F_c", F_C, 0.01), ("F_v", F_V, 0.02)):
        assert found.estimates[name].value == pytest.approx(true, rel=within)
        assert tracked[name]["value"] == pytest.approx(true, rel=within)
    judged = compare(found.design, log).to_dict()
    assert judged["verdict"] == "consistent"
    assert judged["warning_codes"] == []


def test_a_stated_gain_is_known_to_every_verb() -> None:
    """A current that is logged a tenth too large made inertia and friction of these a tenth too large."""
    known = design().add_effect("current_gain", {"g": 0.1})
    tracked = track(known, log_of(1.1 * motion(T)[2])).to_dict()["estimates"]
    for name, true in (("J", J), ("F_c", F_C), ("F_v", F_V)):
        assert tracked[name]["value"] == pytest.approx(true, rel=0.02)


def test_a_stated_gain_is_known_to_responses_and_sweeps() -> None:
    known = Design.read("designs/seed_motor.toml").add_effect("current_gain", {"g": 0.1})
    assert frf(known, simulate(known, "identification", seed=1)).estimates["J"].value == pytest.approx(J, rel=0.02)
    lines = sweep(known).to_dict()["fits"]["both_directions"]
    assert lines["F_c"]["value"] == pytest.approx(F_C, rel=0.01)
