"""MAT files of both kinds, and the measured ones."""

from __future__ import annotations

import builtins
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.importers import read_log, worker
from tests.effort import amount, seeds

N = 50
T = np.arange(N) * 1e-3
CONTENT = {"t": T, "theta": np.sin(T), "torque": np.cos(T), "gtau": 35.15}


def save73(path: Path, content: dict[str, object]) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as stream:
        for name, value in content.items():
            # MATLAB stores a column vector with the axes swapped
            stream[name] = np.atleast_2d(value)
        stream["#refs#/a"] = np.zeros((1, N))
        stream["text"] = np.frombuffer("abc".encode("utf-16-le"), dtype=np.uint16)
    return path


def test_version_5(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, CONTENT | {"label": "run 7", "q": np.zeros(N)}, oned_as="column")
    log = read_log(path)
    assert log.provenance.importer == "MATLAB v5"
    np.testing.assert_array_equal(log["theta"], CONTENT["theta"])
    notes = " | ".join(log.provenance.notes)
    assert "gtau = 35.15" in notes
    assert "label" in notes
    assert "not used: q" in notes


def test_version_7_3(tmp_path: Path) -> None:
    log = read_log(save73(tmp_path / "log.mat", CONTENT))
    assert log.provenance.importer == "MATLAB v7.3"
    np.testing.assert_array_equal(log["torque"], CONTENT["torque"])
    assert any("gtau = 35.15" in note for note in log.provenance.notes)


def test_version_7_3_without_h5py_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save73(tmp_path / "log.mat", CONTENT)
    real = builtins.__import__

    def refuse(name: str, *rest: object, **more: object) -> object:
        if name == "h5py":
            raise ImportError(name)
        return real(name, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(LogError, match=r"needs h5py: pip install 'pmsm-ctrl\[matlab73\]'"):
        read_log(path)


@pytest.mark.usefixtures("good_files")
def test_structs_and_matrices(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, {"run": {"time": T, "y": np.column_stack([np.sin(T), np.cos(T)])}})
    log = read_log(path, mapping={"t": "run.time", "theta": "run.y.1 [deg]", "i_q": "run.y.2"})
    np.testing.assert_allclose(log["theta"], np.deg2rad(np.sin(T)), rtol=1e-14)
    np.testing.assert_array_equal(log["i_q"], np.cos(T))


@pytest.mark.usefixtures("good_files")
def test_nan_names_variable_and_sample(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    theta = np.sin(T)
    theta[6] = np.nan
    scipy.io.savemat(path, CONTENT | {"theta": theta})
    with pytest.raises(LogError, match="variable 'theta', sample 7: empty or not a number"):
        read_log(path)


@pytest.mark.usefixtures("good_files")
def test_unequal_lengths_and_no_vectors(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, CONTENT | {"theta": np.zeros(N + 1)})
    with pytest.raises(LogError, match="'theta' has no time column of its own"):
        read_log(path)
    scipy.io.savemat(path, {"a": 1.0, "b": "text"})
    with pytest.raises(LogError, match=r"no numeric vectors .*found: a, b"):
        read_log(path)


def test_a_reader_that_crashes_takes_nobody_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, CONTENT)
    crash = tmp_path / "crash"
    crash.write_text("#!/bin/sh\nkill -SEGV $$\n")
    crash.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(crash))
    with pytest.raises(LogError, match=r"log\.mat: damaged MAT file \(its reader crashed\)"):
        read_log(path)
    monkeypatch.setattr("sys.executable", str(tmp_path / "nothing"))
    with pytest.raises(LogError, match="the MAT reader cannot be started"):
        read_log(path)


def test_flipped_bytes_never_escape(tmp_path: Path, rng: np.random.Generator) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, CONTENT | {"s": {"a": 1.0, "b": "x"}})
    content = path.read_bytes()
    for _ in range(amount(2, 8)):
        damaged = bytearray(content)
        for place in rng.integers(126, len(content), 6):
            damaged[place] = rng.integers(0, 256)
        path.write_bytes(damaged)
        message = ""
        try:
            read_log(path)
        except LogError as error:
            message = str(error)
        assert "\n" not in message


@pytest.mark.parametrize("cut", seeds(1000, 10, 127, 200))
def test_a_file_cut_short(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, CONTENT)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(LogError) as caught:
        read_log(path)
    assert "\n" not in str(caught.value)


def test_emps_is_a_linear_log_in_newtons(measured, designs: Path) -> None:
    design = Design.read(designs / "emps.toml")
    for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"):
        path = measured(f"emps/{name}")
        log = read_log(path, design)
        raw = scipy.io.loadmat(path)
        assert log.motion == "linear"
        assert list(log) == ["t", "theta_ref", "theta", "torque"]
        assert len(log) == 24841
        np.testing.assert_allclose(log["torque"], 35.15 * raw["vir"].ravel(), rtol=1e-15)
        np.testing.assert_array_equal(log["theta"], raw["qm"].ravel())
        assert log.rate == pytest.approx(1000.0, rel=1e-3)


def test_laas_text_files(measured) -> None:
    log = read_log(measured("laas_mn4004/speed_test1.txt"))
    assert list(log) == ["t", "omega_ref", "theta", "omega", "i_q"]
    assert np.unique(log["omega_ref"]) == pytest.approx(6.28319)
    assert "omega_ref guessed from 'Reference Velocity' [rad/s], unit assumed" in log.provenance.notes
    mapped = read_log(
        measured("laas_mn4004/acc_current.txt"),
        mapping={"t": "Time [s]", "theta": "Position [rad]", "omega": "Velocity [rad/s]", "i_q": "Iq [A]"},
    )
    assert len(mapped) == 26999
    assert mapped.t[0] == 3.001


def test_the_reader_takes_nothing_of_numpy_from_who_calls_it(tmp_path: Path) -> None:
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, CONTENT)
    answer, _ = worker.read_mat(str(path), ())
    assert {name for name, _ in answer["variables"]} == set(CONTENT)
    assert np.testing is not None
