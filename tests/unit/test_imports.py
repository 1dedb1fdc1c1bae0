"""Imports point one way, heavy libraries stay where they belong, and nothing outgrows its room."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "pmsm_ctrl"
SOURCES = sorted(PACKAGE.rglob("*.py"))
MAX_MODULE = 500
MAX_FUNCTION = 60

# A part may import parts of a lower level only (and itself). Parts of one level do not know each other,
# except for the pairs named in SIBLINGS: the first may import the second.
LEVELS = [
    {"errors"},
    {"complaints", "files", "sampling", "section", "units"},
    {"design_parts", "rendering"},
    {"design", "log", "result"},
    {"kernels", "importers", "datasheet", "evidence"},
    {"effects"},
    {"simulate", "tune", "regression"},
    {"identify", "track"},
    {"compare"},
    {"diagnose", "compensate"},
    {"report", "export", "acceptance"},
    {"console"},
    {"options"},
    {"init"},
    {"cli"},
    {"__main__"},
]
SIBLINGS = {("log", "design"), ("tune", "simulate"), ("evidence", "kernels")}
ALLOWED_FOR_IMPORTERS = {"errors", "files", "units", "design", "log", "result", "section", "rendering", "importers"}

ONLY_IN = {"control": "tune", "filterpy": "track"}
NEVER_ON_IMPORT = ["numba", "scipy", "matplotlib", "control", "filterpy", "jinja2", "h5py"]


def part_of(path: Path) -> str:
    """Name of the part a source file belongs to: 'cli', 'effects', ...; '' for the package's __init__."""
    relative = path.relative_to(PACKAGE)
    return "" if relative.name == "__init__.py" and len(relative.parts) == 1 else relative.parts[0].removesuffix(".py")


def level(part: str) -> int:
    for number, parts in enumerate(LEVELS):
        if part in parts:
            return number
    raise AssertionError(f"part '{part}' has no level; give it one in LEVELS")


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, dotted module) of every import, wherever in the file it stands."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import; write the full name"
            module = node.module or ""
            if module == "pmsm_ctrl":
                for alias in node.names:
                    yield node.lineno, f"pmsm_ctrl.{alias.name}"
            else:
                yield node.lineno, module


def identify(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


@pytest.mark.parametrize("path", SOURCES, ids=identify)
def test_imports_point_one_way(path: Path) -> None:
    here = part_of(path)
    if not here:
        return  # the package itself only names its exports
    wrong = []
    for line, module in imports(path):
        root, _, rest = module.partition(".")
        if root != "pmsm_ctrl" or not rest:
            continue
        there = rest.split(".")[0]
        if there in ("__version__", here) or (here, there) in SIBLINGS:
            continue
        if level(there) >= level(here):
            wrong.append(f"line {line}: {here} imports {there}")
        if here == "importers" and there not in ALLOWED_FOR_IMPORTERS:
            wrong.append(f"line {line}: an importer imports {there}; it may only read")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("path", SOURCES, ids=identify)
def test_libraries_stay_where_they_belong(path: Path) -> None:
    here = part_of(path)
    wrong = [
        f"line {line}: {module} is imported in {here}, but belongs in {ONLY_IN[module.split('.')[0]]}/ alone"
        for line, module in imports(path)
        if ONLY_IN.get(module.split(".")[0], here) != here
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("path", SOURCES, ids=identify)
def test_pyplot_is_not_used(path: Path) -> None:
    assert not [line for line, module in imports(path) if module.startswith("matplotlib.pyplot")]


@pytest.mark.parametrize("path", SOURCES, ids=identify)
def test_no_room_outgrows_its_size(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    grown = []
    if text.count("\n") > MAX_MODULE:
        grown.append(f"{text.count(chr(10))} lines; at most {MAX_MODULE}")
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            length = (node.end_lineno or node.lineno) - node.lineno + 1
            if ast.get_docstring(node) is not None:  # saying more about a function must not make it too long
                length -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
            if length > MAX_FUNCTION:
                grown.append(f"line {node.lineno}, {node.name}: {length} lines; at most {MAX_FUNCTION}")
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
