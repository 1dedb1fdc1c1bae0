"""Reading logs: the canonical file, foreign text files, mapping, and every kind of bad input."""

from __future__ import annotations

import errno
import io
import math
import os
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.importers.folders import log_files
from pmsm_ctrl.log import Log

GOOD = "t [s],theta [rad],i_q [A]\n0,0,1\n0.001,0.1,2\n0.002,0.2,3\n0.003,0.3,2\n"


def design(log: dict | None = None, **parts: object) -> Design:
    return Design.from_dict({"motor": {"J": 1e-4, "K_t": 1.0}, "log": log or {}, **parts})


def write(tmp_path: Path, text: str | bytes, name: str = "log.csv") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_canonical_file_reads_without_notes(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, GOOD))
    assert list(log) == ["t", "theta", "i_q"]
    assert log["theta"].tolist() == [0.0, 0.1, 0.2, 0.3]
    assert log.provenance.notes == ()
    assert log.provenance.importer == "canonical CSV"
    assert len(log.provenance.sha256) == 64


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_written_log_reads_back_bit_for_bit(tmp_path: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    n = 500
    channels = {
        "t": np.cumsum(random.uniform(1e-4, 1e-3, n)),
        "theta": random.normal(size=n) * 10.0 ** random.integers(-300, 300, n),
        "i_q": random.normal(size=n) * 5e-324 * 10.0 ** random.integers(0, 20, n),
    }
    log = Log(channels)
    again = read_log(log.write_csv(tmp_path / "log.csv"))
    for name in channels:
        assert again[name].tobytes() == log[name].tobytes()


def test_linear_axis_is_known_from_its_units(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, GOOD.replace("[rad]", "[m]").replace("i_q [A]", "torque [N]")))
    assert log.motion == "linear"
    assert log.unit("torque") == "N"


def test_canonical_file_needs_no_table(tmp_path: Path) -> None:
    foreign = design({"channels": {"t": "Zeit", "theta": "Lage [deg]", "i_q": "Strom"}, "scale": {"i_q": 2.0}})
    log = read_log(write(tmp_path, GOOD), foreign)
    assert log["i_q"].tolist() == [1.0, 2.0, 3.0, 2.0]
    assert any("not needed" in note for note in log.provenance.notes)


AMPERES = "t [s],theta [rad],torque [N m],i_q [A]\n0,0,5,1\n0.001,0.1,6,2\n0.002,0.2,7,3\n0.003,0.3,8,2\n"


@pytest.mark.parametrize(
    ("header", "log", "factor"),
    [
        ("i_q [A]", {"scale": {"i_q": 1.1}}, 1.1),
        ("i_q [A]", {"channels": {"i_q": "1.1 * i_q"}}, 1.1),
        ("i_q [A peak]", {"channels": {"i_q": "1.1 * i_q [A peak]"}}, 1.1),
        ("i_q [A]", {"channels": {"i_q": "-I_q [A]"}, "scale": {"i_q": 2.0}}, -2.0),
        ("i_q [A]", {"channels": {"theta": "Lage [deg]", "i_q": "1.1 * i_q [A]"}, "scale": {"theta": 3.0}}, 1.1),
        ("i_q [A]", {"channels": {"t": "every 2 ms", "theta": "#4 [deg]", "i_q": "1.1 * #3 [A]"}}, 1.1),
        ("i_q [A peak]", {"channels": {"i_q": "i_q [A rms]"}}, math.sqrt(2.0)),
    ],
)
def test_what_a_design_states_of_a_canonical_column_acts(tmp_path: Path, header: str, log: dict, factor: float) -> None:
    found = read_log(write(tmp_path, GOOD.replace("i_q [A]", header)), design(log))
    np.testing.assert_allclose(found["i_q"], factor * np.array([1.0, 2.0, 3.0, 2.0]), rtol=1e-15)
    assert found["theta"].tolist() == [0.0, 0.1, 0.2, 0.3], "its column is one of another file"
    assert found.t[1] == 0.001
    assert any(f"factor {factor:.9g}" in note for note in found.provenance.notes)


