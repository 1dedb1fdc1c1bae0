"""The words of all notices: codes in snake case, one sentence each."""

from __future__ import annotations

import importlib
import re
import string
from pathlib import Path

import pytest

from pmsm_ctrl.section import Template

PACKAGE = Path(__file__).resolve().parents[2] / "pmsm_ctrl"
TEMPLATES = [
    (path.parent.name, template)
    for path in sorted(PACKAGE.glob("*/notices.py"))
    for template in vars(importlib.import_module(f"pmsm_ctrl.{path.parent.name}.notices")).values()
    if isinstance(template, Template)
]


@pytest.mark.parametrize(("room", "template"), TEMPLATES, ids=[f"{room}-{t.code}" for room, t in TEMPLATES])
def test_words_of_a_notice(room: str, template: Template) -> None:
    assert re.fullmatch(r"[a-z][a-z0-9_]*", template.code)
    assert not template.words.endswith((".", " "))
    assert "warning" not in template.words.lower()
    assert "\n" not in template.words
    fields = [name for _, name, _, _ in string.Formatter().parse(template.words) if name is not None]
    assert all(re.fullmatch(r"\w+", name) for name in fields), "a field is a plain name"
