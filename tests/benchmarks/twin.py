"""The C twin of the drive: compiled here with gcc, called through ctypes with the package's own arrays."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.simulate import Controller, Plant, Scenario
from pmsm_ctrl.simulate.compose import BARE_STATES, load
from pmsm_ctrl.simulate.run import LOGGED

SOURCE = Path(__file__).with_name("drive.c")
FLAGS = ("-O3", "-march=native", "-ffp-contract=fast")
SIX = ("coulomb", "viscous", "stribeck", "quadratic_drag", "cogging", "unbalance")
PARAMETERS = 11  # of the six effects together


def gcc() -> str | None:
    """Return gcc's path, or None."""
    return shutil.which("gcc")


def compile_twin(folder: Path, *, six: bool, noise: bool = True, flags: tuple[str, ...] = FLAGS) -> Any:
    """Compile the twin into `folder` and return its `run`, ready to be called by ctypes."""
    compiler = gcc()
    if compiler is None:
        raise RuntimeError("gcc not found: the C twin cannot be compiled")
    library = folder / f"drive_{'six' if six else 'base'}_{'noise' if noise else 'quiet'}.so"
    defines = [name for name, wanted in (("-DSIX", six), ("-DNOISE", noise)) if wanted]
    generator = [str(Path(np.__file__).parent / "random" / "lib" / "libnpyrandom.a")] if noise else []
    command = [compiler, *flags, *defines, "-std=c11", "-Wall", "-fPIC", "-shared", "-o", str(library), str(SOURCE)]
    subprocess.run([*command, *generator, "-lm"], check=True, capture_output=True, text=True)
    run = ctypes.CDLL(str(library)).run
    array = ctypes.POINTER(ctypes.c_double)
    run.argtypes = [ctypes.c_int64, ctypes.c_int64, *[array] * 6, ctypes.c_int64, ctypes.c_void_p]
    run.restype = ctypes.c_int64
    return run


def with_six(design: Design) -> Design:
    """Return the design with the six effects of the benchmark, in the twin's order."""
    return (
        design.with_effect("stribeck", {"dF_s": 0.01, "w_s": 5.0, "delta": 2.0})
        .with_effect("quadratic_drag", {"k_2": 1e-7})
        .with_effect("cogging", {"a_s": 0.003, "a_c": 0.001, "order": 24.0})
        .with_effect("unbalance", {"a_s": 0.005, "a_c": 0.001})
    )


class Pair:
    """The same drive for both: the arrays of one run, and a call for either side."""

    def __init__(self, design: Design, motion: Scenario, ticks: int, twin: Any, seed: int = 0) -> None:
        bound = bound_effects(design)
        assert tuple(effect.id for effect, _ in bound) == SIX[: len(bound)]
        self.module = load([effect for effect, _ in bound])
        self.effects = tuple(value for _, values in bound for value in values.values())
        plant = Plant.of(design)
        self.plant, self.controller = plant.array(), Controller.of(design, motion.control).array()
        self.inputs = motion.inputs(np.arange(-(-ticks // plant.speed_divider)) * plant.period * plant.speed_divider)
        self.ticks, self.twin, self.seed = ticks, twin, seed
        self.out = np.zeros((-(-ticks // plant.log_divider), len(LOGGED)))
        self.flat = np.zeros(PARAMETERS)
        self.flat[: len(self.effects)] = self.effects

    def kernel(self) -> tuple[Any, Any]:
        """Run the package's kernel; return the logged rows and the final state."""
        states = np.zeros(BARE_STATES)
        noise = np.random.default_rng(self.seed)
        rows = self.module.run(
            self.ticks, 0, states, self.plant, self.controller, self.effects, self.inputs, self.out, noise
        )
        return self.out[:rows], states

    def c(self) -> tuple[Any, Any]:
        """Run the C twin; return the logged rows and the final state."""
        states = np.zeros(BARE_STATES)
        noise = np.random.default_rng(self.seed)  # kept: C sees only its address
        arrays = (states, self.plant, self.controller, self.flat, self.inputs, self.out)
        pointers = [a.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for a in arrays]
        rows = self.twin(self.ticks, 0, *pointers, self.out.shape[1], noise.bit_generator.ctypes.bit_generator)
        return self.out[:rows], states


def alternate(
    first: Callable[[], Any], second: Callable[[], Any], pairs: int, clock: Callable[[], float]
) -> tuple[list[float], list[float]]:
    """Time two calls in alternating pairs, the order swapped every time; return both lists of seconds."""
    times: tuple[list[float], list[float]] = ([], [])
    first()
    second()
    for n in range(pairs):
        order = ((0, first), (1, second)) if n % 2 == 0 else ((1, second), (0, first))
        for which, call in order:
            start = clock()
            call()
            times[which].append(clock() - start)
    return times


LANES = 16


def compile_lanes(folder: Path) -> Any:
    """Compile the C loop over `LANES` drives side by side: see lanes.c for what it leaves out."""
    library = folder / "lanes.so"
    flags = (*FLAGS, "-fno-math-errno", "-fno-trapping-math", f"-DLANES={LANES}")
    source = SOURCE.with_name("lanes.c")
    command = [str(gcc()), *flags, "-std=c11", "-Wall", "-fPIC", "-shared", "-o", str(library), str(source), "-lm"]
    subprocess.run(command, check=True, capture_output=True, text=True)
    run = ctypes.CDLL(str(library)).run_lanes
    run.argtypes, run.restype = [ctypes.c_int64, *[ctypes.POINTER(ctypes.c_double)] * 7], None
    return run


def run_lanes(run: Any, design: Design, ticks: int) -> None:
    """Run `LANES` drives for `ticks` control periods in C; the interpreter's lock is free meanwhile."""
    pointer = ctypes.POINTER(ctypes.c_double)
    friction = design.parameters("coulomb")["F_c"], design.parameters("viscous")["F_v"]
    per_drive = [np.full(LANES, value) for value in (design.J, *friction)]
    speed = 100.0 * np.sin(2.0 * np.pi * np.arange(ticks) * Plant.of(design).period)
    arrays = [np.zeros((13, LANES)), *per_drive, Plant.of(design).array(), Controller.of(design).array(), speed]
    run(ticks, *(array.ctypes.data_as(pointer) for array in arrays))
