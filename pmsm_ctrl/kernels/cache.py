"""numba's cache on disk, made to survive damage: what cannot be read is said once and compiled anew.

numba reads its files without checking them. Measured with numba 0.68 on two small cached functions: an index or data
file that is empty, cut short or zeroed ends every command with an EOFError or an UnpicklingError (16 of 16); one
flipped bit in a data file ends 8 of 40 runs, two of them with a crash of the interpreter that no handler can catch.
Hence the SHA-256 of its content in every file.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import warnings
from collections.abc import Callable
from functools import lru_cache
from typing import Any

from numba.core.caching import FunctionCache, IndexDataCacheFile

from pmsm_ctrl.errors import CacheWarning

__all__ = ["SoundCache"]

_DIGEST = hashlib.sha256().digest_size


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
