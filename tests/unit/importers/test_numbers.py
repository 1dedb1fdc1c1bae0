"""The quick parsers against the readable twin, and the places they name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import describe, numbers, read_log
from pmsm_ctrl.importers.layout import Layout
from pmsm_ctrl.importers.numbers import parse_numpy, parse_pyarrow, parse_rows

LAYOUT = Layout("utf-8", ",", ".", ("a", "b", "c"), (), 1, 3)
QUICK = [parse_numpy, parse_pyarrow]


def _rows(random: np.random.Generator) -> list[list[float]]:
    """Numbers of every size, with denormals, exact halves and 17 digits."""
    values = random.normal(size=(400, 3)) * 10.0 ** random.integers(-320, 308, (400, 3))
    values[::7] = np.round(random.normal(size=values[::7].shape), 3)
    values[::11] = random.integers(-(10**15), 10**15, values[::11].shape)
    return values.tolist()


@pytest.mark.parametrize("parser", QUICK)
@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), ("\t", "."), (";", ".")])
def test_quick_parsers_agree_to_the_last_bit(rng: np.random.Generator, parser, separator: str, decimal: str) -> None:
    pytest.importorskip("pyarrow")
    rows = _rows(rng)
    text = "\n".join(separator.join(repr(cell).replace(".", decimal) for cell in row) for row in rows).encode()
    layout = replace(LAYOUT, separator=separator, decimal=decimal)
    twin, _ = parse_rows(text, "file", layout, 1)
    assert twin.tolist() == rows
    (block,) = parser(text, layout, [2, 0])
    assert block[0].tobytes() == twin[:, 2].tobytes()
    assert block[1].tobytes() == twin[:, 0].tobytes()


REFUSED = [
    "1,2\n3,4,5\n",
    "1,2,3,4\n5,6,7\n",
    "1,x,3\n",
    "1,1_0,3\n",
    "EOF,,\n",
    "1,0x10,3\n",
    "1,2,3\nEOF\n",
    "1,2;5,3\n",
]


@pytest.mark.parametrize("parser", QUICK)
@pytest.mark.parametrize("text", REFUSED)
def test_quick_parsers_hand_back_what_is_out_of_the_ordinary(parser, text: str) -> None:
    assert parser((text * 3).encode(), LAYOUT, [0, 1, 2]) is None


@pytest.fixture
def small_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numbers, "PIECE", 4096)
    monkeypatch.setattr(numbers, "NUMPY_FROM", 1)


@pytest.mark.usefixtures("small_limits")
@pytest.mark.parametrize("quickest", ["twin", "numpy", "pyarrow"])
def test_every_way_names_the_same_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quickest: str) -> None:
    if quickest == "pyarrow":
        pytest.importorskip("pyarrow")
        monkeypatch.setattr(numbers, "PYARROW_FROM", 1)
    elif quickest == "twin":
        monkeypatch.setattr(numbers, "NUMPY_FROM", 1 << 60)
    lines = [f"{k * 1e-3!r},{k * 0.5!r},{k % 7}" for k in range(3000)]
    path = tmp_path / "log.csv"
    header = "t [s],theta [rad],i_q [A]\n"
    path.write_text(header + "\n".join(lines) + "\n")
    log = read_log(path)
    assert len(log) == 3000
    assert log["theta"][-1] == 2999 * 0.5
    for bad, line, words in [
        ("2.5,abc,1", 2502, "column 2 ('theta [rad]'): 'abc' found"),
        ("2.5,nan,1", 2502, "column 2 ('theta [rad]'): empty or not a number"),
        ("2.5,1", 2502, "2 cells found; 3 were expected"),
        ("2.499,3,1", 2502, "same time stamp twice"),
    ]:
        path.write_text(header + "\n".join([*lines[:2500], bad, *lines[2501:]]) + "\n")
        with pytest.raises(LogError) as caught:
            read_log(path)
        assert f"line {line}" in str(caught.value)
        assert words in str(caught.value)


@pytest.mark.usefixtures("small_limits")
def test_blank_lines_and_line_ends_across_pieces(tmp_path: Path) -> None:
    lines = [f"{k},{k},{k}" + ("\r\n\r\n" if k % 100 == 0 else "\r\n") for k in range(4000)]
    path = tmp_path / "log.csv"
    path.write_bytes(("t [s],theta [rad],i_q [A]\r\n" + "".join(lines)).encode())
    assert read_log(path).t.tolist() == list(range(4000))
    path.write_bytes(("t [s],theta [rad],i_q [A]\r\n" + "".join(lines) + "7,7,7").encode())
    with pytest.raises(LogError, match=r"line 4042, column 1 .*time runs backwards"):
        read_log(path)


ROWS = [f"{k * 1e-3!r},{k * 0.5!r},{k % 7}" for k in range(3000)]
HEADER = "t [s],theta [rad],i_q [A]"


@pytest.mark.usefixtures("small_limits")
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "latin-1"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("summary", "words"),
    [
        (["Summe über alles,,3000"], "line 3002 ('Summe über alles,,3000')"),
        (["End of trace", ""], "line 3002 ('End of trace')"),
        (["30000 rows"], "line 3002 ('30000 rows')"),
        (["", "-----", "Min,0,0", "Max,1499.5,6"], "3 lines from line 3003 on ('-----')"),
        (["Sum,,,,3000 rows"], "line 3002 ('Sum,,,,3000 rows')"),
    ],
)
def test_a_summary_below_the_numbers_is_left_out(
    tmp_path: Path, encoding: str, end: str, summary: list[str], words: str
) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(end.join([HEADER, *ROWS, *summary, ""]).encode(encoding))
    log = read_log(path)
    assert len(log) == 3000
    assert log["theta"][-1] == 2999 * 0.5
    assert f"text below the numbers not used: {words}" in log.provenance.notes
    assert dict(describe(path).layout)["text below, not used"] == words


@pytest.mark.usefixtures("small_limits")
@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([*ROWS[:2500], "Sum,,3", *ROWS[2500:]], "line 2502, column 1 ('t [s]'): 'Sum' found; a number was expected"),
        ([*ROWS, "3.0,1500"], "line 3002: 2 cells found; 3 were expected"),  # a row that was cut off
        ([*ROWS, "3.0,abc,1"], "line 3002, column 2 ('theta [rad]'): 'abc' found"),
        ([*ROWS, *9 * ["Sum"]], "line 3002: 1 cell found; 3 were expected"),  # more than a summary has
        ([*ROWS[:2990], "Sum", *ROWS[2990:]], "line 2992: 1 cell found; 3 were expected"),
    ],
)
def test_text_elsewhere_stays_an_error(tmp_path: Path, rows: list[str], words: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text("\n".join([HEADER, *rows]) + "\n")
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert words in str(caught.value)
    assert caught.value.next_command is None  # `import` meets the same row


@pytest.mark.parametrize("number", ["1.000,0", "-1.234.567,5", "1.234.567"])
def test_marks_of_thousands_are_named(tmp_path: Path, number: str) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{k},0;{k % 5},5;1,0" for k in range(20)]
    path.write_text("\n".join(["t [ms];theta [rad];i_q [A]", *rows, f"{number};1,5;1,0"]) + "\n")
    with pytest.raises(LogError, match=f"'{number}' found; a number without marks of thousands was expected"):
        read_log(path)


def test_dates_and_text_columns_at_the_end_are_no_summary(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = [f"05/17/2024 11:59:{k:02d} PM,{k},{k % 3},ok" for k in range(1, 40)]
    path.write_text("\n".join(["time,theta [rad],i_q [A],state", *rows, "End of trace"]) + "\n")
    assert len(read_log(path)) == 39
