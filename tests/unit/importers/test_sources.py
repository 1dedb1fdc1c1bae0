"""Logs from bytes, streams and data frames are those of the file with the same content."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl import Log, read_log
from pmsm_ctrl.errors import LogError

T = np.arange(0.0, 4.0, 1e-3)
COLUMNS = {"time [ms]": 1e3 * T, "speed [rpm]": 600.0 * np.sin(3.0 * T), "torque [N m]": 0.1 * np.cos(3.0 * T)}
OMEGA = 20.0 * np.pi * np.sin(3.0 * T)  # 600 rpm are 20 pi rad/s


def text() -> str:
    rows = np.column_stack(list(COLUMNS.values()))
    lines = [",".join(COLUMNS), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n"


class Frame:
    """What pandas and polars have in common."""

    def __init__(self, columns: dict[object, object]) -> None:
        self.columns = list(columns)
        self._held = columns

    def __getitem__(self, name: object) -> object:
        return self._held[name]


def test_bytes_and_streams_are_read_as_the_file(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text(), encoding="utf-8")
    expected = read_log(path)
    with path.open("rb") as stream:
        logs = [read_log(path.read_bytes(), name="run.csv"), read_log(stream), read_log(io.BytesIO(path.read_bytes()))]
    for log in logs:
        assert log.provenance.sha256 == expected.provenance.sha256
        for name in expected:
            np.testing.assert_array_equal(log[name], expected[name])
    assert [log.provenance.file for log in logs] == ["run.csv", "run.csv", "log"]


def test_a_mat_file_of_version_4_is_known_by_its_name() -> None:
    from scipy.io import savemat

    held = io.BytesIO()
    savemat(held, {"t": T, "omega": OMEGA, "torque": 0.1 * np.cos(3.0 * T)}, format="4")
    np.testing.assert_allclose(read_log(held.getvalue(), name="run.mat")["omega"], OMEGA, rtol=1e-12)


def test_a_data_frame_is_read_as_a_file_with_its_columns() -> None:
    pyarrow = pytest.importorskip("pyarrow")
    for frame, kind in ((Frame(dict(COLUMNS)), "Frame"), (pyarrow.table(COLUMNS), "Table")):
        log = read_log(frame, name="monday")
        np.testing.assert_allclose(log["omega"], OMEGA, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(log.t, T, rtol=1e-12, atol=1e-12)
        assert (log.provenance.file, log.provenance.importer) == ("monday", kind)
        assert len(log.provenance.sha256) == 64


class Dataset:
    """A data set of xarray: coordinates are variables, but not among those that it iterates over."""

    def __init__(self, held: dict[str, np.ndarray], units: dict[str, str]) -> None:
        self.variables = {name: Variable(values, {"units": units[name]}) for name, values in held.items()}
        self.data_vars = [name for name in held if name != "t"]

    def __iter__(self) -> Iterator[str]:
        return iter(self.data_vars)

    def __getitem__(self, name: str) -> Variable:
        return self.variables[name]


class Variable:
    def __init__(self, values: np.ndarray, attrs: dict[str, str]) -> None:
        self.attrs = attrs
        self._values = values

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        return self._values


def test_a_data_set_of_xarray_is_read_with_its_coordinate_and_units() -> None:
    held = {"t": T, "speed": COLUMNS["speed [rpm]"], "torque": COLUMNS["torque [N m]"]}
    log = read_log(Dataset(held, {"t": "s", "speed": "rpm", "torque": "N m"}))
    np.testing.assert_allclose(log["omega"], OMEGA, rtol=1e-12, atol=1e-12)
    assert log.provenance.notices == ()
    log = Log.from_pandas(Dataset({"t": T, "omega": held["speed"]}, {"t": "s", "omega": "rpm"}))
    np.testing.assert_array_equal(log.t, T)
    np.testing.assert_allclose(log["omega"], OMEGA, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("package", ["pandas", "polars", "xarray"])
def test_a_log_goes_there_and_back(package: str) -> None:
    module = pytest.importorskip(package)
    log = Log({"t": T, "omega": OMEGA})
    if package == "xarray":
        pytest.importorskip("pandas")
        frame = log.to_pandas().set_index("t").to_xarray()
    else:
        frame = module.DataFrame(log)
    assert Log.from_pandas(frame).fingerprint == log.fingerprint


def test_times_and_columns_that_are_no_numbers_in_a_frame() -> None:
    stamps = np.datetime64("2026-03-01T10:00:00") + (1e9 * T).astype("timedelta64[ns]")
    columns: dict[object, object] = dict(COLUMNS) | {
        "time [ms]": stamps,
        "state": np.array(["run"] * T.size),
        7: T > 1.0,
    }
    log = read_log(Frame(columns))
    np.testing.assert_allclose(log.t, T, atol=1e-9)
    assert any("state" in note for note in log.provenance.notes)


@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_the_time_index_of_pandas_is_the_time(zone: str | None) -> None:
    pandas = pytest.importorskip("pandas")
    columns = {name: values for name, values in COLUMNS.items() if "speed" in name or "torque" in name}
    start = pandas.Timestamp("2026-03-01T10:00:00", tz=zone)
    log = read_log(pandas.DataFrame(columns, index=start + pandas.to_timedelta(T, unit="s")))
    np.testing.assert_allclose(log.t, T, atol=1e-9)
    np.testing.assert_allclose(log["omega"], OMEGA, rtol=1e-12, atol=1e-12)
    named = pandas.DataFrame(columns, index=pandas.Index(1e3 * T, name="time [ms]"))
    np.testing.assert_allclose(read_log(named).t, T, atol=1e-12)


def test_an_empty_frame_over_time_is_refused() -> None:
    """Numpy's UFuncTypeError was raised."""
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"speed [rad/s]": np.zeros(0)}, index=pandas.DatetimeIndex([]))
    with pytest.raises(LogError):
        read_log(frame)


def test_a_mapping_names_the_columns_of_a_frame() -> None:
    columns: dict[object, object] = {"a": T, "b": COLUMNS["speed [rpm]"], "c": COLUMNS["torque [N m]"]}
    log = read_log(Frame(columns), mapping={"t": "a [s]", "omega": "b [rpm]", "torque": "c [N m]"})
    np.testing.assert_allclose(log["omega"], OMEGA, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (io.StringIO("t,omega\n"), "log: a stream of text; one of bytes was expected"),
        (7, "log: found int; a path, bytes, a stream of bytes or a data frame was expected"),
        (b"", "log: empty"),
        (Frame({"state": np.array(["a"])}), "data frame: no column of numbers .found: state"),
    ],
)
def test_what_is_no_log_is_refused_by_name(source: object, said: str) -> None:
    with pytest.raises(LogError, match=said):
        read_log(source)
