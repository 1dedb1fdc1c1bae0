"""How much memory the arrays of kept results take."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import is_dataclass
from typing import Any

import numpy as np

__all__ = ["array_bytes"]

DEEPEST = 40  # objects in objects
PLAIN = (str, bytes, int, float, complex, bool, type(None), type, np.generic)


def array_bytes(values: Iterable[Any]) -> int:
    """Return the bytes of all NumPy arrays that these objects hold; an array that several hold counts once.

    Parameters
    ----------
    values : iterable of object
        Dataclasses and other objects of this package, mappings, sequences and arrays, nested.

    Returns
    -------
    int
    """
    seen: dict[int, Any] = {}  # holds what was seen, so that no address is used again
    total = 0
    waiting = [(value, 0) for value in values]
    while waiting:
        value, depth = waiting.pop()
        if isinstance(value, PLAIN) or id(value) in seen or depth > DEEPEST:
            continue
        seen[id(value)] = value
        if isinstance(value, np.ndarray):
            if isinstance(value.base, np.ndarray):
                waiting.append((value.base, depth))  # a view holds the whole array
            else:
                total += value.nbytes
                if value.dtype.hasobject:
                    waiting += [(one, depth + 1) for one in value.flat]
        elif isinstance(value, Mapping):
            waiting += [(one, depth + 1) for one in value.values()]
        elif isinstance(value, list | tuple | set | frozenset):
            waiting += [(one, depth + 1) for one in value]
        elif is_dataclass(value) or type(value).__module__.startswith("pmsm_ctrl"):  # not functions and modules
            waiting += [(one, depth + 1) for one in getattr(value, "__dict__", {}).values()]
            names = [name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ())]
            waiting += [(getattr(value, name), depth + 1) for name in names if hasattr(value, name)]
    return total
