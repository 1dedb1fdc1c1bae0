"""The part of the MAT reader that runs in a process of its own: scipy's C code crashes on some damaged files.

Started by `pmsm_ctrl.importers.isolated`; imports nothing of this package. Nothing in the file is executed.
"""

from __future__ import annotations

import contextlib
import json
import sys
import warnings
from typing import Any

import numpy as np

__all__ = ["flattened", "main"]

MAX_DEPTH = 4


def flattened(content: dict[str, Any], prefix: str = "", depth: int = 0) -> dict[str, np.ndarray | None]:
    """Return structs as dotted names, numeric arrays as float64, and None for what is no numeric array."""
    out: dict[str, np.ndarray | None] = {}
    for name, value in content.items():
        full = f"{prefix}{name}"
        # a sparse matrix is an object with its own class, and no channel
        array = np.asarray(value) if isinstance(value, np.ndarray | np.generic | float | int) else np.empty(0, object)
        if array.dtype.names and array.size == 1 and depth < MAX_DEPTH:
            record = array.reshape(-1)[0]
            out |= flattened({field: record[field] for field in array.dtype.names}, f"{full}.", depth + 1)
        elif array.dtype.kind in "fiub" and array.dtype.names is None:
            out[full] = np.ascontiguousarray(array, dtype=np.float64)
        else:
            out[full] = None
    return out


def main(arguments: list[str]) -> int:
    """Answer with the name and shape of every variable, then the values of the numeric ones."""
    warnings.simplefilter("ignore")
    _bound_memory()
    output = sys.stdout.buffer
    values: list[np.ndarray] = []
    try:
        import scipy.io

        content = scipy.io.loadmat(arguments[0], struct_as_record=True, squeeze_me=False)
        flat = flattened({name: value for name, value in content.items() if not name.startswith("__")})
        answer: dict[str, Any] = {"variables": [[n, None if v is None else list(v.shape)] for n, v in flat.items()]}
        values = [value for value in flat.values() if value is not None]
    except Exception as error:  # scipy raises whatever the damaged bytes lead to
        answer = {"error": str(error).strip() or type(error).__name__}
    output.write(json.dumps(answer).encode() + b"\n")
    for array in values:
        output.write(array.tobytes())
    output.flush()
    return 0


def _bound_memory() -> None:
    """A damaged file may ask for any amount; the machine must not swap itself to death for it."""
    try:
        import os
        import resource
    except ImportError:  # Windows
        return
    limit = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
