"""Readers that run in a separate process, because C code in their libraries crashes on some damaged files.

The worker answers on standard output with one line of JSON, followed by float64 values.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers.table import one_line

__all__ = ["ask"]

PATIENCE = 600.0  # s; a damaged file may put a reader into an endless loop


def ask(kind: str, path: Path, file: str, words: Sequence[str] = ()) -> tuple[dict[str, Any], bytes]:
    """Read a file of this kind ("MAT", "MDF" or "ROS 2") in the worker; return its answer and the bytes of the values.

    Raises
    ------
    LogError
        When the worker reports an error, crashes, or does not finish.
    """
    script = Path(__file__).with_name("worker.py")
    # -P: modules in the folder of the script must not shadow the standard library
    command = [sys.executable, "-P", str(script), kind.lower(), str(path.absolute()), *words]
    try:
        run = subprocess.run(command, capture_output=True, timeout=PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        raise LogError(f"{file}: damaged {kind} file (not read after {PATIENCE:g} s)") from None
    except OSError as error:
        raise LogError(f"{file}: the {kind} reader cannot be started ({error.strerror})") from None
    line, _, values = run.stdout.partition(b"\n")
    try:
        answer: dict[str, Any] = json.loads(line)
    except ValueError:
        answer = {}
    if run.returncode or not answer:
        raise LogError(f"{file}: damaged {kind} file (its reader crashed)")
    if "error" in answer:
        raise LogError(f"{file}: damaged or unsupported {kind} file ({one_line(answer['error'][:120])})")
    return answer, values
