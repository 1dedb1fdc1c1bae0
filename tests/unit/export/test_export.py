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
from pmsm_ctrl.export import cogging_table, export, export_files, friction_table
from pmsm_ctrl.simulate import scenario, simulate
from tests.unit.export.structured_text import parsed, parsed_library, parsed_tcpou

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-shared", "-fPIC")


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


@pytest.mark.parametrize("smoothing", [0.0, 0.5])
def test_every_flavour_of_structured_text_gives_the_current_of_the_c(
    design: Design, tmp_path: Path, smoothing: float
) -> None:
    changed = design.replace(compensation={"smoothing": smoothing})
    function = compiled(changed, tmp_path)
    files = {flavour: export_files(changed, "st", flavour=flavour) for flavour in ("iec", "br", "beckhoff")}
    blocks = [
        parsed(files["iec"]["FB_seed_motor_compensation.st"]),
        parsed_library(files["br"], "FB_seed_motor_compensation"),
        parsed_tcpou(files["beckhoff"], "FB_seed_motor_compensation", tmp_path),
    ]
    rng = np.random.default_rng(5)
    for omega, theta, i_d, i_q in [(0.0, 1.0, 0.0, 0.1), *(rng.uniform(-1, 1, (50, 4)) * (20.0, 9.0, 0.0, 0.5))]:
        for block in blocks:
            block(omega=float(omega), theta=float(theta), i_d=float(i_d), i_q=float(i_q))
            assert block["i_q_add"] == pytest.approx(function(omega, theta, i_d, i_q), rel=1e-12, abs=1e-15)


def test_an_adaptive_compensation_reads_the_tracker(design: Design, tmp_path: Path) -> None:
    adaptive = design.replace(compensation={"source": "adaptive", "effects": ("coulomb", "viscous"), "gain": 1.0})
    source = export(adaptive, "c")
    assert "double omega, double theta, double i_d, double i_q, double F_c, double F_v" in source
    (tmp_path / "axis.c").write_text(source, encoding="utf-8")
    subprocess.run(["gcc", *FLAGS, str(tmp_path / "axis.c"), "-o", str(tmp_path / "axis.so"), "-lm"], check=True)
    function = ctypes.CDLL(str(tmp_path / "axis.so")).seed_motor_compensation
    function.argtypes, function.restype = [ctypes.c_double] * 6, ctypes.c_double
    assert function(10.0, 0.0, 0.0, 0.0, 0.03, 2e-4) == pytest.approx((0.03 + 2e-3) / design.K_t, rel=1e-12)


def test_structured_text_has_no_literal_that_a_standard_compiler_would_refuse(design: Design) -> None:
    """1e-07 is a number in Python and C; IEC 61131-3 wants a decimal point."""
    text = export(design, "st")
    assert re.search(r"QUADRATIC_DRAG_K_2 : LREAL := 1\.0E-07;", text)
    assert not re.search(r"(?<![\w.])\d+[eE]", text)


def test_powers_avoid_single_precision_where_the_controller_has_no_other(design: Design) -> None:
    files = export_files(design, "st", flavour="br")
    text = files["FB_seed_motor_compensation.st"]
    assert "EXPT" not in text
    assert "EXP(STRIBECK_DELTA * LN(MAX(ABS(omega / STRIBECK_W_S), 1.0E-300)))" in text
    assert "EXPT(ABS(omega / STRIBECK_W_S), STRIBECK_DELTA)" in export(design, "st", flavour="beckhoff")


@pytest.mark.parametrize("flavour", ["iec", "beckhoff"])
def test_a_second_parser_finds_no_error(design: Design, flavour: str) -> None:
    """tree-sitter's grammar of the standard's third edition, written by others than blark's."""
    binding = pytest.importorskip(
        "tree_sitter", reason="tree-sitter not installed: the exported ST is not parsed twice"
    )
    grammar = pytest.importorskip("tree_sitter_iec61131_3_st", reason="no grammar of ST: the ST is not parsed twice")
    parser = binding.Parser(binding.Language(grammar.language()))
    for part in ("compensation", "tracker"):
        text = export(design, "st", part=part, flavour=flavour)
        if flavour == "beckhoff":
            declaration, body = re.findall(r"<!\[CDATA\[(.*?)\]\]>", text, flags=re.DOTALL)
            # the short-circuit AND is Beckhoff's own
            text = f"{declaration}\n{body.replace('AND_THEN', 'AND')}\nEND_FUNCTION_BLOCK\n"
        tree = parser.parse(text.encode())
        assert not tree.root_node.has_error
        assert parser.parse(text.replace("END_VAR", "", 1).encode()).root_node.has_error


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
