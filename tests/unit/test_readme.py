"""What the README shows is true: its verbs exist, and its two commands are where CI looks for them.

Its code is run with that of all pages, in test_docs.py.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pmsm_ctrl.cli import app

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_every_verb_in_the_readme_exists_and_every_verb_is_in_it() -> None:
    verbs = {c.name or c.callback.__name__ for c in app.registered_commands if c.callback is not None}
    assert set(re.findall(r"pmsm-ctrl ([a-z]+)\b", README)) == verbs


def test_every_link_into_the_project_leads_somewhere() -> None:
    for target in re.findall(r"`(designs/[\w.]+|\.ci/\w+)`", README):
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize("name", ["study", "test"])
def test_ci_finds_the_commands(name: str) -> None:
    found = re.search(rf"<!-- command: {name} -->\n```bash\n(.+)\n```", README)
    assert found is not None
    assert found[1].startswith("python3 -m venv .venv && ")
    assert "\n" not in found[1]
