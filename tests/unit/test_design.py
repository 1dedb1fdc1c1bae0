"""Design: datasheet conversions against closed forms, lossless TOML, and messages that help."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic.fields import FieldInfo

from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import Motor, Part, SheetPart
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.units import DATASHEET, UNITS
from tests.characters import ANY_CHARACTER
from tests.effort import amount

# ---- the reference machine, from which every datasheet number is worked out as a test bench would measure it ----

P, PSI = 4, 0.172
ANGLE = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)  # one electrical turn
SHIFT = 2.0 * np.pi / 3.0


def _phase(amplitude: float, lag: float = 0.0) -> np.ndarray:
    return amplitude * np.cos(ANGLE - lag)


def _rms(wave: np.ndarray) -> float:
    return float(np.sqrt(np.mean(wave**2)))


def _emf(omega: float) -> tuple[np.ndarray, np.ndarray]:
    """Phase EMF and line-to-line EMF of the machine at this mechanical speed."""
    a, b = _phase(PSI * P * omega), _phase(PSI * P * omega, SHIFT)
    return a, a - b


def _torque(current_peak: float) -> float:
    """Mean torque from the power balance: sum of e_k i_k over the phases, divided by the speed."""
    power = sum(_phase(PSI * P * 1.0, k * SHIFT) * _phase(current_peak, k * SHIFT) for k in range(3))
    return float(np.mean(power))


THOUSAND_RPM = 1000.0 * 2.0 * np.pi / 60.0
FLUX_SHEET = {
    "K_t_peak": _torque(1.0),
    "K_t_rms": _torque(math.sqrt(2.0)),
    "K_e_phase_peak_per_rad_s": _emf(1.0)[0].max(),
    "K_e_phase_rms_per_rad_s": _rms(_emf(1.0)[0]),
    "K_e_line_peak_per_rad_s": _emf(1.0)[1].max(),
    "K_e_line_rms_per_rad_s": _rms(_emf(1.0)[1]),
    "K_e_phase_peak_per_krpm": _emf(THOUSAND_RPM)[0].max(),
    "K_e_phase_rms_per_krpm": _rms(_emf(THOUSAND_RPM)[0]),
    "K_e_line_peak_per_krpm": _emf(THOUSAND_RPM)[1].max(),
    "K_e_line_rms_per_krpm": _rms(_emf(THOUSAND_RPM)[1]),
}
MOTOR: dict[str, Any] = {"J": 9e-5, "R": 19.0, "L_d": 0.04916, "L_q": 0.04916, "p": P, "psi_f": PSI}


def motor_with(**sheet: float) -> dict[str, Any]:
    """Return the reference motor with SI fields replaced by datasheet names."""
    fields = {DATASHEET[name].field for name in sheet if name in DATASHEET}
    replaced = fields | ({"L_d", "L_q"} if "L" in fields else set())
    return {key: value for key, value in MOTOR.items() if key not in replaced} | sheet


@pytest.mark.parametrize("name", FLUX_SHEET)
def test_flux_from_every_torque_and_emf_constant(name: str) -> None:
    design = Design.from_dict({"motor": motor_with(**{name: FLUX_SHEET[name]})})
    # The waveforms are sampled, so a peak may be missed by cos(pi/3600) at most: 4e-7.
    assert design.motor.psi_f == pytest.approx(PSI, rel=5e-7)
    assert design.K_t == pytest.approx(1.032, rel=5e-7)  # 1.5 * 4 * 0.172, the reference paper's motor


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("J_kg_cm2", 0.9, {"J": 9e-5}),
        ("J_g_cm2", 900.0, {"J": 9e-5}),
        ("R_line_to_line", 38.0, {"R": 19.0}),  # two phases in series
        ("L_d_mH", 49.16, {"L_d": 0.04916}),
        ("L_q_mH", 49.16, {"L_q": 0.04916}),
        ("L_mH", 49.16, {"L_d": 0.04916, "L_q": 0.04916}),
        # energy: 3/4 L i_d^2 with i_d = 2/sqrt(3) i is L i^2, which is 1/2 (2 L) i^2 between the terminals
        ("L_line_to_line_mH", 98.32, {"L_d": 0.04916, "L_q": 0.04916}),
        ("L_d_line_to_line_mH", 98.32, {"L_d": 0.04916}),
        ("L_q_line_to_line_mH", 98.32, {"L_q": 0.04916}),
    ],
)
def test_other_datasheet_values(name: str, value: float, expected: dict[str, float]) -> None:
    motor = Design.from_dict({"motor": motor_with(**{name: value})}).motor
    for field, number in expected.items():
        assert getattr(motor, field) == pytest.approx(number, rel=1e-14)


@pytest.mark.parametrize("pitch", [0.012, 0.016, 0.0243])
def test_pole_pairs_of_a_linear_motor_follow_from_its_pole_pitch(pitch: float) -> None:
    """Waves of the field in 2 pi m, whole by chance alone: the mechanical power is the electrical one."""
    p, K_t, v = math.pi / pitch, 85.0, 1.3
    motor = {"J": 28.0, "p": p, "R": 1.6, "L_mH": 7.0, "K_t_peak": K_t}
    design = Design.from_dict({"motion": "linear", "motor": motor})
    assert design.K_t == pytest.approx(K_t, rel=1e-12)
    # phase EMF: the flux of a phase is psi_f cos(pi x / pitch), so its amplitude is psi_f pi / pitch v
    amplitude = design.motor.psi_f * math.pi / pitch * v
    assert 1.5 * amplitude * 1.0 == pytest.approx(K_t * 1.0 * v, rel=1e-12)
    assert Design.from_toml(design.to_toml()) == design
    by_emf = {key: value for key, value in motor.items() if key != "K_t_peak"} | {"K_e_phase_peak_per_rad_s": K_t / 1.5}
    assert Design.from_dict({"motion": "linear", "motor": by_emf}).K_t == pytest.approx(K_t, rel=1e-12)


def test_whole_pole_pairs_stay_whole() -> None:
    for p in (4, 4.0):
        design = Design.from_dict({"motor": MOTOR | {"p": p}})
        assert "p = 4\n" in design.to_toml()


def test_rms_current_limit() -> None:
    design = Design.from_dict({"motor": MOTOR, "drive": {"i_max_rms": 2.0}})
    assert design.drive.i_max == pytest.approx(2.0 * 1.4142135623730951, rel=1e-15)


def test_every_datasheet_name_is_tested_here() -> None:
    others = {"J_kg_cm2", "J_g_cm2", "R_line_to_line", "L_d_mH", "L_q_mH", "L_mH", "L_line_to_line_mH"}
    others |= {"L_d_line_to_line_mH", "L_q_line_to_line_mH", "i_max_rms"}
    assert set(DATASHEET) == set(FLUX_SHEET) | others


@pytest.mark.parametrize(
    ("unit", "si", "value", "expected"),
    [
        ("rpm", "rad/s", 3000.0, 314.1592653589793),
        ("deg", "rad", 180.0, math.pi),
        ("rev", "rad", 0.5, math.pi),
        ("mNm", "N m", 21.3, 0.0213),
        ("A rms", "A", 1.0, 1.4142135623730951),
        ("ms", "s", 62.5, 0.0625),
        ("mm/min", "m/s", 60000.0, 1.0),
        ("%", "1", 12.5, 0.125),
    ],
)
def test_units_at_the_edges(unit: str, si: str, value: float, expected: float) -> None:
    found, factor = UNITS[unit]
    assert found == si
    assert value * factor == pytest.approx(expected, rel=1e-15)


def test_every_unit_leads_to_one_that_stands_for_itself() -> None:
    assert all(UNITS[si] == (si, 1.0) for si, _ in UNITS.values())


# ---- what the plant is and what the controller believes are two things ------------------------------------------


def test_controllers_torque_constant_is_separate_from_the_plants_flux() -> None:
    plain = Design.from_dict({"motor": MOTOR})
    assert plain.K_t_assumed == plain.K_t == pytest.approx(1.032)
    believed = plain.replace(assumed={"K_t": 1.0})
    assert believed.K_t_assumed == 1.0
    assert believed.K_t == plain.K_t
    assert believed.motor == plain.motor
    assert Design.from_dict({"motor": MOTOR, "assumed": {"K_t_rms": math.sqrt(2.0)}}).K_t_assumed == pytest.approx(1.0)


def test_load_inertia_is_seen_through_the_gear() -> None:
    design = Design.from_dict({"motor": MOTOR, "load": {"J": 0.01, "gear": 10.0}})
    assert pytest.approx(9e-5 + 1e-4) == design.J
    assert pytest.approx(3e-4) == design.with_parameters(J=3e-4).J


def test_torque_constant_and_flux_change_together() -> None:
    assert Design.from_dict({"motor": MOTOR}).with_parameters(K_t=1.0).motor.psi_f == pytest.approx(1.0 / 6.0)


def test_committed_designs_read(designs: Path) -> None:
    for path in sorted(designs.glob("*.toml")):
        assert Design.read(path).motor.J > 0
    seed = Design.read(designs / "seed_motor.toml")
    assert (seed.motor.p, seed.motor.R, seed.motor.L_d, seed.motor.L_q) == (4, 19.0, 49.16e-3, 49.16e-3)
    assert pytest.approx(9e-5) == seed.J
    assert pytest.approx(1.032) == seed.K_t
    assert seed.parameters("coulomb") == {"F_c": 0.0213}
    assert seed.parameters("viscous") == {"F_v": 0.000168}


# ---- TOML ------------------------------------------------------------------------------------------------------

positive = st.floats(min_value=1e-15, max_value=1e15)
word = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,12}", fullmatch=True, alphabet=ANY_CHARACTER)
number = st.floats(min_value=-1e15, max_value=1e15)


@st.composite
def design_data(draw: st.DrawFn) -> dict[str, Any]:
    electrical = draw(st.booleans())
    motor: dict[str, Any] = {"J": draw(positive)}
    if electrical:
        motor |= {"p": draw(st.integers(1, 50)), **{name: draw(positive) for name in ("psi_f", "R", "L_d", "L_q")}}
    else:
        motor["K_t"] = draw(positive)
    parameter = word.filter(lambda w: w not in ("id", "stderr", "parameters"))
    entry = st.fixed_dictionaries({"id": word}).flatmap(
        lambda head: st.dictionaries(parameter, number, max_size=3).map(lambda rest: {**head, **rest})
    )
    optional: dict[str, st.SearchStrategy[Any]] = {
        "name": st.text(st.characters(exclude_categories=("Cs", "Cc", "Cf", "Zl", "Zp")), max_size=20),
        "motion": st.sampled_from(["rotary", "linear"]),
        "load": st.fixed_dictionaries({}, optional={"J": positive, "gear": st.floats(1e-6, 1e6)}),
        "drive": st.fixed_dictionaries({}, optional={"u_dc": positive, "i_max": positive, "plant_steps": st.just(8)}),
        "sensor": st.fixed_dictionaries({}, optional={"encoder_counts": st.integers(0, 2**40)}),
        "assumed": st.fixed_dictionaries({}, optional={"K_t": positive, "J": positive}),
        "loops": st.fixed_dictionaries(
            {"current": st.fixed_dictionaries({"K_p": positive, "T_n": positive}),
             "speed": st.fixed_dictionaries({"K_p": positive, "T_n": positive})}
        ),
        "effects": st.lists(entry, max_size=3),
        "acceptance": st.lists(st.fixed_dictionaries({"scenario": word, "metric": word, "limit": number}), max_size=2),
        "scenarios": st.dictionaries(word, st.dictionaries(word, number, min_size=1, max_size=2), max_size=2),
    }  # fmt: skip
    return {"motor": motor} | draw(st.fixed_dictionaries({}, optional=optional))


@settings(max_examples=amount(50, 150), deadline=None)
@given(design_data())
def test_design_survives_toml_without_loss(data: dict[str, Any]) -> None:
    import tomllib

    design = Design.from_dict(data)
    text = design.to_toml()
    again = Design.from_dict(tomllib.loads(text))
    assert again.model_dump() == design.model_dump()  # bit for bit, every field, defaults included
    assert again.to_toml() == text


scalar = st.none() | st.booleans() | st.integers() | st.floats() | st.text(ANY_CHARACTER, max_size=5)
field = st.sampled_from(["motor", "J", "p", "R", "effects", "id", "loops", "K_t_rms", "x"])
nonsense = st.recursive(
    scalar, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(field, inner, max_size=4), max_leaves=10
)


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(field, nonsense, max_size=4))
def test_any_nonsense_is_refused_in_one_line(data: dict[str, Any]) -> None:
    try:
        Design.from_dict(data, source="axis.toml")
    except DesignError as error:
        message = str(error)
    else:
        return  # by chance a design
    assert "axis.toml" in message
    assert "\n" not in message


def test_design_is_frozen_and_changes_by_copy() -> None:
    from pydantic import ValidationError

    design = Design.from_dict({"motor": MOTOR})
    with pytest.raises(ValidationError):
        design.motor.J = 1.0  # type: ignore[misc]
    more = design.with_effect("coulomb", {"F_c": 1.0}).with_effect("coulomb", {"F_c": 2.0})
    assert [e.parameters for e in more.effects] == [{"F_c": 2.0}]
    assert len(more.add_effect("coulomb", {"F_c": 3.0}).effects) == 2
    assert more.without_effect("coulomb") == design
    assert design.effects == ()


def test_pole_pairs_may_stand_beside_a_torque_constant_alone() -> None:
    """They are enough for the electrical orders of a turn; the inertia need not be known either."""
    motor = Design.from_dict({"motor": {"J": "unknown", "K_t": 1.0, "p": 4}}).motor
    assert (motor.p, motor.J, motor.electrical) == (4, None, False)


BOUNDED = [
    (part, name, field)
    for part in (*Part.__subclasses__(), *SheetPart.__subclasses__())
    for name, field in part.model_fields.items()
    if field.metadata
]


@pytest.mark.parametrize(("part", "name", "field"), BOUNDED, ids=lambda it: getattr(it, "__name__", None))
def test_every_bound_of_a_field_holds(part: type[Part], name: str, field: FieldInfo) -> None:
    """``f_control = 1e-15`` was accepted, and a filter of -1 s: of two lower bounds the wider one counted."""
    for bound in field.metadata:
        for side, sign in (("ge", -1.0), ("gt", -1.0), ("le", 1.0), ("lt", 1.0)):
            if (limit := getattr(bound, side, None)) is None:
                continue
            beyond = limit + int(sign) if field.annotation is int else limit + sign * (0.5 * abs(limit) or 1e-3)
            with pytest.raises(ValueError, match=name):
                part.model_validate({name: beyond})


# ---- messages ---------------------------------------------------------------------------------------------------


ASSUMED = "[motor]\nJ = 1.0\nK_t = 1.0\n[assumed]\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[motor]\nJ = 'heavy'\nK_t = 1.0", ["motor.J", "'heavy'", "rotor inertia, kg m^2"]),
        ("[motor]\nJ = -1.0\nK_t = 1.0", ["motor.J", "-1.0", "greater than or equal to 1e-15"]),
        ("[motor]\nJ = nan\nK_t = 1.0", ["motor.J", "nan", "finite"]),
        ("[motor]\nJ_kg_cm2 = -1.4\nK_t = 1.0", ["motor.J_kg_cm2: found -1.4, which is J = -0.00014, but it should"]),
        (f"{ASSUMED}K_t_rms = -1.0", ["assumed.K_t_rms: found -1.0, which is K_t = -0.707107, but it should be"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\n[log]\nwindow = [30, 2]", ["log.window: found [30, 2], but the first time"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\n[log.scale]\nomega = 0", ["log.scale: omega = 0, but a factor other than 0"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\nJ_load = 2.0", ["motor.J_load", "unknown field", "known: "]),
        (
            "[motor]\nJ = 1.0\nK_t = 1.0\nR = 1.0\nL_d = 1e-3\nL_q = 1e-3\np = 4",
            ["psi_f missing", "K_t_peak", "K_t_rms", "K_e_"],
        ),
        ("[motor]\nJ = 1.0\nK_tt = 1.0", ["motor.K_tt", "did you mean 'K_t'"]),
        ("[motr]\nJ = 1.0", ["motr", "did you mean 'motor'"]),
        ("name = 'x'", ["motor", "missing"]),
        ("[motor]\nK_t = 1.0", ["motor.J", "missing", "kg m^2"]),
        ("[motor]\nJ = 1.0", ["motor", "K_t alone"]),
        ("[motor]\nJ = 1.0\np = 4\nR = 1.0", ["motor", "psi_f, L_d, L_q missing"]),
        ("[motor]\nJ = 1.0\nJ_kg_cm2 = 1.0\nK_t = 1.0", ["motor", "J_kg_cm2 and J both determine J"]),
        ("[motor]\nJ = 1.0\nK_t_rms = 1.0", ["motor", "K_t_rms needs the pole pairs p"]),
        ("[motor]\nJ = 1.0\np = -4\nK_t_rms = 1.0", ["motor", "pole pairs p", "at least 1"]),
        ("[motor]\nJ = 1.0\np = 4.5\nR = 1.0\nL_mH = 1.0\nK_t_rms = 1.0", ["motor.p", "4.5", "a whole number"]),
        ("[motor]\nJ = 1.0\nK_t_rms = 'big'\np = 4", ["K_t_rms must be a number", "N m per A rms"]),
        (f"[motor]\nJ_kg_cm2 = {'9' * 400}\nK_t = 1.0", ["motor", "J_kg_cm2 must be a number", "not 9999"]),
        (f"{ASSUMED}K_t_rms = 'x'", ["assumed: K_t_rms must be a number", "N m per A rms", "'x'"]),
        (f"{ASSUMED}K_t_rms = [1.0]", ["assumed: K_t_rms must be a number", "(1.0,)"]),
        (f"{ASSUMED}K_t_rms = true", ["assumed: K_t_rms must be a number", "True"]),
        (f"{ASSUMED}K_t_rms = {'9' * 400}", ["assumed: K_t_rms must be a number"]),
        (f"{ASSUMED}K_t_rms = nan", ["assumed.K_t", "nan"]),
        (f"{ASSUMED}K_t = 2.0\nK_t_rms = 1.0", ["assumed", "K_t_rms and K_t both determine K_t; keep one"]),
        (f"{ASSUMED}K_t_rms = 1.0\nK_t = 2.0", ["assumed", "K_t and K_t_rms both determine K_t; keep one"]),
        (f"{ASSUMED}K_t_rm = 1.0", ["assumed.K_t_rm", "unknown field", "K_t_rms"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\ni_max_rms = 1.0", ["motor", "i_max_rms"]),
        ("motion = 'round'\n[motor]\nJ = 1.0\nK_t = 1.0", ["motion", "'round'", "rotary", "linear"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\n[drive]\nplant_steps = 1.5", ["drive.plant_steps", "1.5"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\n[loops.current]\nK_p = 1.0", ["loops", "missing"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\n[[effects]]\nF_c = 1.0", ["effects.0.id", "missing"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\n[[effects]]\nid = 'coulomb'\nF_c = 'x'", ["effects.coulomb.F_c", "'x'"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\ntolerance = { Jx = 0.1 }", ["motor.tolerance", "Jx", "accepted: J, psi_f"]),
        ("[motor]\nJ = 1.0\nK_t = 1.0\n" + 1000 * "[[effects]]\nid = 'cogging'\n", ["effects", "1000", "at most 100"]),
        ("motor = 3", ["motor", "3"]),
        ("[motor]\nJ = = 1", ["not valid TOML", "line 2"]),
        ("", ["empty", "[motor]"]),
    ],
)  # fmt: skip
def test_wrong_design_names_file_field_and_what_is_accepted(tmp_path: Path, text: str, expected: list[str]) -> None:
    path = tmp_path / "axis.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DesignError) as caught:
        Design.read(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    missing = [part for part in expected if part not in message]
    assert not missing, f"{message!r} lacks {missing}"


def test_missing_file_folder_and_binary(tmp_path: Path) -> None:
    with pytest.raises(DesignError, match="no such file"):
        Design.read(tmp_path / "none.toml")
    with pytest.raises(DesignError, match="cannot be read"):
        Design.read(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(DesignError, match="not UTF-8"):
        Design.read(tmp_path / "binary.toml")


def test_replace_names_the_nearest_part() -> None:
    with pytest.raises(DesignError, match="did you mean 'sensor'"):
        Design.from_dict({"motor": MOTOR}).replace(sensr={})


def test_unwritable_place_is_refused_and_nothing_is_left(tmp_path: Path) -> None:
    from pmsm_ctrl.errors import RequestError

    with pytest.raises(RequestError, match="cannot write here"):
        Design.from_dict({"motor": MOTOR}).write(tmp_path / "none" / "x.toml")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RequestError, match="is a folder"):
        Design.from_dict({"motor": MOTOR}).write(tmp_path / "folder")
    assert [p.name for p in tmp_path.iterdir()] == ["folder"]


@pytest.mark.parametrize(("source", "hint"), [({}, "a dict found"), (None, "a NoneType found"), (3, "an? int found")])
def test_what_is_no_path_of_a_design_is_one_line(source: Any, hint: str) -> None:
    with pytest.raises(DesignError, match=rf"{hint}; the path of a design in TOML was expected"):
        Design.read(source)


@pytest.mark.parametrize(
    ("stated", "wanted"), [({}, 0.07), ({"J": 0.1}, 0.07), ({"psi_f": 0.02}, 0.02), ({"R": 0.0}, 0.07)]
)
def test_a_stated_tolerance_leaves_the_usual_ones_of_the_others(stated: dict[str, float], wanted: float) -> None:
    """One of J alone made 2 % of the flux linkage, and a sound torque constant was flagged."""
    motor = Motor(J=1e-3, p=4, psi_f=0.05, R=1.0, L_d=1e-3, L_q=1e-3, tolerance=stated)
    assert motor.tolerance_of("psi_f", 0.5) == wanted
    assert motor.tolerance_of("J", 0.5) == stated.get("J", 0.15)
    assert motor.tolerance_of("k", 0.5) == 0.5


@pytest.mark.parametrize("stated", [True, False])
def test_a_stated_control_rate_stays_one(stated: bool) -> None:
    """One that is the default was left out: a log was fitted with another timing by the JSON than by the TOML."""
    drive = {"drive": {"f_control": 16000.0}} if stated else {}
    design = Design.from_dict({"motor": {"J": 1e-3, "K_t": 1.0}, **drive})
    for copy in (Design.from_dict(design.to_dict()), design.replace(motor={"J": 2e-3}), design.with_parameters(J=2e-3)):
        assert ("f_control" in copy.drive.model_fields_set) is stated
