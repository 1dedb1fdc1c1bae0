"""Live tracking: against the tracking of the whole log, and through what happens to streams."""

from __future__ import annotations

import io
import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.cli import main
from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import LogMap
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import Scenario, scenario, simulate
from pmsm_ctrl.track import Alarm, FrictionTracker, Reading, Settings, track, watch
from pmsm_ctrl.track.alarms import Alarms, Window, Windows
from pmsm_ctrl.track.stream import IDLE, REOPENED, follow, lines_of, read_header
from tests.effort import amount, seeds


@pytest.fixture(scope="module")
def seed(designs: Path) -> Design:
    return Design.read(designs / "seed_motor.toml")


@pytest.fixture(scope="module")
def log(seed: Design) -> Log:
    whole = simulate(seed, scenario("triangle", seed, speed=150.0, period=2.0), seed=1).between(0.0, 3.0)
    return Log({name: whole[name] for name in ("t", "theta", "i_d", "i_q")})


@pytest.fixture(scope="module")
def lines(log: Log) -> list[str]:
    rows = np.column_stack([log[name] for name in log]).tolist()
    return ["t [s],theta [rad],i_d [A],i_q [A]\n", *(",".join(map(repr, row)) + "\n" for row in rows)]


def test_a_stream_is_tracked_as_its_whole_log(seed: Design, log: Log, lines: list[str]) -> None:
    """The stream goes through filterpy, the log through its compiled twin, which knows the log's noise besides."""
    settings = Settings(measure="theta", estimate=(), torque_noise=0.006)
    whole = track(seed, log, settings)
    found = watch(seed, lines, settings=settings)
    for name, one in found.estimates.items():
        assert one.value == pytest.approx(whole.estimates[name].value, rel=1e-6)
        assert one.stderr == pytest.approx(whole.estimates[name].stderr, rel=1e-4)
    assert found.samples == len(log)
    assert (found.lost, found.damaged, found.repeated, found.jumps, found.reconnects) == (0, 0, 0, 0, 0)
    assert found.warnings == ()


def test_lost_samples_damaged_lines_and_a_clock_set_back_are_survived_and_told(seed: Design, lines: list[str]) -> None:
    head, rows = lines[0], lines[1:]
    broken = [head, *rows[:1000], *rows[1005:1500], "1.5,garbage\n", rows[1499], REOPENED, head]
    # from here on the clock counts anew
    for row in rows[1500:]:
        t, rest = row.split(",", 1)
        broken.append(f"{float(t) - 1.4!r},{rest}")
    found = watch(seed, broken)
    assert (found.lost, found.damaged, found.jumps, found.reconnects) == (5, 1, 1, 1)
    assert found.repeated == 1
    codes = {notice.code for notice in found.notices}
    assert {"stream_samples_lost", "stream_clock_set_back", "stream_reopened"} <= codes
    estimate = found.estimates["F_c"]
    assert estimate.value == pytest.approx(0.0213, abs=4.0 * estimate.stderr)
    assert np.all(np.diff(found.t) > 0.0)


def test_the_noise_of_a_sensor_that_the_design_does_not_know_is_that_of_the_stream(seed: Design, log: Log) -> None:
    """The steps of an encoder of 12 bits are no accelerations; an axis at rest first shows no step."""
    coarse = 2.0 * np.pi / 4096.0
    still = Log({name: np.zeros(500) if name != "t" else log.period * np.arange(500.0) for name in log})
    stepped = Log({name: np.round(log[name] / coarse) * coarse if name == "theta" else log[name] for name in log})
    unknown = seed.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    shown: list[Reading] = []
    found = watch(unknown, spoken([still, stepped]), show=shown.append, every=0.1)
    assert found.samples == len(still) + len(log)
    assert [one.event for one in shown[:2]] == ["standstill", "standstill"]
    assert found.counts.get("implausible", 0) < 0.01 * found.samples
    assert found.estimates["F_c"].value == pytest.approx(0.0213, abs=3.0 * found.estimates["F_c"].stderr)
    assert found.estimates["F_c"].stderr < 0.1 * 0.0213


