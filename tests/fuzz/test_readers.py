"""A short run of ``python -m tests.fuzz`` for every reader; more by hand, or in a nightly job."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz.readers import READERS, seeds

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("reader", READERS)
def test_the_seeds_are_good_files(reader: str) -> None:
    try:
        files = seeds(reader)
    except ImportError as error:
        pytest.skip(f"{error.name} IS NOT INSTALLED: {reader} IS NOT FUZZED")
    for content in files:
        READERS[reader](content)


@pytest.mark.parametrize(
    "reader",
    ["text", "design", *(pytest.param(r, marks=pytest.mark.slow) for r in READERS if r not in ("text", "design"))],
)
def test_guided_by_coverage(tmp_path: Path, reader: str) -> None:
    pytest.importorskip("atheris", reason="atheris IS NOT INSTALLED: NOTHING IS FUZZED BY COVERAGE")
    try:
        seeds(reader)
    except ImportError as error:
        pytest.skip(f"{error.name} IS NOT INSTALLED: {reader} IS NOT FUZZED")
    line = [sys.executable, "-m", "tests.fuzz", reader, "--seconds", "5", "--corpus", str(tmp_path)]
    found = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, check=False, timeout=120)
    assert found.returncode == 0, found.stderr[-3000:]
    assert not list(tmp_path.glob("crash-*"))
