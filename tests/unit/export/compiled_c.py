"""The exported compensator, compiled by gcc with warnings as errors, and the drive with it in its loop."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.export import export
from pmsm_ctrl.export.blocks import identifier
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import Scenario
from pmsm_ctrl.simulate.compose import load
from pmsm_ctrl.simulate.run import LOGGED, prepare

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-fPIC")


class Compensator:
    """The C function of a design; call it with omega, theta, i_d, i_q and what the tracker says."""

    def __init__(self, design: Design, folder: Path, *flags: str) -> None:
        if shutil.which("gcc") is None:
            pytest.skip("gcc not found: the exported C cannot be compiled")
        source, library = folder / "axis.c", folder / "axis.so"
        source.write_text(export(design, "c", force=True), encoding="utf-8")
        # linked by itself: with -ffast-math the linker adds code that turns off subnormal numbers in the whole process
        compiled = folder / "axis.o"
        subprocess.run(["gcc", *FLAGS, *flags, "-c", str(source), "-o", str(compiled)], check=True)
        subprocess.run(["gcc", "-shared", str(compiled), "-o", str(library), "-lm"], check=True)
        held = source.read_text(encoding="utf-8").count("held[") > 0
        turns = "double swing;" in source.read_text(encoding="utf-8")
        observer = design.compensation.source == "observer"
        tracked = sum(name in design.compensation.effects for name in ("coulomb", "viscous")) if held else 0
        inputs = 2 if observer else 4 + 2 * tracked

        class Memory(ctypes.Structure):
            _fields_ = (
                *([("held", ctypes.c_double * (1 if observer else tracked))] if held else []),
                *([("swing", ctypes.c_double)] if turns else []),
                ("i_q_add", ctypes.c_double),
                ("fault", ctypes.c_int),
            )

        name, found = f"{identifier(design.name)}_compensation", ctypes.CDLL(str(library))
        self.memory = Memory()
        self._update = getattr(found, f"{name}_update")
        self._update.argtypes = [ctypes.c_void_p] + [ctypes.c_double] * inputs + [ctypes.c_int]
        self._update.restype = None
        begin = getattr(found, f"{name}_init")
        begin.argtypes, begin.restype = [ctypes.c_void_p], None
        begin(ctypes.byref(self.memory))

    def __call__(self, *inputs: float, enable: bool = True) -> float:
        self._update(ctypes.byref(self.memory), *inputs, int(enable))
        return float(self.memory.i_q_add)

    @property
    def fault(self) -> bool:
        return bool(self.memory.fault)


def simulate_with(compensator: Compensator, design: Design, motion: Scenario, truth: Design, seed: int = 0) -> Log:
    """Simulate a drive in position control whose compensation is the compiled C, called once per speed period.

    The kernel runs one speed period at a time without a compensation; what the C asks for is added to the current's
    reference. The signals that the C reads are those of the speed controller at this tick.
    """
    off = design.model_copy(update={"compensation": design.compensation.model_copy(update={"gain": 0.0})})
    drive = prepare(off, motion, truth=truth)
    plant, controller = drive.plant, drive.controller
    assert motion.control == "position"
    module, states, noise = load(drive.active), drive.states(), np.random.default_rng(seed)
    divider, turn = plant.speed_divider, 2.0 * math.pi
    out = np.empty((-(-drive.total // plant.log_divider), len(LOGGED)))
    inputs = motion.inputs(np.arange(-(-drive.total // divider)) * plant.period * divider)
    gains, numbers, row = controller.array(), plant.array(), 0
    source = design.compensation.source
    for tick in range(len(inputs)):
        theta = states[3]
        if plant.counts:
            theta = math.floor(states[3] * plant.counts / turn + 0.5) * turn / plant.counts
        reference = inputs[tick : tick + 1]
        omega_hat = states[8] + controller.speed_filter * ((theta - states[7]) / (plant.period * divider) - states[8])
        filtered = states[14] + controller.reference_filter * (
            controller.velocity_feedforward * reference[0, 1] - states[14]
        )
        commanded = filtered + controller.position_gain * (reference[0, 0] - theta)
        wanted = controller.speed_gain * (commanded - omega_hat) + states[6]
        wanted += controller.acceleration_feedforward * reference[0, 2] + reference[0, 3]
        if source == "observer":
            reference[0, 3] += compensator(omega_hat, states[9])
        else:
            omega = {"reference": reference[0, 1], "commanded": commanded, "measured": omega_hat}[source]
            reference[0, 3] += compensator(omega, theta, reference[0, 4], wanted)
        first, n = tick * divider, min(divider, drive.total - tick * divider)
        row += module.run(n, first, states, numbers, gains, drive.effects, reference, out[row:], noise)
    return drive.log(out[:row], seed, True)
