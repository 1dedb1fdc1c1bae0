"""numba's cache on disk, made to survive damage: what cannot be read is said once and compiled anew.

numba reads its files without checking them. Measured with numba 0.68 on two small cached functions: an index or data
file that is empty, cut short or zeroed ends every command with an EOFError or an UnpicklingError (16 of 16); one
flipped bit in a data file ends 8 of 40 runs, two of them with a crash of the interpreter that no handler can catch.
Hence the SHA-256 of its content in every file.

The folder is keyed on the content of all sources. Where they are installed is of no matter: a second environment finds
what the first one compiled.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
import warnings
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

from pmsm_ctrl.errors import CacheWarning

__all__ = ["SoundCache", "compiled_sources", "source_hash"]

_DIGEST = hashlib.sha256().digest_size
_PACKAGE = Path(__file__).resolve().parent.parent
_InFolder = CompileResultCacheImpl._locator_classes[0]  # numba's for a folder that is named; its name changed


# What compiles; a test holds it against every use of numba in the package.
_COMPILES = re.compile(rb"@(?:kernel|inlined|uncontracted)\b|\bnjit\(")
_SIGNS = (b"@kernel", b"@inlined", b"@uncontracted", b"njit(")  # found ten times as fast, at the start of every command


def compiled_sources() -> list[Path]:
    """Return the package's source files that hold compiled code, and the room of the kernels with its templates."""
    here = Path(__file__).resolve().parent
    files = sorted(here.parent.rglob("*.py"))
    return [path for path in files if path.parent == here or _compiles(path.read_bytes())]


def _compiles(text: bytes) -> bool:
    return any(sign in text for sign in _SIGNS) and _COMPILES.search(text) is not None


@lru_cache  # of what this process has loaded
def source_hash() -> str:
    """Return a hash over every source file with compiled code, and numba's version.

    The options of the compiler stand in `pmsm_ctrl.kernels`, which is one of them.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).resolve().parent.parent
    for path in compiled_sources():
        digest.update(path.relative_to(root).as_posix().encode() + b"\0")
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:16]


class _Located(_InFolder):  # type: ignore[valid-type, misc]
    """Where the compiled code of a file lies: by its room in the package, not by the place of the installation."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Return the folder inside the cache."""
        room = _room(py_file)
        return str(super().get_suitable_cache_subpath(py_file)) if room is None else room

    def get_source_stamp(self) -> Any:
        """Return what changes with the source: of one file of the package, all that it may call lies in the others."""
        return super().get_source_stamp() if _room(self._py_file) is None else source_hash()


@lru_cache
def _room(file: str) -> str | None:
    """Name of the folder in the package that holds a file, None for one outside."""
    folder = Path(file).resolve().parent
    if not folder.is_relative_to(_PACKAGE):
        return None
    return "-".join((_PACKAGE.name, *folder.relative_to(_PACKAGE).parts))


class _Kept(CompileResultCacheImpl):
    _locator_classes = [_Located, *CompileResultCacheImpl._locator_classes[1:]]


class _CheckedFile(IndexDataCacheFile):
    """Data files that begin with the digest of the rest."""

    def _save_data(self, name: str, data: Any) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as stream:
            stream.write(hashlib.sha256(content).digest() + content)

    def _load_data(self, name: str) -> Any:
        with open(self._data_path(name), "rb") as stream:
            digest, content = stream.read(_DIGEST), stream.read()
        if hashlib.sha256(content).digest() != digest:
            raise ValueError(f"{name}: its content is not what was written")
        return pickle.loads(content)  # written by this package into its own folder


class SoundCache(FunctionCache):
    """The cache of one function; damage and a disk that cannot be written cost time, never the answer."""

    _impl_class = _Kept

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        checked = _CheckedFile.__new__(_CheckedFile)
        checked.__dict__.update(self._cache_file.__dict__)
        self._cache_file = checked

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function for these types, None where it must be compiled."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # damaged bytes raise whatever they lead to
            self._warn("is damaged: what cannot be read is compiled anew")
            try:
                self.flush()
            except OSError:
                self.disable()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the compiled function; a disk that is full or read-only is no reason to stop."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            self._warn(f"cannot be written ({error.strerror}): every start compiles anew")

    def _warn(self, what: str) -> None:
        folder = os.path.dirname(self._cache_path)
        _say(f"the cache of compiled kernels in {folder} {what}")


@lru_cache
def _say(message: str) -> None:
    """Warn once in a process: where one file is damaged, a hundred may be."""
    warnings.warn(message, CacheWarning, stacklevel=4)
