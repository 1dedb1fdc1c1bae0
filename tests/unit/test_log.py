"""The log: what it accepts, what it refuses and in which words, cuts, copies and the canonical file."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.errors import LogError, RequestError
from pmsm_ctrl.log import CHANNELS, Log, Provenance, Segment, as_logs
from tests.unit.several import record


def make(n: int = 10, **channels: object) -> Log:
    base = {"t": np.arange(n) * 1e-3, "omega": np.linspace(-1, 1, n), "i_q": np.zeros(n)}
    return Log(base | channels)  # type: ignore[operator]


def test_channels_are_copies_that_nobody_can_change() -> None:
    mine = np.arange(10) * 1e-3
    log = Log({"t": mine})
    mine[0] = -1.0
    assert log.t[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        log.t[0] = 1.0
    with pytest.raises(TypeError):
        log.channels["t"] = mine  # type: ignore[index]


def test_a_read_only_view_of_a_changeable_array_is_copied() -> None:
    mine = np.arange(10) * 1e-3
    view = mine[:]
    view.setflags(write=False)
    log = Log({"t": view})
    mine[0] = -1.0
    assert log.t[0] == 0.0


def test_copies_of_a_log_share_its_channels() -> None:
    log = make()
    assert log.with_channels(theta=np.zeros(10))["omega"] is log["omega"]


def test_times_and_units() -> None:
    log = make(11)
    assert log.period == pytest.approx(1e-3)
    assert log.rate == pytest.approx(1000.0)
    assert log.duration == pytest.approx(0.01)
    assert len(log) == 11
    assert log.unit("omega") == "rad/s"
    assert Log({"t": [0.0, 1.0]}, motion="linear").unit("torque") == "N"
    assert "omega" in log
    assert "theta" not in log
    assert list(log) == ["t", "omega", "i_q"]


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        ({"omega": [1.0]}, ("no time channel 't'", "omega")),
        ({"t": []}, ("empty",)),
        ({"t": [0.0, 1.0], "omga": [0.0, 1.0]}, ("unknown channel 'omga'", "did you mean 'omega'")),
        ({"t": [0.0, 1.0], "omega": [0.0]}, ("channel 'omega'", "(1,)", "(2,)")),
        ({"t": [0.0, 1.0], "omega": [0.0, np.nan]}, ("channel 'omega', sample 1", "finite")),
        ({"t": [0.0, 1.0], "omega": [np.inf, 0.0]}, ("channel 'omega', sample 0", "finite")),
        ({"t": [0.0, 1.0, 1.0]}, ("sample 2", "the same time stamp twice")),
        ({"t": [0.0, 1.0, 0.5]}, ("sample 2", "time runs backwards")),
    ],
)
def test_what_is_refused(channels: dict[str, list[float]], words: tuple[str, ...]) -> None:
    with pytest.raises(LogError) as caught:
        Log(channels, provenance=Provenance(file="a.csv"))  # type: ignore[arg-type]
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_channel_names_the_present_ones() -> None:
    with pytest.raises(LogError, match="no channel 'theta' \\(present: t, omega, i_q\\)"):
        make()["theta"]


def test_slices_keep_the_segments_that_fall_inside() -> None:
    log = Log({"t": np.arange(10.0)}, segments=(Segment("a", 0, 4), Segment("b", 4, 10)))
    part = log.slice(3, 6)
    assert part.t.tolist() == [3.0, 4.0, 5.0]
    assert part.segments == (Segment("a", 0, 1), Segment("b", 1, 3))
    assert log.between(2.0, 4.0).t.tolist() == [2.0, 3.0]
    assert log.slice(0, 4).segments == (Segment("a", 0, 4),)
    with pytest.raises(LogError, match="no sample between 20 s and 30 s"):
        log.between(20, 30)


def test_canonical_file_is_plain_csv_with_units(tmp_path: Path) -> None:
    """Read back with the standard library, not with the importer."""
    log = make(5, omega=[0.1, 1 / 3, -2e-300, 5e300, 0.0])
    with open(log.write_csv(tmp_path / "log.csv"), newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == ["t [s]", "omega [rad/s]", "i_q [A]"]
    assert [float(row[1]) for row in rows[1:]] == log["omega"].tolist()
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


def test_writing_where_one_cannot_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="cannot write here"):
        make().write_csv(tmp_path / "no" / "log.csv")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RequestError, match="is a folder"):
        make().write_csv(tmp_path / "folder")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_every_channel_has_units_and_a_meaning() -> None:
    for name, (rotary, linear, meaning) in CHANNELS.items():
        assert name.isidentifier()
        assert rotary
        assert linear
        assert meaning


@pytest.mark.parametrize(
    ("values", "found"),
    [
        (np.array([1.0 + 2.0j, 0.0, 0.0]), "complex numbers"), ([1.0 + 2.0j, 0.0, 0.0], "complex numbers"),
        (["a", "b", "c"], "text"), (["1", "2", "3"], "text"), ([1.0, [2.0], 3.0], "list of object"),
        ([1.0, None, "x"], "list of object"), ({"a": 1.0}, "dict of object"),
    ],
)  # fmt: skip
def test_values_that_are_no_real_numbers_are_refused_with_the_channel(values: Any, found: str) -> None:
    t = np.arange(3) * 1e-3
    with pytest.raises(LogError, match=rf"channel 'omega': {found} found; an array of real numbers was expected"):
        Log({"t": t, "omega": values})
    with pytest.raises(LogError, match="channel 'omega': "):
        Log({"t": t}).with_channels(omega=values)


def test_the_same_numbers_are_no_second_record() -> None:
    """A copy made standard errors smaller."""
    first, second = record(1), record(2)
    copy = first.with_channels()
    assert as_logs([first, second]) == (first, second)
    for same in (first, copy):
        with pytest.raises(RequestError, match=r"^record_1\.csv: the same numbers as record_1\.csv; every record"):
            as_logs([first, second, same])
