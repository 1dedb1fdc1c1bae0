"""Options and fixtures for all tests."""

from __future__ import annotations

import gc
import os
import random
from collections.abc import Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the tests run side by side; small matrices gain nothing from more

import numpy as np
import pytest

from tests import effort

ROOT = Path(__file__).resolve().parent.parent


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", default=False, help="run the whole of the tests that take minutes")
    parser.addoption("--physics-table", action="store_true", default=False, help="print the table of physics checks")


def pytest_configure(config: pytest.Config) -> None:
    effort.WHOLE = config.getoption("--slow")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect tests without looking for garbage: half a million objects that all stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()  # what was collected stays: no later search looks at it again
        gc.set_threshold(10_000)  # of 700 objects one test makes many times as many
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what takes minutes: a thousand skipped tests would be sent, reported and counted one by one."""
    if config.getoption("--slow"):
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if not item.get_closest_marker("slow")]
    if hasattr(config, "workerinput"):
        items[:] = _begun_apart(items)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if not config.getoption("--slow"):
        terminalreporter.write_line("Tests marked slow are left out; --slow runs them.")


# What compiles no kernel, and takes 20 s; one file among them does.
NO_KERNELS = tuple(ROOT / "tests" / "unit" / name for name in (
    "importers", "rendering", "test_design.py", "test_docstrings.py", "test_imports.py",
))  # fmt: skip
BUT = ROOT / "tests" / "unit" / "importers" / "test_lost.py"


def _begun_apart(items: list[pytest.Item]) -> list[pytest.Item]:
    """Let the second of two processes begin with what compiles nothing: both would compile the same kernels at once."""
    plain = [any(item.path.is_relative_to(place) for place in NO_KERNELS) and item.path != BUT for item in items]
    light = [item for item, is_plain in zip(items, plain, strict=True) if is_plain]
    others = [item for item, is_plain in zip(items, plain, strict=True) if not is_plain]
    half = len(items) // 2
    return others[:half] + light + others[half:]


def data_folder() -> Path:
    """Where measured data is looked for: PMSM_CTRL_DATA, else ../shared/data beside the project."""
    named = os.environ.get("PMSM_CTRL_DATA")
    return Path(named) if named else ROOT.parent / "shared" / "data"


class MeasuredData:
    """Finds measured files; a missing one skips the test, saying what is missing and where it was sought."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __call__(self, relative: str) -> Path:
        path = self.folder / relative
        if not path.is_file():
            pytest.skip(f"MEASURED DATA ABSENT: {path} (set PMSM_CTRL_DATA to the folder that holds {relative})")
        return path


@pytest.fixture(scope="session", autouse=True)
def json_follows_its_schema() -> Iterator[None]:
    """Hold every result that a command writes as JSON, in any test, against the schema it names."""
    try:
        import jsonschema
    except ImportError:  # an environment older than this dependency
        yield
        return
    from pmsm_ctrl import console
    from pmsm_ctrl.result import jsonable
    from pmsm_ctrl.schemas import SCHEMAS

    known = {schema["title"]: schema for schema in SCHEMAS.values()}
    write = console.write_json

    def checked(path: Path, verb: str, data: Mapping[str, Any]) -> None:
        write(path, verb, data)
        content = {"schema": f"pmsm-ctrl/{verb}/1", **jsonable(data)}
        if content["schema"] in known:
            jsonschema.Draft202012Validator(known[content["schema"]]).validate(content)

    console.write_json = checked
    yield
    console.write_json = write


@pytest.fixture(scope="session")
def measured() -> MeasuredData:
    """Return a function from a relative name (emps/DATA_EMPS.mat) to a path; skips loudly if absent."""
    return MeasuredData(data_folder())


@pytest.fixture(scope="session", autouse=True)
def measured_files_need_no_process() -> Iterator[None]:
    """Read measured MAT files in this process: starting another one takes half a second, and they damage nothing."""
    from pmsm_ctrl.importers import mat
    from tests.readers_here import ask_here

    outside, folder = mat.ask, data_folder().resolve()

    def ask(kind: str, path: Path, file: str, words: Sequence[str] = ()) -> tuple[dict[str, Any], bytes]:
        chosen = ask_here if path.resolve().is_relative_to(folder) else outside
        return chosen(kind, path, file, words)

    mat.ask = ask
    yield
    mat.ask = outside


@pytest.fixture
def good_files(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read MAT files and bags of a test in this process, as measured ones are."""
    from tests.readers_here import ask_here

    for name in ("mat", "bags"):
        monkeypatch.setattr(f"pmsm_ctrl.importers.{name}.ask", ask_here)


@pytest.fixture(scope="session")
def project_root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def designs() -> Path:
    """Return the folder of the committed designs."""
    return ROOT / "designs"


@pytest.fixture(autouse=True)
def _fixed_seeds() -> None:
    """Give every test the same state of the global generators, whatever ran before it."""
    random.seed(20240501)
    np.random.seed(20240501)  # noqa: NPY002 - libraries under test may still use the legacy generator


@pytest.fixture(params=effort.seeds(1, 2, 3))
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Return generators of several fixed seeds, one test run each: the first every time, the others with ``--slow``."""
    return np.random.default_rng(request.param)
