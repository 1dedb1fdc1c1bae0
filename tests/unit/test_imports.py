"""What `lint-imports` cannot say: circles, heavy libraries, rooms that only read, and nothing outgrows its room.

The layers and what stands beside them are contracts in pyproject.toml, under `[tool.importlinter]`.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "pmsm_ctrl"
PATHS = sorted(PACKAGE.rglob("*.py"))
MAX_MODULE = 500
MAX_FUNCTION = 60

ALLOWED_FOR_IMPORTERS = {"errors", "files", "units", "design", "log", "result", "section", "rendering", "importers"}
ONLY_IN = {
    "control": "tune", "filterpy": "track", "bokeh": "rendering", "starlette": "workbench", "uvicorn": "workbench",
    "dask": "fleet", "distributed": "fleet",
}  # fmt: skip
NEVER_ON_IMPORT = ["numba", "scipy", "matplotlib", "control", "filterpy", "jinja2", "h5py", "bokeh"]
NEVER_ON_IMPORT += ["starlette", "uvicorn", "dask", "distributed", "pyarrow"]


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def module_of(path: Path) -> str:
    """Dotted name of a source file."""
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path) for path in PATHS}


@cache
def imports(path: Path) -> list[tuple[str, str]]:
    """Return (place, dotted module) of every import, wherever in the file it stands, functions included."""
    return list(imported(path))


def imported(path: Path) -> Iterator[tuple[str, str]]:
    for node in ast.walk(tree_of(path)):
        place = f"{path.relative_to(PACKAGE)}:{getattr(node, 'lineno', 0)}"
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield place, alias.name
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{place}: relative import; write the full name"
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield place, full if full in MODULES else str(node.module)


def test_every_import_keeps_the_contracts(project_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    linter = pytest.importorskip("importlinter.cli", reason="import-linter IS NOT INSTALLED: LAYERS ARE NOT CHECKED")
    monkeypatch.chdir(project_root)
    assert linter.lint_imports(config_filename="pyproject.toml", no_cache=True) == 0


def for_types_alone(path: Path) -> set[str]:
    """Modules that a file imports for the type checker and nowhere else."""
    blocks = [n for n in ast.walk(tree_of(path)) if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"]
    return {node.module or "" for block in blocks for node in ast.walk(block) if isinstance(node, ast.ImportFrom)}


def test_no_module_imports_itself_in_a_circle() -> None:
    graph = {}
    for path in PATHS:
        graph[module_of(path)] = {module for _, module in imports(path) if module in MODULES}
        # an effect holds its structure, and a structure is asked about an effect: the two types know each other
        graph[module_of(path)] -= for_types_alone(path) & {"pmsm_ctrl.effects.base"}
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
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                if ast.get_docstring(node) is not None:  # saying more about a function must not make it too long
                    length -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
                if length > MAX_FUNCTION:
                    grown.append(f"{name}:{node.lineno}, {node.name}: {length} lines; at most {MAX_FUNCTION}")
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
