"""The exported compensator: the C compiles without a warning and agrees with the simulation; ST says the same."""

from __future__ import annotations

import io
import math
import re
import shutil
import subprocess
import tomllib
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, Parameter, bound_effects
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export import cogging_table, friction_table, tables
from pmsm_ctrl.export import export as checked_export
from pmsm_ctrl.export import export_files as checked_export_files
from pmsm_ctrl.export.blocks import identifier
from pmsm_ctrl.export.tables import angle_table, friction_points
from pmsm_ctrl.simulate import Scenario, scenario, simulate
from pmsm_ctrl.simulate.feedforward import Feedforward
from pmsm_ctrl.simulate.parameters import Controller
from tests.effort import seeds
from tests.linear_motors import linear_motor
from tests.unit.export.compiled_c import FLAGS, Compensator
from tests.unit.export.structured_text import parsed, parsed_library, parsed_tcpou

# The text is compared here. Whether its gain is safe takes simulations: test_safe_export.py.
export = partial(checked_export, force=True)
MADE: dict[tuple[object, ...], dict[str, str]] = {}


def export_files(design: Design, language: str, *, flavour: str = "iec") -> dict[str, str]:
    """Return the files of an export, made once for each design and language."""
    key = (design.to_toml(), language, flavour)
    if key not in MADE:
        MADE[key] = checked_export_files(design, language, flavour=flavour, force=True)
    return MADE[key]


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


@pytest.mark.parametrize("smoothing", [0.0, 0.5])
def test_c_agrees_with_the_terms_over_a_scenario(
    design: Design, designs: Path, tmp_path: Path, smoothing: float
) -> None:
    changed = design.replace(compensation={"smoothing": smoothing})
    function = Compensator(changed, tmp_path)
    plain = Design.read(designs / "seed_motor.toml")  # any log has the signals that the terms read
    log = simulate(plain, scenario("reversal", plain, speed=5.0, cycles=1.0), seed=1)
    omega, theta, i_q = log["omega_ref"], log["theta"], log["i_q_ref"]
    direction = np.sign(omega) if smoothing == 0.0 else np.clip(omega / smoothing, -1.0, 1.0)
    signals = {"omega": omega, "theta": theta, "direction": direction, "torque": design.K_t * i_q, "i_q": i_q,
               "i_d": np.zeros_like(i_q), "p": 4.0}  # fmt: skip
    torque = sum(column(effect, signals, values) for effect, values in bound_effects(design))
    found = np.array([function(w, a, 0.0, i) for w, a, i in zip(omega, theta, i_q, strict=True)])
    assert np.allclose(found, 0.8 * torque / design.K_t, rtol=1e-6, atol=1e-12)
    assert np.ptp(found) > 0.05


@pytest.mark.parametrize("smoothing", seeds(0.5, 0.0))
def test_every_flavour_of_structured_text_gives_the_current_of_the_c(
    design: Design, tmp_path: Path, smoothing: float
) -> None:
    changed = design.replace(compensation={"smoothing": smoothing})
    function = Compensator(changed, tmp_path)
    files = {flavour: export_files(changed, "st", flavour=flavour) for flavour in ("iec", "br", "beckhoff")}
    blocks = [
        parsed(files["iec"]["FB_seed_motor_compensation.st"]),
        parsed_library(files["br"], "FB_seed_motor_compensation"),
        parsed_tcpou(files["beckhoff"], "FB_seed_motor_compensation"),
    ]
    rng = np.random.default_rng(5)
    for omega, theta, i_d, i_q in [(0.0, 1.0, 0.0, 0.1), *(rng.uniform(-1, 1, (50, 4)) * (20.0, 9.0, 0.0, 0.5))]:
        for block in blocks:
            block(omega=float(omega), theta=float(theta), i_d=float(i_d), i_q=float(i_q), enable=True)
            assert block["i_q_add"] == pytest.approx(function(omega, theta, i_d, i_q), rel=1e-12, abs=1e-15)


