"""Compiled code: floats and arrays in SI, no objects, no I/O.

`kernel` is the only way to compile here. numba's options are not part of its cache key and a callee takes
over `fastmath` and `error_model` from whoever compiles it first, so one dictionary serves everywhere.
numba's disk cache does not notice a change in another file either: the cache folder is keyed on a hash of
every source file that holds compiled code, so that a changed effect can never meet a stale kernel.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import event as events

from pmsm_ctrl.kernels.cache import SoundCache, compiled_sources, source_hash

__all__ = [
    "OPTIONS",
    "cache_folder",
    "compiled_sources",
    "inlined",
    "kernel",
    "soundly_cached",
    "source_hash",
    "uncontracted",
]

# Contraction only: it gives the fused multiply-add (1.6 x) and keeps NaN, infinity and signed zero exact.
OPTIONS: dict[str, Any] = {
    "fastmath": {"contract"},
    "error_model": "numpy",
    "nogil": True,
    "cache": True,
    "no_cfunc_wrapper": True,
}
_INLINED = {**OPTIONS, "forceinline": True, "no_cpython_wrapper": True}


def cache_folder() -> Path:
    """Return the folder that holds compiled kernels of exactly these sources.

    ``PMSM_CTRL_CACHE`` names another place than ``~/.cache/pmsm_ctrl``.
    """
    base = os.environ.get("PMSM_CTRL_CACHE")
    root = Path(base) if base else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pmsm_ctrl"
    return root / source_hash()


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = str(cache_folder())  # type: ignore[attr-defined]


class _NoCollection(events.Listener):
    """Holds the garbage collector while numba compiles: it takes a tenth of that time, and finds nothing."""

    def __init__(self) -> None:
        self._depth, self._was_on = 0, False

    def on_start(self, event: events.Event) -> None:
        if self._depth == 0:
            self._was_on = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: events.Event) -> None:
        self._depth -= 1
        if self._depth == 0 and self._was_on:
            gc.enable()


events.register("numba:compile", _NoCollection())  # type: ignore[no-untyped-call]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a scalar or array function with the options that every kernel shares.

    A user's own term is compiled anew in every process: numba's cache would not notice a change in another file that
    it imports.

    Parameters
    ----------
    function : function

    Returns
    -------
    numba dispatcher
    """
    return soundly_cached(numba.njit(**{**OPTIONS, "cache": _in_package(function)})(function))


def uncontracted(function: Callable[..., Any]) -> Any:
    """Compile without fused multiply-add: the same bits as a library in C that was built for every processor.

    For filters that stand in the place of scipy's, and cost the same without.

    Parameters
    ----------
    function : function

    Returns
    -------
    numba dispatcher
    """
    options = {**OPTIONS, "fastmath": False, "cache": _in_package(function)}
    return soundly_cached(numba.njit(**options)(function))


def inlined(function: Callable[..., Any]) -> Any:
    """Compile a piece that kernels alone call, and have it inlined there.

    Left alone, LLVM calls the larger pieces, and everything constant in the loop around is worked out again at
    every step (1.2 x). Without wrappers for Python they compile faster.

    Parameters
    ----------
    function : function

    Returns
    -------
    numba dispatcher
    """
    return soundly_cached(numba.njit(**{**_INLINED, "cache": _in_package(function)})(function))


def soundly_cached(dispatcher: Any) -> Any:
    """Give a compiled function that numba would cache a cache that survives damage.

    Parameters
    ----------
    dispatcher : numba dispatcher

    Returns
    -------
    numba dispatcher
        The same one.
    """
    if _in_package(dispatcher.py_func):
        dispatcher._cache = SoundCache(dispatcher.py_func)
    return dispatcher


def _in_package(function: Callable[..., Any]) -> bool:
    """Whether the cache's folder is keyed on a function: one of this package's files, or one generated there."""
    file = Path(function.__code__.co_filename).resolve()
    roots = Path(__file__).resolve().parent.parent, cache_folder().resolve()
    return file.is_file() and any(file.is_relative_to(root) for root in roots)
