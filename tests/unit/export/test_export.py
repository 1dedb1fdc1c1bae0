"""The exported compensator: the C compiles without a warning and agrees with the simulation; ST says the same."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export import cogging_table, export, friction_table
from pmsm_ctrl.simulate import scenario, simulate

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-O2", "-shared", "-fPIC")


@pytest.fixture
def design(designs: Path) -> Design:
    full = (
        Design.read(designs / "seed_motor.toml")
        .with_effect("stribeck", {"dF_s": 0.01, "w_s": 5.0, "delta": 1.5})
        .with_effect("viscous_asymmetry", {"dF_v": -2e-5})
        .with_effect("constant_load", {"T_0": -0.003})
        .with_effect("quadratic_drag", {"k_2": 1e-7})
        .with_effect("load_dependent_friction", {"mu": 0.03})
        .with_effect("position_dependent_friction", {"b_s": 0.002, "b_c": -0.001})
        .with_effect("cogging", {"a_s": 0.004, "a_c": -0.002, "order": 24.0})
    )
    return full.replace(compensation={"gain": 0.8, "effects": tuple(e.id for e in full.effects)})


def compiled(design: Design, folder: Path):  # type: ignore[no-untyped-def]
    """Compile the exported C with warnings as errors and return the function."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc not found: the exported C cannot be compiled")
    source, library = folder / "axis.c", folder / "axis.so"
    source.write_text(export(design, "c"), encoding="utf-8")
    subprocess.run(["gcc", *FLAGS, str(source), "-o", str(library), "-lm"], check=True)
    function = ctypes.CDLL(str(library)).seed_motor_compensation
    function.argtypes, function.restype = [ctypes.c_double] * 4, ctypes.c_double
    return function


@pytest.mark.parametrize("smoothing", [0.0, 0.5])
def test_c_agrees_with_the_terms_over_a_scenario(design: Design, tmp_path: Path, smoothing: float) -> None:
    changed = design.replace(compensation={"smoothing": smoothing})
    function = compiled(changed, tmp_path)
    log = simulate(design, scenario("reversal", design, speed=5.0, cycles=1.0), seed=1)
    omega, theta, i_q = log["omega_ref"], log["theta"], log["i_q_ref"]
    direction = np.sign(omega) if smoothing == 0.0 else np.clip(omega / smoothing, -1.0, 1.0)
    signals = {"omega": omega, "theta": theta, "direction": direction, "torque": design.K_t * i_q, "i_q": i_q,
               "i_d": np.zeros_like(i_q), "p": 4.0}  # fmt: skip
    torque = sum(column(effect, signals, values) for effect, values in bound_effects(design))
    found = np.array([function(w, a, 0.0, i) for w, a, i in zip(omega, theta, i_q, strict=True)])
    assert np.allclose(found, 0.8 * torque / design.K_t, rtol=1e-6, atol=1e-12)
    assert np.ptp(found) > 0.05


def test_structured_text_is_the_same_tree(design: Design) -> None:
    """Turning the ST's names and signs back into C gives the exported C, term by term."""
    c = re.findall(r"torque_out \+= (.*); /\*", export(design, "c"))
    st = re.findall(r"torque_out \+ (.*); \(\*", export(design, "st"))
    assert len(c) == len(st) == len(design.effects)
    back = {"EXPT": "pow", "EXP": "exp", "SIN": "sin", "COS": "cos", "ABS": "fabs", "SQRT": "sqrt"}
    for one, other in zip(c, st, strict=True):
        assert re.sub(r"[A-Z]{3,}", lambda m: back.get(m.group(), m.group()), other) == one
    text = export(design, "st")
    for opening in ("VAR_INPUT", "VAR_OUTPUT", "VAR CONSTANT", "FUNCTION_BLOCK FB_seed_motor_compensation"):
        assert opening in text
    assert text.count("END_VAR") == 4


def test_gains_are_in_both(design: Design) -> None:
    assert "#define SEED_MOTOR_SPEED_KP 0.0274" in export(design, "c")
    assert "SPEED_KP : LREAL := 0.0274;" in export(design, "st")


def test_tables_are_what_drives_accept(design: Design) -> None:
    table = friction_table(design, [-100.0, -1.0, 1.0, 100.0])
    at_hundred = 0.0213 + 0.0168 - 0.002 - 0.003 + 1e-3 + 0.01 * np.exp(-(20.0**1.5))
    assert table[-1, 1] == pytest.approx(at_hundred, rel=1e-12)
    ((order, amplitude, phase),) = cogging_table(design)
    x = np.linspace(0.0, 1.0, 50)
    assert np.allclose(amplitude * np.sin(order * x + phase), 0.004 * np.sin(24 * x) - 0.002 * np.cos(24 * x))


def test_bad_requests_are_told(design: Design) -> None:
    with pytest.raises(RequestError, match="accepted: c, st"):
        export(design, "fortran")
    with pytest.raises(RequestError, match="identify friction first"):
        export(design.replace_effects(()), "c")
    warm = design.with_effect("thermal_drift", {"dF_v": 1e-4})
    with pytest.raises(RequestError, match="cannot be evaluated in a drive"):
        export(warm.replace(compensation={"effects": ("coulomb", "thermal_drift")}), "c")
