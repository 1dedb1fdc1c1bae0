"""The exported tracker: C and Structured Text do what the compiled twin does, over everything that can happen."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export import export, export_files
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import Scenario, simulate
from pmsm_ctrl.track import Settings, model
from pmsm_ctrl.track.inputs import samples_of
from pmsm_ctrl.track.settings import numbers
from pmsm_ctrl.track.tracking import Filtered, filter_samples
from tests.effort import amount, slow
from tests.unit.export.structured_text import FunctionBlock, parsed, parsed_library, parsed_tcpou
from tests.unit.track.tracking_axes import step_of_F_c

FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion", "-Wshadow", "-shared", "-fPIC")
VARIANTS = {
    "angle": Settings(estimate=()),
    "speed": Settings(measure="omega", estimate=()),
    "load and inertia": Settings(estimate=("T_load", "J")),
    "speed, load and inertia": Settings(measure="omega", estimate=("T_load", "J"), standstill=2.0),
}


@pytest.fixture(scope="module")
def design(request: pytest.FixtureRequest) -> Design:
    """Return the reference motor with effects whose torque the tracker is told."""
    seed = Design.read(request.config.rootpath / "designs" / "seed_motor.toml")
    return seed.with_effect("cogging", {"a_s": 0.004, "a_c": -0.002, "order": 24.0}).with_effect(
        "stribeck", {"dF_s": 0.01, "w_s": 5.0, "delta": 1.5}
    )


@pytest.fixture(scope="module")
def log(design: Design) -> Log:
    """Return a log with reversals, standstill, constant speed, a step of friction, and damage of every kind."""

    def references(t: np.ndarray) -> dict[str, np.ndarray]:
        wave = np.where(t < 3.0, 100.0 * np.sin(3.0 * t), 0.0) + np.where(t > 3.6, 60.0 * np.sin(4.0 * (t - 3.6)), 0.0)
        return {"omega_ref": np.where(t > 6.2, 60.0 * np.sin(4.0 * 2.6), wave)}

    truth = design.with_own_effects(step_of_F_c).with_effect("step_of_F_c", {"dF_c": 0.012, "t_0": 5.0})
    whole = simulate(design, Scenario("all", 14.5, references), truth=truth, seed=3)
    rng = np.random.default_rng(7)
    channels = {name: values.copy() for name, values in whole.channels.items()}
    for name in ("theta", "i_q", "omega"):
        channels[name][rng.integers(10, len(whole), 15)] = np.nan
    channels["theta"][2000:] += 0.7
    channels["omega"][2000] += 50.0
    channels["theta"][2700:2703] += 2e-3
    channels["t"][5500:] += 0.5
    channels["t"][1500] = channels["t"][1499]
    keep = np.flatnonzero(rng.random(len(whole)) > 0.01)
    return Unchecked({name: values[keep] for name, values in channels.items()}, whole)


class Unchecked:
    """A log that a damaged stream would make; `Log` itself refuses such channels."""

    def __init__(self, channels: dict[str, np.ndarray], like: Log) -> None:
        self.channels, self.provenance = channels, like.provenance

    def __getitem__(self, name: str) -> np.ndarray:
        return self.channels[name]

    def __contains__(self, name: str) -> bool:
        return name in self.channels

    def __len__(self) -> int:
        return len(self.channels["t"])

    @property
    def t(self) -> np.ndarray:
        return self.channels["t"]


def twin(design: Design, log: Any, settings: Settings) -> Filtered:
    """Return what the package's own filter makes of the log."""
    period = design.sensor.log_divider / design.drive.f_control
    samples = samples_of(design, log, settings.measure)
    return filter_samples(design, settings, numbers(design, settings, period), samples)


class CTracker:
    """The exported C, compiled with warnings as errors."""

    def __init__(self, design: Design, settings: Settings, folder: Path, precision: str = "double") -> None:
        if shutil.which("gcc") is None:
            pytest.skip("gcc not found: the exported C cannot be compiled")
        files = export_files(design, "c", settings=settings, force=True, precision=precision)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        library = folder / "tracker.so"
        source = folder / "seed_motor_tracker.c"
        single = ["-Wdouble-promotion", "-Wfloat-conversion"] if precision == "single" else []
        subprocess.run(["gcc", *FLAGS, *single, str(source), "-o", str(library), "-lm"], check=True)
        header = files["seed_motor_tracker.h"]
        fields = []
        for kind, name, sizes in re.findall(
            r"^    (double|float|int) (\w+)((?:\[\d+\])*);", header, flags=re.MULTILINE
        ):
            shape: Any = {"double": ctypes.c_double, "float": ctypes.c_float, "int": ctypes.c_int}[kind]
            for size in reversed(re.findall(r"\d+", sizes)):
                shape = shape * int(size)
            fields.append((name, shape))
        structure = type("Tracker", (ctypes.Structure,), {"_fields_": fields})
        self.memory, loaded = structure(), ctypes.CDLL(str(library))
        self.inputs = re.findall(r"^ \* (\w+):", header, flags=re.MULTILINE)
        self.update = loaded.seed_motor_tracker_update
        number = ctypes.c_float if precision == "single" else ctypes.c_double
        self.update.argtypes = [ctypes.POINTER(structure), *[number] * len(self.inputs)]
        loaded.seed_motor_tracker_init(ctypes.byref(self.memory))

    def __call__(self, **inputs: float) -> None:
        self.update(ctypes.byref(self.memory), *(inputs[name] for name in self.inputs))

    def __getitem__(self, name: str) -> Any:
        return getattr(self.memory, name)


