"""MDF4, TDMS and Parquet, written by their own libraries."""

from __future__ import annotations

import builtins
import warnings
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import read_log

RPM = 0.10471975511965977
FAST = 0.001 * np.arange(200)
SLOW = 0.01 * np.arange(20)


def mdf(path: Path) -> Path:
    pytest.importorskip("asammdf", reason="asammdf is not installed: MDF IS NOT TESTED")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from asammdf import MDF, Signal

        with MDF(version="4.10") as content:
            content.append([
                Signal(50 * np.sin(FAST), FAST, name="Axis.ActPos", unit="deg"),
                Signal(np.arange(200, dtype=np.int16), FAST, name="Axis.ActVelo", unit="rpm"),
            ])  # fmt: skip
            content.append([Signal(2.0 * SLOW, SLOW, name="Axis.Iq", unit="A")])
            content.append([Signal(np.array([b"RUN"] * 20), SLOW, name="State", encoding="utf-8")])
            content.save(path, overwrite=True)
    return path


def tdms(path: Path) -> Path:
    nptdms = pytest.importorskip("nptdms")
    wave = {"wf_increment": 0.001, "wf_start_offset": 0.0, "wf_start_time": np.datetime64("2024-01-01")}
    slow = {"wf_increment": 0.01, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([
            nptdms.ChannelObject("drive", "Position", 50 * np.sin(FAST), properties=wave | {"unit_string": "deg"}),
            nptdms.ChannelObject("drive", "Velocity", np.arange(200), properties=wave | {"unit_string": "rpm"}),
            nptdms.ChannelObject("current", "Iq", 2.0 * SLOW, properties=slow | {"unit_string": "A"}),
            nptdms.ChannelObject("drive", "State", ["RUN"] * 200),
        ])  # fmt: skip
    return path


def parquet(path: Path) -> Path:
    pyarrow = pytest.importorskip("pyarrow")
    writer = pytest.importorskip("pyarrow.parquet")
    clock = (FAST * 1e9).round().astype("int64") + 1_700_000_000_000_000_000
    table = pyarrow.table({
        "time": pyarrow.array(clock, pyarrow.timestamp("ns")),
        "Position [deg]": 50 * np.sin(FAST),
        "Velocity [rpm]": np.arange(200, dtype=np.int16),
        "Iq": np.float32(2.0) * FAST.astype(np.float32),
        "enabled": FAST > 0.1,
        "State": ["RUN"] * 200,
    })  # fmt: skip
    writer.write_table(table, path, row_group_size=70)
    return path


def test_mdf_groups_with_their_own_rasters(tmp_path: Path) -> None:
    log = read_log(mdf(tmp_path / "log.mf4"))
    assert log.provenance.importer.startswith("MDF 4")
    assert list(log) == ["t", "theta", "omega", "i_q"]
    np.testing.assert_allclose(log.t, FAST[:191], atol=1e-12)
    np.testing.assert_allclose(log["theta"], np.deg2rad(50 * np.sin(FAST[:191])), rtol=1e-12)
    np.testing.assert_allclose(log["omega"], RPM * np.arange(191), rtol=1e-12)
    np.testing.assert_allclose(log["i_q"], 2.0 * FAST[:191], atol=1e-12)
    notes = " | ".join(log.provenance.notes)
    assert "i_q interpolated linearly from a raster of 10 ms to 1 ms" in notes
    assert "State" in notes


def test_tdms_waveforms(tmp_path: Path) -> None:
    log = read_log(tdms(tmp_path / "log.tdms"))
    assert log.provenance.importer == "TDMS"
    np.testing.assert_allclose(log.t, FAST[:191], atol=1e-12)
    np.testing.assert_allclose(log["omega"], RPM * np.arange(191), rtol=1e-12)
    np.testing.assert_allclose(log["i_q"], 2.0 * FAST[:191], atol=1e-12)


def test_tdms_with_a_time_channel(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "log.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([
            nptdms.ChannelObject("g", "Time (ms)", 1e3 * FAST),
            nptdms.ChannelObject("g", "Position", FAST),
            nptdms.ChannelObject("g", "Torque [mNm]", FAST),
        ])  # fmt: skip
    log = read_log(path)
    np.testing.assert_allclose(log.t, FAST, rtol=1e-14)
    np.testing.assert_allclose(log["torque"], 1e-3 * FAST, rtol=1e-14)


BEGIN = np.datetime64("2026-05-17T23:59:45", "us")


def late_tdms(path: Path, starts: tuple[np.datetime64 | None, ...], lengths: tuple[int, ...] = (200, 180)) -> Path:
    """Write a position from its start on, and a current `i_q = 2 t` in A peak whose first samples are missing."""
    nptdms = pytest.importorskip("nptdms")
    waves = [{"wf_increment": 0.001} | ({} if start is None else {"wf_start_time": start}) for start in starts]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([
            nptdms.ChannelObject("A", "Position", FAST[: lengths[0]], {"unit_string": "rad"} | waves[0]),
            nptdms.ChannelObject("B", "Iq", 2.0 * FAST[-lengths[1] :], {"unit_string": "A peak"} | waves[1]),
        ])  # fmt: skip
    return path


def test_tdms_channels_begin_at_their_start_times(tmp_path: Path) -> None:
    log = read_log(late_tdms(tmp_path / "log.tdms", (BEGIN, BEGIN + np.timedelta64(20, "ms"))))
    assert len(log) == 180
    np.testing.assert_allclose(log["theta"], log.t, atol=1e-12)
    np.testing.assert_allclose(log["i_q"], 2.0 * log.t, atol=1e-12)
    notes = " | ".join(log.provenance.notes)
    assert "Iq begins 0.02 s after the first channel" in notes
    assert "20 samples outside the time that all groups cover were dropped (0 to 0.019 s): theta" in notes
    assert "interpolated" not in notes  # the stamps of both are the same but for rounding
    assert not any(notice.code == "peak_or_rms" for notice in log.provenance.notices)  # the unit says it


