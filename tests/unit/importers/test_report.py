"""The import report: what it says, the table that reproduces it, and the delays it finds."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers import describe, read_log
from pmsm_ctrl.importers.delays import delays, lag
from pmsm_ctrl.log import Log
from tests.effort import slow

PLAIN = {"motor": {"J": 1e-4, "K_t": 1.0}}


def reproduce(path: Path, tmp_path: Path, motion: str = "rotary") -> None:
    """The table of the report, put into a design, must read the same log without a guess."""
    report = describe(path)
    toml = tmp_path / "design.toml"
    toml.write_text(f'motion = "{motion}"\n{report.table}\n[motor]\nJ = 1e-4\nK_t = 1.0\n', encoding="utf-8")
    again = read_log(path, Design.read(toml))
    assert not any("guessed" in note or "assumed" in note for note in again.provenance.notes)
    assert list(again) == list(report.log)
    for name in again:
        assert again[name].tobytes() == report.log[name].tobytes()


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    return path


FILES = {
    "guessed": "Time (ms);Position (°);Velocity [rpm];Iq\n0;0;0;1,5\n1;1,5;2;3\n2;3;2;3\n",
    "same names": "t;x;x;theta [deg];Iq\n0;1;2;3;4\n1;1;2;3;4\n2;1;2;3;5\n",
    "blanks in names": "Time Stamp [s],Actual Position [deg],Motor Torque [mNm]\n0,1,2\n1,2,3\n2,3,4\n",
    "groups": "Time [ms];Position;Time [s];Iq\n0;0;0;1\n1;1;0,001;2\n2;2;0,002;3\n3;3;;\n",
    "slashes": "t / s\tspeed / min-1\ttorque / Nm\n0\t1\t2\n1\t2\t3\n2\t3\t4\n",
    "canonical": "t [s],theta [rad],i_q [A]\n0,1,2\n1,2,3\n",
    "linear": "t [s],theta [m],torque [N],i_d [A]\n0,1,2,4\n1,2,3,4\n",
}


@pytest.mark.parametrize("name", FILES)
def test_the_table_reproduces_the_log(tmp_path: Path, name: str) -> None:
    reproduce(write(tmp_path, FILES[name]), tmp_path, "linear" if name == "linear" else "rotary")


def test_the_table_keeps_a_clock(tmp_path: Path) -> None:
    path = write(tmp_path, "Position;Iq\n1;2\n2;3\n")
    assert 't = "every 0.125 ms"' in describe(path, mapping={"t": "every 0.125 ms"}).table


@pytest.mark.parametrize(
    "scenario", ["identification", "positioning", *map(slow, ("triangle", "trapezoid", "reversal"))]
)
def test_simulated_logs_raise_no_doubt_and_show_the_speed_filter(tmp_path: Path, designs: Path, scenario: str) -> None:
    from pmsm_ctrl.simulate import simulate

    design = Design.read(designs / "seed_motor.toml")
    report = describe(simulate(design, scenario).write_csv(tmp_path / "log.csv"), design)
    assert report.warnings == ()
    assert report.velocity[0] == pytest.approx(1.0, abs=0.02)
    (delay,) = report.delays
    assert delay.seconds == pytest.approx(design.sensor.speed_filter, abs=1e-4)


def test_the_table_keeps_a_scale(tmp_path: Path) -> None:
    design = Design.from_dict(PLAIN | {"log": {"channels": {"t": "a [ms]", "theta": "b [inc]", "torque": "c [V]"},
                                               "scale": {"theta": 1e-3, "torque": 35.15}}})  # fmt: skip
    path = write(tmp_path, "a,b,c\n0,1,2\n1,2,3\n2,3,4\n")
    report = describe(path, design)
    again = Design.from_dict(PLAIN | {"log": __import__("tomllib").loads(report.table)["log"]})
    for name in report.log:
        assert read_log(path, again)[name].tobytes() == report.log[name].tobytes()
    assert report.log["theta"].tolist() == [0.001, 0.002, 0.003]


def _filtered(rng: np.random.Generator, n: int = 6000) -> dict[str, np.ndarray]:
    t = np.arange(n) * 1e-3
    phases = rng.uniform(0, 2 * np.pi, 8)
    rates = 2 * np.pi * np.linspace(0.7, 15, 8)

    def omega(at: np.ndarray) -> np.ndarray:
        return sum(20 * np.cos(w * at + p) for w, p in zip(rates, phases, strict=True))

    def theta(at: np.ndarray) -> np.ndarray:
        return sum(20 / w * np.sin(w * at + p) for w, p in zip(rates, phases, strict=True))

    def current(at: np.ndarray) -> np.ndarray:
        return sum(np.cos(w * at + 2 * p) for w, p in zip(rates, phases, strict=True))

    return {"t": t, "theta": theta(t), "omega": omega(t - 0.0023), "i_q": current(t), "torque": 2 * current(t + 0.0017)}


def test_delays_to_a_fraction_of_a_sample(rng: np.random.Generator) -> None:
    channels = _filtered(rng)
    channels["omega"] = channels["omega"] + rng.normal(0, 0.5, 6000)
    found = {(d.later, d.earlier): d for d in delays(Log(channels))}
    assert found["omega", "dtheta/dt"].seconds == pytest.approx(0.0023, abs=5e-5)
    assert found["torque", "i_q"].seconds == pytest.approx(-0.0017, abs=5e-5)


def test_no_delay_between_strangers(rng: np.random.Generator) -> None:
    assert lag(rng.normal(size=4000), rng.normal(size=4000)) is None
    assert lag(np.zeros(100), np.ones(100)) is None


def test_report_says_everything(rng: np.random.Generator, tmp_path: Path) -> None:
    channels = _filtered(rng)
    channels["omega"] = channels["omega"] / 1.66
    path = Log(channels).write_csv(tmp_path / "log.csv")
    report = describe(path, Design.from_dict({"motor": {"J": 1e-4, "K_t": 2.0}}))
    assert report.velocity[0] == pytest.approx(1.66, rel=0.01)
    assert report.torque[0] == pytest.approx(1.0, rel=0.02)
    assert report.notices[0].detail["factor"] == pytest.approx(1.66, rel=0.01)
    text = report.summary()
    for words in (
        "warning: dtheta/dt is 1.6",
        "[speed_factor]",
        "rate 1000 Hz",
        "gaps 0",
        "separator comma",
        "delay of omega",
    ):
        assert words in " ".join(text.split())
    assert text.index("warning") < text.index("rate")
    data = json.loads(json.dumps(report.to_dict()))
    assert data["schema"] == "pmsm-ctrl/import/1"
    assert data["channels"]["omega"]["how"] == "canonical"
    assert len(report.plot().axes) == 4
    assert data["warning_codes"][0] == "speed_factor"
    assert len(data["warnings"]) == len(data["warning_codes"])


def test_one_sample_has_a_report(tmp_path: Path) -> None:
    report = describe(write(tmp_path, "t [s],theta [rad],i_q [A]\n0,1,2\n"))
    assert math.isnan(report.base.period)
    assert "too few samples: 1" in report.summary()
    json.dumps(report.to_dict())
    report.plot()


def test_measured_files(measured, designs: Path, tmp_path: Path) -> None:
    report = describe(measured("emps/DATA_EMPS.mat"), Design.read(designs / "emps.toml"))
    assert "torque = 35.15" in report.table
    path = measured("laas_mn4004/acc_current.txt")
    steps = {c.channel: c.quantum for c in describe(path).channels}
    assert steps["theta"] == pytest.approx(2 * np.pi / 20000, rel=1e-3)  # its encoder has 20000 counts
    assert steps["i_q"] == pytest.approx(2.0**-10, rel=1e-3)
    reproduce(path, tmp_path)


@pytest.mark.parametrize("counts", [2000, 131072])
@pytest.mark.parametrize("late", [0.5e-3, 1.3e-3])
def test_neither_noise_nor_a_coarse_encoder_changes_a_delay(rng: np.random.Generator, counts: int, late: float) -> None:
    t = 1e-3 * np.arange(8000)
    step = 2 * np.pi / counts

    def speed(t: np.ndarray) -> np.ndarray:
        return 40 * np.pi * np.sin(np.pi * t) + 18 * np.pi * np.cos(6 * np.pi * t)

    theta = np.round((40 * (1 - np.cos(np.pi * t)) + 3 * np.sin(6 * np.pi * t)) / step) * step
    for noise in (0.0, 1.0, 3.0):
        omega = speed(t - late) + rng.normal(0, noise, t.size)
        (found,) = delays(Log({"t": t, "theta": theta, "omega": omega}))
        assert found.seconds == pytest.approx(late, abs=1e-5 + 5e-5 * noise)


def test_a_delay_beyond_the_jitter_of_the_time_stamps_is_told(rng: np.random.Generator) -> None:
    t = 0.01 * np.arange(3000)
    omega = np.sin(1.3 * t) + 0.6 * np.sin(2.9 * t)
    theta = -np.cos(1.3 * t) / 1.3 - 0.6 * np.cos(2.9 * t) / 2.9
    stamps = t + rng.uniform(-0.002, 0.002, t.size)
    late = np.interp(t - 0.15, t, omega)
    (found,) = delays(Log({"t": stamps, "theta": theta, "omega": late}))
    assert found.seconds == pytest.approx(0.15, abs=0.002)
    assert delays(Log({"t": stamps, "theta": theta, "omega": omega})) == ()
