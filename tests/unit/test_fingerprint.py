"""The key of an own effect's kernel: whatever the term calls or reads changes it, in whichever file it stands."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

from pmsm_ctrl.effects.fingerprint import fingerprint

FILES = {
    "own_term": "import math\nimport own_shape\nfrom own_shape import helper\n\n"
    "def term(w, a):\n    return a * helper(w) * own_shape.FACTOR * math.pi\n",
    "own_shape": "from own_sizes import POWER, TABLE\nFACTOR = 1.0\nUNUSED = 0\n\n"
    "def helper(w):\n    return w ** POWER + TABLE[0]\n",
    "own_sizes": "POWER = 2\nTABLE = (0.0, 1.0)\n",
}


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Return the key of the term after edits of its files."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def of(**edits: tuple[str, str]) -> bytes:
        for name, text in FILES.items():
            old, new = edits.get(name, ("", ""))
            assert old in text
            (tmp_path / f"{name}.py").write_text(text.replace(old, new) if old else text)
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
        try:
            return fingerprint(importlib.import_module("own_term").term)
        finally:
            sys.dont_write_bytecode = before
            for name in FILES:
                sys.modules.pop(name, None)

    return of


def test_the_same_files_give_the_same_key(key) -> None:
    assert key() == key()


@pytest.mark.parametrize(
    "edit",
    [
        {"own_term": ("a * helper", "2 * a * helper")},
        {"own_shape": ("+ TABLE", "- TABLE")},
        {"own_shape": ("FACTOR = 1.0", "FACTOR = 9.0")},
        {"own_sizes": ("POWER = 2", "POWER = 3")},
        {"own_sizes": ("(0.0, 1.0)", "(0.5, 1.0)")},
    ],
)
def test_whatever_the_term_calls_or_reads_changes_the_key(key, edit: dict[str, tuple[str, str]]) -> None:
    assert key(**edit) != key()


def test_what_it_does_not_read_of_another_file_does_not(key) -> None:
    assert key(own_sizes=("TABLE", "SPARE = 1\nTABLE")) == key()
