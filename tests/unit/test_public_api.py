"""The public names are frozen: a change here is a change for every user."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pickle
import subprocess
import sys

import pytest

import pmsm_ctrl

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