@pytest.mark.parametrize(
    "log",
    [
        {"channels": {"t": "#1 [ms]", "theta": "#2 [deg]", "i_q": "#3 [A]", "torque": "#9"}},
        {"channels": {"theta": "theta [deg]", "i_q": "torque"}, "scale": {"theta": 2.0, "i_q": 0.01}},
        {"channels": {"i_q": "torque [%]", "torque": "i_q"}, "scale": {"i_q": 0.01}},
        {"channels": {"t": "tick", "i_q": "i_q [A rms]"}, "rate": 500.0},
    ],
)
def test_the_table_of_other_files_does_not_act_on_a_log_of_the_package(tmp_path: Path, log: dict) -> None:
    found = read_log(write(tmp_path, AMPERES), design(log))
    plain = read_log(write(tmp_path, AMPERES))
    assert {name: values.tolist() for name, values in found.items()} == {
        name: values.tolist() for name, values in plain.items()
    }


def test_a_unit_that_the_file_states_otherwise_is_doubted(tmp_path: Path) -> None:
    found = read_log(write(tmp_path, GOOD), design({"channels": {"i_q": "i_q [A rms]"}}))
    (notice,) = (one for one in found.provenance.notices if one.code == "other_unit")
    assert "the file states [A], the design's [log] table [A rms]" in notice.text
    assert "--map 'i_q=i_q [A rms]'" in notice.text


FOREIGN = "Zeit;n;Strom\n0,0;0,0;1,5\n1,0;60,0;1,6\n2,0;120,0;1,7\n3,0;240,0;1,8\n"


def test_semicolon_and_decimal_comma_with_mapping(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, FOREIGN), mapping={"t": "Zeit [ms]", "omega": "n [rpm]", "i_q": "Strom [A rms]"})
    np.testing.assert_allclose(log.t, [0, 0.001, 0.002, 0.003], rtol=1e-15)
    np.testing.assert_allclose(log["omega"], np.array([0, 60, 120, 240]) * 2 * math.pi / 60, rtol=1e-15)
    np.testing.assert_allclose(log["i_q"], np.sqrt(2.0) * np.array([1.5, 1.6, 1.7, 1.8]), rtol=1e-15)
    notes = " | ".join(log.provenance.notes)
    assert "semicolon" in notes
    assert "comma" in notes
    assert "omega mapped from 'n' [rpm], factor 0.104719755" in notes


def test_design_table_with_scale_and_mapping_on_top(tmp_path: Path) -> None:
    table = design({
        "channels": {"t": "Zeit [ms]", "omega": "n [rad/s]", "torque": "Strom [A]"},
        "scale": {"torque": 0.5}, "separator": ";", "decimal": ",",
    })  # fmt: skip
    log = read_log(write(tmp_path, FOREIGN), table)
    np.testing.assert_allclose(log["torque"], [0.75, 0.8, 0.85, 0.9], rtol=1e-15)
    again = read_log(write(tmp_path, FOREIGN), table, {"omega": "n [rpm]"})
    assert again["omega"][1] == pytest.approx(2 * math.pi, rel=1e-15)


def test_guesses_are_stated(tmp_path: Path) -> None:
    text = "Time (ms), Actual Position, Velocity [rpm], Iq, Comment\n0, 0, 0, 1, 2\n1, 1, 2, 3, 4\n2, 1, 2, 3, 4\n"
    log = read_log(write(tmp_path, text))
    notes = log.provenance.notes
    assert log.t.tolist() == [0.0, 0.001, 0.002]
    assert "theta guessed from 'Actual Position' [rad], unit assumed" in notes
    assert any(note.startswith("omega guessed from 'Velocity [rpm]' [rpm], factor 0.1047") for note in notes)
    assert "not used: Comment" in notes


def test_column_by_number_and_no_header(tmp_path: Path) -> None:
    log = read_log(
        write(tmp_path, "0 1 5\n1 2 6\n2 3 7\n", "log.dat"), mapping={"t": "#1 [ms]", "theta": "#2 [deg]", "i_q": "#3"}
    )
    assert log["i_q"].tolist() == [5.0, 6.0, 7.0]
    assert log["theta"][0] == pytest.approx(math.pi / 180)


