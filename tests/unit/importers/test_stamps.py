"""Time as dates: every form, what cannot be told apart, and the place of what is wrong."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import describe, numbers, read_log

START = datetime(2024, 5, 17, 23, 59, 58, 250_000)
STEP = timedelta(milliseconds=12.5)
MOMENTS = [START + k * STEP for k in range(300)]  # runs past midnight after 1.75 s
SECONDS = [(moment - START).total_seconds() for moment in MOMENTS]


def filetime(moment: datetime) -> int:
    return (moment - datetime(1601, 1, 1)) // timedelta(microseconds=1) * 10


def ticks(moment: datetime) -> int:
    return (moment - datetime(1, 1, 1)) // timedelta(microseconds=1) * 10


def since_1970(moment: datetime, unit: timedelta) -> float:
    return (moment - datetime(1970, 1, 1)) / unit


FORMS = {
    "ISO 8601": lambda m: m.isoformat(timespec="microseconds"),
    "ISO 8601, blank": lambda m: m.isoformat(" ", "microseconds"),
    "ISO 8601, comma": lambda m: m.isoformat(timespec="microseconds").replace(".", ","),
    "ISO 8601, Z": lambda m: m.isoformat(timespec="microseconds") + "Z",
    "ISO 8601, zone": lambda m: m.replace(tzinfo=timezone(timedelta(hours=2))).isoformat(timespec="microseconds"),
    "ISO 8601, compact": lambda m: m.strftime("%Y%m%dT%H%M%S.%f"),
    "yyyy/mm/dd": lambda m: m.strftime("%Y/%m/%d %H:%M:%S.%f"),
    "dd.mm.yyyy": lambda m: m.strftime("%d.%m.%Y %H:%M:%S,%f"),
    "mm/dd/yyyy": lambda m: m.strftime("%m/%d/%Y %I:%M:%S.%f %p"),
    "mm/dd/yyyy, 24 hours": lambda m: m.strftime("%m/%d/%Y %H:%M:%S.%f"),
    "dd/mm/yyyy": lambda m: m.strftime("%d/%m/%Y %H:%M:%S.%f"),
    "time of day": lambda m: m.strftime("%H:%M:%S.%f"),
    "FILETIME": lambda m: str(filetime(m)),
    "ticks of .NET": lambda m: str(ticks(m)),
    "us since 1970": lambda m: f"{since_1970(m, timedelta(microseconds=1)):.0f}",
}


def table(stamps: list[str], name: str = "Timestamp", separator: str = ";") -> str:
    rows = [f"{stamp}{separator}{0.1 * k:.1f}{separator}{k}" for k, stamp in enumerate(stamps)]
    return "\n".join([separator.join([name, "Position [rad]", "Iq [A]"]), *rows]) + "\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "dates.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("piece", [numbers.PIECE, 2000])
def test_every_form(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, piece: int) -> None:
    monkeypatch.setattr(numbers, "PIECE", piece)  # midnight passes in a later piece as well
    path = write(tmp_path, table([FORMS[name](moment) for moment in MOMENTS]))
    log = read_log(path)
    # numbers of 100 ns or better, all differences exact before the last division
    np.testing.assert_allclose(log.t, SECONDS, rtol=1e-15, atol=0)
    form = "mm/dd/yyyy" if name.startswith("mm/dd") else name.split(",")[0] if "compact" not in name else name
    (note,) = (note for note in log.provenance.notes if "counted from its first row" in note)
    assert f"t from 'Timestamp', read as {form}" in note
    assert "23:59:58.25" in note or "21:59:58.25" in note  # a zone is turned into UTC
    assert log["i_q"].tolist() == list(range(300))


@pytest.mark.parametrize("name", ["ISO 8601", "dd.mm.yyyy", "time of day", "FILETIME"])
def test_the_table_reproduces_the_log(tmp_path: Path, name: str) -> None:
    import tomllib

    path = write(tmp_path, table([FORMS[name](moment) for moment in MOMENTS]))
    report = describe(path)
    design = Design.from_dict({"motor": {"J": 1.0, "K_t": 1.0}, **tomllib.loads(report.table)})
    again = read_log(path, design)
    assert again.t.tolist() == report.log.t.tolist()
    assert list(again) == list(report.log)
    # whatever unit a mapping gives a date, it is a date
    assert read_log(path, mapping={"t": "Timestamp [ms]"}).t.tolist() == report.log.t.tolist()


def test_milliseconds_since_1970(tmp_path: Path) -> None:
    stamps = [1_715_000_000_000 + 5 * k for k in range(50)]
    log = read_log(write(tmp_path, table([str(stamp) for stamp in stamps])))
    np.testing.assert_allclose(log.t, 0.005 * np.arange(50), rtol=1e-15)
    # with a unit it is what it says
    log = read_log(write(tmp_path, table([str(stamp) for stamp in stamps], name="Timestamp [ms]")))
    assert log.t[0] == 1_715_000_000.0


@pytest.mark.parametrize("unit", ["us", "ms"])
def test_stamps_since_1970_keep_their_digits(tmp_path: Path, unit: str) -> None:
    """In seconds since 1970 a double resolves 0.24 us: a log of 8 kHz was one of 8004.4 Hz that jitters."""
    step, first = (125, 1716000000000000) if unit == "us" else (1, 1716000000000)
    lines = [f"timestamp [{unit}];omega [rad/s];i_q [A]"]
    lines += [f"{first + step * k};{k % 7};{k % 5}" for k in range(500)]
    path = tmp_path / "l.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    t = read_log(path, mapping={"t": f"timestamp [{unit}]"}).t
    np.testing.assert_allclose(t - t[0], np.arange(500) * step * (1e-6 if unit == "us" else 1e-3), rtol=0, atol=1e-12)


def test_day_and_month_that_can_be_exchanged(tmp_path: Path) -> None:
    """Within one day it makes no difference; beyond, it is refused."""
    at = datetime(2024, 5, 6, 23, 59, 58)
    stamps = [(at + timedelta(seconds=0.5 * k)).strftime("%d/%m/%Y %H:%M:%S.%f") for k in range(10)]
    log = read_log(write(tmp_path, table(stamps[:4])))
    assert log.t.tolist() == [0.0, 0.5, 1.0, 1.5]
    assert any("read as dd/mm/yyyy or mm/dd/yyyy" in note for note in log.provenance.notes)
    with pytest.raises(LogError, match=r"dates\.csv: line 6, column 1 \('Timestamp'\): '07/05/2024 .* day first or"):
        read_log(write(tmp_path, table(stamps)))


@pytest.mark.parametrize(
    "bad",
    [
        "2024-05-32T10:00:00",
        "2024-05-17T25:00:00",
        "9999-12-31T23:59:59",
        "0001-01-01T00:00",
        "yesterday",
        "2024-05-17",
        "",
    ],
)
def test_a_bad_date_names_its_place(tmp_path: Path, bad: str) -> None:
    stamps = [FORMS["ISO 8601"](moment) for moment in [*MOMENTS, *MOMENTS, *MOMENTS]]
    stamps[500] = bad  # far below the rows that decide on the form
    with pytest.raises(LogError, match=r"dates\.csv: line 502, column 1 \('Timestamp'\): '.*' found; a date was exp"):
        read_log(write(tmp_path, table(stamps)))


def test_a_log_that_runs_back_is_refused(tmp_path: Path) -> None:
    stamps = [FORMS["time of day"](moment) for moment in MOMENTS[:20]]
    stamps[7], stamps[8] = stamps[8], stamps[7]
    with pytest.raises(LogError, match=r"line 10.*time runs backwards"):
        read_log(write(tmp_path, table(stamps)))


def test_a_date_beside_a_time_in_numbers_is_left_out(tmp_path: Path) -> None:
    rows = [f"{FORMS['ISO 8601'](moment)};{0.5 * k};{k};{k}" for k, moment in enumerate(MOMENTS)]
    log = read_log(write(tmp_path, "\n".join(["Timestamp;Time [ms];Position;Iq", *rows])))
    np.testing.assert_allclose(log.t, 0.0005 * np.arange(300), rtol=1e-14)
    assert "text columns not used: 'Timestamp'" in log.provenance.notes


def test_date_and_time_in_two_columns(tmp_path: Path) -> None:
    rows = [f"{m:%d.%m.%Y};{m:%H:%M:%S,%f};{k};{k}" for k, m in enumerate(MOMENTS)]
    log = read_log(write(tmp_path, "\n".join(["Datum;Uhrzeit;Position;Iq", *rows])))
    np.testing.assert_allclose(log.t, SECONDS, rtol=1e-15)
    assert "text columns not used: 'Datum'" in log.provenance.notes


def test_a_column_of_dates_under_any_name(tmp_path: Path) -> None:
    stamps = [FORMS["ISO 8601"](moment) for moment in MOMENTS]
    assert len(read_log(write(tmp_path, table(stamps, name="recorded at")))) == 300
