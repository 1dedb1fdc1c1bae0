"""From a file to a log: which format it has, which column is which channel, and what it all adds up to."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, PmsmCtrlError, require_kind
from pmsm_ctrl.files import sha256
from pmsm_ctrl.importers.build import channels_of
from pmsm_ctrl.importers.clock import with_clock
from pmsm_ctrl.importers.current_scale import peak_or_rms
from pmsm_ctrl.importers.header_rate import timed_by_header
from pmsm_ctrl.importers.mapping import Assignment, assign, of_this_file
from pmsm_ctrl.importers.notices import HEADER_PERIOD, UNIT_ASSUMED
from pmsm_ctrl.importers.plausibility import check
from pmsm_ctrl.importers.sources import Source, as_file, frame_digest, frame_table, is_frame
from pmsm_ctrl.importers.table import Table
from pmsm_ctrl.log import Log, Provenance

__all__ = ["log_of", "open_table", "read_all", "read_log"]

ACCEPTED = "CSV and other text, MAT, MDF4, TDMS, Parquet, NumPy, ROS 2 bags"
_REFUSED = {
    b"PK\x03\x04": "a zip archive or Excel workbook; save the sheet as CSV",
    b"#ROSBAG V": "a ROS 1 bag; convert it to MCAP first (`mcap convert`, or rosbags-convert)",
    b"\x1f\x8b": "gzip-compressed; unpack it first",
    **{bytes([0x80, protocol]): "a Python pickle, which is never read" for protocol in range(2, 6)},
}


UNEQUAL = 0.02  # of a period in the header and in the time stamps


def read_log(
    source: Source, design: Design | None = None, mapping: Mapping[str, str] | None = None, *, name: str = ""
) -> Log:
    """Read a measured or simulated log.

    Parameters
    ----------
    source
        A path, the bytes of a file, or a stream of bytes: CSV and other text, MAT (v4 to v7.3), MDF4, TDMS, Parquet,
        NumPy or a ROS 2 bag, found from the content. Or a data frame of pandas, polars or pyarrow, whose columns are
        read as those of a file.
    design
        Its [log] table maps foreign columns to channels; its motion decides between rotary and linear units.
    mapping
        Channel to column, ``{"omega": "speed [rpm]"}``; takes precedence over the design's table. ``"#3 [rpm]"`` is the
        third column, ``{"t": "every 0.125 ms"}`` the time of a file without one.
    name
        What messages and results call it; the path where it is left out.

    Returns
    -------
    Log
        In SI units, with notes and warnings in its provenance.

    Raises
    ------
    LogError
        One line with the file, the place and what is wrong.
    """
    if design is not None or isinstance(source, Design):
        require_kind(design, Design, "read_log(source, design): design")
    if is_frame(source):
        return _from_table(frame_table(source, name), frame_digest, design, mapping)[0]
    with as_file(source, name) as (path, label):
        return read_all(path, design, mapping, file=label)[0]


def read_all(
    path: str | os.PathLike[str], design: Design | None = None, mapping: Mapping[str, str] | None = None, file: str = ""
) -> tuple[Log, Table, Assignment]:
    """Return the log of `read_log` with the table and the assignment that led to it.

    Parameters
    ----------
    path, design, mapping
        As `pmsm_ctrl.importers.read_log`.
    file : str
        What messages and results call it; the path where it is left out.

    Returns
    -------
    (Log, Table, Assignment)

    Raises
    ------
    LogError
        As `read_log`.
    """
    target, found = _existing(path, file)
    return _from_table(open_table(target, design, found), lambda _: sha256(target), design, mapping)


def log_of(
    table: Table,
    design: Design | None = None,
    mapping: Mapping[str, str] | None = None,
    stated: Mapping[str, str] | None = None,
) -> Log:
    """Return the log of an opened table, as `read_log`, without the digest of the file.

    Parameters
    ----------
    table : Table
    design, mapping
        As `read_log`.
    stated : mapping of str to str, optional
        What of the mapping somebody has stated, where that is less.

    Returns
    -------
    Log

    Raises
    ------
    LogError
        As `read_log`.
    """
    return _from_table(table, lambda _: "", design, mapping, stated)[0]


def _from_table(
    table: Table,
    digest_of: Callable[[Table], str],
    design: Design | None,
    mapping: Mapping[str, str] | None,
    stated: Mapping[str, str] | None = None,
) -> tuple[Log, Table, Assignment]:
    stated = mapping if stated is None else stated
    table, design, disputed = of_this_file(table, design, mapping)
    table, mapping = timed_by_header(table, design, mapping)
    table, mapping = with_clock(table, design, mapping)
    assignment, file = assign(table, design, mapping), table.file
    # a large file takes a second to hash, so a thread does it during parsing
    with ThreadPoolExecutor(max_workers=1) as pool:
        digest = pool.submit(digest_of, table)
        try:
            cut = (design.log.wrap, design.log.window) if design is not None else (None, None)
            channels, notes, doubts = channels_of(table, assignment, *cut)
        except MemoryError:
            raise LogError(f"{file}: does not fit into memory") from None
    kept = tuple(source for source in assignment.sources if source.channel in channels)
    assignment = replace(assignment, sources=kept)
    provenance = Provenance(file, digest.result(), table.format, (*table.notes, *assignment.notes, *notes))
    log = Log(channels, motion=assignment.motion, provenance=provenance)
    assumed = tuple(source for source in assignment.sources if source.doubtful(table))
    if assumed:
        units = ", ".join(f"{source.unit} for {source.channel}" for source in assumed)
        doubts = (*doubts, UNIT_ASSUMED(channels=[source.channel for source in assumed], units=units))
    period = table.header_period
    if period is not None and len(log) > 2 and abs(log.period / period.seconds - 1.0) > UNEQUAL and not period.assumed:
        doubts = (*doubts, HEADER_PERIOD(line=period.text, period_ms=1e3 * log.period))
    doubts = (*disputed, *doubts, *check(log, design), *peak_or_rms(log, table, assignment, design, stated))
    return replace(log, provenance=replace(provenance, notices=doubts)), table, assignment


def open_table(path: str | os.PathLike[str], design: Design | None = None, file: str = "") -> Table:
    """Open a file and identify its columns without reading all numbers.

    Parameters
    ----------
    path : path
    design : Design, optional
        Its [log] table may name separator and decimal mark.
    file : str
        What messages call it; the path where it is left out.

    Returns
    -------
    Table

    Raises
    ------
    LogError
        When the file is missing, empty, damaged or of no known format.
    """
    target, file = _existing(path, file)
    try:
        with open(target, "rb") as stream:
            # what the kernel makes up, such as /proc/kmsg, has no size, and reading it may wait for ever
            head = stream.read(1024) if target.stat().st_size else b""
    except OSError as error:
        raise LogError(f"{file}: cannot be read ({error.strerror})") from None
    if not head:
        raise LogError(f"{file}: empty; a log with time, position or speed, and current or torque was expected")
    if head.startswith((b"\x93NUMPY", b"PK\x03\x04")):
        from pmsm_ctrl.importers.numpy_files import is_npz, open_npy, open_npz

        if head.startswith(b"\x93NUMPY"):
            return open_npy(target, file)
        if is_npz(target):
            return open_npz(target, file)
    for magic, what in _REFUSED.items():
        if head.startswith(magic):
            raise LogError(f"{file}: {what} (accepted: {ACCEPTED})")
    if head.startswith(b"\x89HDF") or head[512:516] == b"\x89HDF":
        from pmsm_ctrl.importers.mat import open_hdf5

        return open_hdf5(target, file)
    if head.startswith(b"MATLAB 5.0") or target.suffix.lower() == ".mat":
        from pmsm_ctrl.importers.mat import open_mat

        return open_mat(target, file)
    if head.startswith((b"MDF     ", b"UnFinMF ")):
        from pmsm_ctrl.importers.mdf import open_mdf

        return open_mdf(target, file)
    if head.startswith(b"TDSm"):
        from pmsm_ctrl.importers.tdms import open_tdms

        return open_tdms(target, file)
    if head.startswith(b"PAR1"):
        from pmsm_ctrl.importers.parquet import open_parquet

        return open_parquet(target, file)
    if head.startswith((b"\x89MCAP0\r\n", b"SQLite format 3\0")):
        from pmsm_ctrl.importers.bags import open_bag

        return open_bag(target, file)
    from pmsm_ctrl.importers.text import open_text

    settings = design.log if design is not None else None
    return open_text(target, file, settings.separator if settings else None, settings.decimal if settings else None)


def _existing(path: str | os.PathLike[str], name: str = "") -> tuple[Path, str]:
    try:
        target, file = Path(path), name or os.fspath(path)
        if target.is_dir():
            raise LogError(f"{file}: is a folder; a log file was expected")
        if not target.exists():
            raise LogError(f"{file}: no such file; a log was expected")
        if not target.is_file():
            raise LogError(f"{file}: is a device or a pipe; a log file was expected")
        with open(target, "rb"):
            return target, str(file)
    except PmsmCtrlError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LogError(f"{path}: cannot be read ({reason})") from None