def fed(step: Any, inputs: list[str], log: Any) -> dict[str, np.ndarray]:
    """Feed a log sample by sample and return the outputs' history."""
    channels = {"dt_s": np.diff(log.t, prepend=log.t[0] - 1e-3), **log.channels, "T_load": np.zeros(len(log))}
    out: dict[str, list[float]] = {}
    for row in zip(*(channels[name].tolist() for name in inputs), strict=True):
        step(**dict(zip(inputs, row, strict=True)))
        for name in ("F_c", "F_v", "sd_F_c", "sd_F_v", "omega_hat", "event", "innovation", "innovation_variance"):
            out.setdefault(name, []).append(step[name])
    return {name: np.array(values) for name, values in out.items()}


def agree(found: dict[str, np.ndarray], wanted: Filtered, tolerance: float) -> None:
    """Hold outputs against the twin's; errors are relative to the largest value of each."""
    n = len(found["event"])
    expected = {
        "F_c": wanted.estimates[:n, 1],
        "F_v": wanted.estimates[:n, 2],
        "omega_hat": wanted.estimates[:n, 0],
        "sd_F_c": np.sqrt(wanted.variances[:n, 1]),
        "sd_F_v": np.sqrt(wanted.variances[:n, 2]),
        "innovation": np.nan_to_num(wanted.innovations[:n, 0]),
        "innovation_variance": np.nan_to_num(wanted.innovations[:n, 1]),
    }
    assert np.array_equal(found["event"], wanted.events[:n])
    for name, values in expected.items():
        assert np.abs(found[name] - values).max() <= tolerance * np.abs(values).max(), name


@pytest.mark.parametrize("variant", [name if name == "speed, load and inertia" else slow(name) for name in VARIANTS])
def test_c_agrees_with_the_twin_whatever_comes(design: Design, log: Any, tmp_path: Path, variant: str) -> None:
    settings = VARIANTS[variant]
    wanted = twin(design, log, settings)
    if variant == "load and inertia":
        # by default: without load and inertia persistent signs are no change, and the jumps before raise the noise;
        # gating, standstill, constant speed, a NaN, a lost sample, a gap, jumps, a step: all are in the log
        assert {model.EVENTS[e] for e in np.unique(wanted.events)} == set(model.EVENTS)
    tracker = CTracker(design, settings, tmp_path)
    agree(fed(tracker, tracker.inputs, log), wanted, 1e-6)