def test_an_axis_that_only_turns_fast_is_no_coarse_encoder(seed: Design) -> None:
    """Between 100 and 220 rad/s no two samples are one count apart."""
    motion = Scenario("fast", 4.0, lambda t: {"omega_ref": 160.0 + 60.0 * np.sin(6.0 * t)}, omega_0=160.0)
    log = simulate(seed, motion, seed=2).between(0.5, 4.0)
    unknown = seed.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    found = track(unknown, log, Settings(measure="theta", estimate=()))
    assert found.counts.get("standstill", 0) <= 1  # before the second sample no speed is known
    assert found.estimates["F_c"].value == pytest.approx(0.0213, abs=4.0 * found.estimates["F_c"].stderr)


def spoken(parts: list[Log]) -> list[str]:
    """Return the lines of logs one after another, with German commas, angles in degrees within a turn and mA."""
    said, start = ["t [s];theta [deg];i_q [mA]\n"], 0.0
    for part in parts:
        said += [f"{start + t:.6f};{np.degrees(a % (2.0 * np.pi)):.6f};{1e3 * i:.4f}\n".replace(".", ",")
                 for t, a, i in zip(part.t, part["theta"], part["i_q"], strict=True)]  # fmt: skip
        start += float(part.t[-1]) + part.period
    return said


def test_a_step_of_friction_is_an_alarm(seed: Design) -> None:
    """Four seconds with F_c, four with 1.3 F_c, as if the axis had been restarted with a dry bearing."""
    motion = scenario("triangle", seed, speed=150.0, period=1.0, cycles=4.0)
    dry = seed.with_effect("coulomb", {"F_c": 1.3 * 0.0213}).with_effect("viscous", seed.parameters("viscous"))
    parts = [
        simulate(plant, motion, seed=k).between(0.0, stop) for k, (plant, stop) in enumerate(((seed, 4.0), (dry, 4.0)))
    ]
    heard: list[Alarm] = []
    found = watch(seed, spoken(parts), window=1.0, alarm=heard.append)
    assert tuple(heard) == found.alarms
    (one,) = (alarm for alarm in heard if alarm.parameter == "F_c")
    assert one.kind == "step"
    assert one.earliest <= 4.0 <= one.latest + 0.01
    assert one.t == pytest.approx(4.0, abs=1.0)
    assert one.told <= 7.2
    assert (one.before, one.after) == (pytest.approx(0.0213, rel=0.03), pytest.approx(1.3 * 0.0213, rel=0.03))
    assert "friction_changed" in {notice.code for notice in found.notices}
    assert "F_c" in found.summary()
    json.dumps(found.to_dict())


@pytest.mark.parametrize("k", seeds(0, 1, 2))
def test_a_stream_in_which_nothing_changes_raises_no_alarm(seed: Design, k: int) -> None:
    """The design is wrong in inertia and friction, and does not know of a load."""
    plant = seed.with_parameters(J=1.2 * seed.J).with_effect("coulomb", {"F_c": 0.03})
    plant = plant.with_effect("viscous", seed.parameters("viscous"))  # in the order, and the kernel, of the others
    motion = scenario("triangle", seed, speed=120.0, period=0.9, cycles=float(amount(9, 14)))
    assert watch(seed, spoken([simulate(plant, motion, seed=k)]), window=1.0).alarms == ()


def test_a_standstill_is_no_window(seed: Design, log: Log) -> None:
    """The time that an axis stands still does not count as motion, and its samples are not kept."""
    still = Log({name: np.full(1500, log[name][-1]) if name != "t" else log.period * np.arange(1500.0) for name in log})
    found = Windows(seed, Settings(), log.period, duration=2.0)
    tracker = FrictionTracker(seed, Settings(), period=log.period)
    kept, start = [], 0.0
    for part, turned in ((log, 0.0), (still, 0.0), (log, float(log["theta"][-1]))):
        for t, theta, i_q in zip(part.t, part["theta"], part["i_q"], strict=True):
            event = tracker.update(start + t, theta=theta + turned, i_q=i_q).event
            found.take(tracker.taken, event)
            kept.append(len(found.rows))
        start += float(part.t[-1]) + log.period
    assert max(kept) < 2.5 / log.period
    spans = [one.stop - one.start for one in found.alarms.series["F_v"]]
    assert spans[0] == pytest.approx(2.0, abs=0.1)
    assert 3.5 < spans[1] < 3.6  # the rest of the first motion, 1.5 s of standstill, the beginning of the second


