"""Numbers that are unlikely for a servo motor, in every command that begins with a design."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.likely import unlikely
from pmsm_ctrl.log import Log
from pmsm_ctrl.report import study
from pmsm_ctrl.simulate import scenario
from pmsm_ctrl.tune import tune
from tests.linear_motors import linear_motor
from tests.unit.tuned import DESIGNS, tuned

SERVO = {
    "motor": {"p": 5, "K_t_rms": 0.49, "R_line_to_line": 2.7, "L_line_to_line_mH": 9.4, "J_kg_cm2": 0.25},
    "load": {"J": 5e-5}, "drive": {"i_max_rms": 8.4, "u_dc": 325.0}, "sensor": {"encoder_counts": 1 << 20},
}  # fmt: skip


def servo(**changed: dict[str, float]) -> Design:
    tables = {name: {**SERVO[name], **changed.get(name, {})} for name in SERVO}  # type: ignore[dict-item]
    if "J" in changed.get("motor", {}):
        del tables["motor"]["J_kg_cm2"]
    return Design.from_dict(tables)


@pytest.mark.parametrize(
    ("design", "said"),
    [
        (servo(motor={"J": 0.25}), "torque at the current limit over J of 4.12 N m, 16.5 rad/s^2"),  # kg cm^2 as kg m^2
        (servo(drive={"u_dc": 3.25}), "dc-link voltage of 3.25 V"),
        (servo(sensor={"encoder_counts": 1}), "encoder resolution of 1 counts per turn"),
        (linear_motor().design.replace(motor={"p": 5.0, "psi_f": 85.0 / 7.5}), "pole pitch of 628 mm"),
        (linear_motor().design.replace(sensor={"encoder_counts": 1}), "encoder resolution of 1 counts per metre"),
    ],
)
def test_tune_and_study_say_which_number_is_unlikely(design: Design, said: str) -> None:
    wanted = f"{said} "
    assert any(notice.text.startswith(wanted) for notice in unlikely(design)), unlikely(design)
    assert "unlikely_value" in {notice.code for notice in tune(design, prove=False).notices}


@pytest.mark.parametrize("name", [path.stem for path in sorted(DESIGNS.glob("*.toml"))])
def test_no_shipped_design_is_unlikely(name: str) -> None:
    assert unlikely(Design.read(DESIGNS / f"{name}.toml")) == []


def test_the_no_load_speed_of_a_linear_motor_is_in_metres() -> None:
    from pmsm_ctrl.likely import figures_of

    axis = linear_motor()
    value, shown = figures_of(axis.design)["no-load speed, linear"]
    assert value == pytest.approx(axis.fastest)
    assert shown == f"{axis.fastest:.4g} m/s at 560 V dc"
    assert unlikely(axis.design) == []


def test_a_run_that_is_too_slow_names_the_inertia_and_how_to_ask_for_a_longer_one() -> None:
    slow = tuned("seed_motor").design.replace(motor={"J": 0.9})
    with pytest.raises(RequestError) as raised:
        scenario("identification", slow)
    message = str(raised.value)
    assert "the current limit and the inertia J of the design make it" in message
    assert "duration = 120.0 in [scenarios.identification]" in message
    assert "torque at the current limit over J of" in message
    longer = slow.replace(scenarios={"identification": {"duration": 1e5}})
    assert math.isfinite(scenario("identification", longer).duration)


def test_a_study_of_a_log_warns_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without winding data nothing is tuned: the study says it itself."""
    monkeypatch.setattr("pmsm_ctrl.rendering.html.inline_svg", lambda *given: "<svg></svg>")
    t = np.arange(0, 4, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    torque = 1e-4 * np.gradient(omega, t) + 0.02 * np.sign(omega) + 2e-4 * omega
    log = Log({"t": t, "omega": omega, "torque": torque + np.random.default_rng(0).normal(0, 1e-3, t.size)})
    design = Design.from_dict({"motor": {"J": 1e-4, "K_t": 1.0}, "sensor": {"encoder_counts": 2}})
    assert "unlikely_value" in {one.code for one in study(design, log, output=tmp_path / "page.html").notices}
