"""The public names are frozen: a change here is a change for every user."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pmsm_ctrl
from pmsm_ctrl import Design, Log
from pmsm_ctrl.errors import PmsmCtrlError

PUBLIC = [
    "Design",
    "Log",
    "add",
    "compare",
    "compensate",
    "diagnose",
    "export",
    "fleet",
    "frf",
    "identify",
    "read_log",
    "simulate",
    "study",
    "sweep",
    "track",
    "tune",
    "verify",
]
VERBS = [name for name in PUBLIC if name[0].islower()]
SAME_NAME = [name for name in VERBS if importlib.util.find_spec(f"pmsm_ctrl.{name}") is not None]


def test_public_names_are_frozen() -> None:
    assert sorted(pmsm_ctrl.__all__) == sorted(PUBLIC)
    assert set(PUBLIC) <= set(dir(pmsm_ctrl))


@pytest.mark.parametrize("name", PUBLIC)
def test_public_name_resolves_and_is_documented(name: str) -> None:
    value = getattr(pmsm_ctrl, name)
    assert inspect.getdoc(value)
    assert value.__name__.removeprefix("pmsm_ctrl.") == name
    if inspect.isfunction(value):
        hidden = [p for p in inspect.signature(value).parameters.values() if p.kind is p.VAR_KEYWORD]
        assert not hidden, "**kwargs would swallow a typo"


@pytest.mark.parametrize("name", VERBS)
def test_every_parameter_of_a_verb_is_in_its_docstring(name: str) -> None:
    value = getattr(pmsm_ctrl, name)
    text = inspect.getdoc(value) or ""
    missing = [p for p in inspect.signature(value).parameters if p not in text]
    assert not missing, f"{name}: {missing} not described"


@pytest.mark.parametrize("name", SAME_NAME)
def test_a_verb_and_the_module_of_its_name_are_the_same(name: str) -> None:
    room = importlib.import_module(f"pmsm_ctrl.{name}")
    assert getattr(pmsm_ctrl, name) is room
    function = getattr(room, name)
    assert inspect.isfunction(function)
    assert inspect.signature(room) == inspect.signature(function)
    assert inspect.getdoc(function) in inspect.getdoc(room)
    assert pickle.loads(pickle.dumps(room)) is room


IMPORTS = {
    "import pmsm_ctrl": "pmsm_ctrl.tune, pmsm_ctrl.tune.margins",
    "import pmsm_ctrl.tune as t": "t, t.margins",
    "import pmsm_ctrl.tune.margins as m": "m, m.Margins",
    "import pmsm_ctrl.simulate as s": "s, s.scenario",
    "from pmsm_ctrl import tune": "tune, tune.margins",
    "from pmsm_ctrl.tune import margins": "margins, margins.Margins",
    "from pmsm_ctrl.tune import margins; import pmsm_ctrl.tune.margins as m": "m, margins",
    "import pmsm_ctrl.tune.margins; from pmsm_ctrl.tune import margins": "margins, margins.margins",
    "from pmsm_ctrl.tune.margins import margins": "margins",
}


@pytest.mark.slow
def test_every_form_of_import_gives_what_can_be_called() -> None:
    """Each in an interpreter that has none of the package's modules, but keeps the libraries."""
    lines = ["import sys"]
    for first, given in IMPORTS.items():
        lines += [first, f"for one in ({given},): assert callable(one), one"]
        lines += ["for name in [m for m in sys.modules if m.partition('.')[0] == 'pmsm_ctrl']: del sys.modules[name]"]
    subprocess.run([sys.executable, "-c", "\n".join(lines)], check=True)


def test_a_verb_is_called_with_its_arguments() -> None:
    with pytest.raises(TypeError, match="missing 1 required positional argument"):
        pmsm_ctrl.tune()  # type: ignore[call-arg]


def test_unknown_name_suggests_the_nearest() -> None:
    with pytest.raises(AttributeError, match="did you mean 'Design'"):
        _ = pmsm_ctrl.Desing


def test_version_matches_the_distribution() -> None:
    from importlib.metadata import version

    assert pmsm_ctrl.__version__ == version("pmsm-ctrl")


SERVO = Design.example("seed_motor")
TIME = 1e-3 * np.arange(200.0)
RECORD = Log({"t": TIME, "omega": np.sin(TIME), "i_q": np.cos(TIME)})


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: pmsm_ctrl.identify("axis.toml", RECORD), "design: str found; a Design was expected: Design.read("),
        (lambda: pmsm_ctrl.compare(Path("axis.toml"), RECORD), "design: PosixPath found; a Design was expected"),
        (lambda: pmsm_ctrl.diagnose({"motor": {}}, RECORD), "design: dict found; a Design was expected"),
        (lambda: pmsm_ctrl.track(None, RECORD), "design: None found; a Design was expected"),
        (lambda: pmsm_ctrl.add("axis.toml", RECORD, "stribeck"), "design: str found"),
        (lambda: pmsm_ctrl.tune("axis.toml"), "design: str found"),
        (lambda: pmsm_ctrl.simulate("axis.toml", "sweep"), "design: str found"),
        (lambda: pmsm_ctrl.sweep("axis.toml"), "design: str found"),
        (lambda: pmsm_ctrl.compensate("axis.toml"), "design: str found"),
        (lambda: pmsm_ctrl.export("axis.toml", "c"), "design: str found"),
        (lambda: pmsm_ctrl.study("axis.toml"), "design: str found"),
        (lambda: pmsm_ctrl.frf("axis.toml", RECORD), "design: str found"),
        (lambda: pmsm_ctrl.verify("axis.toml", RECORD, RECORD), "design: str found"),
        (lambda: pmsm_ctrl.verify(SERVO, RECORD, "after.csv"), "log 2: str found; a Log was expected"),
        (lambda: pmsm_ctrl.diagnose(SERVO, None), "log: None found; a Log was expected: read_log("),
        (lambda: pmsm_ctrl.identify(SERVO, "axis.csv"), "log: str found; a Log was expected"),
        (lambda: pmsm_ctrl.identify(RECORD, SERVO), "log: Design found; a Log was expected"),
        (lambda: pmsm_ctrl.compare(SERVO, {"t": TIME}), "log: dict found; a Log was expected"),
        (lambda: pmsm_ctrl.compare(SERVO, RECORD, holdout=[RECORD, 3]), "holdout 2: int found; a Log was expected"),
        (lambda: pmsm_ctrl.read_log(SERVO, "axis.csv"), "read_log(source, design): design: str found"),
        (lambda: pmsm_ctrl.read_log("axis.csv", "axis.toml"), "read_log(source, design): design: str found"),
        (lambda: Log(TIME, {"omega": TIME}), "channels of a log: ndarray found; a Mapping was expected: Log({'t': t"),
        (lambda: SERVO.with_effect("stribeck", {"dF_s": "a"}), "effect 'stribeck': dF_s: found 'a', but"),
        (lambda: SERVO.add_effect("cogging", {"A": float("nan")}), "effect 'cogging': A: found nan, but"),
    ],
)  # fmt: skip
def test_an_argument_of_another_kind_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Callable[[], object], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(PmsmCtrlError) as caught:
        call()
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
