"""A workbench for every test; skipped where starlette is not installed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return two logs as bytes."""
    from tests.unit.workbench.harness import moved

    folder = tmp_path_factory.mktemp("logs")
    return {name: moved(seed).write_csv(folder / name).read_bytes() for seed, name in enumerate(("a.csv", "b.csv"))}


@pytest.fixture
def bench(tmp_path: Path) -> Any:
    """Return a server whose tasks run in a thread."""
    from tests.unit.workbench.harness import Bench

    return Bench(tmp_path / "sessions")


@pytest.fixture
def page(bench: Any) -> Iterator[Any]:
    """Yield a fresh session."""
    from tests.unit.workbench.harness import TOKEN, Page

    with bench.client() as client:
        found = client.get(f"/{TOKEN}/", follow_redirects=False).headers["location"].rstrip("/")
        yield Page(client, f"/{TOKEN}/{found}")
