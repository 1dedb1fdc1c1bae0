"""numba compiles the same, faster: a fifth of its calls work out again what does not change.

Nothing of it is part of the package: a user compiles a kernel now and then, a cold run of the tests a hundred of them.
`tests/unit/test_faster_compiling.py` holds each function against numba's own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakSet

import pytest
from numba.core import event as events
from numba.core.cpu import CPUContext
from numba.core.targetconfig import TargetConfig

__all__ = ["equal", "hashed", "install", "once", "untold", "values"]

_DEFAULTS: dict[type, dict[str, Any]] = {}
_HASHES: dict[type, int] = {}


def values(config: TargetConfig) -> dict[str, Any]:
    """Return all options of a compilation; numba asks for every one of them by its name."""
    kind = type(config)
    if kind not in _DEFAULTS:
        _DEFAULTS[kind] = {name: option.default for name, option in kind.options.items()}
    return {**_DEFAULTS[kind], **config._values}


def equal(config: TargetConfig, other: object) -> Any:
    """Compare two sets of options: those that were set, and all of them only where these differ."""
    if not isinstance(other, TargetConfig):
        return NotImplemented
    return (type(config) is type(other) and config._values == other._values) or values(config) == values(other)


def hashed(config: TargetConfig) -> int:
    """Return the hash of a set of options: numba takes that of their names alone, which are the same for all."""
    kind = type(config)
    if kind not in _HASHES:
        _HASHES[kind] = hash(tuple(sorted(kind.options)))
    return _HASHES[kind]


def once(load: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return a method that loads at the first call on each object alone: numba calls it for every function."""
    done: WeakSet[Any] = WeakSet()

    def method(self: Any) -> None:
        if self not in done:
            load(self)
            done.add(self)

    return method


def untold(tell: Callable[..., None], kind: str) -> Callable[..., None]:
    """Return what tells events, without those of a kind."""

    def function(event: str, *details: Any, **more: Any) -> None:
        if event != kind:
            tell(event, *details, **more)

    return function


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace functions of numba by the same ones, faster.

    Nobody reads how long LLVM's lock was held: each of thousands of calls tells it to a clock of every function that
    waits for this one to be compiled.
    """
    for name, function in {"values": values, "__eq__": equal, "__hash__": hashed}.items():
        monkeypatch.setattr(TargetConfig, name, function)
    monkeypatch.setattr(CPUContext, "load_additional_registries", once(CPUContext.load_additional_registries))
    for name in ("start_event", "end_event"):
        monkeypatch.setattr(events, name, untold(getattr(events, name), "numba:llvm_lock"))
