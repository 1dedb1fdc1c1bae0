"""The readers that have a process of their own, in this one: for files that are known to be good."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

__all__ = ["ask_here"]


def ask_here(kind: str, path: Path, file: str, words: Sequence[str] = ()) -> tuple[dict[str, Any], bytes]:
    """Return what `pmsm_ctrl.importers.isolated.ask` does; an error of the reader is not turned into a message."""
    from pmsm_ctrl.importers import worker

    answer, values = worker.READERS[kind.lower()](str(path.absolute()), words)
    return json.loads(json.dumps(answer)), b"".join(array.tobytes() for array in values)
