"""A changed source never meets a stale kernel: the cache belongs to exactly the sources that are compiled."""

import ast
import builtins
import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import pmsm_ctrl
from pmsm_ctrl import Design, kernels, simulate
from pmsm_ctrl.effects import CATALOGUE
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.simulate.compose import load
from pmsm_ctrl.simulate.controller_lines import SpeedParts
from tests.effort import amount

PACKAGE = Path(pmsm_ctrl.__file__).parent
COMPILERS = {"kernel", "inlined", "njit", "jit", "vectorize", "guvectorize", "cfunc", "shared"}

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
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.simulate import Scenario, simulate
design = Design.read("designs/seed_motor.toml").replace(
    sensor={"encoder_counts": 0, "current_noise": 0.0, "log_divider": 1},
    loops={"current": {"K_p": 1e-6, "T_n": 1.0}},
)
design = design.with_parameters(psi_f=1e-9).replace_effects(())
design = design.with_own_effects(mine.effect).with_effect("mine", {"a": 1e-3})
coast = Scenario("coast", 0.01, lambda t: {}, control="current", omega_0=100.0)
log = simulate(design, coast, keep_truth=True)
slope = (log["omega_true"][0] - log["omega_true"][-1]) / (log.t[-1] - log.t[0])
read = column(mine.effect, {"omega": [100.0]}, {"a": 1e-3})[0]
assert abs(slope * 9e-5 / read - 1.0) < 1e-6, "simulation and regression differ"
print(slope)
"""

MINE = """
from pmsm_ctrl.effects import Effect, Parameter, kernel
from shape import helper

@kernel
def term(omega, a):
    return helper(a)

effect = Effect(id="mine", title="t", equation="a", source="s", enters="torque",
    parameters=(Parameter("a", "N m", 0.0, -1.0, 1.0, "a", linear=True),), term=term, needs="n")
"""
SHAPE = """
import sizes
from pmsm_ctrl.effects import kernel

@kernel
def helper(x):
    return sizes.FACTOR * x
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


@pytest.mark.slow  # the hash and what is in it are tested below
def test_an_edited_effect_of_the_package_is_seen(copy):
    code = MEASURE.replace('"current_noise": 0.0}', '"current_noise": 0.0, "log_divider": 1}')
    before = run(copy, code)
    assert before == pytest.approx(0.000168 * 100.0 / 9e-5, rel=2e-3)  # F_v omega / J
    assert run(copy, code) == before  # from the cache
    path = copy / "pmsm_ctrl" / "effects" / "viscous.py"
    path.write_text(path.read_text().replace("return F_v * omega", "return 3.0 * F_v * omega"))
    assert run(copy, code) == pytest.approx(3.0 * before, rel=5e-3)


@pytest.mark.slow
def test_an_edited_constant_behind_an_own_effect_is_seen(copy):
    """Neither the term's file nor that of the helper it calls changes: only a number in a third file."""
    (copy / "mine.py").write_text(MINE)
    (copy / "shape.py").write_text(SHAPE)
    (copy / "sizes.py").write_text("FACTOR = 1.0")
    before = run(copy, OWN)
    assert before == pytest.approx(1e-3 / 9e-5, rel=1e-6)
    (copy / "sizes.py").write_text("FACTOR = 9.0")
    assert run(copy, OWN) == pytest.approx(9.0 * before, rel=1e-6)


