"""Results and logs in a notebook: one line, a table, and data frames of other packages."""

from __future__ import annotations

import copy
import importlib.util
import pickle
import pkgutil
from collections.abc import Callable

import numpy as np
import pytest

import pmsm_ctrl
from pmsm_ctrl import Design, Log, identify
from pmsm_ctrl.errors import LogError, RequestError
from pmsm_ctrl.result import Result

AXIS = Design.from_dict(
    {"motor": {"J": 1e-4, "K_t": 1.0}, "effects": [{"id": "coulomb", "F_c": 0.02}, {"id": "viscous", "F_v": 2e-4}]}
)


@pytest.fixture(scope="module")
def log() -> Log:
    t = np.arange(0, 6, 1e-3)
    omega = 80 * np.sin(np.pi * t) + 40 * np.sin(2.6 * np.pi * t + 1)
    alpha = 80 * np.pi * np.cos(np.pi * t) + 104 * np.pi * np.cos(2.6 * np.pi * t + 1)
    torque = 1e-4 * alpha + 0.02 * np.sign(omega) + 2e-4 * omega + np.random.default_rng(5).normal(0, 1e-3, t.size)
    return Log({"t": t, "omega": omega, "torque": torque})


def test_a_result_is_one_line_and_a_page_of_a_cell(log: Log) -> None:
    found = identify(AXIS, log)
    assert repr(found).startswith("<Identification: Inverse-dynamics least squares: ")
    assert "\n" not in repr(found)
    assert len(repr(found)) < 200
    html = found._repr_html_()
    assert html.index("Inverse-dynamics") < html.index("<table") < html.index("<svg")


def test_a_figure_is_shown_without_pyplot(log: Log) -> None:
    """IPython asks an object for this method; the figure's type is registered with it by pyplot alone."""
    picture = identify(AXIS, log).plot()._repr_png_()
    assert picture.startswith(b"\x89PNG\r\n\x1a\n")
    assert len(picture) > 5000


def kinds_of_result(kind: type[Result] = Result) -> list[type[Result]]:
    """Return every type of result that the package's rooms define."""
    for room in pkgutil.iter_modules(pmsm_ctrl.__path__, "pmsm_ctrl."):
        if importlib.util.find_spec(f"{room.name}.result") if room.ispkg else None:
            importlib.import_module(f"{room.name}.result")
    below = kind.__subclasses__()
    found = [*below, *(each for one in below for each in kinds_of_result(one))]
    return [one for one in found if one.__module__.startswith("pmsm_ctrl.")]


def test_every_result_has_its_cell_and_its_line() -> None:
    found = kinds_of_result()
    assert len(found) >= 12
    for kind in found:
        assert kind._repr_html_ is Result._repr_html_, kind
        assert not hasattr(kind.__repr__, "__wrapped__"), kind  # a dataclass's own would print every array


def test_a_log_is_one_line_and_a_table(log: Log) -> None:
    assert repr(log) == "<Log: 6000 samples, 5.999 s at 1000 Hz: t, omega, torque>"
    assert "<td>omega</td><td>rad/s</td>" in log._repr_html_()
    assert "&lt;" in Log(log.channels, provenance=type(log.provenance)(file="<b>.csv"))._repr_html_()


def test_a_log_is_a_dict_of_arrays_and_no_array(log: Log) -> None:
    assert list(dict(log)) == list(log) == list(log.keys()) == ["t", "omega", "torque"]
    assert {**log}["omega"] is log["omega"] is log.get("omega")
    assert [len(values) for values in log.values()] == 3 * [len(log)]
    with pytest.raises(RequestError, match="to_pandas"):
        np.asarray(log)


def test_a_log_is_a_dict_that_nobody_changes(log: Log) -> None:
    changes: list[Callable[[Log], object]] = [
        lambda it: it.update(t=it["t"]), lambda it: it.pop("t"), lambda it: it.clear(), lambda it: it.popitem(),
        lambda it: it.setdefault("t", it["t"]), lambda it: it.__setitem__("t", it["t"]),
        lambda it: it.__delitem__("t"), lambda it: it.__ior__({"t": it["t"]}),
    ]  # fmt: skip
    for change in changes:
        with pytest.raises(TypeError, match="with_channels"):
            change(log)
    assert list(log) == ["t", "omega", "torque"]
    again = pickle.loads(pickle.dumps(log))
    assert again.fingerprint == copy.deepcopy(log).fingerprint == log.fingerprint
    assert again.provenance == log.provenance
    assert log == log
    assert log != again  # as two objects, in sets as well
    assert len({log, again}) == 2


def test_frames_of_pandas(log: Log) -> None:
    pandas = pytest.importorskip("pandas")
    frame = log.to_pandas()
    assert frame.attrs["units"] == {"t": "s", "omega": "rad/s", "torque": "N m"}
    assert Log.from_pandas(frame).fingerprint == log.fingerprint
    plain = pandas.DataFrame(log)  # a frame of the channels' names came out
    pandas.testing.assert_frame_equal(plain, frame)
    assert list(pandas.DataFrame(log, columns=["omega"], index=log.t).index[:2]) == [0.0, 1e-3]
    assert plain["omega"].dtype == np.float64
    plain.loc[0, "omega"] = 7.0  # a copy
    assert log["omega"][0] != 7.0
    stamped = frame.drop(columns="t").rename(columns={"omega": "omega [rpm]"}).assign(note="x")
    stamped["omega [rpm]"] *= 30 / np.pi
    stamped.index = pandas.to_datetime("2026-01-01") + pandas.to_timedelta(np.arange(len(log)), unit="ms")
    again = Log.from_pandas(stamped)
    assert again.t == pytest.approx(log.t, abs=1e-9)
    assert again["omega"] == pytest.approx(log["omega"], rel=1e-12)
    stamped.index = stamped.index.tz_localize("Europe/Berlin")
    assert Log.from_pandas(stamped).t == pytest.approx(log.t, abs=1e-9)
    in_ms = frame.assign(t=1e3 * frame["t"]).rename(columns={"t": "t [ms]"}).set_index("t [ms]")
    assert Log.from_pandas(in_ms).t == pytest.approx(log.t, abs=1e-12)
    with pytest.raises(LogError, match=r"no time channel|no samples|empty"):
        Log.from_pandas(stamped.iloc[:0])
    with pytest.raises(LogError, match="column 'omega': numbers"):
        Log.from_pandas(frame.assign(omega="x"))
    with pytest.raises(LogError, match="rad/s or a unit"):
        Log.from_pandas(frame.rename(columns={"omega": "omega [A]"}))
    with pytest.raises(LogError, match="no time channel"):
        Log.from_pandas(frame.drop(columns="t"))


def test_arrow_reads_a_log_with_its_units(log: Log) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    assert pyarrow.table(log).column_names == ["t", "omega", "torque"]  # taken as a dictionary: without units
    table = pyarrow.RecordBatchReader.from_stream(log).read_all()
    assert table.column_names == ["t", "omega", "torque"]
    assert table.schema.field("torque").metadata == {b"unit": b"N m"}
    assert table.column("omega").to_numpy() == pytest.approx(log["omega"], rel=0, abs=0)
