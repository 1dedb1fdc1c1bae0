"""The exported filters of the current reference: compiled C and parsed Structured Text against scipy's filter."""

import ctypes
import math
import shutil
import subprocess

import numpy as np
import pytest
from scipy import signal

from pmsm_ctrl.design import Design, Filter
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export import export, export_files
from pmsm_ctrl.tune.drive_units import drive_units
from tests.unit.export.compiled_c import FLAGS
from tests.unit.export.structured_text import parsed, parsed_library, parsed_tcpou

FILTERS = (
    Filter(kind="notch", frequency=300.0, width=120.0, depth=20.0),
    Filter(kind="low_pass", frequency=900.0, order=1),
    Filter(kind="lead", frequency=200.0, phase=30.0),
)


@pytest.fixture(scope="module")
def design(designs):
    found = Design.read(designs / "seed_motor.toml")
    speed = found.loops.speed.model_copy(update={"filters": FILTERS})
    return found.model_copy(update={"loops": found.loops.model_copy(update={"speed": speed})})


@pytest.fixture(scope="module")
def current():
    """Current asked for: noise and a step."""
    return np.random.default_rng(3).standard_normal(400) + (np.arange(400) > 200)


@pytest.fixture(scope="module")
def expected(current):
    out = current
    for one in FILTERS:
        b_0, b_1, b_2, a_1, a_2 = one.biquad.sampled(1.0 / 4000.0)
        out = signal.lfilter([b_0, b_1, b_2], [1.0, a_1, a_2], out)
    return out


@pytest.mark.parametrize("precision", ["double", "single"])
def test_the_compiled_c_filters_as_scipy_does(design, current, expected, tmp_path, precision):
    if shutil.which("gcc") is None:
        pytest.skip("gcc not found: the exported C cannot be compiled")
    source, library = tmp_path / "axis.c", tmp_path / "axis.so"
    source.write_text(export(design, "c", part="filter", precision=precision), encoding="utf-8")
    subprocess.run(["gcc", *FLAGS, "-shared", str(source), "-o", str(library), "-lm"], check=True)
    number = ctypes.c_double if precision == "double" else ctypes.c_float

    class Memory(ctypes.Structure):
        _fields_ = (("held", number * 6), ("i_q_ref", number), ("fault", ctypes.c_int))

    found, memory = ctypes.CDLL(str(library)), Memory()
    update, begin = found.seed_motor_filter_update, found.seed_motor_filter_init
    update.argtypes, update.restype = [ctypes.c_void_p, number, ctypes.c_int], None
    begin.argtypes, begin.restype = [ctypes.c_void_p], None
    begin(ctypes.byref(memory))

    def run(value, enable=1):
        update(ctypes.byref(memory), value, enable)
        return float(memory.i_q_ref)

    np.testing.assert_allclose(
        [run(value) for value in current], expected, atol=1e-12 if precision == "double" else 3e-5
    )
    before = list(memory.held)
    assert run(math.nan) == 0.0
    assert memory.fault
    assert list(memory.held) == before
    # While it is not enabled the current passes, and it is enabled without a step.
    assert run(0.7, enable=0) == pytest.approx(0.7)
    assert [run(0.7) for _ in range(5)] == pytest.approx([0.7] * 5, rel=1e-6)
    assert not memory.fault


@pytest.mark.parametrize("flavour", ["iec", "br", "beckhoff"])
def test_every_structured_text_filters_as_scipy_does(design, current, expected, flavour):
    files = export_files(design, "st", flavour=flavour, force=True)
    if flavour == "br":
        block = parsed_library(files, "FB_seed_motor_filter")
    else:
        block = (
            parsed(files["FB_seed_motor_filter.st"])
            if flavour == "iec"
            else parsed_tcpou(files, "FB_seed_motor_filter")
        )
    out = []
    for value in current[:60]:
        block(i_q=float(value), enable=True)
        out.append(block["i_q_ref"])
    np.testing.assert_allclose(out, expected[:60], atol=1e-12)


def test_a_design_without_filters_exports_none(designs):
    plain = Design.read(designs / "seed_motor.toml")
    assert not [name for name in export_files(plain, "c", force=True) if "filter" in name]
    with pytest.raises(RequestError, match="filters: none"):
        export(plain, "c", part="filter")


def test_the_filters_in_the_terms_of_drives(design):
    """SINAMICS S120 Function Manual FH1: D_N = f_BB / (2 f_Sp), D_Z = D_N 10^(K/20)."""
    units = drive_units(design)
    general = {name: value for name, value in units["general"].items() if name.startswith("current filter 1")}
    assert general["current filter 1, notch: denominator frequency [Hz]"] == pytest.approx(300.0)
    assert general["current filter 1, notch: denominator damping [1]"] == pytest.approx(120.0 / 600.0)
    assert general["current filter 1, notch: numerator damping [1]"] == pytest.approx(
        120.0 / 600.0 * 10.0 ** (-20.0 / 20.0)
    )
    assert units["Siemens"]["current setpoint filter 1, notch depth [dB]"] == -20.0
    assert units["general"]["current filter 2, low-pass: pole [Hz]"] == pytest.approx(900.0)
    lead = [units["general"][f"current filter 3, lead: {part} [Hz]"] for part in ("zero", "pole")]
    assert math.sqrt(lead[0] * lead[1]) == pytest.approx(200.0)
