"""Whatever a file holds, the answer is a log or one clear line; never another exception."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, PmsmCtrlError
from pmsm_ctrl.importers import describe, numbers
from pmsm_ctrl.importers.names import guess_channel, split_header, unit_spelling
from pmsm_ctrl.log import CHANNELS, Log
from tests.characters import ANY_CHARACTER
from tests.effort import amount

BOUNDED = settings(
    max_examples=amount(40, 150),
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def judge(content: bytes, mapping: dict[str, str] | None = None, design: Design | None = None) -> Log | None:
    """Read these bytes; check that what comes out is a sound log or one line that names the file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "some.csv"
        path.write_bytes(content)
        before = sorted(Path(folder).iterdir())
        message, log = "", None
        try:
            report = describe(path, design, mapping)
            log = report.log
            report.summary()
            report.to_dict()
        except PmsmCtrlError as error:
            message = str(error)
            assert message.startswith(f"{path}: ")
        assert sorted(Path(folder).iterdir()) == before
    assert "\n" not in message
    assert len(message) < 3000
    if log is not None:
        assert all(np.isfinite(log[name]).all() for name in log)
        assert (np.diff(log.t) > 0).all()
        assert not any("\n" in text for text in (*log.provenance.notes, *log.provenance.warnings))
    return log


MAGIC = [
    b"",
    *(b"MATLAB 5.0 MAT-file, " for _ in range(amount(0, 1))),  # a process each; see test_mat.py
    b"\x89HDF\r\n\x1a\n",
    b"TDSm",
    b"PAR1",
    b"PK\x03\x04",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
]


@BOUNDED
@given(st.sampled_from(MAGIC), st.binary(max_size=400))
def test_any_bytes(magic: bytes, rest: bytes) -> None:
    judge(magic + rest)


