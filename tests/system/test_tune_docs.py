"""The figures of docs/tuning.md are recomputed."""

from __future__ import annotations

import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.tune.tuning import tune


def rows(text: str) -> dict[str, list[str]]:
    table = {}
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 13 and not cells[0].startswith(("design", "-")):
            table[cells[0]] = cells[1:]
    return table


@pytest.mark.parametrize("name", ["seed_motor", "small_servo", "servo_2kw", "geared_resonant"])
def test_the_table_of_the_four_designs(project_root, name):
    found = tune(Design.read(project_root / "designs" / f"{name}.toml"), prove=False)
    current, speed = found.margins["current"], found.margins["speed"]
    loops = found.loops
    computed = [
        loops.current.K_p, current.crossover, current.phase_margin, 1e3 * found.delays.speed, loops.speed.K_p,
        1e3 * loops.speed.T_n, speed.crossover, speed.phase_margin, speed.sensitivity_peak, found.highest["speed"],
        loops.position.K_v, found.robustness.worst_speed.speed.phase_margin,
    ]  # fmt: skip
    printed = rows((project_root / "docs" / "tuning.md").read_text(encoding="utf-8"))[name]
    for text, value in zip(printed, computed, strict=True):
        decimals = len(text.partition(".")[2])
        # One unit of the last printed digit
        assert float(text) == pytest.approx(value, abs=1.01 * 10.0**-decimals), (name, text)


def test_the_table_of_the_delays(project_root):
    found = tune(Design.read(project_root / "designs" / "seed_motor.toml"), prove=False)
    text = (project_root / "docs" / "tuning.md").read_text(encoding="utf-8")
    lines = {line.split("|")[1].strip(): line.split("|")[2:5] for line in text.splitlines() if line.count("|") == 5}
    names = {"sampled, exact (as it runs)": 0, "continuous, exact": 1, "continuous, none": 2}
    names |= {"continuous, Pade of order 1": 3, "continuous, Pade of order 2": 4}
    for name, index in names.items():
        model = found.delay_models[index].margins
        crossover, phase, gain = (cell.strip() for cell in lines[name])
        assert float(crossover) == pytest.approx(model.crossover, abs=0.06)
        assert float(phase) == pytest.approx(model.phase_margin, abs=0.06)
        if gain != "unlimited":
            assert float(gain) == pytest.approx(model.gain_margin_db, abs=0.01)