@pytest.mark.parametrize("start", [None, np.datetime64("1904-01-01", "us")])
def test_a_tdms_start_time_that_says_nothing(tmp_path: Path, start: np.datetime64 | None) -> None:
    log = read_log(late_tdms(tmp_path / "log.tdms", (BEGIN, start)))
    assert log.t[0] == 0.0
    assert log["i_q"][0] == pytest.approx(2.0 * FAST[20])
    assert not any("after the first channel" in note for note in log.provenance.notes)


def test_tdms_groups_that_never_meet(tmp_path: Path) -> None:
    path = late_tdms(tmp_path / "log.tdms", (BEGIN, BEGIN + np.timedelta64(1, "h")))
    with pytest.raises(LogError, match="do not overlap in time"):
        read_log(path)


def test_every_dropped_sample_is_told(tmp_path: Path) -> None:
    log = read_log(late_tdms(tmp_path / "log.tdms", (None, None), (120, 200)))
    assert len(log) == 120
    assert "80 samples outside the time that all groups cover were dropped (0.12 to 0.199 s): i_q" in " | ".join(
        log.provenance.notes
    )


def test_tdms_time_stamps(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "log.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([
            nptdms.ChannelObject("g", "Zeitstempel", BEGIN + (1e6 * FAST).round().astype("timedelta64[us]")),
            nptdms.ChannelObject("g", "Position", FAST, {"unit_string": "rad"}),
            nptdms.ChannelObject("g", "Torque", FAST, {"unit_string": "Nm"}),
        ])  # fmt: skip
    log = read_log(path)
    np.testing.assert_allclose(log.t, FAST, atol=1e-9)


def test_tdms_time_stamps_without_a_date_beside_a_dated_waveform(tmp_path: Path) -> None:
    """They lay 120 years before it: "the channel groups do not overlap in time"."""
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "log.tdms"
    stamps = np.datetime64("1904-01-01T00:00:03", "us") + (1e6 * FAST).round().astype("timedelta64[us]")
    wave = {"wf_increment": 0.001, "wf_start_time": BEGIN, "unit_string": "A peak"}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([
            nptdms.ChannelObject("g", "Time", stamps),
            nptdms.ChannelObject("g", "Position", FAST, {"unit_string": "rad"}),
            nptdms.ChannelObject("h", "Iq", 2.0 * FAST, wave),
        ])  # fmt: skip
    log = read_log(path)
    assert len(log) == 200
    np.testing.assert_allclose(log["i_q"], 2.0 * log["theta"], atol=1e-9)


def test_parquet(tmp_path: Path) -> None:
    log = read_log(parquet(tmp_path / "log.parquet"), mapping={"temperature": "enabled [degC]"})
    assert log.provenance.importer == "Parquet"
    np.testing.assert_allclose(log.t, FAST, atol=1e-12)
    np.testing.assert_allclose(log["omega"], RPM * np.arange(200), rtol=1e-12)
    assert log["temperature"].tolist() == (FAST > 0.1).astype(float).tolist()
    assert any("State" in note for note in log.provenance.notes)


def test_decimals_of_parquet_are_numbers(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    import pyarrow.parquet as writer

    current = pyarrow.array([Decimal(f"{value:.4f}") for value in FAST])
    writer.write_table(pyarrow.table({"time [s]": FAST, "speed [rad/s]": FAST, "iq [A peak]": current}), tmp_path / "p")
    np.testing.assert_allclose(read_log(tmp_path / "p")["i_q"], FAST, atol=1e-4)


MAKERS = {
    "log.mf4": (mdf, "asammdf", "mdf"),
    "log.tdms": (tdms, "nptdms", "tdms"),
    "log.parquet": (parquet, "pyarrow", "parquet"),
}


@pytest.mark.parametrize("name", MAKERS)
def test_a_missing_library_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    maker, library, extra = MAKERS[name]
    path = maker(tmp_path / name)
    real = builtins.__import__

    def refuse(wanted: str, *rest: object, **more: object) -> object:
        if wanted.split(".")[0] == library:
            raise ImportError(wanted)
        return real(wanted, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", refuse)
    monkeypatch.setattr("pmsm_ctrl.importers.mdf.find_spec", lambda _: None)
    with pytest.raises(LogError, match=rf"pip install 'pmsm-ctrl\[{extra}\]'"):
        read_log(path)


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize("keep", [8, 60, 0.3, 0.6, 0.95])
def test_a_file_cut_short_is_one_line(tmp_path: Path, name: str, keep: float) -> None:
    path = MAKERS[name][0](tmp_path / name)
    content = path.read_bytes()
    path.write_bytes(content[: int(keep if keep > 1 else keep * len(content))])
    _read_or_refuse(path)


def _read_or_refuse(path: Path) -> None:
    message = ""
    try:
        read_log(path)
    except LogError as error:
        message = str(error)
    assert "\n" not in message
    assert not message or message.startswith(f"{path}: ")


@pytest.mark.parametrize("name", MAKERS)
def test_flipped_bytes_never_escape(tmp_path: Path, rng: np.random.Generator, name: str) -> None:
    path = MAKERS[name][0](tmp_path / name)
    content = bytearray(path.read_bytes())
    for _ in range(1 if name == "log.mf4" else 40):
        damaged = bytearray(content)
        for place in rng.integers(4, len(content), 8):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged)
        _read_or_refuse(path)