@BOUNDED
@given(st.text(ANY_CHARACTER, max_size=300), st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-32"]))
def test_any_text(text: str, encoding: str) -> None:
    judge(text.encode(encoding, errors="ignore"))


HEADS = ["t [s]", "theta [rad]", "i_q [A]", "omega [rpm]", "Time", "Time (ms)", "Position", "Iq", "x", "", "1", "Name",
         "torque [N m]", "torque [furlong]", "t", "#2", "[s]", "theta [°]", "Zeit;", '"q"',
         "SymbolName", "EOF", "Timestamp", "Uhrzeit"]  # fmt: skip
CELLS = [
    *("0", "1", "2", "-1.5", "1e3", "1,5", "nan", "inf", "1e999", "", " ", "abc", '"', '"3"', "EOF", "0x1F", "1_0"),
    *("१", "-", "+", "1e", ".", ",", "5e-324", "1.7976931348623157e308", "12:00:01", "132959733843760000"),
    *("2024-05-17T10:00:00.5Z", "2024-05-17 10:00:01", "17.05.2024 10:00:02,5", "05/06/2024 10:00", "20240517T100000"),
    *("23:59:59.9", "00:00:00.1", "2024-13-01T00:00", "9999-12-31T23:59:59", "0001-01-01T00:00:00"),
]


@st.composite
def tables(draw: st.DrawFn) -> bytes:
    separator = draw(st.sampled_from([",", ";", "\t", " ", "|", ", "]))
    width = draw(st.integers(1, 5))
    lines = [separator.join(draw(st.lists(st.sampled_from(HEADS), min_size=width, max_size=width)))]
    for k in range(draw(st.integers(0, 6))):
        cells = draw(st.lists(st.sampled_from(CELLS), min_size=max(1, width - 1), max_size=width + 1))
        lines.append(separator.join([str(k), *cells][: len(cells)] if draw(st.booleans()) else cells))
    ending = draw(st.sampled_from(["\n", "\r\n", "\r", "\n\n"]))
    return (ending.join(lines) + draw(st.sampled_from(["", ending, "\x1a"]))).encode()


@settings(BOUNDED, max_examples=amount(40, 400))
@given(tables())
@example(b"t [s],theta [rad],i_q [A]\n0,1,2\n1,5e-324,1.7976931348623157e308\n2,-1.7976931348623157e308,3\n")
def test_any_table(content: bytes) -> None:
    judge(content)


@settings(BOUNDED, max_examples=amount(40, 300))
@given(tables())
def test_any_table_on_the_quick_way(monkeypatch: pytest.MonkeyPatch, content: bytes) -> None:
    """The quick parsers must never accept what the twin refuses, nor read it differently."""
    slow = judge(content)
    with monkeypatch.context() as patch:
        patch.setattr(numbers, "NUMPY_FROM", 1)
        patch.setattr(numbers, "PYARROW_FROM", 1)
        quick = judge(content)
    assert (slow is None) == (quick is None)
    if slow is not None and quick is not None:
        assert list(slow) == list(quick)
        assert all(slow[name].tobytes() == quick[name].tobytes() for name in slow)


GOOD = "Time [ms];Position [deg];Velocity [rpm];Iq [A]\n" + "".join(f"{k};{k},5;{k};{k % 3}\n" for k in range(40))


SPECS = ["Time", "Time [s]", "Position", "#2", "#9 [rad]", "Velocity [A]", "Iq [inc]", "[", "#", "#0", "#-1"]
KEYS = st.sampled_from([*CHANNELS, "nonsense"])


@BOUNDED
@given(st.dictionaries(KEYS, st.text(ANY_CHARACTER, max_size=20) | st.sampled_from(SPECS), max_size=4))
def test_any_mapping(mapping: dict[str, str]) -> None:
    judge(GOOD.encode(), mapping)


@BOUNDED
@given(
    st.dictionaries(
        st.sampled_from(["t", "theta", "omega", "torque", "x"]), st.sampled_from(["Time", "#2", "Iq [V]", "y"])
    ),
    st.dictionaries(st.sampled_from(["theta", "torque", "x"]), st.floats(allow_nan=False, allow_infinity=False)),
    st.none() | st.text(ANY_CHARACTER, max_size=2),
    st.none() | st.sampled_from([".", ","]),
)
def test_any_log_table(channels: dict, scale: dict, separator: str | None, decimal: str | None) -> None:
    table = {"channels": channels, "scale": scale} | {
        key: value for key, value in (("separator", separator), ("decimal", decimal)) if value is not None
    }
    try:
        design = Design.from_dict({"motor": {"J": 1.0, "K_t": 1.0}, "log": table})
    except DesignError:
        return
    judge(GOOD.encode(), None, design)


@settings(BOUNDED, max_examples=amount(60, 200))
@given(st.integers(0, len(GOOD) - 1), st.integers(0, 255), st.integers(0, 3))
def test_one_byte_changed(place: int, byte: int, drop: int) -> None:
    content = GOOD.encode()
    judge(content[:place] + bytes([byte]) + content[place + drop :])


@BOUNDED
@given(st.text(ANY_CHARACTER, max_size=30))
def test_any_header_cell(cell: str) -> None:
    name, unit = split_header(cell)
    assert len(name) <= len(cell)
    guess_channel(name)
    unit_spelling(unit)


FLOATS = st.floats(allow_nan=False, allow_infinity=False)


@BOUNDED
@given(st.lists(st.tuples(FLOATS, FLOATS), min_size=1, max_size=60))
@example([(1.7e308, 0.0), (0.0, 0.0), (-1.7e308, 0.0)])  # the difference of two finite angles need not be finite
def test_any_finite_log_survives_the_file(rows: list[tuple[float, float]]) -> None:
    channels = {"t": np.arange(len(rows)) * 0.5, "theta": [a for a, _ in rows], "i_q": [b for _, b in rows]}
    log = Log(channels)
    with tempfile.TemporaryDirectory() as folder:
        again = describe(log.write_csv(Path(folder) / "log.csv")).log
    assert again["i_q"].tobytes() == log["i_q"].tobytes()
    if not any("unwrapped" in note for note in again.provenance.notes):
        assert again["theta"].tobytes() == log["theta"].tobytes()
    assert math.isfinite(again.duration)
