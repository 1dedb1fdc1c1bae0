"""What is fuzzed, from which seeds, and what a reader must never do. Shared by atheris and by the bounded test."""

from __future__ import annotations

import io
import struct
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.importers import describe

__all__ = ["PATIENCE", "READERS", "Reader", "seeds"]

Reader = Callable[[bytes], None]
PATIENCE = 20.0  # s for one file of a few kB
T = 0.001 * np.arange(60)


def _file(content: bytes, suffix: str, read: Callable[[Path], object]) -> None:
    """Read a file of these bytes: an answer, or one line that names the file, soon, and nothing left behind."""
    with tempfile.TemporaryDirectory(prefix="fuzz") as folder:
        path = Path(folder) / f"some{suffix}"
        path.write_bytes(content)
        start = time.perf_counter()
        try:
            read(path)
        except PmsmCtrlError as error:
            message = str(error)
            assert message.startswith(f"{path}: "), message
            assert "\n" not in message
            assert len(message) < 4000, f"{len(message)} characters"
        assert time.perf_counter() - start < PATIENCE
        assert [p.name for p in Path(folder).iterdir()] == [path.name]


def _log(content: bytes, suffix: str) -> None:
    def read(path: Path) -> None:
        report = describe(path)
        assert all(np.isfinite(report.log[name]).all() for name in report.log)
        assert (np.diff(report.log.t) > 0.0).all()
        report.summary()
        report.to_dict()

    _file(content, suffix, read)


def _packed_mat(content: bytes) -> bytes:
    """Return a MAT file whose one compressed variable unpacks to these bytes: damage is done before its checksum."""
    body = zlib.compress(content)
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    return header + struct.pack("<II", 15, len(body)) + body  # miCOMPRESSED


