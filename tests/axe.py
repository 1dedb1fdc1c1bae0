"""What axe-core, the usual checker of accessibility, finds in a page that Chromium shows."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

__all__ = ["violations"]

# WCAG 2.1 at level AA, which law asks of public pages; axe's own advice beyond it is not judged here.
RULES = {"runOnly": {"type": "tag", "values": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa"]}}


def violations(driver: Any) -> list[str]:
    """Return one line for every rule that the present page breaks, with the first places."""
    spec = find_spec("axe_core_python")
    if spec is None or spec.origin is None:
        pytest.skip("AXE-CORE ABSENT: accessibility was not checked (pip install axe-core-python)")
    source = Path(spec.origin).with_name("axe.min.js").read_text(encoding="utf-8")
    driver.execute_script(source)
    driver.set_script_timeout(120)
    found = driver.execute_async_script(
        "const done = arguments[arguments.length - 1];"
        f"axe.run(document, {json.dumps(RULES)}).then((r) => done(r.violations), (e) => done([{{id: String(e)}}]));"
    )
    return [
        f"{one['id']}: {one.get('help', '')} ({len(one.get('nodes', []))}): "
        + "; ".join(str(node["html"])[:160] for node in one.get("nodes", [])[:3])
        for one in found
    ]
