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


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Yield a server in a process of its own."""
    from tests.unit.workbench.person import Server

    found = Server(tmp_path_factory.mktemp("sessions"))
    yield found
    found.close()


@pytest.fixture(params=[(1280, 800)], ids=["1280x800"])
def person(request: pytest.FixtureRequest) -> Iterator[Any]:
    """Yield a browser of this size."""
    from tests.unit.workbench.person import Person

    found = Person(*request.param)
    yield found
    found.driver.quit()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a design and two logs whose names are markup."""
    from tests.unit.workbench.harness import DESIGN, moved

    target = tmp_path_factory.mktemp("logs")
    (target / "design.toml").write_text(DESIGN, encoding="utf-8")
    for seed, name in enumerate(("<img src=x onerror=alert(1)>.csv", "b.csv")):
        moved(seed).write_csv(target / name)
    return target
