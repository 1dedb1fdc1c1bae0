"""What a docstring has to say: numpydoc's validation, and a look at each `raise`.

The public interface is what a room exports (its ``__init__``) and what stands in the modules beside the rooms. Every
parameter, return, field and raised error of it is documented. Inside a room a short docstring may do, but a list of
parameters that is there is complete, and every error that is raised on purpose is named.
"""

from __future__ import annotations

import ast
import builtins
import dataclasses
import importlib
import inspect
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.sources import nodes_of

numpydoc = pytest.importorskip("numpydoc.validate", reason="NUMPYDOC ABSENT: pip install 'pmsm-ctrl[dev]'")

PACKAGE = Path(__file__).resolve().parents[2] / "pmsm_ctrl"
# Commands document their parameters by the help text of each option; pytest's hooks have pytest's own signatures;
# the worker and the entry point are scripts.
EXEMPT = {"cli", "init", "acceptance", "__main__", "importers/worker"}
MODULES = [
    name
    for path in sorted(PACKAGE.rglob("*.py"))
    if (name := path.relative_to(PACKAGE).with_suffix("").as_posix()) not in EXEMPT
]


def exported() -> set[int]:
    """Identify the objects of the public interface."""
    rooms = [name.removesuffix("/__init__") for name in MODULES if name.endswith("/__init__") and name.count("/") == 1]
    beside = [name for name in MODULES if "/" not in name and name not in ("console", "options")]
    found = set()
    for name in rooms + beside:
        module = importlib.import_module("pmsm_ctrl." + name.replace("/", "."))
        names = getattr(module, "__all__", [])
        found |= {id(getattr(vars(module)[n], "py_func", vars(module)[n])) for n in names if n in vars(module)}
    return found


def defined(module: Any) -> Iterator[tuple[str, Any]]:
    """Yield name and object of the functions, classes and methods without underscore that a module defines."""
    for name, held in vars(module).items():
        found = getattr(held, "py_func", held)  # of a compiled function its Python source
        if name.startswith("_") or getattr(found, "__module__", None) != module.__name__:
            continue
        if inspect.isfunction(found) or inspect.isclass(found):
            yield name, found
        if inspect.isclass(found):
            for method, inner in vars(found).items():
                plain = inner.__func__ if isinstance(inner, classmethod | staticmethod) else inner
                if inspect.isfunction(plain) and not method.startswith(("_", "model_")):  # pydantic's hooks
                    yield f"{name}.{method}", plain


def faults_of_class(found: Any, public: bool) -> Iterator[str]:
    """Yield the fields of a dataclass that its docstring leaves out."""
    document = numpydoc.Validator(numpydoc.get_doc_object(found))
    rows = [*document.doc["Parameters"], *document.doc["Attributes"]]
    if not found.__doc__ or not dataclasses.is_dataclass(found) or not (public or rows):
        return
    said = {name.strip() for row in rows for name in row.name.split(",")}
    fields = (f.name for f in dataclasses.fields(found) if f.name in vars(found).get("__annotations__", {}))
    missing = [name for name in fields if name not in said and not name.startswith("_")]
    if missing:
        yield f"fields not documented: {', '.join(missing)}"


def faults_of_function(found: Any, public: bool) -> Iterator[str]:
    """Yield what numpydoc and the source find missing in the docstring of a function."""
    document = numpydoc.Validator(numpydoc.get_doc_object(found))
    if not document.raw_doc:
        yield "no docstring"
        return
    if public or document.doc["Parameters"]:
        yield from (text for _, text in document.parameter_mismatches)
    # A summary that begins with what is returned documents it.
    told = document.returns or document.yields or document.summary.split(" ")[0] in ("Return", "Yield", "Whether")
    if public and (document.method_returns_something or document.is_generator_function) and not told:
        yield "what is returned is not documented"
    said = " ".join(row.type or row.name for row in document.doc["Raises"])
    missing = sorted(name for name in raised_by(found) if name not in said)
    if missing:
        yield f"raised errors not documented: {', '.join(missing)}"


@cache
def functions_of(path: Path) -> dict[int, ast.AST]:
    """Return the functions of a file by their first line, which is that of the first decorator."""
    found = (node for node in nodes_of(path) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda))
    return {min([node.lineno, *(one.lineno for one in getattr(node, "decorator_list", []))]): node for node in found}


def raised_by(function: Any) -> set[str]:
    """Return the names of the errors that a function raises itself, by ``raise Name(...)``."""
    code = inspect.unwrap(function).__code__
    nodes = tuple(ast.walk(functions_of(Path(code.co_filename))[code.co_firstlineno]))
    raised = (node.exc for node in nodes if isinstance(node, ast.Raise) and node.exc is not None)
    called = (node.func if isinstance(node, ast.Call) else node for node in raised)
    names = {node.id for node in called if isinstance(node, ast.Name) and node.id[0].isupper()}
    # what a function catches itself, such as a ValueError to leave a block, does not leave it
    handlers = (node.type for node in nodes if isinstance(node, ast.ExceptHandler))
    caught = {part.id for kind in handlers if kind for part in ast.walk(kind) if isinstance(part, ast.Name)}
    return {name for name in names if name.endswith("Error") and (name not in caught or name not in dir(builtins))}


def faults(name: str) -> list[str]:
    """Return the faults of every docstring of a module."""
    module = importlib.import_module("pmsm_ctrl." + name.removesuffix("/__init__").replace("/", "."))
    found = []
    for spoken, held in defined(module):
        public = id(getattr(module, spoken.split(".")[0])) in PUBLIC
        look = faults_of_class if inspect.isclass(held) else faults_of_function
        found += [f"{spoken}: {text}" for text in look(held, public)]
    return found


PUBLIC = exported()


@pytest.mark.parametrize("room", sorted({name.partition("/")[0] if "/" in name else "beside" for name in MODULES}))
def test_docstrings_are_complete(room: str) -> None:
    """Of the modules of a room, or of those that stand beside the rooms."""
    held = [name for name in MODULES if (name.startswith(f"{room}/") if room != "beside" else "/" not in name)]
    assert held
    found = [f"{name}.py: {text}" for name in held for text in faults(name)]
    assert not found, "\n".join(found)
