"""What is exported is what was judged: the compiled C in the drive's loop, and gains that are not safe are refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.compensate import baseline, compensated, gain_verdict, judge, study_trials
from pmsm_ctrl.compensate.motions import PUSHES
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export import export, export_files
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.simulate.feedforward import smoothing_width
from tests.effort import slow
from tests.unit.export.compiled_c import Compensator, simulate_with
from tests.unit.export.structured_text import parsed, parsed_tcpou

SIMPLE = ("coulomb", "viscous")


@pytest.fixture
def seed_motor(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


@pytest.mark.parametrize(
    ("source", "ramp"),
    [
        slow("reference", 0.0),
        ("commanded", 0.0),
        slow("measured", 0.0),
        slow("observer", 0.0),
        slow("reference", 1e-3),
        slow("commanded", 1e-3),
    ],
)
def test_the_compiled_c_in_the_loop_is_the_simulated_compensation(
    seed_motor: Design, tmp_path: Path, source: str, ramp: float
) -> None:
    axis = baseline(seed_motor).replace(compensation={"bandwidth": 200.0, "ramp": ramp})
    believed = compensated(axis, SIMPLE, gain=0.9, source=source)
    motion = study_trials(seed_motor)["reversal 2 rad/s"].motions[0]
    compensator = Compensator(believed, tmp_path)
    short = type(motion)(motion.name, 0.6, motion.references, motion.control)
    by_c = simulate_with(compensator, believed, short, seed_motor, seed=3)
    simulated = simulate(believed, short, truth=seed_motor, seed=3, keep_truth=True)
    assert not compensator.fault
    for channel in ("theta_true", "i_q_ref"):
        assert by_c[channel] == pytest.approx(simulated[channel], rel=1e-9, abs=1e-9), channel


@pytest.mark.parametrize("flavour", ["iec", "beckhoff"])
def test_structured_text_turns_the_friction_over_the_ramp(seed_motor: Design, flavour: str) -> None:
    """The torque is that of an elastic contact: it turns in proportion to the travel, and rests with the axis."""
    axis = seed_motor.replace(compensation={"gain": 1.0, "ramp": 1e-3, "effects": ("coulomb",)})
    texts = export_files(axis, "st", flavour=flavour, force=True)
    block = (parsed if flavour == "iec" else lambda text: parsed_tcpou(texts, "FB_seed_motor_compensation"))(
        texts.get("FB_seed_motor_compensation.st", "")
    )
    F_c, period = axis.parameters("coulomb")["F_c"], axis.drive.speed_period
    travel = 0.0
    for omega in (2.0,) * 8 + (0.0,) * 3 + (-0.5,) * 20:
        block(omega=omega, theta=0.0, i_d=0.0, i_q=0.0, enable=True)
        travel = min(max(travel + omega * period, -1e-3), 1e-3)
        assert block["i_q_add"] == pytest.approx(F_c * travel / 1e-3 / axis.K_t_assumed, rel=1e-12)
        assert not block["fault"]


@pytest.mark.parametrize(("source", "gain", "safe"), [("measured", 1.0, False), slow("commanded", 0.5, True)])
def test_the_compiled_c_cycles_where_the_window_says_so(
    seed_motor: Design, tmp_path: Path, source: str, gain: float, safe: bool
) -> None:
    chosen = seed_motor.replace(compensation={"source": source, "gain": gain})
    assert gain_verdict(chosen, gain).safe is safe
    trial = study_trials(seed_motor)["push"]
    believed = compensated(baseline(chosen), SIMPLE, gain=gain, factor=1.0, source=source)
    (motion,) = trial.motions
    first = replace(motion, duration=motion.duration - PUSHES[1][1])  # the first push, after which it cycles
    log = simulate_with(Compensator(believed, tmp_path), believed, motion if safe else first, seed_motor)
    assert (judge(trial, (log,), seed_motor.encoder_step).cycle_amplitude == 0.0) is safe


def test_a_gain_that_is_not_safe_is_refused(seed_motor: Design, tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from pmsm_ctrl.cli import app

    eager = seed_motor.replace(compensation={"source": "measured", "gain": 1.0})
    with pytest.raises(RequestError, match=r"100 % with the measured speed is not safe: the axis has a limit cycle of"):
        export(eager, "c")
    with pytest.raises(RequestError, match="--force"):
        export_files(eager, "st")
    assert "not known to be safe (--force)" in export(eager, "c", force=True)
    path = eager.write(tmp_path / "eager.toml")
    runner = CliRunner()
    command = ["export", str(path), "-l", "c", "-o", str(tmp_path / "a.c")]
    assert isinstance(runner.invoke(app, command).exception, RequestError)
    assert not (tmp_path / "a.c").exists()
    forced = runner.invoke(app, [*command, "--force"])
    assert forced.exit_code == 0
    assert "warning: " in forced.stderr
    assert "is not safe" in forced.stderr
    # the tracker adds no current
    assert "tracker" in export(eager, "c", part="tracker")


def test_a_gain_that_is_safe_or_zero_is_exported(seed_motor: Design) -> None:
    assert "GAIN = 1.0;" in export(seed_motor, "c")
    none = seed_motor.replace(compensation={"source": "measured", "gain": 0.0})
    assert "GAIN = 0.0;" in export(none, "c")


def test_a_design_that_cannot_be_simulated_says_so_in_the_text(designs: Path) -> None:
    emps = Design.read(designs / "emps.toml")
    assert gain_verdict(emps, 1.0).safe is None
    assert "the safety of its gain is not known" in export(emps, "c")


def test_the_commanded_speed_is_smoothed_over_five_counts_unless_a_width_is_stated(seed_motor: Design) -> None:
    commanded = seed_motor.replace(compensation={"source": "commanded", "gain": 1.0})
    K_v = seed_motor.require_loops().position.K_v
    assert smoothing_width(commanded) == pytest.approx(5.0 * K_v * 2.0 * np.pi / 131072)
    assert smoothing_width(commanded.replace(compensation={"smoothing": 0.0})) == 0.0
    assert smoothing_width(seed_motor.replace(compensation={"source": "reference"})) == 0.0
    assert f"SMOOTHING = {smoothing_width(commanded)!r}".upper() in export(commanded, "c", force=True).upper()
    again = Design.from_dict(commanded.replace(compensation={"smoothing": 0.0}).to_dict())
    assert again.compensation.smoothing == 0.0


def test_the_reason_is_that_of_the_gain_and_not_of_the_axis_without(seed_motor: Design) -> None:
    """Too much friction fed forward: the error grows. A limit cycle that the axis has without it is no reason."""
    eager = seed_motor.replace(compensation={"source": "reference", "gain": 2.5})
    assert "the RMS error is " in gain_verdict(eager, 2.5).why


def test_what_compensate_judges_and_export_leaves_out_is_said(
    seed_motor: Design, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a table of its own a design exports Coulomb and viscous friction alone, whatever was diagnosed."""
    from typer.testing import CliRunner

    from pmsm_ctrl.cli import app

    monkeypatch.setattr("pmsm_ctrl.export.code._require_safe", lambda design: "")  # not asked here, and seconds long

    whole, said = seed_motor.with_effect("stribeck", {"dF_s": 0.01, "w_s": 2.0, "delta": 2.0}), []
    for k, effects in enumerate((SIMPLE, (*SIMPLE, "stribeck"))):
        stated = whole.replace(compensation={"effects": effects, "gain": 0.1}).write(tmp_path / f"axis{k}.toml")
        said.append(CliRunner().invoke(app, ["export", str(stated), "-l", "c", "--force"]).stderr)
    assert 'not fed forward: stribeck; effects = ["coulomb", "viscous", "stribeck"] in [compensation]' in said[0]
    assert "not fed forward" not in said[1]
