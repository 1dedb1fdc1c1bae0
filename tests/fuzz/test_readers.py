"""A short run of ``python -m tests.fuzz`` for every reader; more by hand, or in a nightly job."""

from __future__ import annotations

import random
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


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("reader", ["npy", "npz"])
def test_damage_behind_a_checksum_is_met(reader: str, seed: int) -> None:
    rng = random.Random(seed)
    (good,) = seeds(reader)
    for _ in range(100):
        content = bytearray(good)
        for _ in range(rng.choice((1, 2, 8))):  # mostly in the header, which says what follows
            content[rng.randrange(128 if rng.random() < 0.7 else len(content))] = rng.randrange(256)
        READERS[reader](bytes(content[: rng.randrange(len(content))] if rng.random() < 0.1 else content))