def test_units_row_and_preamble(tmp_path: Path) -> None:
    text = "Scope export\nDate: 2024-05-01\n\nTime;Speed;Iq\nms;1/min;A\n0;0,5;1\n1;0,6;1\n2;0,7;2\n"
    log = read_log(write(tmp_path, text))
    assert log.t[1] == 0.001
    assert log["omega"][0] == pytest.approx(0.5 * math.pi / 30)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_encodings_and_line_ends(tmp_path: Path, encoding: str, ending: str) -> None:
    text = "Zeit [s];Lage [°];Strom\n0;180;1\n1;360;2\n2;360;3\n".replace("\n", ending)
    log = read_log(write(tmp_path, text.encode(encoding)), mapping={"i_q": "Strom [A]", "theta": "Lage"})
    np.testing.assert_allclose(log["theta"], [math.pi, 2 * math.pi, 2 * math.pi])


def test_text_column_is_left_out(tmp_path: Path) -> None:
    text = "t [s],theta [rad],state,i_q [A]\n0,0,RUN,1\n1,1,RUN,2\n2,2,HOLD,3\n"
    log = read_log(write(tmp_path, text))
    assert log["i_q"].tolist() == [1.0, 2.0, 3.0]
    assert "text columns not used: 'state'" in log.provenance.notes


def test_wrapped_angle_is_unwrapped_and_said_so(tmp_path: Path) -> None:
    theta = np.linspace(0, 20, 400)
    log = Log({"t": np.arange(400) * 1e-3, "theta": theta % (2 * np.pi), "i_q": np.sin(theta)})
    again = read_log(log.write_csv(tmp_path / "log.csv"))
    np.testing.assert_allclose(again["theta"], theta, atol=1e-12)
    assert any("unwrapped" in note for note in again.provenance.notes)