def test_alarms_of_series_that_only_scatter() -> None:
    """Streams of 60 windows with very different errors: at most 5 % alarm, and four standard errors more."""
    alarmed, streams = 0, amount(4, 400)
    for k in range(streams):
        rng, one = np.random.default_rng(k), Alarms()
        for n in range(60):
            stderr = 1e-4 * float(rng.uniform(0.2, 3.0))
            for name in one.series:
                one.add(name, Window(10.0 * n, 10.0 * n + 10.0, 0.02 + stderr * float(rng.standard_normal()), stderr))
            alarmed += bool(told := one.ask())
            if told:
                break
    assert alarmed <= 0.05 * streams + 4 * (streams * 0.05 * 0.95) ** 0.5


def test_ctrl_c_leaves_with_the_last_state(seed: Design, lines: list[str]) -> None:
    def interrupted() -> Iterator[str]:
        yield from lines[:2001]
        raise KeyboardInterrupt

    found = watch(seed, interrupted())
    assert found.samples == 2000
    assert found.estimates["F_c"].stderr < 0.1 * 0.0213


def test_a_growing_file_that_is_cut_and_comes_back(tmp_path: Path, seed: Design, lines: list[str]) -> None:
    path = tmp_path / "growing.csv"

    def write() -> None:
        time.sleep(0.05)
        with open(path, "w", encoding="utf-8") as stream:
            for k in range(0, 1001, 250):
                stream.write("".join(lines[k : k + 250]))
                stream.flush()
                time.sleep(0.02)
        time.sleep(0.1)
        path.unlink()
        path.write_text("".join([lines[0], *lines[1250:2001]]), encoding="utf-8")

    writer = threading.Thread(target=write)
    writer.start()
    found = watch(seed, follow(path, poll=0.02), source=str(path), patience=0.4)
    writer.join()
    assert found.reconnects >= 1
    assert (found.samples, found.damaged) == (2000, 0)


def test_headers(seed: Design) -> None:
    header = read_header("Zeit [ms]\tx [deg]\ti_q [A]\n", {"t": "Zeit [ms]", "theta": "x [deg]"})
    assert header is not None
    assert header.values("1,5\t180,0\t0,25\n") == {"t": 0.0015, "theta": pytest.approx(np.pi), "i_q": 0.25}
    assert header.values("1,5\t180,0\n") is None
    assert read_header("0.1,0.2,0.3\n") is None
    with pytest.raises(LogError, match="a unit that converts"):
        read_header("t [s],theta [V],i_q [A]\n")
    with pytest.raises(LogError, match="no column for torque"):
        read_header("t [s],theta [rad]\n", {"torque": "M [N m]"})
    with pytest.raises(LogError, match="lacks a channel"):
        watch(seed, ["t [s],i_q [A]\n", "0.0,1.0\n"])
    with pytest.raises(LogError, match="no sample came"):
        watch(seed, [IDLE], patience=-1.0)
    assert list(lines_of(io.StringIO("a\n\n b\n"))) == ["a\n", " b\n"]


GERMAN = "Zeit [ms];Lageistwert [°];Istgeschwindigkeit [1/min];Lagesollwert [°];Iq_fbk [A rms]\r\n"


