"""What `lint-imports` cannot say: circles, heavy libraries, rooms that only read, and nothing outgrows its room.

The layers and what stands beside them are contracts in pyproject.toml, under `[tool.importlinter]`.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.sources import nodes_of

PACKAGE = Path(__file__).resolve().parents[2] / "pmsm_ctrl"
PATHS = sorted(PACKAGE.rglob("*.py"))
MAX_MODULE = 500
MAX_FUNCTION = 60

ALLOWED_FOR_IMPORTERS = {"errors", "files", "frames", "units", "design", "log", "result", "section", "rendering"}
ALLOWED_FOR_IMPORTERS |= {"importers"}
ONLY_IN = {
    "control": "tune", "filterpy": "track", "bokeh": "rendering", "starlette": "workbench", "uvicorn": "workbench",
    "dask": "fleet", "distributed": "fleet",
}  # fmt: skip
NEVER_ON_IMPORT = ["numba", "scipy", "matplotlib", "control", "filterpy", "jinja2", "h5py", "bokeh"]
NEVER_ON_IMPORT += ["starlette", "uvicorn", "dask", "distributed", "pyarrow"]


def module_of(path: Path) -> str:
    """Dotted name of a source file."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path) for path in PATHS}


@dataclass(frozen=True)
class Source:
    """What the tests ask of a source file, all of it found in one pass.

    Imports are (place, dotted module), wherever in the file they stand, functions included.
    """

    imports: list[tuple[str, str]]
    for_types: set[str]  # imported for the type checker and nowhere else
    functions: list[tuple[int, str, int]]  # line, name, length without its docstring


@cache
def source_of(path: Path) -> Source:
    found = Source([], set(), [])
    for node in nodes_of(path):
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.imports.extend((f"{path.relative_to(PACKAGE)}:{node.lineno}", module) for module in imported(node))
        elif isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            found.for_types.update(one.module or "" for one in node.body if isinstance(one, ast.ImportFrom))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.functions.append((node.lineno, node.name, length_of(node)))
    return found


def imports(path: Path) -> list[tuple[str, str]]:
    return source_of(path).imports


def imported(node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
        return
    assert node.level == 0, f"line {node.lineno}: relative import; write the full name"
    for alias in node.names:
        full = f"{node.module}.{alias.name}"
        yield full if full in MODULES else str(node.module)


def length_of(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function without its docstring: saying more about it must not make it too long."""
    length = (node.end_lineno or node.lineno) - node.lineno + 1
    if ast.get_docstring(node) is not None:
        length -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
    return length


def test_every_import_keeps_the_contracts(project_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    linter = pytest.importorskip("importlinter.cli", reason="import-linter IS NOT INSTALLED: LAYERS ARE NOT CHECKED")
    monkeypatch.chdir(project_root)
    assert linter.lint_imports(config_filename="pyproject.toml", no_cache=True) == 0


def test_no_module_imports_itself_in_a_circle() -> None:
    graph = {}
    for path in PATHS:
        graph[module_of(path)] = {module for _, module in imports(path) if module in MODULES}
        # an effect holds its structure, and a structure is asked about an effect: the two types know each other
        graph[module_of(path)] -= source_of(path).for_types & {"pmsm_ctrl.effects.base"}
    graph["pmsm_ctrl"] = set()  # the package itself names its exports, and everybody may ask for its version
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(reversed(error.args[1])))


def test_importers_only_read() -> None:
    wrong = [
        f"{place}: an importer imports {module}"
        for path in (PACKAGE / "importers").rglob("*.py")
        for place, module in imports(path)
        if module.startswith("pmsm_ctrl.") and module.split(".")[1] not in ALLOWED_FOR_IMPORTERS
    ]
    assert not wrong, "\n".join(wrong)


def test_libraries_stay_where_they_belong() -> None:
    wrong = [
        f"{place}: {module} belongs in {ONLY_IN[module.split('.')[0]]}/ alone"
        for path in PATHS
        for place, module in imports(path)
        if module.split(".")[0] in ONLY_IN and path.relative_to(PACKAGE).parts[0] != ONLY_IN[module.split(".")[0]]
    ]
    assert not wrong, "\n".join(wrong)


def test_pyplot_is_not_used() -> None:
    assert not [place for path in PATHS for place, module in imports(path) if module.startswith("matplotlib.pyplot")]


def test_no_room_outgrows_its_size() -> None:
    grown = []
    for path in PATHS:
        name, lines = path.relative_to(PACKAGE), path.read_text(encoding="utf-8").count("\n")
        if lines > MAX_MODULE:
            grown.append(f"{name}: {lines} lines; at most {MAX_MODULE}")
        for line, function, length in source_of(path).functions:
            if length > MAX_FUNCTION:
                grown.append(f"{name}:{line}, {function}: {length} lines; at most {MAX_FUNCTION}")
    assert not grown, "\n".join(grown)


def loaded_after(code: str) -> set[str]:
    """Top-level modules that are loaded after running `code` in a fresh interpreter."""
    probe = f"{code}\nimport sys\nprint('LOADED', *sorted({{m.split('.')[0] for m in sys.modules}}))"
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    return set(run.stdout.rpartition("LOADED")[2].split())


def test_importing_the_package_loads_nothing_heavy() -> None:
    loaded = loaded_after("import pmsm_ctrl")
    assert not loaded & {*NEVER_ON_IMPORT, "numpy", "pydantic", "typer", "rich"}


def test_help_loads_nothing_heavy() -> None:
    loaded = loaded_after("from pmsm_ctrl.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass")
    assert not loaded & {*NEVER_ON_IMPORT, "numpy", "pydantic"}


@pytest.mark.parametrize("name", ["Design", "Log"])
def test_the_nouns_load_no_numerics(name: str) -> None:
    assert not loaded_after(f"import pmsm_ctrl; pmsm_ctrl.{name}") & set(NEVER_ON_IMPORT)
