"""What a compiled term hangs on: its own file, and whatever it calls or reads of other files."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

__all__ = ["fingerprint"]

_PACKAGE = __name__.partition(".")[0]
# Their functions change with their release alone; the package's own are in the hash of its sources.
_KNOWN = {*sys.stdlib_module_names, "numpy", "numba", "llvmlite", "scipy", _PACKAGE}
_CONSTANTS = (bool, int, float, complex, str, bytes, tuple, np.generic)


def fingerprint(term: Callable[..., Any]) -> bytes:
    """Return a digest that changes when a term, a helper it calls or a constant it reads does, in whichever file.

    Parameters
    ----------
    term : function
        Compiled or plain.

    Returns
    -------
    bytes
    """
    digest = hashlib.sha256()
    for part in _parts(term, set()):
        digest.update(hashlib.sha256(part).digest())
    return digest.digest()


def _parts(function: Any, seen: set[CodeType]) -> Iterator[bytes]:
    function = getattr(function, "py_func", function)
    code = function.__code__
    if code in seen:
        return
    seen.add(code)
    file = Path(code.co_filename)
    yield file.read_bytes() if file.is_file() else code.co_code + repr(code.co_consts).encode()
    names = set(_names(code))
    found = {name: function.__globals__[name] for name in names if name in function.__globals__}
    found |= {name: cell.cell_contents for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True)}
    for name, value in sorted(found.items()):
        yield from _of(name, value, names, seen)


def _of(name: str, value: Any, names: set[str], seen: set[CodeType]) -> Iterator[bytes]:
    """Yield what a name stands for; of a module, what the code reads of it."""
    if isinstance(value, _CONSTANTS):
        yield f"{name} = {value!r}".encode()
    elif isinstance(value, np.ndarray):
        yield f"{name} = {value.dtype} {value.shape}".encode() + value.tobytes()
    elif isinstance(value, ModuleType):
        if value.__name__.partition(".")[0] not in _KNOWN:
            for inner in sorted(names & set(vars(value))):
                yield from _of(f"{name}.{inner}", getattr(value, inner), names, seen)
    elif hasattr(getattr(value, "py_func", value), "__code__") and _root(value) not in _KNOWN:
        yield from _parts(value, seen)


def _root(value: Any) -> str:
    return (getattr(value, "__module__", None) or "").partition(".")[0]


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)
