"""What is said of parameters beside the design's numbers, from fits that are written down by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.diagnose import deviations
from pmsm_ctrl.diagnose.deviations import deviation_notices, parameter_deviations
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.diagnose.result import Deviation
from tests.unit.plausibility.drives import believed


@pytest.mark.parametrize(("p", "ratio", "other"), [(5, 0.8, 4), (5, 0.78, 4), (4, 0.8, 3), (4, 1.27, 5)])
def test_a_torque_constant_of_other_pole_pairs_is_told_with_them(p: int, ratio: float, other: int) -> None:
    assert f"a motor with {other} pole pairs in place of {p} shows the same" in told(p, ratio)


@pytest.mark.parametrize(("p", "ratio"), [(5, 0.89), (4, 0.87), (1, 0.8), (4, 0.93)])
def test_a_torque_constant_between_pole_pairs_is_one_alone(p: int, ratio: float) -> None:
    assert "in place of" not in told(p, ratio)


def told(p: int, ratio: float) -> str:
    design = believed(p=p, tolerance={"psi_f": 0.07})
    deviation = Deviation("K_t", 1.0, ratio, 1e-3, "N m/A", True, True)
    fit: Any = SimpleNamespace(record=SimpleNamespace(design=design, age=None), model=SimpleNamespace(names=()))
    (notice,) = deviation_notices((deviation,), fit)
    return notice.text


@pytest.mark.parametrize(("found", "flagged"), [
    ((4.0,), True),  # hot, and no effect is named
    ((4.2, 4.0), True),  # an effect is named that has little to do with it
    ((8.0, 5.0), False),  # a dead time that was a resistance, and would be the rest of it with another shape
    ((9.0, 0.4), False),  # or made too much of it
    ((5.0, 9.0, 8.9), True),  # further off than any of two moved it
    ((20.0, -1.0), False),
    ((-1.0,), False),
    ((0.02,), False),  # of an error of 0.01: no winding has 1 % of its datasheet's
    ((0.2,), True),
])  # fmt: skip
def test_a_resistance_is_flagged_where_no_named_effect_can_be_it(
    found: tuple[float, ...], flagged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(deviations, "seen_beyond", lambda *_: 1.0)
    (R,) = parameter_deviations(believed(R=2.0, tolerance={"R": 0.3}), selected(found))
    assert (R.outside, R.flagged) == (True, flagged)
    assert flagged == R.note.startswith("beyond its tolerance of 30 %")
    assert ("dead_time resembles it" in R.note) == (not flagged and found[-1] > 0.1)


@pytest.mark.parametrize(("steps", "flagged"), [(0.9, True), (1.1, False)])
def test_a_parameter_that_acts_in_a_voltage_below_its_steps_is_not_flagged(
    steps: float, flagged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Steps of 0.1 V, of a u_d of 0.02 V: L_q was 84 % too small with a standard error of 8 %."""
    monkeypatch.setattr(deviations, "seen_beyond", lambda *_: 1.0)
    (R,) = parameter_deviations(believed(R=2.0, tolerance={"R": 0.3}), selected((4.0,), steps))
    assert (R.outside, R.flagged) == (True, flagged)
    assert flagged or R.note == "not sure: u_q is no larger than its steps"


def selected(found: tuple[float, ...], steps: float = 0.0) -> Any:
    """Steps of dead time, and what R was before the first and after each; errors of the steps of a voltage of 1 V."""
    model = SimpleNamespace(
        names=("R",), nominal=np.array([2.0]), group_of=lambda k: SimpleNamespace(effect=None),
        matrix=np.stack([np.zeros((8, 1)), np.ones((8, 1))]),
    )  # fmt: skip
    record = SimpleNamespace(
        sampling_stated=True, prepared=SimpleNamespace(motion="rotary", signals={}), mask=np.ones(8, dtype=bool),
        channels=("torque", "u_q"), coarse=np.array([0.0, steps]), target=np.ones((2, 8)),
    )  # fmt: skip
    fits = []
    for value in found:
        solved = SimpleNamespace(values=np.array([value]), stderr=np.array([0.01]))
        fits.append(SimpleNamespace(model=model, plain=solved, estimate=solved, record=record, trials=()))
    candidate = SimpleNamespace(effect=SimpleNamespace(label=lambda shape: "dead_time"))
    step = SimpleNamespace(trial=SimpleNamespace(candidate=candidate, group=SimpleNamespace(shape={})))
    return SimpleNamespace(fit=fits[-1], fits=tuple(fits), steps=(step,) * (len(found) - 1))


@pytest.mark.parametrize(("assumed", "share"), [(None, 0.07), (1.0, 0.02)])
def test_a_torque_constant_that_was_assumed_has_not_the_tolerance_of_the_flux(
    assumed: float | None, share: float
) -> None:
    """The paper's own case: K_t = 1 beside a psi_f of 1.032 N m/A, which is known to 7 %."""
    design = believed(tolerance={"psi_f": 0.07})
    design = design if assumed is None else design.replace(assumed={"K_t": assumed})
    assert deviations._allowed(design, POLICY) == share


@pytest.mark.parametrize(("motion", "unit"), [("rotary", "N m/A"), ("linear", "N/A")])
def test_the_torque_constant_has_the_unit_of_the_axis(motion: str, unit: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deviations, "negative_friction", lambda *_: "")
    design = believed().model_copy(update={"motion": motion})
    value = np.array([design.K_t_assumed / (1.5 * (design.motor.p or 0))])
    solved = SimpleNamespace(values=value, stderr=np.array([1e-6]))
    fit: Any = SimpleNamespace(model=SimpleNamespace(names=("psi_f",)), plain=solved)
    (found,) = deviations._torque_constant(design, fit, POLICY)
    assert (found.parameter, found.unit, found.outside) == ("K_t", unit, False)
