"""What is shipped: the source distribution names the tracked files and folders, and nothing beside them."""

from __future__ import annotations

import subprocess
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_the_source_distribution_holds_what_is_tracked() -> None:
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode or not (ROOT / ".git").exists():
        pytest.skip("no working copy of the project")
    tracked = {f"/{line.split('/')[0]}" for line in done.stdout.splitlines()}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert set(project["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]) == tracked


def test_what_a_command_leaves_beside_tracked_files_is_ignored() -> None:
    written = ["reports/axis.html", "reports/axis.design.toml", "reports/axis-2.html", "site/index.html", "dist/a.whl"]
    done = subprocess.run(["git", "check-ignore", *written], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode == 128:
        pytest.skip("no working copy of the project")
    assert done.stdout.split() == written
