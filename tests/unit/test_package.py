"""What is shipped: the source distribution names the tracked files and folders, and nothing beside them."""

from __future__ import annotations

import importlib.metadata
import re
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

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


def installed(needed: list[str], found: set[str]) -> set[str]:
    """Return the packages that these requirements bring, and those that they bring in turn."""
    for requirement in map(Requirement, needed):
        name = re.sub(r"[-_.]+", "-", requirement.name).lower()
        if name in found or (requirement.marker is not None and not requirement.marker.evaluate({"extra": ""})):
            continue
        found.add(name)
        installed(importlib.metadata.distribution(name).requires or [], found)
    return found


def test_the_readme_says_what_the_installation_takes() -> None:
    """It said 31 packages long after that had become 35. Their size hangs on what pip compiles, and is not judged."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    said = re.search(r"takes \d+ MB in (\d+) packages", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert said is not None
    found = installed(project["dependencies"], set())
    assert len(found) + 3 == pytest.approx(int(said[1]), abs=2)  # pmsm-ctrl, pip and setuptools
