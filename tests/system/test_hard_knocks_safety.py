"""Nothing in a file is executed, no pickle is read, no path leaves its folder, no name breaks out of its place."""

from __future__ import annotations

import io
import os
import pickle
import re
import struct
import subprocess
import sys
import tomllib
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from pmsm_ctrl import Design
from pmsm_ctrl.cli import main
from pmsm_ctrl.errors import DesignError, LogError
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log
from tests.effort import seeds

SEED_MOTOR = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"
T = 0.001 * np.arange(60)


class Bomb:
    """Leaves a file behind when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("suffix", [".pkl", ".csv", ".mat", ".npy", ".parquet"])
def test_a_pickle_is_not_read(tmp_path: Path, protocol: int, suffix: str) -> None:
    crater = tmp_path / "crater"
    path = tmp_path / f"log{suffix}"
    path.write_bytes(pickle.dumps({"t": T, "bomb": Bomb(crater)}, protocol=protocol))
    with pytest.raises(LogError, match=re.escape(str(path))):
        read_log(path)
    assert not crater.exists()


def test_numpy_objects_are_not_read(tmp_path: Path) -> None:
    crater = tmp_path / "crater"
    for name, write in (("a.npy", np.save), ("a.npz", np.savez)):
        write(tmp_path / name, np.array([Bomb(crater)], dtype=object), allow_pickle=True)
        with pytest.raises(LogError, match="a pickle, which is never read"):
            read_log(tmp_path / name)
    assert not crater.exists()


def test_an_extension_type_of_parquet_is_not_unpickled(tmp_path: Path) -> None:
    """CVE-2023-47248: old pyarrow unpickled the metadata of a column."""
    pyarrow = pytest.importorskip("pyarrow")
    writer = pytest.importorskip("pyarrow.parquet")
    crater, path = tmp_path / "crater", tmp_path / "log.parquet"
    evil = {
        b"ARROW:extension:name": b"arrow.py_extension_type",
        b"ARROW:extension:metadata": pickle.dumps(Bomb(crater)),
    }
    fields = [pyarrow.field("t [s]", pyarrow.float64()), pyarrow.field("theta [rad]", pyarrow.float64()),
              pyarrow.field("i_q [A]", pyarrow.float64(), metadata=evil)]  # fmt: skip
    schema = pyarrow.schema(fields, metadata={b"pandas": b'{"columns": [], "index_columns": ["__import__(0)"]}'})
    writer.write_table(pyarrow.Table.from_arrays([T, np.sin(T), np.cos(T)], schema=schema), path)
    with suppress(LogError):
        assert len(read_log(path)) == 60
    assert not crater.exists()


def test_a_function_in_a_mat_file_is_not_called(tmp_path: Path) -> None:
    """A function handle is a struct of another class number; so are Java objects and other opaque ones."""
    scipy_io = pytest.importorskip("scipy.io")
    buffer = io.BytesIO()
    scipy_io.savemat(buffer, {"t": T, "theta": np.sin(T), "i_q": np.cos(T), "f": {"name": "system('touch crater')"}})
    content = bytearray(buffer.getvalue())
    flags = content.rindex(b"\x06\x00\x00\x00\x08\x00\x00\x00\x02\x00\x00\x00")  # array flags of the struct, class 2
    for kind in (3, 16, 17, 18):  # object, function handle, opaque, object reference
        content[flags + 8] = kind
        path = tmp_path / f"class{kind}.mat"
        path.write_bytes(content)
        with suppress(LogError):
            assert set(read_log(path)) == {"t", "theta", "i_q"}
        assert sorted(p.name for p in tmp_path.iterdir() if not p.name.startswith("class")) == []


def test_hdf5_does_not_lead_to_another_file(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    secret = tmp_path / "secret.bin"
    secret.write_bytes(np.arange(60.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["i_q"] = np.arange(60.0)
    for kind in ("external", "virtual", "link"):
        path = tmp_path / f"{kind}.mat"
        with h5py.File(path, "w") as content:
            content["t"], content["theta"] = T, np.sin(T)
            if kind == "external":
                content.create_dataset("i_q", (60,), "f8", external=[(str(secret), 0, 480)])
            elif kind == "virtual":
                layout = h5py.VirtualLayout((60,), "f8")
                layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "i_q", shape=(60,))
                content.create_virtual_dataset("i_q", layout)
            else:
                content["i_q"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/i_q")
        with pytest.raises(LogError, match=r"points to another file|no channel 'i_q'"):
            read_log(path)


def test_a_promised_size_is_not_believed(tmp_path: Path) -> None:
    """A few bytes can promise a terabyte; memory is asked for only as far as there is some."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "bomb.mat"
    with h5py.File(path, "w") as content:
        content.create_dataset("t", (10**12,), "f8", chunks=(1024,), compression="gzip")
    assert path.stat().st_size < 10_000
    with pytest.raises(LogError, match=r"bomb\.mat: HDF5 file of 1e\+12 values: 8e\+03 GB needed"):
        read_log(path)