def test_an_adaptive_compensation_takes_what_the_tracker_is_sure_of(design: Design, tmp_path: Path) -> None:
    adaptive = design.replace(compensation={"source": "adaptive", "effects": ("coulomb", "viscous"), "gain": 1.0})
    function, K_t = Compensator(adaptive, tmp_path), design.K_t
    block = parsed(export(adaptive, "st"))
    own = 0.0213, 0.000168
    for F_c, sd_F_c, F_v, sd_F_v, used in (
        (0.03, 0.02, 2e-4, 1e-4, own),  # not known well enough: the design's
        (0.03, 1e-3, 2e-4, 1e-4, (0.03, own[1])),
        (0.03, 1e-3, 2e-4, 1e-6, (0.03, 2e-4)),
        (0.05, 0.02, -1e-4, 1e-6, (0.03, 2e-4)),  # the last good ones are held; a friction below zero is none
        (math.nan, 1e-3, 2e-4, 1e-6, (0.0, 0.0)),
        (0.04, 1e-3, 2e-4, 1e-6, (0.04, 2e-4)),
    ):
        expected = (used[0] + 10.0 * used[1]) / K_t
        assert function(10.0, 0.0, 0.0, 0.0, F_c, sd_F_c, F_v, sd_F_v) == pytest.approx(expected, rel=1e-12)
        assert function.fault == math.isnan(F_c)
        block(omega=10.0, theta=0.0, i_d=0.0, i_q=0.0, F_c=F_c, sd_F_c=sd_F_c, F_v=F_v, sd_F_v=sd_F_v, enable=True)
        assert block["i_q_add"] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("smoothing", [0.0, 0.5])
def test_an_input_that_is_no_number_adds_nothing_and_sets_the_flag(
    design: Design, tmp_path: Path, smoothing: float
) -> None:
    changed = design.replace(compensation={"smoothing": smoothing})
    function = Compensator(changed, tmp_path)
    block = parsed(export(changed, "st"))
    good = [3.0, 1.0, 0.0, 0.1]
    for bad in (math.nan, math.inf, -math.inf):
        for k in range(4):
            inputs = [bad if n == k else value for n, value in enumerate(good)]
            assert function(*inputs) == 0.0
            assert function.fault
            block(**dict(zip(("omega", "theta", "i_d", "i_q"), inputs, strict=True)), enable=True)
            assert block["i_q_add"] == 0.0
            assert block["fault"] is True
    assert function(*good) != 0.0
    assert not function.fault
    assert function(*good, enable=False) == 0.0
    assert not function.fault
    assert function.memory.i_q_add == 0.0


@pytest.mark.slow
def test_dead_zone_and_limit_are_those_of_the_simulation(designs: Path, tmp_path: Path) -> None:
    plain = Design.read(designs / "seed_motor.toml")
    changed = plain.replace(compensation={"gain": 1.0, "dead_zone": 0.5, "limit": 0.01, "effects": ("coulomb",)})
    function = Compensator(changed, tmp_path)
    assert function(0.5, 0.0, 0.0, 0.0) == 0.0
    assert function(-0.6, 0.0, 0.0, 0.0) == -0.01
    motion = Scenario("one", 0.02, lambda t: {"omega_ref": np.full(t.shape, 3.0)}, omega_0=3.0)
    still = changed.replace(sensor={"current_noise": 0.0})
    off = still.replace(compensation={"gain": 0.0})
    with_it, without = (simulate(d, motion, truth=off)["i_q_ref"][0] for d in (still, off))
    assert with_it - without == pytest.approx(0.01, rel=1e-12)


