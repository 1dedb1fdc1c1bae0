"""Pages in Chromium without a window: what a script says of them in frames of several sizes, in one start."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

__all__ = ["browser", "measured", "no_browser"]

no_browser = pytest.mark.skipif(
    shutil.which("chromium") is None, reason="CHROMIUM ABSENT: no page was drawn (apt install chromium)"
)


def browser(*words: str, profile: Path) -> subprocess.CompletedProcess[bytes]:
    """Start the browser, without network, and wait for its end."""
    command = [
        "chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync", "--hide-scrollbars",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={profile}", *words,
    ]  # fmt: skip
    return subprocess.run(command, capture_output=True, timeout=120, check=True)


def measured(frames: Sequence[tuple[str, int, int, str]], folder: Path) -> list[Any]:
    """Return what an expression says of each page in a frame of its size: a window is never narrower than 500 px.

    Parameters
    ----------
    frames : sequence of (str, int, int, str)
        Text of the page, width and height of the frame, px, and the expression.
    folder : Path
        For the pages and the browser's profile.
    """
    inner = []
    for k, (page, width, height, expression) in enumerate(frames):
        probe = f"<script>addEventListener('load', () => parent.postMessage([{k}, {expression}], '*'))</script></body>"
        text, found = re.subn('<meta http-equiv="Content-Security-Policy"[^>]*>', "", page)  # forbids the probe
        assert found == 1
        (folder / f"page{k}.html").write_text(text.replace("</body>", probe), encoding="utf-8")
        inner.append(f"<iframe src='page{k}.html' style='width:{width}px;height:{height}px;border:0'></iframe>")
    outer = folder / "frame.html"
    hear = "const said = []; onmessage = (e) => { said[e.data[0]] = e.data[1]; document.title = JSON.stringify(said) }"
    outer.write_text(f"<!DOCTYPE html><title>?</title><script>{hear}</script>{''.join(inner)}", encoding="utf-8")
    drawn = browser(
        "--window-size=1400,1000", "--virtual-time-budget=20000", "--dump-dom", outer.as_uri(),
        profile=folder / "profile",
    )  # fmt: skip
    found = re.search("<title>([^<]*)</title>", drawn.stdout.decode())
    assert found is not None
    said: list[Any] = json.loads(found[1])
    assert len(said) == len(frames)
    return said
