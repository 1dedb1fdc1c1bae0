"""`axis.c`, compiled on first use into a temporary folder and called through ctypes."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SOURCE = Path(__file__).with_name("axis.c")
FLAGS = ("-O3", "-std=c11", "-Wall", "-fPIC", "-shared")  # no fused operations: the same log on every machine
COLUMNS = (
    "theta", "omega", "measured angle", "speed estimate", "i_q", "i_q command", "ideal torque", "dry friction",
    "added torque", "acceleration", "i_d", "u_d", "u_q", "torque",
)  # fmt: skip


class RunawayError(ArithmeticError):
    """The loop of this drive is not stable."""


def gcc() -> str | None:
    """Return gcc's path, or None."""
    return shutil.which("gcc")


@cache
def library() -> tuple[Any, tuple[str, ...]]:
    """Compile the axis; return its `run` and the names of its parameters."""
    compiler = gcc()
    if compiler is None:
        raise RuntimeError("gcc not found: the fourth simulator cannot be compiled")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "axis.so"
        command = [compiler, *FLAGS, "-o", str(target), str(SOURCE), "-lm"]
        subprocess.run(command, check=True, capture_output=True, text=True)
        loaded = ctypes.CDLL(str(target))
    loaded.parameter_names.restype = ctypes.c_char_p
    loaded.run.argtypes = [ctypes.c_void_p, ctypes.c_long, *[ctypes.c_void_p] * 7]
    return loaded.run, tuple(loaded.parameter_names().decode().split())


def simulate(
    parameters: dict[str, float], reference: tuple[Array, Array, Array], noise: tuple[Array, Array, Array]
) -> dict[str, Array]:
    """Run the axis; return its columns at the rate of the speed controller.

    Parameters
    ----------
    parameters
        By the names in `axis.c`; what is left out is zero.
    reference
        Angle, speed and acceleration, (n,) each.
    noise
        Of the currents, (2, n) with i_q first; of the angle and of the load, (n,).

    Raises
    ------
    RunawayError
        The loop is not stable.
    """
    run, names = library()
    unknown = set(parameters) - set(names)
    assert not unknown, f"not in axis.c: {sorted(unknown)}"
    values = np.array([float(parameters.get(name, 0.0)) for name in names])
    samples = len(reference[0])
    arrays = [np.ascontiguousarray(a, dtype=float) for a in (*reference, *noise)]
    table = np.zeros((samples, len(COLUMNS)))
    if run(values.ctypes.data, samples, *[a.ctypes.data for a in (*arrays, table)]):
        raise RunawayError("the axis runs away")
    return dict(zip(COLUMNS, np.ascontiguousarray(table.T), strict=True))