@pytest.fixture(scope="module")
def counted(design: Design, log: Any, tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Return what the C makes of the whole log with settings of its own choice."""
    tracker = CTracker(design, Settings(), tmp_path_factory.mktemp("counted"))
    return fed(tracker, tracker.inputs, log)


def test_c_tracks_the_step_of_friction(log: Any, counted: dict[str, np.ndarray]) -> None:
    late = log.t > 6.0
    assert np.median(counted["F_c"][late & (log.t < 7.0)]) == pytest.approx(0.0213 + 0.012, rel=0.05)


FLAVOURS: dict[str, Callable[[dict[str, str]], FunctionBlock]] = {
    "iec": lambda files: parsed(files["FB_seed_motor_tracker.st"]),
    "br": lambda files: parsed_library(files, "FB_seed_motor_tracker"),
    "beckhoff": lambda files: parsed_tcpou(files, "FB_seed_motor_tracker"),
}


@pytest.mark.parametrize("variant", ["speed, load and inertia", *(slow(name) for name in VARIANTS if "," not in name)])
@pytest.mark.parametrize("flavour", ["iec", slow("beckhoff"), slow("br")])  # the text of iec, as a library
def test_structured_text_runs_as_the_twin_does(design: Design, log: Any, flavour: str, variant: str) -> None:
    settings = VARIANTS[variant]
    block = FLAVOURS[flavour](export_files(design, "st", flavour=flavour, settings=settings, force=True))
    inputs = [name for name, kind in block.kinds.items() if kind == "input" and name != "restart"]
    named = {"t_load": "T_load"}
    found = fed(block, [named.get(name, name) for name in inputs], log)
    agree(found, twin(design, log, settings), 1e-6)
    before = block["F_c"]
    block(restart=True)
    assert block["F_c"] == design.parameters("coulomb")["F_c"] != before
    block(restart=False)


@pytest.mark.parametrize("variant", ["speed, load and inertia", slow("angle")])
def test_every_variable_has_a_name_a_unit_and_a_use(design: Design, variant: str) -> None:
    c = export(design, "c", part="tracker", settings=VARIANTS[variant])
    st = export(design, "st", part="tracker", settings=VARIANTS[variant])
    declarations = (
        (c, r"^    (?:double|int) (\w+)(?:\[\d+\])*(?: = 0)?;(.*)$", "/*"),
        (c, r"^static const double (\w+) = [^;]+;(.*)$", "/*"),
        (c, r"^    ([A-Z_]+) = \d+,?(.*)$", "/*"),
        (st, r"^    (\w+) : (?:ARRAY\[[^]]+\] OF )?(?:LREAL|INT|BOOL)(?: := [^;]+)?;(.*)$", "(*"),
    )
    for text, pattern, remark in declarations:
        found = re.findall(pattern, text, flags=re.MULTILINE)
        assert len(found) > 4, pattern
        bare = re.sub(r"/\*.*?\*/|\(\*.*?\*\)", "", text, flags=re.DOTALL)
        for name, comment in found:
            assert comment.strip().startswith(remark), name
            assert len(name) <= 32
            assert len(re.findall(rf"\b{name}\b", bare)) > 1, f"{name} is declared and not used"
    for text in (c, st):
        assert not re.search(r"\b(memory|settings)\b *\[", text)
        assert not re.search(r"\b\w+\[(?:[1-9]\d*)(?:, [1-9]\d*)?\] *:?=[^=]", text)  # an element without a name


def test_a_tracker_that_could_not_work_is_refused(design: Design) -> None:
    with pytest.raises(RequestError, match=r"sensor\.current_noise is 0"):
        export(design.replace(sensor={"current_noise": 0.0}), "c", part="tracker")
    loose = design.with_effect("compliance", {"J_load": 4e-5, "k": 15.0, "d": 0.002})
    with pytest.raises(RequestError, match="compliance is not modelled"):
        export(loose, "c", part="tracker")
    with pytest.raises(RequestError, match="name a folder"):
        export(design, "st", part="tracker", flavour="br")
    with pytest.raises(RequestError, match="accepted: compensation, filter, tracker"):
        export(design, "st", part="observer")
    with pytest.raises(RequestError, match="flavours are Structured Text's"):
        export(design, "c", flavour="br")


def test_a_tracker_says_what_its_inputs_are_not_corrected_for(design: Design) -> None:
    wrong = design.with_effect("current_offset", {"o_alpha": 0.02, "o_beta": 0.0}).with_effect("delay", {"tau": 1e-3})
    assert "not corrected for current_offset, delay" in export(wrong, "c", part="tracker")
    assert "not corrected" not in export(design, "c", part="tracker")


def test_a_design_without_pole_pairs_and_known_effects(tmp_path: Path) -> None:
    """The smallest tracker: torque from the torque constant alone."""
    plain = Design.from_dict(
        {
            "name": "seed motor",
            "motor": {"J": 9e-5, "K_t": 1.0},
            "sensor": {"encoder_counts": 131072, "current_noise": 0.004},
            "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 1e-4}],
        }
    )
    tracker = CTracker(plain, Settings(), tmp_path)
    assert tracker.inputs == ["dt_s", "theta", "i_q", "T_load"]
    t = np.arange(0.0, 2.0, 1e-3)
    theta = 10.0 * (1.0 - np.cos(6.0 * t))
    omega, alpha = 60.0 * np.sin(6.0 * t), 360.0 * np.cos(6.0 * t)
    rng = np.random.default_rng(1)
    i_q = 9e-5 * alpha + 0.026 * np.sign(omega) + 1e-4 * omega + 0.004 * rng.standard_normal(t.size)
    step = 2.0 * np.pi / 131072
    log = Log({"t": t, "theta": step * np.round(theta / step), "i_q": i_q})
    found = fed(tracker, tracker.inputs, log)
    agree(found, twin(plain, log, Settings()), 1e-6)
    assert found["F_c"][-1] == pytest.approx(0.026, abs=4.0 * found["sd_F_c"][-1])


DAY = 86400.0  # s


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 6, 7, 8])
def test_single_precision_after_a_day_of_motion(tmp_path: Path, request: pytest.FixtureRequest, seed: int) -> None:
    """Float and double agree to 0.1 % where the motion shows F_c and F_v, and everywhere to 5 % of their errors.

    The angle and the knowledge of a day are set, not run. After a day at 200 rad/s the axis stands at 1.7e7 rad, where
    two floats are 1 or 2 rad apart; the encoder's angle within a turn is all that the tracker needs. By then the
    inertia is known from 10,000 times as much motion. The first log ends at constant speed, which leaves F_v unknown.
    With seed 5 that ignorance ends in a change of friction which lies at its threshold: the float announces it first.
    """
    axis = Design.read(request.config.rootpath / "designs" / "seed_motor.toml")

    def references(t: np.ndarray) -> dict[str, np.ndarray]:
        return {"omega_ref": np.where(t < 6.0, 150.0 * np.sin(2.0 * t), 40.0) * (np.abs(t - 3.5) > 0.3)}

    log = simulate(axis, Scenario("day", 8.0, references), seed=seed)
    later = log.with_channels(theta=np.remainder(log["theta"] + 200.0 * DAY, 2.0 * np.pi))
    found = {}
    for precision in ("double", "single"):
        (tmp_path / precision).mkdir()
        tracker = CTracker(axis, Settings(), tmp_path / precision, precision)
        fed(tracker, tracker.inputs, log)
        covariance = tracker["covariance"]
        for k in range(6):
            for row, column in ((k, model.INERTIA), (model.INERTIA, k)):
                covariance[row][column] *= (log.t[-1] / DAY) ** 0.5
        found[precision] = fed(tracker, tracker.inputs, later)
    exact, rounded = found["double"], found["single"]
    changes = [log.t[one["event"] == model.CHANGE] for one in (exact, rounded)]
    assert np.allclose(*changes, atol=0.05)
    alike = np.array_equal(exact["event"], rounded["event"])
    assert alike or seed == 5
    shown = (log.t > 4.5) & (log.t < 6.0)
    for name in ("F_c", "F_v"):
        apart = np.abs(rounded[name] - exact[name])
        if alike:
            assert (apart / exact[name])[shown].max() < 1e-3, name
            assert (apart / exact[f"sd_{name}"]).max() < 0.05, name
        else:
            assert (apart / exact[f"sd_{name}"])[log.t > 7.5].max() < 0.3, name


@pytest.mark.parametrize(("counts", "apart"), [(1 << 17, 1e-3), (1 << 20, 1e-2)])
@pytest.mark.slow
def test_a_day_that_is_run_in_single_precision_is_that_in_double(
    tmp_path: Path, request: pytest.FixtureRequest, counts: int, apart: float
) -> None:
    """86,400,000 samples in either precision: at two speeds, with rests, while the friction falls by 40 %.

    The bounds are what docs/export.md states; of a finer encoder a difference within a period has fewer digits.
    """
    axis = Design.read(request.config.rootpath / "designs" / "seed_motor.toml")
    axis = axis.replace(sensor={"encoder_counts": counts})
    n, every = amount(3_600_000, 86_400_000), 5000
    numbers_of_axis = np.array([axis.J, axis.K_t, 0.0213, 0.000168, 2.0 * np.pi / counts, 0.004])
    found = {}
    for precision, kind in (("double", "double"), ("single", "float")):
        folder = tmp_path / precision
        folder.mkdir()
        CTracker(axis, Settings(), folder, precision)
        sources = [str(Path(__file__).with_name("day.c")), str(folder / "seed_motor_tracker.c")]
        names = ['-DAXIS="seed_motor_tracker.h"', f"-DNUMBER={kind}", f"-I{folder}"]
        library = folder / "day.so"
        subprocess.run(
            ["gcc", "-std=c99", "-O2", "-shared", "-fPIC", *names, *sources, "-o", library, "-lm"], check=True
        )
        rows = np.zeros((n // every, 6))
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in (numbers_of_axis, rows)]
        ctypes.CDLL(str(library)).day(ctypes.c_long(n), ctypes.c_long(every), *pointers)
        found[precision] = rows
    exact, rounded = found["double"], found["single"]
    assert np.abs(rounded[:, :2] / exact[:, :2] - 1.0).max() < apart
    for name, value in (("double", exact), ("single", rounded)):
        off = (value[:, :2] - value[:, 4:]) / value[:, 2:4]
        assert np.sqrt(np.mean(off[24:] ** 2)) < 1.3, name  # both follow the warm axis


def test_an_angle_within_a_turn_is_as_good_as_one_that_is_counted_on(
    design: Design, log: Any, tmp_path: Path, counted: dict[str, np.ndarray]
) -> None:
    turned = object.__new__(Unchecked)
    turned.channels = {**log.channels, "theta": np.remainder(log["theta"], 2.0 * np.pi)}
    tracker = CTracker(design, Settings(), tmp_path)
    wrapped = fed(tracker, tracker.inputs, turned)
    for name in ("F_c", "F_v", "sd_F_c", "event"):
        assert np.allclose(wrapped[name], counted[name], rtol=1e-6), name
