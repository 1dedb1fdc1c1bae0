"""Acceptance: `pytest designs/` runs it, a gain made too high fails readably, other runs are left alone."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import compensate
from pmsm_ctrl.compensate import Trial, accept, judge, run_trial, study_trials
from pmsm_ctrl.compensate.motions import PUSHES
from pmsm_ctrl.compensate.notices import _limit
from pmsm_ctrl.design import Acceptance, Design
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.simulate import Scenario
from pmsm_ctrl.simulate.motions import Limits

LINE = '\n[[acceptance]]\nscenario = "{}"\nmetric = "{}"\nlimit = {}\n'


def run_pytest(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run pytest in a process and folder of its own, with this plugin alone, whether it is installed or not."""
    command = [sys.executable, "-m", "pytest", "-p", "pmsm_ctrl.acceptance", "--rootdir", str(folder), "-W", "error"]
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "COLUMNS": "200"}
    return subprocess.run(
        [*command, *arguments], capture_output=True, text=True, cwd=folder, env=environment, check=False
    )


@pytest.fixture(scope="module")
def seed_text(request: pytest.FixtureRequest) -> str:
    text = (request.config.rootpath / "designs" / "hand_tuned.toml").read_text(encoding="utf-8")
    return text.partition("[[acceptance]]")[0]


def with_gain(seed_text: str, gain: float, source: str = "reference") -> str:
    return seed_text + f'\n[compensation]\ngain = {gain}\nsource = "{source}"\n'


def test_a_limit_is_printed_with_the_digits_that_were_stated() -> None:
    """A limit of -0.9999 was "-100.0 %", with which -99.3 % does not look far off."""
    assert _limit(-99.99) == "-99.99"
    assert _limit(100 * -0.8) == "-80.0"
    assert _limit(12.5) == "+12.5"


def test_a_gain_made_too_high_and_a_wrong_name_fail_readably(tmp_path: Path, seed_text: str) -> None:
    wanted = LINE.format("reversal 2 rad/s", "rms_change", -0.8)
    (tmp_path / "good.toml").write_text(with_gain(seed_text, 1.0) + wanted)
    (tmp_path / "high.toml").write_text(with_gain(seed_text, 2.5) + wanted)
    names = LINE.format("pusch", "cycle_amplitude", 0.0) + LINE.format("push", "rsm", 0.0)
    (tmp_path / "names.toml").write_text(seed_text + names)
    (tmp_path / "test_late.py").write_text("import sys\ndef test_light():\n    assert 'control' not in sys.modules\n")
    ran = run_pytest(tmp_path, ".")
    assert ran.returncode == 1, ran.stdout + ran.stderr
    assert "3 failed, 2 passed" in ran.stdout
    assert "unknown scenario 'pusch'; did you mean 'push'?" in ran.stdout
    known = ran.stdout.partition("did you mean 'push'? (known: ")[2].partition(")")[0].split(", ")
    assert len(known) == len(set(known)) > 5
    assert "unknown metric 'rsm'; did you mean 'rms'?" in ran.stdout
    assert "FAILED: reversal 2 rad/s: rms_change = +" in ran.stdout
    assert "limit -80.0 %" in ran.stdout
    assert "Traceback" not in ran.stdout
    plot = Path(ran.stdout.partition("plot: ")[2].splitlines()[0])
    assert plot.parent == tmp_path / "reports" / "acceptance"
    assert plot.read_text().startswith("<?xml")
    assert "high.toml::reversal 2 rad/s: rms_change <= -0.8" in ran.stdout


def test_a_gain_that_shakes_the_axis_fails(seed_text: str) -> None:
    """By measured speed 10 % is safe and 100 % is not: a push at rest starts a limit cycle."""
    wanted = Acceptance(scenario="push", metric="cycle_amplitude", limit=0.0)
    for gain, safe in ((0.1, True), (1.0, False)):
        design = Design.from_dict(tomllib.loads(with_gain(seed_text, gain, "measured")))
        assert accept(design, wanted).passed is safe


@pytest.mark.parametrize(
    ("gain", "size", "safe"),
    [
        (0.1, 1.0, True), (0.1, -1.0, True), (0.1, 0.5, True), (0.1, -0.5, True), (0.1, 2.0, True), (0.1, -2.0, True),
        (0.2, 1.0, True), (0.2, -1.0, False),
    ],
)  # fmt: skip
def test_a_gain_that_is_said_to_be_safe_cycles_after_no_other_push(
    seed_text: str, gain: float, size: float, safe: bool
) -> None:
    """At 20 % a push of twice the friction starts no limit cycle from one side, and does from the other."""
    design = Design.from_dict(tomllib.loads(with_gain(seed_text, gain, "measured")))
    trial, load = study_trials(design)["push"].motions[0], size * Limits.of(design).breakaway * design.K_t
    start = trial.duration - sum(rest for _, rest in PUSHES)

    def references(t: np.ndarray) -> dict[str, np.ndarray]:
        return {**trial.references(t), "T_load": np.where((t >= start) & (t < start + 0.005), load, 0.0)}

    alone = Trial((Scenario("one push", start + 4.0, references, control="position"),))
    found = judge(alone, run_trial(design, alone), design.encoder_step)
    assert (found.cycle_amplitude == 0.0) is safe


