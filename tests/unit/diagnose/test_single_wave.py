"""What is left of the torque and consists of one wave is a load of the process or a force ripple, and no noise."""

import numpy as np
import pytest

from pmsm_ctrl import Design, Log, diagnose
from pmsm_ctrl.effects.catalogue import CATALOGUE
from pmsm_ctrl.residuals.single_wave import _line

J, F_c, F_v = 20.0, 60.0, 50.0
PITCH, FREQUENCY = 0.024, 5.3  # m, Hz


def axis(ripple: float = 0.0, process: float = 0.0) -> tuple[Design, Log]:
    """A linear motor with a force ripple over the pole pitch, and a force of the process, in N."""
    t = 1e-3 * np.arange(12000)
    waves = ((0.06, 0.31, 0.2), (0.03, 0.87, 1.0), (0.008, 2.3, 2.2))
    x = sum(a * np.sin(2.0 * np.pi * f * t + at) for a, f, at in waves)
    v = sum(2.0 * np.pi * f * a * np.cos(2.0 * np.pi * f * t + at) for a, f, at in waves)
    a = -sum((2.0 * np.pi * f) ** 2 * a * np.sin(2.0 * np.pi * f * t + at) for a, f, at in waves)
    force = J * a + F_c * np.sign(v) + F_v * v + ripple * np.sin(2.0 * np.pi * x / PITCH)
    force += process * np.sin(2.0 * np.pi * FREQUENCY * t)
    noise = np.random.default_rng(2).normal(0.0, 0.5, len(t))
    design = Design.model_validate({"name": "axis", "motion": "linear", "motor": {"J": J, "K_t": 1.0}})
    design = design.with_effect("coulomb", {"F_c": F_c}).with_effect("viscous", {"F_v": F_v})
    return design, Log({"t": t, "theta": x, "torque": force + noise}, motion="linear")


@pytest.mark.parametrize(
    ("forces", "coordinate", "words"),
    [({"ripple": 8.0}, "position", "24"), ({"process": 5.0}, "time", "5.3")],
    ids=["ripple", "process"],
)
def test_a_wave_over_position_or_time_is_structure(forces: dict[str, float], coordinate: str, words: str) -> None:
    others = [name for name in CATALOGUE if name != "detent_force"]  # which is the name of a wave over position
    found = diagnose(*axis(**forces), candidates=others, plan=False)
    assert not found.steps
    assert (str(found.verdict), found.to_dict()["reason_codes"]) == ("unexplained", ["single_wave"])
    assert f"a single wave over {coordinate} ({words}" in found.summary().replace("\n", " ")


def test_a_wave_over_position_has_a_name() -> None:
    (step,) = diagnose(*axis(ripple=8.0), plan=False).steps
    assert step.effect == "detent_force"
    assert step.parameters["period"].value == pytest.approx(PITCH, rel=1e-3)
    assert np.hypot(*(step.parameters[name].value for name in ("a_s", "a_c"))) == pytest.approx(8.0, rel=0.02)


def test_without_such_a_force_nothing_is_left() -> None:
    found = diagnose(*axis(), plan=False)
    assert not found.steps
    assert found.verdict != "unexplained"


def test_a_wave_of_a_periodic_motion_is_told_by_its_line_in_the_spectrum() -> None:
    t = 1e-2 * np.arange(2000)
    noise = np.random.default_rng(1).normal(size=len(t))
    assert _line(noise + np.sin(2.0 * np.pi * 3.0 * t), t, t[-1], 3.0) < 1e-6
    assert _line(noise, t, t[-1], 3.0) > 0.01
