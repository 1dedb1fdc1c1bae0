"""A changed source never meets a stale kernel: the cache belongs to exactly the sources that made it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

MEASURE = """
from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import Scenario, simulate
design = Design.read("designs/seed_motor.toml").replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
free = design.replace(loops={"current": {"K_p": 1e-6, "T_n": 1.0}}).with_parameters(psi_f=1e-9)
coast = Scenario("coast", 0.001, lambda t: {}, control="current", omega_0=100.0)
log = simulate(free.without_effect("coulomb"), coast, keep_truth=True)
print((log["omega_true"][0] - log["omega_true"][-1]) / log.t[-1] if log.t.size > 1 else 0.0)
"""

OWN = """
import sys
sys.path.insert(0, ".")
import mine
from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import Scenario, simulate
design = Design.read("designs/seed_motor.toml").replace(
    sensor={"encoder_counts": 0, "current_noise": 0.0, "log_divider": 1},
    loops={"current": {"K_p": 1e-6, "T_n": 1.0}},
)
design = design.with_parameters(psi_f=1e-9).replace_effects(()).with_effect("mine", {"a": 1e-3})
coast = Scenario("coast", 0.01, lambda t: {}, control="current", omega_0=100.0)
log = simulate(design, coast, own=[mine.effect], keep_truth=True)
print((log["omega_true"][0] - log["omega_true"][-1]) / (log.t[-1] - log.t[0]))
"""

MINE = """
from pmsm_ctrl.effects import Effect, Parameter, kernel
FACTOR = 1.0

@kernel
def helper(x):
    return FACTOR * x

@kernel
def term(omega, a):
    return helper(a)

effect = Effect(id="mine", title="t", equation="a", source="s", enters="torque",
    parameters=(Parameter("a", "N m", 0.0, -1.0, 1.0, "a", linear=True),), term=term, needs="n")
"""


@pytest.fixture
def copy(tmp_path, project_root):
    """A copy of the package, with a cache of its own."""
    for folder in ("pmsm_ctrl", "designs"):
        shutil.copytree(project_root / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def run(folder: Path, code: str) -> float:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment |= {"PYTHONPATH": str(folder), "PMSM_CTRL_CACHE": str(folder / "cache"), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


def test_an_edited_effect_of_the_package_is_seen(copy):
    code = MEASURE.replace('"current_noise": 0.0}', '"current_noise": 0.0, "log_divider": 1}')
    before = run(copy, code)
    assert before == pytest.approx(0.000168 * 100.0 / 9e-5, rel=2e-3)  # F_v omega / J
    assert run(copy, code) == before  # from the cache
    path = copy / "pmsm_ctrl" / "effects" / "viscous.py"
    path.write_text(path.read_text().replace("return F_v * omega", "return 3.0 * F_v * omega"))
    assert run(copy, code) == pytest.approx(3.0 * before, rel=5e-3)


def test_an_edited_constant_behind_an_own_effect_is_seen(copy):
    """Neither the term's own text nor its name changes: only what it calls."""
    mine = copy / "mine.py"
    mine.write_text(MINE)
    before = run(copy, OWN)
    assert before == pytest.approx(1e-3 / 9e-5, rel=1e-6)
    mine.write_text(MINE.replace("FACTOR = 1.0", "FACTOR = 2.0"))
    assert run(copy, OWN) == pytest.approx(2.0 * before, rel=1e-6)