@pytest.mark.parametrize("gain", [None, 0.0, 0.3])
def test_the_exported_gain_is_the_designs_and_a_zero_stays_zero(designs: Path, tmp_path: Path, gain: float) -> None:
    plain = Design.read(designs / "seed_motor.toml")
    chosen = plain if gain is None else Design.from_dict(plain.to_dict() | {"compensation": {"gain": gain}})
    again = Design.from_dict(tomllib.loads(chosen.to_toml()))
    assert again.compensation.gain == gain
    function = Compensator(again, tmp_path)
    expected = (1.0 if gain is None else gain) * (0.0213 + 3.0 * 0.000168) / plain.K_t
    assert function(3.0, 0.0, 0.0, 0.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("optimised", ["-O0", "-O3"])
def test_the_guard_against_nan_survives_fast_math(design: Design, tmp_path: Path, optimised: str) -> None:
    function = Compensator(design, tmp_path, "-ffast-math", optimised)
    good = function(3.0, 0.0, 0.0, 0.1)
    assert good > 0.0
    assert not function.fault
    for value in (math.nan, math.inf, -math.inf):
        for place in range(4):
            inputs = [3.0, 0.0, 0.0, 0.1]
            inputs[place] = value
            assert function(*inputs) == 0.0
            assert function.fault
    assert function(3.0, 0.0, 0.0, 0.1) == good
    assert not function.fault


LONG = "spindle_of_the_second_milling_unit_left"


def test_names_have_at_most_32_characters_and_stay_apart(design: Design) -> None:
    assert identifier(LONG) != identifier(LONG + "_2")
    renamed = design.model_copy(update={"name": LONG})
    for language, flavour in (("c", "iec"), ("st", "iec"), ("st", "beckhoff"), ("st", "br")):
        for name, text in export_files(renamed, language, flavour=flavour).items():
            if name.endswith((".c", ".h", ".st", ".fun", ".var", ".TcPOU")):
                bare = re.sub(
                    r"/\*.*?\*/|\(\*.*?\*\)|//[^\n]*|<[^>]*>|UINT64_C\(\w+\)|0x\w+", "", text, flags=re.DOTALL
                )
                assert max(map(len, re.findall(r"[A-Za-z_]\w*", bare))) <= 32, name


@pytest.mark.parametrize("source", ["reference", "adaptive", "observer"])
def test_every_variable_of_the_compensator_says_what_it_is_and_is_used(design: Design, source: str) -> None:
    axis = design.replace(compensation={"source": source, "bandwidth": 200.0})
    text = export(axis, "st")
    declared, body = text.split("END_VAR\n\n", 1)
    for line in declared.splitlines():
        if re.match(r"    \w+ : ", line):
            assert re.search(r"\(\*.+\*\)$", line), line
            name = line.split(" : ")[0].strip()
            gains = ("CURRENT_", "SPEED_", "POSITION_", "REFERENCE_", "VELOCITY_", "INERTIA_FEEDFORWARD")
            inputs = ("theta", "i_d", "i_q")  # the same for every compensator
            assert name.startswith(gains) or name in inputs or re.search(rf"\b{name}\b", body), name
    c = export(axis, "c")
    assert "(void)omega" not in c
    assert c.count('extern "C"') == 1


@pytest.mark.parametrize("assumed", [{}, {"J": 4.5e-5}, {"K_t": 0.9}, {"J": 2e-4, "K_t": 1.2}])
@pytest.mark.parametrize("source", ["reference", "observer"])
def test_exported_constants_are_those_of_the_simulated_controller(
    designs: Path, assumed: dict[str, float], source: str
) -> None:
    axis = Design.read(designs / "seed_motor.toml").replace(
        assumed=assumed, compensation={"gain": 0.8, "source": source, "bandwidth": 200.0}
    )
    current = {**axis.to_dict()["loops"]["current"], "K_p_d": 7.0, "T_n_d": 0.004}
    place = {**axis.to_dict()["loops"]["position"], "velocity_feedforward": 0.9, "acceleration_feedforward": 0.8}
    axis = axis.replace(loops={"current": current, "position": place})
    number = r"(?:#define SEED_MOTOR_|const double )([A-Z_]+)(?: =)? (-?[\d.E+-]+)"
    told = {name: float(value) for name, value in re.findall(number, export(axis, "c"))}
    drive, fed = Controller.of(axis, "position"), Feedforward.of(axis)
    assert fed is not None
    simulated = {
        "CURRENT_KP": drive.current_gain[1], "CURRENT_TN": 1.0 / axis.drive.f_control / drive.current_integral[1],
        "CURRENT_KP_D": drive.current_gain[0], "CURRENT_TN_D": 1.0 / axis.drive.f_control / drive.current_integral[0],
        "SPEED_KP": drive.speed_gain, "SPEED_TN": axis.drive.speed_period / drive.speed_integral,
        "POSITION_KV": drive.position_gain, "VELOCITY_FEEDFORWARD": drive.velocity_feedforward,
        "INERTIA_FEEDFORWARD": drive.acceleration_feedforward,
    }  # fmt: skip
    values = dict(zip(fed.names, fed.values.tolist(), strict=True))
    simulated |= {"K_T": values["K_t"], "GAIN": values["gain"], "LIMIT": values["limit"]}
    simulated |= {"INERTIA": values["inertia"], "SHARE": values["share"]} if source == "observer" else {}
    assert {name: told[name] for name in simulated} == pytest.approx(simulated, rel=1e-12)


def test_headers_compile_as_cpp_and_link_to_the_c(design: Design, tmp_path: Path) -> None:
    if shutil.which("g++") is None:
        pytest.skip("g++ not found")
    files = export_files(design, "c")
    headers = [name for name in files if name.endswith(".h")]
    assert headers == ["seed_motor_compensation.h", "seed_motor_tracker.h"]
    for name in headers:
        block = name.removesuffix(".h")
        (tmp_path / name).write_text(files[name], encoding="utf-8")
        (tmp_path / "use.cpp").write_text(f'#include "{name}"\nvoid f({block}_t *s) {{ {block}_init(s); }}\n')
        subprocess.run(["g++", "-c", str(tmp_path / "use.cpp"), "-o", str(tmp_path / "use.o")], check=True)
        symbols = subprocess.run(["nm", str(tmp_path / "use.o")], check=True, capture_output=True, text=True).stdout
        assert f" U {block}_init" in symbols  # the name of C, not one that C++ has decorated


def test_the_code_of_a_linear_axis_speaks_of_forces() -> None:
    """A force was called "N, Coulomb friction torque"."""
    axis = linear_motor().design.with_effect("constant_load", {"T_0": 2.0})
    axis = axis.replace(compensation={"gain": 0.5, "effects": ["coulomb", "viscous", "constant_load"]})
    for language in ("c", "st"):
        text = checked_export(axis, language, force=True)
        assert "torque" not in text.lower()
        assert "angle" not in text
        assert {"Coulomb friction force", "Constant load force"} <= set(re.findall(r"[A-Z][a-z]+ \w+ force", text))


def test_the_comments_of_a_linear_tracker_have_its_units() -> None:
    """A comment said "(N m s)^2"."""
    text = checked_export(linear_motor().design, "c", part="tracker")
    assert not re.search(r"N m\b|\brad\b|torque's", text)
    assert "(N s)^2" in text


def test_linear_friction_gets_evenly_spread_speeds() -> None:
    plain = Design.from_dict({
        "motor": {"J": 1e-4, "K_t": 1.0},
        "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 1e-3}],
    })  # fmt: skip
    table, error = friction_points(plain, 20, 100.0)
    gaps = np.diff(table[:, 0])
    assert error < 1e-12
    assert gaps.max() < 2.5 * 100.0 / 19
    assert gaps.min() > 0.4 * 100.0 / 19


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


@pytest.mark.slow
@pytest.mark.parametrize("part", ["compensation", "tracker"])
@pytest.mark.parametrize("flavour", ["iec", "beckhoff"])
def test_a_second_parser_finds_no_error(design: Design, tmp_path: Path, flavour: str, part: str) -> None:
    """blark's grammar is that of TwinCAT, and it reads the .TcPOU as TwinCAT does; it takes half a minute."""
    blark = pytest.importorskip("blark.parse", reason="blark not installed: the exported ST is not parsed twice")
    path = tmp_path / ("block.TcPOU" if flavour == "beckhoff" else "block.st")
    path.write_text(export(design, "st", part=part, flavour=flavour), encoding="utf-8")
    for found in blark.parse(path):
        assert found.exception is None
        assert found.transform().items


def test_no_name_ends_a_comment_or_leaves_ascii(design: Design, tmp_path: Path) -> None:
    odd = design.replace(name="Ständer*/ 2 *) ]]> #1")
    for flavour in ("iec", "br", "beckhoff"):
        for name, text in export_files(odd, "st", flavour=flavour).items():
            assert name.isascii()
            if not name.endswith((".csv", ".toml", ".lis")):
                assert text.isascii()
    (tmp_path / "axis.c").write_text(export(odd, "c"), encoding="ascii")
    subprocess.run(
        ["gcc", *FLAGS, "-shared", str(tmp_path / "axis.c"), "-o", str(tmp_path / "axis.so"), "-lm"], check=True
    )
    assert "void St_nder_2_1_compensation_update(" in export(odd, "c")


def test_gains_are_in_both(design: Design) -> None:
    assert "#define SEED_MOTOR_SPEED_KP 0.0439" in export(design, "c")
    assert "SPEED_KP : LREAL := 0.0439;" in export(design, "st")


def test_tables_are_what_drives_accept(design: Design) -> None:
    table = friction_table(design, [-100.0, -1.0, 1.0, 100.0])
    at_hundred = 0.0213 + 0.0168 - 0.002 - 0.003 + 1e-3 + 0.01 * np.exp(-(20.0**1.5))
    assert table[-1, 1] == pytest.approx(at_hundred, rel=1e-12)
    ((order, amplitude, phase),) = cogging_table(design)
    x = np.linspace(0.0, 1.0, 50)
    assert np.allclose(amplitude * np.sin(order * x + phase), 0.004 * np.sin(24 * x) - 0.002 * np.cos(24 * x))


def test_speeds_of_the_table_are_chosen_so_that_lines_between_them_err_little(design: Design) -> None:
    table, error = friction_points(design, 20)
    assert table.shape == (20, 3)
    assert np.all(np.diff(table[:, 0]) > 0.0)
    fine = np.geomspace(table[0, 0], table[-1, 0], 5000)
    for side, sign in ((1, 1.0), (2, -1.0)):
        exact = sign * friction_table(design, sign * fine)[:, 1]
        missed = np.abs(np.interp(fine, table[:, 0], table[:, side]) - exact).max() / np.abs(table[:, 1:]).max()
        assert missed < 1.05 * error + 1e-4
    assert error < 0.002
    assert table[-1, 0] == pytest.approx(560.0 / np.sqrt(3.0) / (4 * 0.172), rel=1e-12)
    # a straight line needs no more than its ends: further speeds halve the gaps
    plain = Design.from_dict({"motor": {"J": 1e-4, "K_t": 1.0}, "effects": [{"id": "viscous", "F_v": 1e-3}]})
    assert friction_points(plain, 6, 100.0)[1] < 1e-12


def test_table_files_hold_the_same_numbers(design: Design) -> None:
    files = export_files(design, "c")
    rows = np.genfromtxt(io.StringIO(files["seed_motor_friction.csv"]), delimiter=",", skip_header=1)
    assert np.allclose(friction_table(design, rows[:, 0])[:, 1], rows[:, 2], rtol=1e-7)
    assert np.allclose(rows[:, 1], rows[:, 0] * 60.0 / (2.0 * np.pi), rtol=1e-8)
    assert np.allclose(rows[:, 3] * design.K_t, rows[:, 2], rtol=1e-7)
    tables = tomllib.loads(files["seed_motor_tables.toml"])
    assert tables["friction"]["speed"] == pytest.approx(rows[20:, 0].tolist(), rel=1e-8)
    assert tables["friction"]["backwards"] == pytest.approx((-rows[19::-1, 2]).tolist(), rel=1e-7)
    # AX8000, object 32CB: order up to 200, phase from 0 to 360 degrees, amplitude in N m
    assert files["seed_motor_cogging_ax8000.csv"].splitlines()[1:4] == [
        "32CB:07,Coef 0 n,24,", "32CB:08,Coef 0 phi,333.435,deg", "32CB:09,Coef 0 r,0.00447214,N m",
    ]  # fmt: skip


def test_compensation_list_of_the_cnc(design: Design) -> None:
    """TF5200: speeds rise, from above 0, in 0.001 degrees per second; both directions share a table."""
    text = export_files(design, "st", flavour="beckhoff")["seed_motor_frict_comp.lis"]
    speeds = [int(n) for n in re.findall(r"\.in (-?\d+)", text)]
    currents = [int(n) for n in re.findall(r"\.out (-?\d+)", text)]
    assert len(speeds) == len(currents) == 20
    assert speeds == sorted(set(speeds))
    assert speeds[0] > 0
    assert speeds[-1] == round(np.degrees(friction_points(design)[0][-1, 0]) * 1000.0)
    both = friction_table(design, np.radians(speeds[-1] / 1000.0) * np.array([1.0, -1.0]))[:, 1]
    assert currents[-1] == pytest.approx((both[0] - both[1]) / 2.0 / design.K_t * 1e6, abs=1.0)
    apart = float(re.search(r"at most\n# (\S+) uA", text).group(1))  # type: ignore[union-attr]
    # the load of -3 mN m and the asymmetry of viscous friction
    assert apart == pytest.approx((0.003 + 2e-5 * friction_points(design)[0][-1, 0]) / design.K_t * 1e6, rel=0.01)


def test_torque_over_the_angle_differs_by_direction(design: Design) -> None:
    table = angle_table(design, 4096)
    theta = table[:, 0]
    cogging = 0.004 * np.sin(24 * theta) - 0.002 * np.cos(24 * theta)
    once = 0.002 * np.sin(theta) - 0.001 * np.cos(theta)
    assert np.allclose(table[:, 1], cogging + once, atol=1e-15)
    assert np.allclose(table[:, 2], cogging - once, atol=1e-15)
    plain = Design.read(Path(design.source)) if design.source else design
    assert "seed_motor_torque_over_angle.csv" not in export_files(plain, "c")
    assert "seed_motor_torque_over_angle.csv" in export_files(design, "c")


def test_a_table_over_a_turn_holds_what_repeats_with_the_turn(design: Design) -> None:
    """Gravity behind a gear of 10 has ten turns for its own: the table jumped by 0.157 N m at the end of each."""
    load = {"a_s": 0.3, "a_c": 0.1, "period": 20.0 * np.pi}
    geared = design.with_effect("load_gravity", load)
    assert np.array_equal(angle_table(geared), angle_table(design))
    files = export_files(geared, "c")
    last = files["seed_motor_torque_over_angle.csv"].splitlines()[-1]
    assert last.startswith("# Not held: load_gravity")
    assert "not_held_over_a_turn" in files["seed_motor_tables.toml"]
    assert "Not held" not in export_files(design, "c")["seed_motor_torque_over_angle.csv"]


@pytest.mark.parametrize("turns", [2.0, 10.0])
def test_a_wave_of_half_turns_does_not_repeat_with_the_turn(designs: Path, turns: float) -> None:
    """A sine of half a wave in a turn is zero at both ends of the table, and was taken for one that repeats."""
    load = {"a_s": 0.3, "a_c": 0.0, "period": turns * 2.0 * np.pi}
    design = Design.read(designs / "seed_motor.toml").with_effect("load_gravity", load)
    assert tables._not_of_a_turn(design) == [f"load_gravity {turns * 2.0 * np.pi:.4g}"]
    assert not np.any(angle_table(design)[:, 1:])


def test_each_direction_is_asked_whether_it_repeats_with_the_turn(designs: Path) -> None:
    """Waves of half turns that act one way only, beside a step that closes."""
    design = Design.read(designs / "seed_motor.toml")
    for name, term in {"forwards": forwards_only, "backwards": backwards_only, "step": step_of_a_turn}.items():
        own = Effect(
            id=name, title="t", equation="k", source="none", enters="torque", term=term, needs="motion",
            parameters=(Parameter("k", "N m", 0.0, -1.0, 1.0, "level", linear=True),),
        )  # fmt: skip
        design = design.with_own_effects(own).with_effect(name, {"k": 0.2})
    assert tables._not_of_a_turn(design) == ["forwards", "backwards"]
    assert np.abs(angle_table(design)[:, 1:]).max(axis=0) == pytest.approx(0.2, rel=1e-6)


def forwards_only(theta: float, direction: float, k: float) -> float:
    return k * (1.0 + direction) * math.sin(0.5 * theta)


def backwards_only(theta: float, direction: float, k: float) -> float:
    return k * (1.0 - direction) * math.sin(0.5 * theta)


def step_of_a_turn(theta: float, k: float) -> float:
    return k if math.sin(theta) > 0.0 else -k


def test_bad_requests_are_told(design: Design) -> None:
    with pytest.raises(RequestError, match="accepted: c, st"):
        export(design, "fortran")
    with pytest.raises(RequestError, match="identify friction first"):
        export(design.replace_effects(()), "c")
    warm = design.with_effect("thermal_drift", {"dF_v": 1e-4})
    with pytest.raises(RequestError, match="cannot be evaluated in a drive"):
        export(warm.replace(compensation={"effects": ("coulomb", "thermal_drift")}), "c")


DESIGNS = sorted((Path(__file__).resolve().parents[3] / "designs").glob("*.toml"))


@pytest.mark.parametrize("path", seeds(*DESIGNS), ids=lambda path: path.stem)
def test_every_design_is_exported_and_compiles(path: Path, tmp_path: Path) -> None:
    if shutil.which("gcc") is None:
        pytest.skip("gcc not found: the exported C cannot be compiled")
    axis = Design.read(path)
    for name, text in export_files(axis, "c").items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    for source in tmp_path.glob("*.c"):
        subprocess.run(["gcc", *FLAGS, "-shared", str(source), "-o", str(tmp_path / "a.so"), "-lm"], check=True)
    names = {file.name for file in tmp_path.iterdir()}
    assert any(name.endswith(("_tracker.c", "_tracker_not_exported.txt")) for name in names)
    if axis.motion == "linear":
        text = next(tmp_path.glob("*_compensation.c")).read_text("utf-8")
        assert "/* N, Coulomb friction torque */" in text
        assert "rad" not in text
    with pytest.raises(RequestError):
        export_files(axis.replace_effects(()), "c")


def test_command_line_writes_a_file_or_a_folder(designs: Path, tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from pmsm_ctrl.cli import app

    axis = str(designs / "seed_motor.toml")
    runner = CliRunner()
    folder = tmp_path / "plc"
    found = runner.invoke(app, ["export", axis, "-l", "st", "--flavour", "br", "-o", str(folder)])
    assert found.exit_code == 0, found.output
    assert {"IEC.lby", "seed_motor.fun", "seed_motor.var", "FB_seed_motor_tracker.st"} <= {
        p.name for p in folder.iterdir()
    }
    single = tmp_path / "tracker.c"
    assert runner.invoke(app, ["export", axis, "-l", "c", "--part", "tracker", "-o", str(single)]).exit_code == 0
    assert "seed_motor_tracker_update" in single.read_text("utf-8")