def hashed(root: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The hash of the copy of the package in this folder."""
    monkeypatch.setattr(kernels.cache, "__file__", str(root / "pmsm_ctrl" / "kernels" / "cache.py"))
    return kernels.source_hash.__wrapped__()


def test_every_compiled_file_is_in_the_hash_and_no_other(copy, monkeypatch):
    compiled = set(kernels.compiled_sources())
    before = hashed(copy, monkeypatch)
    assert not compiled & {PACKAGE / name for name in ("cli.py", "design.py", "simulate/run.py")}
    for path in sorted(compiled)[:: amount(6, 1)]:
        edited = copy / "pmsm_ctrl" / path.relative_to(PACKAGE)
        content = edited.read_bytes()
        edited.write_bytes(content + b"\n# edited\n")
        assert hashed(copy, monkeypatch) != before, path
        edited.write_bytes(content)
    for path in set(PACKAGE.rglob("*.py")) - compiled:
        (copy / "pmsm_ctrl" / path.relative_to(PACKAGE)).write_bytes(b"# edited\n")
    assert hashed(copy, monkeypatch) == before


def test_versions_and_places_are_in_the_hash(copy, monkeypatch):
    before = hashed(copy, monkeypatch)
    (copy / "pmsm_ctrl" / "effects" / "viscous.py").rename(copy / "pmsm_ctrl" / "effects" / "viscous_drag.py")
    moved = hashed(copy, monkeypatch)
    monkeypatch.setattr("numba.__version__", "0.0")
    assert len({before, moved, hashed(copy, monkeypatch)}) == 3


def name_of(decorator: ast.expr) -> str:
    """The last name of `@kernel`, `@numba.njit`, `@numba.njit(...)`."""
    decorator = decorator.func if isinstance(decorator, ast.Call) else decorator
    return decorator.attr if isinstance(decorator, ast.Attribute) else getattr(decorator, "id", "")


def test_no_file_compiles_unseen():
    """Whoever imports numba or the decorators is in the hash; `effects` passes `kernel` on and has no function."""
    unseen = []
    for path in set(PACKAGE.rglob("*.py")) - {*kernels.compiled_sources(), PACKAGE / "effects" / "__init__.py"}:
        text = path.read_text(encoding="utf-8")
        if not any(word in text for word in ("numba", *COMPILERS)):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                seen = any(alias.name.split(".")[0] == "numba" for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                module = node.module or ""
                names = {alias.name for alias in node.names}
                seen = module.split(".")[0] == "numba" or (module.startswith("pmsm_ctrl") and bool(names & COMPILERS))
            else:
                continue
            if seen:
                unseen.append(f"{path}, line {node.lineno}")
    assert not unseen


def test_a_kernel_reads_nothing_from_outside_the_hash():
    """A constant or a helper from a file that is not hashed would stay in the cache with its old value."""
    compiled = kernels.compiled_sources()
    for path in compiled:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        sources = {
            alias.asname or alias.name: node.module or ""
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for alias in node.names
        }
        for function in ast.walk(tree):
            if not isinstance(function, ast.FunctionDef):
                continue
            if not {name_of(decorator) for decorator in function.decorator_list} & COMPILERS:
                continue
            for node in ast.walk(ast.Module(function.body, [])):
                module = sources.get(node.id, "") if isinstance(node, ast.Name) else ""
                if module.startswith("pmsm_ctrl") and not hasattr(builtins, node.id):
                    file = importlib.import_module(module).__file__
                    assert Path(file) in compiled, f"{path}: {function.name} reads {node.id} from {module}"


def is_kernel(value: object) -> bool:
    """By type: `isinstance` asks weak references to what is gone."""
    return issubclass(type(value), Dispatcher)


def test_no_kernel_is_compiled_anew_for_a_constant():
    """numba compiles a function again for every constant that it is called with."""
    simulate(Design.read("designs/seed_motor.toml"), "hold")
    low_pass(np.ones((1, 100)), 100.0, 10.0)
    # by module: what was loaded while tests were collected is frozen, and the garbage collector does not list it
    rooms = [one for name, one in list(sys.modules.items()) if name.startswith("pmsm_ctrl.kernels")]
    kept = {f"{one.__module__}.{one.__name__}": one for room in rooms for one in vars(room).values() if is_kernel(one)}
    used = {name: one.signatures for name, one in kept.items() if one.signatures}
    assert "pmsm_ctrl.kernels.filters.zero_phase" in used
    assert [name for name, signatures in used.items() if "Literal" in str(signatures)] == []


def test_a_plant_is_compiled_once_for_all_its_controllers_and_a_controller_for_all_its_plants():
    dry, wavy = ((CATALOGUE["coulomb"], CATALOGUE[name]) for name in ("viscous", "cogging"))
    plain, feeding, filtering, elsewhere = (
        load(dry), load(dry, dry), load(dry, parts=SpeedParts(filters=1)), load(wavy, dry),
    )  # fmt: skip
    for name in ("shaft_torque", "derivative", "runge_kutta", "step_dry"):
        assert getattr(feeding, name) is getattr(plain, name) is getattr(filtering, name)
        assert getattr(elsewhere, name) is not getattr(plain, name)
    assert elsewhere.speed_control is feeding.speed_control
    assert len({one.speed_control for one in (plain, feeding, filtering)}) == 3
    assert len({one.run for one in (plain, feeding, filtering, elsewhere)}) == 4