# what is wrong -> (content, words that must be in the message)
BAD: dict[str, tuple[str | bytes, tuple[str, ...]]] = {
    "empty": ("", ("empty",)),
    "blank": (" \n\n", ("empty",)),
    "header only": ("t [s],theta [rad],i_q [A]\n", ("line 1", "no row of numbers")),
    "nan": (GOOD.replace("0.1,2", "nan,2"), ("line 3", "column 2", "theta", "finite")),
    "infinity": (GOOD.replace("0.1,2", "inf,2"), ("line 3", "column 2", "theta", "finite")),
    "too large": (GOOD.replace("0.1,2", "1e999,2"), ("line 3", "column 2", "theta", "finite")),
    "empty cell": (GOOD.replace("0.1,2", ",2"), ("line 3", "column 2", "empty")),
    "text in a cell": (GOOD.replace("0.2,3", "0.2,abc"), ("line 4", "column 3", "'abc'", "number was expected")),
    "text in the first row": (GOOD.replace("0,0,1", "0,abc,1"), ("line 2", "column 2", "'abc'")),
    "underscore": (GOOD.replace("0.2,3", "0.2,1_0"), ("line 4", "column 3", "'1_0'")),
    "nan time": (GOOD.replace("0.001,", "nan,"), ("line 3", "column 1", "a time was expected")),
    "backwards": (GOOD.replace("0.002,", "0.0005,"), ("line 4", "column 1", "time runs backwards")),
    "duplicate": (GOOD.replace("0.002,", "0.001,"), ("line 4", "column 1", "same time stamp twice")),
    "duplicate after blank lines": (GOOD.replace("0.002,", "\n\n0.001,"), ("line 6", "same time stamp twice")),
    "no time": (GOOD.replace("t [s]", "foo"), ("'t'", "foo")),
    "no position": (GOOD.replace("theta [rad]", "foo"), ("'theta' or 'omega'", "foo")),
    "no torque": (GOOD.replace("i_q [A]", "i_d [A]"), ("'i_q' or 'torque'",)),
    "unknown unit": (GOOD.replace("[rad]", "[furlong]"), ("column 2", "unknown unit [furlong]", "accepted: rad, deg")),
    "unit of another kind": (GOOD.replace("[rad]", "[A]"), ("column 2", "[A] does not fit 'theta'", "rad")),
    "short row": (GOOD.replace("0.2,3", "0.2"), ("line 4", "2 cells", "3 were expected")),
    "long row": (GOOD.replace("0.2,3", "0.2,3,4"), ("line 4", "4 cells", "3 were expected")),
    "junk": (bytes(range(256)) * 4, ("byte 0", "neither text")),
    "damaged mat": (b"MATLAB 5.0 MAT-file" + bytes(200), ("damaged",)),
    "damaged hdf5": (b"\x89HDF\r\n\x1a\n" + bytes(200), ("damaged",)),
    "zip": (b"PK\x03\x04" + bytes(50), ("Excel", "CSV")),
    "pickle": (b"\x80\x04\x95" + bytes(50), ("pickle", "never")),
    "prose": ("this is not\na log at all\n", ("no row of numbers",)),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_content_is_one_clear_line(tmp_path: Path, case: str) -> None:
    content, words = BAD[case]
    path = write(tmp_path, content)
    with pytest.raises(LogError) as caught:
        read_log(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    for word in words:
        assert word in message, message


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"nothing\.csv: no such file"):
        read_log(tmp_path / "nothing.csv")
    with pytest.raises(LogError, match="is a folder"):
        read_log(tmp_path)
    with pytest.raises(LogError, match=r"no such file|cannot be read"):
        read_log("a\0b")
    (tmp_path / "round.csv").symlink_to(tmp_path / "round.csv")
    assert log_files([tmp_path / "round.csv"])  # looked at before the reader is: a link that leads to itself
    with pytest.raises(LogError, match=r"round\.csv: (no such file|cannot be read)"):
        read_log(tmp_path / "round.csv")


def test_a_file_that_breaks_while_it_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "log.csv"
    file.write_text("t,omega\n0,1\n")

    class Broken(io.BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("builtins.open", lambda *given, **named: Broken())
    with pytest.raises(LogError, match=r"log.csv: cannot be read \(Input/output error\)"):
        read_log(file)


@pytest.mark.skipif(not os.path.isfile("/proc/self/mem"), reason="no /proc")
def test_what_the_kernel_makes_up_is_not_read() -> None:
    with pytest.raises(LogError, match="/proc/self/mem: empty"):
        read_log("/proc/self/mem")


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"omegga": "n"}, ("unknown channel 'omegga'", "did you mean 'omega'")),
        ({"omega": "nn"}, ("no column 'nn'", "did you mean 'n'", "Zeit, n, Strom")),
        ({"omega": "#7"}, ("#7", "3 columns")),
        ({"omega": "n [rpx]"}, ("unknown unit [rpx]", "did you mean 'rpm'")),
        ({"omega": "n [A]"}, ("[A] does not fit 'omega'", "rpm")),
        ({"t": "Zeit [m]"}, ("[m] does not fit 't'",)),
    ],
)
def test_bad_mapping(tmp_path: Path, mapping: dict[str, str], words: tuple[str, ...]) -> None:
    complete = {"t": "Zeit", "omega": "n", "i_q": "Strom"} | mapping
    with pytest.raises(LogError) as caught:
        read_log(write(tmp_path, FOREIGN), mapping=complete)
    for word in words:
        assert word in str(caught.value)


def test_a_channel_that_the_design_misspells_is_said_of_the_design(tmp_path: Path, designs: Path) -> None:
    text = (designs / "seed_motor.toml").read_text(encoding="utf-8") + '\n[log.channels]\nomegga = "n [rpm]"\n'
    (tmp_path / "axis.toml").write_text(text, encoding="utf-8")
    with pytest.raises(LogError, match=r"axis.toml: \[log.channels\] of the design names unknown channel 'omegga'"):
        read_log(write(tmp_path, FOREIGN), Design.read(tmp_path / "axis.toml"))


def test_ambiguous_name_asks_for_a_number(tmp_path: Path) -> None:
    text = "t [s],x,x,i_q [A]\n0,1,2,3\n1,1,2,3\n"
    with pytest.raises(LogError, match="'x' appears 2 times; name it by its number: #2 or #3"):
        read_log(write(tmp_path, text), mapping={"theta": "x [rad]"})
    assert read_log(write(tmp_path, text), mapping={"theta": "#3 [rad]"})["theta"][0] == 2.0


