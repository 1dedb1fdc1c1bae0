"""The quadrant error: spikes of known height, and the simulated circle against its own true motion."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import main
from pmsm_ctrl.compensate.metrics import measure_contour
from pmsm_ctrl.compensate.motions import CIRCLE, RADIUS, study_trials
from pmsm_ctrl.compensate.runs import baseline, compensated, run_trial
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.verify import quadrants

T = np.arange(0.0, 4.0, 1e-3)


def circle(spikes: tuple[float, ...], sense: float = 1.0, lag: float = 0.01) -> tuple[Log, Log]:
    """Two turns of radius 2; a smooth spike of this height 10 degrees behind each reversal."""
    phi = sense * np.pi * T + 0.7
    radius = 2.0 - lag + 0.003 * np.cos(2.0 * phi)
    for k, height in enumerate(spikes):
        away = np.mod(sense * (phi - 0.5 * np.pi * k) - np.radians(10.0) + np.pi, 2.0 * np.pi) - np.pi
        radius = radius + height * np.exp(-((away / np.radians(3.0)) ** 2))
    reference = (5.0 + 2.0 * np.cos(phi), -1.0 + 2.0 * np.sin(phi))
    path = (5.0 + radius * np.cos(phi), -1.0 + radius * np.sin(phi))
    x, y = (Log({"t": T, "theta_ref": r, "theta": p}) for r, p in zip(reference, path, strict=True))
    return x, y


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_spikes_of_known_height(sense: float) -> None:
    found = quadrants(*circle((0.02, -0.01, 0.03, 0.015), sense)).before
    np.testing.assert_allclose(found.spikes, [0.02, -0.01, 0.03, 0.015], atol=2e-4)
    assert found.worst == pytest.approx(0.03, abs=2e-4)
    assert found.radius == pytest.approx(2.0, rel=1e-9)
    assert found.radius_error == pytest.approx(-0.01, abs=2e-4)
    assert found.speed == pytest.approx(2.0 * np.pi, rel=1e-3)
    assert found.turns == pytest.approx(2.0, abs=0.01)
    assert found.rest < 1e-3


def test_before_and_after() -> None:
    found = quadrants(*circle((0.02, 0.02, 0.02, 0.02)), circle((0.005, 0.0, 0.004, 0.0)))
    assert found.change == pytest.approx(-0.75, abs=0.02)
    assert found.notices == ()
    assert "before and 5 mrad after (-75 %)" in found.summary(width=200)
    none = quadrants(*circle((0.0, 0.0, 0.0, 0.0)))
    assert [notice.code for notice in none.notices] == ["quadrants_no_spike"]


def test_the_simulated_circle_agrees_with_its_true_motion(designs: Path) -> None:
    """The drive's own measurement against the metric of the study, which knows the true motion: 10 %."""
    design = baseline(Design.read(designs / "hand_tuned.toml"))
    trial = study_trials(design)[CIRCLE]
    off = run_trial(design, trial, truth=design)
    on = run_trial(compensated(design, ("coulomb", "viscous")), trial, truth=design)
    found = quadrants(*off, on)
    assert found.before.worst == pytest.approx(measure_contour(*off, RADIUS).reversal_peak, rel=0.1)
    assert found.change < -0.8


def test_what_is_no_circle_is_refused() -> None:
    x, y = circle((0.0,) * 4)
    with pytest.raises(LogError, match="no circle"):
        quadrants(x, y.with_channels(theta_ref=np.zeros_like(T)))
    with pytest.raises(LogError, match=r"0.5 of a circle"):
        quadrants(x.slice(0, 1000), y.slice(0, 1000))
    with pytest.raises(LogError, match="second axis has no theta_ref"):
        quadrants(x, Log({"t": T, "theta": y["theta"]}))


def test_the_command(designs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                     capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    for name, log in zip("xy", circle((0.02, 0.01, 0.02, 0.01)), strict=True):
        log.with_channels(i_q=0.1 * np.sin(T)).write_csv(f"{name}.csv")
    words = ["quadrants", "x.csv", "y.csv", "--design", str(designs / "seed_motor.toml")]
    with pytest.raises(SystemExit) as left:
        main([*words, "--after", "x.csv", "--after", "y.csv", "--json", "q.json", "--report", "q.html"])
    assert left.value.code in (0, None)
    assert "Quadrant error 20 mrad before and 20 mrad after" in capsys.readouterr().out
    assert json.loads(Path("q.json").read_text(encoding="utf-8"))["change"] == pytest.approx(0.0)
    assert "<svg" in Path("q.html").read_text(encoding="utf-8")
    with pytest.raises(SystemExit) as left:
        main([*words, "--after", "x.csv"])
    assert left.value.code == 2
