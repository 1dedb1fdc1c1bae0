"""NumPy files without pickles, and the arrays of structs that dSPACE and Simulink write into MAT files."""

from __future__ import annotations

import io
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import guard, mat, open_table, read_log

N = 400
T = 2e-3 * np.arange(N)
THETA = 3.0 * np.sin(5.0 * T)
OMEGA = 15.0 * np.cos(5.0 * T)
CURRENT = -75.0 * np.sin(5.0 * T) * 1e-3
MATRIX = np.column_stack([T, THETA, OMEGA, CURRENT])


def test_an_archive_of_arrays_is_read_by_their_names(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez_compressed(path, zeit=T, istposition=THETA, iq=CURRENT, gain=2.5, note=np.array(["a", "b"]))
    log = read_log(path)
    assert log.provenance.importer == "NumPy archive"
    np.testing.assert_array_equal(log["theta"], THETA)
    np.testing.assert_array_equal(log["i_q"], CURRENT)
    assert any("gain = 2.5" in note for note in log.provenance.notes)
    assert any("not used: note" in note for note in log.provenance.notes)


def test_a_text_array_names_the_columns_of_a_matrix(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    np.savez(path, data=MATRIX.T, columns=np.array(["time [s]", "angle [rad]", "n [rad/s]", "iq [A]"]))
    log = read_log(path, mapping={"omega": "n [rad/s]"})
    np.testing.assert_array_equal(log["omega"], OMEGA)


def test_a_structured_array_is_read_by_its_fields(tmp_path: Path) -> None:
    path = tmp_path / "run.npy"
    array = np.zeros(N, dtype=[("t", "f8"), ("angle_deg", "f4"), ("speed_rpm", "f8"), ("iq", "f8")])
    for field, values in zip(array.dtype.names, (T, np.degrees(THETA), OMEGA * 30 / np.pi, CURRENT), strict=True):
        array[field] = values
    np.save(path, array)
    log = read_log(path)
    np.testing.assert_allclose(log["theta"], THETA, atol=1e-6)
    np.testing.assert_allclose(log["omega"], OMEGA, rtol=1e-12)


def test_a_matrix_without_names_has_numbered_columns(tmp_path: Path) -> None:
    path = tmp_path / "run.npy"
    np.save(path, np.asfortranarray(MATRIX))
    assert [column.name for column in open_table(path).columns] == ["#1", "#2", "#3", "#4"]
    log = read_log(path, mapping={"t": "#1 [s]", "omega": "#3 [rad/s]", "i_q": "#4 [A]"})
    np.testing.assert_array_equal(log["omega"], OMEGA)


class _Runs:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return pytest.fail, ("executed",)


def test_no_pickle_is_read(tmp_path: Path) -> None:
    array = tmp_path / "a.npy"
    np.save(array, np.array([_Runs()], dtype=object), allow_pickle=True)
    archive = tmp_path / "b.npz"
    with zipfile.ZipFile(archive, "w") as content:
        content.writestr("t.npy", array.read_bytes())
        content.writestr("x.npy", pickle.dumps(_Runs()))
    for path in (array, archive):
        with pytest.raises(LogError, match="pickle"):
            read_log(path)


def test_a_header_that_declares_more_than_the_file_holds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": (10**13, 4)})
    path.write_bytes(stream.getvalue() + bytes(64))
    with pytest.raises(LogError, match="damaged NumPy file"):
        read_log(path)


def test_an_archive_made_to_fill_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.npz"
    size = 2_000_000
    monkeypatch.setattr(guard, "ALWAYS", 1e6)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (size,)})
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as content, content.open("t.npy", "w") as member:
        member.write(header.getvalue())
        block = bytes(1 << 20)
        for _ in range(8 * size // len(block)):
            member.write(block)
    with pytest.raises(LogError, match="made to fill the memory"):
        read_log(path)


def test_another_zip_archive_is_still_refused(tmp_path: Path) -> None:
    path = tmp_path / "book.xlsx"
    with zipfile.ZipFile(path, "w") as content:
        content.writestr("xl/workbook.xml", "<workbook/>")
    with pytest.raises(LogError, match="zip archive or Excel workbook"):
        read_log(path)


def _structs(rows: list[dict[str, object]]) -> np.ndarray:
    array = np.zeros((1, len(rows)), dtype=[(field, "O") for field in rows[0]])
    for k, row in enumerate(rows):
        for field, value in row.items():
            array[0, k][field] = value
    return array


def dspace(path: Path) -> None:
    """The layout of a ControlDesk recording: X has the time, Y the channels."""
    rows = [
        {"Name": f"Platform()://Model Root/{name}", "Type": 4.0, "Data": values[None, :], "Unit": unit, "XIndex": 1.0}
        for name, values, unit in (("pos", THETA, "rad"), ("n_act", OMEGA * 30 / np.pi, "rpm"), ("i_q", CURRENT, "A"))
    ]
    time = _structs([{"Name": "time", "Type": 4.0, "Data": T[None, :], "Unit": "s"}])
    scipy.io.savemat(path, {"rec1_007": {"X": time, "Y": _structs(rows), "Capture": {"Downsampling": 1.0}}})


def simulink(path: Path) -> None:
    """The layout of a scope that saves a structure with time."""
    rows = [
        {"values": values[:, None], "dimensions": 1.0, "label": label, "title": "", "blockName": "model/Scope"}
        for label, values in (("theta", THETA), ("iq", CURRENT))
    ]
    scipy.io.savemat(path, {"ScopeData": {"time": T[:, None], "signals": _structs(rows), "blockName": "model/Scope"}})


@pytest.mark.usefixtures("good_files")
def test_a_recording_of_dspace(tmp_path: Path) -> None:
    path = tmp_path / "rec.mat"
    dspace(path)
    log = read_log(path)
    np.testing.assert_allclose(log["omega"], OMEGA, rtol=1e-12)
    np.testing.assert_array_equal(log["theta"], THETA)
    np.testing.assert_array_equal(log["i_q"], CURRENT)


@pytest.mark.usefixtures("good_files")
def test_a_structure_with_time_of_simulink(tmp_path: Path) -> None:
    path = tmp_path / "scope.mat"
    simulink(path)
    log = read_log(path)
    np.testing.assert_array_equal(log["theta"], THETA)
    np.testing.assert_array_equal(log["i_q"], CURRENT)


def test_an_array_of_structs_in_version_7_3(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "scope.mat"
    with h5py.File(path, "w") as content:
        content["ScopeData/time"] = T[None, :]
        fields = {"values": [], "label": []}
        for k, (label, values) in enumerate((("theta", THETA), ("iq", CURRENT))):
            content[f"#refs#/v{k}"] = values[None, :]
            text = content.create_dataset(f"#refs#/l{k}", data=np.frombuffer(label.encode("utf-16-le"), np.uint16))
            text.attrs["MATLAB_class"] = np.bytes_("char")
            fields["values"].append(content[f"#refs#/v{k}"].ref)
            fields["label"].append(text.ref)
        for field, pointers in fields.items():
            content.create_dataset(f"ScopeData/signals/{field}", data=np.array([pointers], dtype=h5py.ref_dtype))
    log = read_log(path)
    np.testing.assert_array_equal(log["theta"], THETA)
    np.testing.assert_array_equal(log["i_q"], CURRENT)


@pytest.mark.parametrize("how", ["reference", "hard link"])
def test_structs_that_hold_themselves_are_refused_soon(
    tmp_path: Path, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few kilobytes stand for 1e14 structs."""
    h5py = pytest.importorskip("h5py")
    monkeypatch.setattr(mat, "MOST_MEMBERS", 5000)
    with h5py.File(tmp_path / "ring.mat", "w") as content:
        ring = content.create_group("ring")
        if how == "reference":
            ring.create_dataset("again", data=np.array([ring.ref] * 4096, dtype=h5py.ref_dtype))
        else:
            for k in range(300):
                ring[f"again{k}"] = ring
    with pytest.raises(LogError, match="structs in structs"):
        read_log(tmp_path / "ring.mat")


def test_a_link_to_another_file_is_not_followed(tmp_path: Path) -> None:
    """It may lead to a pipe, at which nobody writes, or nowhere."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "linked.mat", "w") as content:
        for name, values in (("t", T), ("theta", THETA), ("i_q", CURRENT)):
            content[f"scope/{name}"] = values
        content["scope/elsewhere"] = h5py.ExternalLink("absent.h5", "/theta")
        content["scope/nowhere"] = h5py.SoftLink("/absent")
    np.testing.assert_array_equal(read_log(tmp_path / "linked.mat")["theta"], THETA)


@pytest.mark.parametrize("kind", ["M8[Y]", "m8[M]", "m8"])
def test_times_of_no_fixed_length_are_no_time(tmp_path: Path, kind: str) -> None:
    np.savez(tmp_path / "years.npz", years=np.arange(len(T)).astype(kind), t=T, theta=THETA, i_q=CURRENT)
    np.testing.assert_array_equal(read_log(tmp_path / "years.npz")["theta"], THETA)
