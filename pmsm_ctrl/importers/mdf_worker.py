"""The part of the MDF reader that runs in a process of its own: asammdf's C code crashes on some damaged files.

Started by `pmsm_ctrl.importers.isolated`; imports nothing of this package.
"""

from __future__ import annotations

import contextlib
import json
import logging
import sys
import warnings
from typing import Any

import numpy as np

__all__ = ["main"]


def main(arguments: list[str]) -> int:
    """Answer ``PATH`` with the columns, ``PATH G:I ...`` with the values of channel I of group G."""
    warnings.simplefilter("ignore")
    _bound_memory()
    logging.disable(logging.CRITICAL)
    output = sys.stdout.buffer
    values: list[np.ndarray] = []
    try:
        from asammdf import MDF

        with open(arguments[0], "rb") as stream:
            content = MDF(stream)
            if len(arguments) == 1:
                answer = _columns(content)
            else:
                values = [_values(content, *map(int, place.split(":"))) for place in arguments[1:]]
                answer = {"sizes": [int(array.size) for array in values]}
            content.close()
    except Exception as error:  # the library raises whatever the damaged bytes lead to
        answer, values = {"error": str(error).strip() or type(error).__name__}, []
    output.write(json.dumps(answer).encode() + b"\n")
    for array in values:
        output.write(array.tobytes())
    output.flush()
    return 0


def _columns(content: Any) -> dict[str, Any]:
    columns, left = [], []
    for number, group in enumerate(content.groups):
        master = content.masters_db.get(number)
        if master is None:
            continue
        for index, channel in enumerate(group.channels):
            # data types 0 to 5 are integers and floats of either byte order; the rest are text, bytes and dates
            if index != master and int(channel.data_type) > 5:
                left.append(str(channel.name))
                continue
            unit = "s" if index == master else str(content.get_channel_unit(group=number, index=index) or "")
            columns.append([str(channel.name), unit, number, index, index == master])
    return {"version": str(content.version), "columns": columns, "left": left}


def _values(content: Any, group: int, index: int) -> np.ndarray:
    if content.masters_db.get(group) == index:
        return np.asarray(content.get_master(group), dtype=np.float64)
    samples = content.get(group=group, index=index).samples
    if samples.ndim != 1 or samples.dtype.kind not in "fiub":
        raise ValueError(f"channel '{content.groups[group].channels[index].name}' holds no single numbers")
    return np.asarray(samples, dtype=np.float64)


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