def test_a_small_file_does_not_unpack_to_any_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By hand, as the MAT-file format of version 5 has it: a header of 128 bytes, then type 15 and a zlib stream."""
    from pmsm_ctrl.importers import guard, worker

    packed = zlib.compress(bytes(1 << 24), 9)
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path = tmp_path / "l.mat"
    path.write_bytes(header + struct.pack("<II", 15, len(packed)) + packed)
    monkeypatch.setattr(worker, "ALWAYS", 1e6)
    with pytest.raises(ValueError, match=r"unpacks to more than 1\.65 MB"):  # 100 times its own 16.5 kB
        worker.read_mat(str(path), ())
    monkeypatch.setattr(guard, "ALWAYS", 1e6)
    guard.afford("l.parquet", "Parquet", 1e5, path)
    with pytest.raises(LogError, match=r"l\.parquet: Parquet file of 3e\+05 values, 2\.4 MB, in a file of 0\.0165 MB"):
        guard.afford("l.parquet", "Parquet", 3e5, path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
def test_a_pipe_or_a_device_does_not_hang_a_command(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for source in (pipe, Path("/dev/zero")):
        with pytest.raises(LogError, match="is a device or a pipe"):
            read_log(source)
        with pytest.raises(DesignError, match="not a file"):
            Design.read(source)


# ---- designs ----------------------------------------------------------------------------------------------------

NAMES = ["../../escaped", "/tmp/escaped", "a*/ int escaped; /*", "a *) escaped := 1; (*", "<script>alert(1)</script>",
         '"><img src=x onerror=alert(1)>', "{{ 7 * 7 }}", "{% include '/etc/passwd' %}", "$(touch escaped)",
         "`touch escaped`", "%s%n", "CON", "a\\", "$x_1$", "."]  # fmt: skip
# Out of a comment in C, out of one in Structured Text, and into a page, all in one
ANYWHERE = "a*/ int escaped; /* *) escaped := 1; (* <script>alert(1)</script>"


def design_named(folder: Path, name: str) -> Path:
    data = tomllib.loads(SEED_MOTOR.read_text(encoding="utf-8")) | {"name": name}
    path = folder / "axis.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return path


def files_in(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", seeds(ANYWHERE, *NAMES))
def test_a_name_is_a_name_wherever_it_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    inside = tmp_path / "deep" / "inside"
    inside.mkdir(parents=True)
    monkeypatch.chdir(inside)
    design_named(inside, name)
    t = 1e-3 * np.arange(3000)
    Log({"t": t, "omega": 50 * np.sin(5 * t), "i_q": 0.1 * np.sign(np.sin(5 * t))}).write_csv("log.csv")
    for line in (
        ["export", "axis.toml", "--language", "c", "--output", "code"],
        ["export", "axis.toml", "--language", "st", "--output", "code", "--force"],  # beside the C, over the same table
        ["identify", "log.csv", "--design", "axis.toml", "--report", "page.html"],
    ):
        with pytest.raises(SystemExit) as left:
            main(line)
        assert left.value.code in (0, None), capsys.readouterr().err
    assert files_in(tmp_path) == files_in(inside), "everything written is inside"
    assert not Path("escaped").exists()
    page = Path("page.html").read_text(encoding="utf-8")
    assert "alert(1)</script>" not in page
    assert "<img src=x" not in page
    for path in Path("code").iterdir():
        text = path.read_text(encoding="utf-8", errors="replace")
        if path.suffix in (".c", ".h"):
            text = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
            assert "escaped;" not in text
        elif path.suffix == ".st":
            text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)
            assert "escaped :=" not in text


def test_the_report_of_a_study_stays_in_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from pmsm_ctrl.report.chain import report_path

    monkeypatch.chdir(tmp_path)
    for name in [*NAMES, "..", "a" * 100, "/", "reports/../../x"]:
        path = report_path(Design.read(design_named(tmp_path, name)), None)
        assert path.resolve().parent == tmp_path / "reports"
        assert path.suffix == ".html"


@pytest.mark.parametrize("name", ["two\nlines", "\x1b[2J", "\x07", "a\u202eb", "a" * 101])
def test_a_name_that_steers_a_terminal_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(DesignError, match=r"axis\.toml: name: ") as caught:
        Design.read(design_named(tmp_path, name))
    assert str(caught.value).isprintable()


def test_no_escape_sequence_of_a_file_reaches_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t [s],theta [rad],\x1b]0;owned [A]\n0,1,2\n1,2,\x1b[31mred\n2,3,4\n", encoding="utf-8")
    design = tmp_path / "axis.toml"
    design.write_text('[motor]\n"J\\u001b[31m" = 1.0\nK_t = 1.0\n', encoding="utf-8")
    for line in (["import", str(path)], ["import", str(path), "--design", str(design)]):
        with pytest.raises(SystemExit):
            main(line)
        shown = capsys.readouterr()
        assert "\x1b" not in shown.out + shown.err


def test_a_package_beside_the_log_is_not_imported(tmp_path: Path) -> None:
    """The readers that run in processes of their own must not pick up modules from the folder they are called in."""
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(tmp_path / "log.mat", {"t": T, "theta": np.sin(T), "i_q": np.cos(T)})
    for module in ("numpy", "scipy", "json", "warnings", "contextlib"):
        (tmp_path / f"{module}.py").write_text("open('crater', 'w')\nraise SystemExit('hijacked')\n", encoding="utf-8")
    script = "import sys; from pmsm_ctrl.cli import main; main(['import', 'log.mat'])"
    run = subprocess.run(
        [sys.executable, "-P", "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert not (tmp_path / "crater").exists()