def test_per_mille_of_rated_torque_needs_a_factor(tmp_path: Path) -> None:
    """CiA 402 gives torque in per mille of the rated torque, which only the design knows."""
    text = "Time [s];Velocity actual value [rpm];Torque actual value [‰]\n0;1;100\n1;2;200\n2;3;300\n"
    path = write(tmp_path, text)
    with pytest.raises(
        LogError, match=r"'Torque actual value \[‰\]' would be 'torque', but its unit \[‰\] does not fit"
    ):
        read_log(path)
    with pytest.raises(
        LogError, match=r"unit \[‰\] for 'torque': a share of the rated value: .*or a factor in \[log.scale\]"
    ):
        read_log(path, mapping={"torque": "Torque actual value"})
    table = design({
        "channels": {"t": "Time", "omega": "Velocity actual value", "torque": "Torque actual value"},
        "scale": {"torque": 0.0024},
    })  # fmt: skip
    assert read_log(path, table)["torque"].tolist() == [0.24, 0.48, pytest.approx(0.72)]


def test_a_guessed_extra_of_unknown_unit_does_not_stop_the_import(tmp_path: Path) -> None:
    log = read_log(write(tmp_path, "t [s],theta [rad],i_q [A],Motor temp [foo]\n0,1,2,3\n1,2,3,4\n2,2,3,4\n"))
    assert list(log) == ["t", "theta", "i_q"]
    assert "not used: Motor temp [foo]" in log.provenance.notes


def test_a_line_without_end_is_refused_soon(tmp_path: Path) -> None:
    path = tmp_path / "long.csv"
    with open(path, "wb") as stream:
        stream.write(b"t [s],theta [rad],i_q [A]\n0,1,2\n1,2,3\n")
        for _ in range(40):
            stream.write(b"1" * (1 << 20))
    with pytest.raises(LogError, match="a line longer than 16 MB"):
        read_log(path)


def test_twenty_thousand_columns(tmp_path: Path) -> None:
    names = [f"x{k}" for k in range(20000)]
    text = ",".join(["t [s]", "theta [rad]", *names, "i_q [A]"]) + "\n"
    text += "".join(",".join([str(k), *["1"] * 20002]) + "\n" for k in range(3))
    log = read_log(write(tmp_path, text))
    assert list(log) == ["t", "theta", "i_q"]
    assert max(map(len, log.provenance.notes)) < 500


@pytest.mark.parametrize("spec", ["every 0.125 ms", "every 125us", "EVERY 0,000125 s"])
def test_a_file_without_time_gets_a_clock(tmp_path: Path, spec: str) -> None:
    text = "Position [deg];Iq [A]\n" + "".join(f"{k},5;{k % 3}\n" for k in range(50))
    log = read_log(write(tmp_path, text), mapping={"t": spec})
    np.testing.assert_allclose(log.t, 0.000125 * np.arange(50), rtol=1e-15)
    assert log["i_q"][4] == 1.0


@pytest.mark.parametrize(
    "spec", ["every 0 ms", "every -1 ms", "every x ms", "every 1 A", "every nan s", "every 1e999 s"]
)
def test_a_clock_without_a_period(tmp_path: Path, spec: str) -> None:
    with pytest.raises(LogError, match=r"a period such as 'every 0.125 ms' was expected"):
        read_log(write(tmp_path, "Position;Iq\n1;2\n2;3\n"), mapping={"t": spec})


def test_no_time_says_how_to_give_one(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"no channel 't'.* or 'every 1 ms'"):
        read_log(write(tmp_path, "Position;Iq\n1;2\n2;3\n"))


def test_everything_that_is_missing_is_said_at_once(tmp_path: Path) -> None:
    with pytest.raises(LogError) as caught:
        read_log(write(tmp_path, "a,b\n0,1\n1,2\n2,3\n"))
    message = str(caught.value)
    for word in (
        "no channel 't'",
        "no 'theta' or 'omega'",
        "no 'i_q' or 'torque'",
        "found the columns a, b",
        "torque = ",
    ):
        assert word in message