def test_the_table_of_the_design_names_the_columns_of_a_stream(seed: Design) -> None:
    log = LogMap(
        channels={"t": "Zeit [ms]", "i_q": "-2 * Iq_fbk [A rms]", "omega": "#3 [1/min]", "torque": "none [N m]"},
        scale={"omega": 0.5},
    )
    header = read_header(GERMAN, design=log)
    assert header is not None
    values = header.values("2,5;1,0;60,0;1,0;3,0\n")
    expected = {"t": 0.0025, "omega": np.pi, "i_q": -6.0 * np.sqrt(2.0)}
    assert values == {name: pytest.approx(value) for name, value in expected.items()}
    for line in ("Kopfzeile 1;Wert 3\n", "# Messung Achse 7, Zeile 0\n"):
        assert read_header(line, design=log) is None
    over = read_header(GERMAN, {"i_q": "Iq_fbk [A]"}, design=log)
    assert over is not None
    assert over.columns["i_q"] == (4, 1.0)
    own = read_header("t [s],theta [rad],i_q [A]\n", design=log)  # a log of the package
    assert own is not None
    assert set(own.columns) == {"t", "theta", "i_q"}
    assert read_header("t [ms];theta [deg];i_q [A];Lagesollwert [?]\n") is not None  # a column that nothing takes
    counted = read_header("t [ms];theta [Inc];omega [counts/s];i_q [A]\n", counts=1000)
    assert counted is not None
    assert counted.columns["theta"][1] == counted.columns["omega"][1] == pytest.approx(2e-3 * np.pi)
    with pytest.raises(LogError, match="a unit that converts"):
        read_header("t [ms];theta [Inc];i_q [A]\n")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_a_file_in_the_encoding_of_a_drive(tmp_path: Path, seed: Design, encoding: str) -> None:
    path = tmp_path / "log.csv"
    rows = (f"{k},0;{k % 90},0;0,0;0,0;0,5\r\n" for k in range(300))
    path.write_bytes("".join(["Müller;Zeile 3\r\n", GERMAN, *rows]).encode(encoding))
    channels = {"t": "Zeit [ms]", "theta": "Lageistwert [°]", "i_q": "Iq_fbk [A rms]"}
    design = seed.model_copy(update={"log": LogMap(channels=channels)})
    found = watch(design, follow(path, poll=0.01), patience=0.05)
    assert (found.samples, found.damaged) == (300, 0)
    with open(path, "rb") as stream:
        assert watch(design, lines_of(stream)).samples == 300


def test_a_stream_without_samples_says_why(tmp_path: Path, seed: Design) -> None:
    missing = str(tmp_path / "nowhere.csv")
    with pytest.raises(LogError, match=r"nowhere\.csv: no such file; one that grows was expected"):
        watch(seed, follow(missing, poll=0.01), source=missing, patience=0.03)
    with pytest.raises(LogError, match="x: no header in 2 lines; a line of names"):
        watch(seed, ["Kopfzeile 1;Wert 3\n", "0,0;1,0;2,0\n"], source="x")
    with pytest.raises(LogError, match="lines below the header that hold none: 1"):
        watch(seed, ["t [s],theta [rad],i_q [A]\n", "0.0,x,1.0\n"])


def test_the_command(
    tmp_path: Path, designs: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO("".join(lines[:1501])))
    words = ["track", "--design", str(designs / "seed_motor.toml")]
    with pytest.raises(SystemExit) as left:
        main([*words, "--live", "-", "--json", "w.json", "--report", "w.html"])
    assert left.value.code in (0, None)
    said = capsys.readouterr().out
    assert said.count("F_v") >= 2
    data = json.loads(Path("w.json").read_text(encoding="utf-8"))
    assert data["stream"]["samples"] == 1500
    assert data["estimates"]["F_c"]["value"] == pytest.approx(0.0213, rel=0.1)
    for more, told in ([], "neither LOG nor --live"), (["l.csv", "--live", "-"], "excludes LOG"):
        with pytest.raises(SystemExit) as left:
            main([*words, *more])
        assert left.value.code == 2
        assert told in capsys.readouterr().err


@pytest.mark.parametrize("quote", ["", '"'])
def test_a_row_of_units_below_the_names_is_no_damaged_line(seed: Design, lines: list[str], quote: str) -> None:
    """Its units hold, as in a file: the current of this stream is in mA."""
    header, *rows = lines
    names, units = zip(*(cell.strip().rstrip("]").split(" [") for cell in header.split(",")), strict=True)
    place = names.index("i_q")
    scaled = []
    for row in rows[:3000]:
        cells = row.strip().split(",")
        cells[place] = repr(float(cells[place]) * 1e3)
        scaled.append(",".join(cells))
    stated = [f"{quote}{'mA' if name == 'i_q' else unit}{quote}" for name, unit in zip(names, units, strict=True)]
    found = watch(seed, [",".join(names), ",".join(stated), *scaled], source="test")
    known = watch(seed, [header, *rows[:3000]], source="test")
    assert (found.samples, found.damaged) == (known.samples, 0)
    assert found.estimates["F_c"].value == pytest.approx(known.estimates["F_c"].value, rel=1e-6)