def _zipped(content: bytes) -> bytes:
    """Return an archive whose arrays are these bytes, with the checksums that belong to them."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", content)
        archive.writestr("theta.npy", content[::-1] if len(content) % 2 else content)
    return stream.getvalue()


READERS: dict[str, Reader] = {
    "npy": lambda content: _log(b"\x93NUMPY" + content[6:], ".npy"),
    "npz": lambda content: _log(_zipped(content), ".npz"),
    "mat_packed": lambda content: _log(_packed_mat(content), ".mat"),
    "text": lambda content: _log(content, ".csv"),
    "hdf5": lambda content: _log(b"\x89HDF\r\n\x1a\n" + content[8:], ".mat"),
    "tdms": lambda content: _log(b"TDSm" + content[4:], ".tdms"),
    "parquet": lambda content: _log(b"PAR1" + content[4:], ".parquet"),
    "mat": lambda content: _log(b"MATLAB 5.0 MAT-file" + content[19:], ".mat"),
    "mdf": lambda content: _log(b"MDF     " + content[8:], ".mf4"),
    "bag": lambda content: _log(b"\x89MCAP0\r\n" + content[8:], ".mcap"),
    "design": lambda content: _file(content, ".toml", lambda path: Design.read(path).to_toml()),
}

TEXTS = [
    "t [s],theta [rad],i_q [A]\n0,1,2\n0.1,2,3\n0.2,3,4\n",
    "Zeit;Position [°];Iq\nms;°;A\n0,5;1,5;2\n1,5;2,5;3\n2,5;3,5;4\n",
    "Timestamp;Position;Iq\n2024-05-17T10:00:00.5Z;1;2\n2024-05-17T10:00:01.5Z;2;3\n",
    "Datum\tPosition\tIq\n17.05.2024 10:00:00,5\t1\t2\n17.05.2024 10:00:01,5\t2\t3\n",
    "Time\tPosition\tIq\n132959733843760000\t1\t2\n132959733843770000\t2\t3\n",
    "Time;Position;Time;Iq\n0;1;0;5\n1;2;2;6\n2;3;;\n",
    "Name\taxis\nFile\tx\nStarttime of export\t132959733843760000\n\nName\tActPos\tName\tActVelo\n"
    "SampleTime[ms]\t0,5\tSampleTime[ms]\t1\nUnit\t° (Angle)\tUnit\trpm\n\n0\t1\t0\t2\n0.5\t2\t1\t3\nEOF\n",
    '"t [s]","theta [rad]","i_q [A]"\r\n"0,5","1","2"\r\n"1,5","2","3"\r\n',
]
DESIGN = Path(__file__).resolve().parents[2] / "designs" / "seed_motor.toml"


def _written(write: Callable[[Path], object], suffix: str) -> list[bytes]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"seed{suffix}"
        write(path)
        return [path.read_bytes()]


def _mat(path: Path) -> None:
    from scipy.io import savemat

    savemat(path, {"t": T, "theta": np.sin(T), "i_q": np.cos(T), "note": "text", "part": {"omega": T}})


def _npy(path: Path) -> None:
    array = np.zeros(T.size, dtype=[("t", "f8"), ("theta", "f4"), ("i_q", "f8")])
    array["t"], array["theta"], array["i_q"] = T, np.sin(T), np.cos(T)
    np.save(path, array)


def _hdf5(path: Path) -> None:
    import h5py

    # one dataset in chunks without compression, whose damage reaches the numbers
    with h5py.File(path, "w", userblock_size=0) as content:
        for name, values, packed in (("t", T, None), ("theta", np.sin(T), "gzip"), ("part/i_q", np.cos(T), "gzip")):
            content.create_dataset(name, data=values, chunks=(20,), compression=packed)


def _tdms(path: Path) -> None:
    import nptdms

    wave = {"wf_increment": 0.001, "wf_start_offset": 0.0}
    with nptdms.TdmsWriter(path) as writer:
        channels = [("Position", np.sin(T)), ("Iq", np.cos(T))]
        writer.write_segment(
            [nptdms.ChannelObject("drive", name, values, properties=wave) for name, values in channels]
        )


def _parquet(path: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table({"t [s]": T, "theta [rad]": np.sin(T), "i_q [A]": np.cos(T)})
    pyarrow.parquet.write_table(table, path, compression="none")  # damage reaches the pages


def _mdf(path: Path) -> None:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from asammdf import MDF, Signal

        with MDF(version="4.10") as content:
            content.append(
                [Signal(np.sin(T), T, name="Position", unit="rad"), Signal(np.cos(T), T, name="Iq", unit="A")]
            )
            content.save(path, overwrite=True)


def _bag(path: Path) -> None:
    from mcap.writer import CompressionType
    from mcap_ros2.writer import Writer

    with open(path, "wb") as stream, Writer(stream, compression=CompressionType.NONE, enable_crcs=False) as bag:
        for name, values in (("t", T), ("theta", np.sin(T)), ("i_q", np.cos(T))):
            number = bag.register_msgdef("std_msgs/msg/Float64", "float64 data\n")
            for k, value in enumerate(values):
                bag.write_message(f"/{name}", number, {"data": float(value)}, log_time=1_000_000 * (k + 1))


def seeds(reader: str) -> list[bytes]:
    """Return good files for a reader; raises ImportError when the library that writes them is not there."""
    binary: dict[str, tuple[Callable[[Path], None], str]] = {
        "mat": (_mat, ".mat"), "hdf5": (_hdf5, ".mat"), "tdms": (_tdms, ".tdms"),
        "parquet": (_parquet, ".parquet"), "mdf": (_mdf, ".mf4"), "npy": (_npy, ".npy"), "bag": (_bag, ".mcap"),
    }  # fmt: skip
    if reader == "text":
        return [text.encode() for text in TEXTS]
    if reader == "design":
        return [DESIGN.read_bytes(), b"[motor]\nJ = 1e-4\nK_t = 1.0\n[log.channels]\nt = 'x [s]'\n"]
    if reader == "mat_packed":  # one variable behind the header of 128 bytes
        return [content[128:] for content in _written(_mat, ".mat")]
    if reader == "npz":
        return _written(_npy, ".npy")
    return _written(*binary[reader])