def test_nobody_else_is_disturbed(tmp_path: Path, seed_text: str) -> None:
    (tmp_path / "tool.toml").write_text('[tool]\nacceptance = "x"\n')
    (tmp_path / "other.toml").write_text('acceptance = ["of another tool"]\n')
    (tmp_path / "nothing.toml").write_text("[broken\n")
    (tmp_path / "design.toml").write_text(seed_text)
    (tmp_path / "test_one.py").write_text(
        "import sys\ndef test_light():\n"
        "    heavy = {'numpy', 'numba', 'scipy', 'pydantic', 'matplotlib', 'control', 'filterpy'}\n"
        "    assert not heavy & set(sys.modules)\n"
    )
    ran = run_pytest(tmp_path, ".")
    assert ran.returncode == 0, ran.stdout
    assert "1 passed" in ran.stdout


def test_a_broken_design_is_an_error_not_a_pass(tmp_path: Path, seed_text: str) -> None:
    (tmp_path / "typo.toml").write_text(
        seed_text + LINE.format("push", "cycle_amplitude", 0.0).replace("limit", "limt")
    )
    (tmp_path / "broken.toml").write_text(seed_text + "\n[[acceptance]]\nscenario = \n")
    ran = run_pytest(tmp_path, ".")
    assert ran.returncode == 2
    assert "unknown field; did you mean 'limit'?" in ran.stdout
    assert "not valid TOML" in ran.stdout
    assert "Traceback" not in ran.stdout


def test_entry_point_names_the_plugin(project_root: Path) -> None:
    data = tomllib.loads((project_root / "pyproject.toml").read_text(encoding="utf-8"))
    assert data["project"]["entry-points"]["pytest11"] == {"pmsm_ctrl": "pmsm_ctrl.acceptance"}


def test_shipped_designs_state_the_targets(designs: Path) -> None:
    """The project's own limits stand in the designs, where `pytest designs/` holds them."""
    lines = {(a.scenario, a.metric, a.factor, a.limit) for a in Design.read(designs / "low_speed.toml").acceptance}
    for speed in ("0.5", "2", "10"):
        assert (f"reversal {speed} rad/s", "rms_change", 1.0, -0.8) in lines
        assert (f"reversal {speed} rad/s", "reversal_peak_change", 1.0, -0.85) in lines
    assert {f for s, m, f, limit in lines if m == "rms_change" and limit == -0.6} == {0.8, 1.2}


def test_change_needs_a_compensation(seed_text: str) -> None:
    design = Design.from_dict(tomllib.loads(seed_text))
    with pytest.raises(DesignError, match="needs a gain above 0"):
        accept(design, Acceptance(scenario="push", metric="rms_change", limit=-0.5))
    with pytest.raises(RequestError, match="unknown metric"):
        accept(design, Acceptance(scenario="push", metric="cycle_amplitude_change", limit=-0.5))


def test_a_wrong_name_is_said_before_anything_runs(seed_text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A misspelt metric was reported after ten seconds of simulation."""
    monkeypatch.setattr("pmsm_ctrl.compensate.study.run_trial", lambda *_, **__: pytest.fail("it runs"))
    design = Design.from_dict(tomllib.loads(seed_text))
    for scenario, metric in (("push", "reversal_peek"), ("pusch", "rms")):
        limited = design.model_copy(update={"acceptance": (Acceptance(scenario=scenario, metric=metric, limit=1.0),)})
        with pytest.raises(RequestError, match=r"reversal_peek|pusch"):
            compensate(limited)


def test_an_environment_without_pytest_is_told_what_to_install(tmp_path: Path) -> None:
    code = (
        "import runpy, sys\nsys.modules['pytest'] = None\n"
        "runpy.run_module('pmsm_ctrl.acceptance', run_name='__main__')\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False)
    assert run.returncode == 2
    assert "-m pip install pytest" in run.stderr
    assert "Traceback" not in run.stderr


def test_without_pytest_the_error_says_into_which_environment_it_belongs(tmp_path: Path) -> None:
    """A pytest of another environment says "no tests ran": the plugin has to be asked by its own Python."""
    (tmp_path / "pytest.py").write_text("raise ModuleNotFoundError('no pytest', name='pytest')\n", encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    ran = subprocess.run(
        [sys.executable, "-m", "pmsm_ctrl.acceptance", "designs"],
        env=environment, cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 2
    assert f"{sys.executable} -m pip install pytest" in ran.stderr
    assert "Traceback" not in ran.stderr
