"""A design that is read, changed and written keeps its comments, its order and its fields."""

from __future__ import annotations

import difflib
import math
from pathlib import Path

import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.units import rounded

pytest.importorskip("tomlkit")

DESIGNS = Path(__file__).resolve().parents[2] / "designs"
SHEET = """# drive of the conveyor
[motor] # plate
p = 4
J_kg_cm2 = 1.6              # without brake
K_t_rms = 1.46
R_line_to_line = 1.1
L_line_to_line_mH = 7.6     # both axes

[[effects]]
id = "coulomb"
F_c = 0.08   # as assumed

# from the seal
[[effects]]
id = "viscous"
F_v = 2e-4
"""


@pytest.fixture
def sheet(tmp_path: Path) -> Path:
    path = tmp_path / "sheet.toml"
    path.write_text(SHEET, encoding="utf-8")
    return path


def changes(design: Design, old: Path, new: Path) -> list[str]:
    """Write a design and return the lines that differ from the file that it was read from."""
    design.write(new)
    again = Design.read(new)
    assert again == design or math.isclose(again.J, design.J, rel_tol=1e-14)
    lines = [path.read_text(encoding="utf-8").splitlines() for path in (old, new)]
    return [line for line in difflib.ndiff(*lines) if line[0] in "+-"]


@pytest.mark.parametrize("path", sorted(DESIGNS.glob("*.toml")), ids=lambda path: path.stem)
def test_an_unchanged_design_is_written_as_it_was_read(path: Path, tmp_path: Path) -> None:
    assert Design.read(path).write(tmp_path / "new.toml").read_bytes() == path.read_bytes()


def test_an_inertia_stays_in_the_unit_of_its_field_rounded_to_its_standard_error(tmp_path: Path) -> None:
    old = DESIGNS / "seed_motor.toml"
    found = Design.read(old).with_parameters(J=9.1234567e-5, stderr={"J": 2.1e-7})
    assert changes(found, old, tmp_path / "new.toml") == ["- J_kg_cm2 = 0.9", "+ J_kg_cm2 = 0.9123"]


@pytest.mark.parametrize(
    ("value", "stderr", "expected"),
    [(9.1234567e-5, 2.1e-7, 9.123e-5), (95.1089, 0.6, 95.11), (1234.5678, 150.0, 1230.0), (0.5, 0.0, 0.5)],
)
def test_two_digits_of_the_standard_error_stay(value: float, stderr: float, expected: float) -> None:
    """As in the GUM, 7.2.6: 100.021 47 g with 0.35 mg is 100.021 47(35) g."""
    assert rounded(value, stderr) == pytest.approx(expected, rel=1e-15)
    assert rounded(value, math.nan) == value
    assert rounded(100.02147123, 0.35e-3) == 100.02147


def test_comments_and_order_stay_where_effects_change(sheet: Path, tmp_path: Path) -> None:
    axis = Design.read(sheet)
    found = axis.replace_effects(
        (axis.effects[0].model_copy(update={"parameters": {"F_c": 0.0712}, "stderr": {"F_c": 0.0003}}), axis.effects[1])
    ).with_effect("constant_load", {"T_0": 0.01}, {"T_0": 0.002})
    assert changes(found, sheet, tmp_path / "new.toml") == [
        "- F_c = 0.08   # as assumed", "+ F_c = 0.0712   # as assumed", "+ stderr = {F_c = 0.0003}",
        "+ ", "+ [[effects]]", '+ id = "constant_load"', "+ T_0 = 0.01", "+ stderr = {T_0 = 0.002}",
    ]  # fmt: skip


def test_an_effect_that_goes_takes_nothing_with_it(sheet: Path, tmp_path: Path) -> None:
    found = Design.read(sheet).without_effect("coulomb")
    lines = changes(found, sheet, tmp_path / "new.toml")
    assert {"- F_c = 0.08   # as assumed", '- id = "coulomb"'} <= set(lines)
    assert not any("viscous" in line or "F_v" in line or "plate" in line for line in lines)


def test_datasheet_fields_stay(sheet: Path, tmp_path: Path) -> None:
    axis = Design.read(sheet)
    psi_f = axis.motor.psi_f
    assert psi_f is not None
    found = axis.replace(motor={"psi_f": 1.1 * psi_f, "R": 0.6, "L_d": 4e-3, "L_q": 4e-3})
    assert changes(found, sheet, tmp_path / "new.toml")[1::2] == [
        "+ K_t_rms = 1.606", "+ R_line_to_line = 1.2", "+ L_line_to_line_mH = 8.0     # both axes",
    ]  # fmt: skip
    apart = axis.replace(motor={"L_q": 4e-3})
    lines = changes(apart, sheet, tmp_path / "other.toml")
    assert [line for line in lines if "L_" in line and line[0] == "+"] == ["+ L_d = 0.0038", "+ L_q = 0.004"]


def test_a_comment_stays_above_what_follows_the_effects(tmp_path: Path) -> None:
    old = DESIGNS / "seed_motor.toml"
    lines = changes(Design.read(old).with_effect("constant_load", {"T_0": 0.01}), old, tmp_path / "new.toml")
    assert [line for line in lines if line.strip("+ ")] == ["+ [[effects]]", '+ id = "constant_load"', "+ T_0 = 0.01"]
    text = (tmp_path / "new.toml").read_text(encoding="utf-8")
    assert "checks them.\n[[acceptance]]" in text


def test_tables_are_added_behind(sheet: Path, tmp_path: Path) -> None:
    loops = {"current": {"K_p": 2.0, "T_n": 1e-3}, "speed": {"K_p": 0.1, "T_n": 1e-2}, "position": {"K_v": 10.0}}
    lines = changes(Design.read(sheet).replace(loops=loops), sheet, tmp_path / "new.toml")
    assert all(line[0] == "+" for line in lines)
    assert "+ [loops.current]" in lines


@pytest.mark.parametrize(
    "text",
    [
        "motor.J = 1e-4\nmotor.K_t = 1.0\neffects = [{id = 'coulomb', F_c = 0.02}] # inline\n",
        "motor = {J = 1e-4, K_t = 1.0}\n[[effects]]\nid = 'coulomb'\nF_c = 0.02\n",
        "[assumed]\nK_t_rms = 1.0\n[motor]\nJ_g_cm2 = 1000\nK_t = 1.0\n[log]\n[motor.tolerance]\nJ = 0.2\n",
        SHEET.replace("\n", "\r\n"),
    ],
)
def test_any_style_is_written_as_the_same_design(text: str, tmp_path: Path) -> None:
    path = tmp_path / "old.toml"
    path.write_bytes(text.encode())
    axis = Design.read(path)
    found = axis.with_parameters(J=2.5e-4).with_effect("viscous", {"F_v": 3e-4}).with_effect("coulomb", {"F_c": 0.03})
    found = found.replace(assumed={"K_t": 1.3})
    again = Design.read(found.write(tmp_path / "new.toml"))
    assert math.isclose(again.J, 2.5e-4, rel_tol=1e-14)
    assert [(e.id, e.parameters) for e in again.effects] == [(e.id, e.parameters) for e in found.effects]
    assert again.K_t_assumed == pytest.approx(1.3, rel=1e-14)
