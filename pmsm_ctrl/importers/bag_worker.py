"""Messages of ROS 2 bags as columns; runs inside `pmsm_ctrl.importers.worker`, a process of its own.

Reads MCAP by the library ``mcap`` and SQLite by Python's own. The definitions of the messages stand in the bag and are
interpreted by ``mcap-ros2-support``: no code is made of them, nothing is executed. Imports nothing of this package.
"""

from __future__ import annotations

import os
import sqlite3
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.request import pathname2url

import numpy as np

__all__ = ["read_bag"]

# The bounds of `guard.afford`: bytes per byte of the file, and bytes that are always allowed.
EXPANSION, ALWAYS = 100.0, float(1 << 28)
MAX_DEPTH = 4  # messages in messages
MAX_VALUES = 64  # elements of an array that become columns; an image is no channel
MAX_COLUMNS = 4096
JOINT_STATE = "sensor_msgs/JointState"
ARRAYS = ("position", "velocity", "effort")  # of a JointState, one element for each joint
# Bags of SQLite before ROS 2 Iron hold no definitions; these stand in every installation of ROS 2.
HEADER = "std_msgs/Header header\n"
DEFINED_HEADER = (
    "================================================================================\n"
    "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
)
STANDARD = {
    JOINT_STATE: HEADER + "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + DEFINED_HEADER,
    **{f"std_msgs/{name}": f"{name.lower()} data\n" for name in ("Float32", "Float64", "Int32", "Int64")},
}
Message = tuple[str, str, int, Any]  # topic, kind, time of the recorder in ns, content
Answer = tuple[dict[str, Any], list[np.ndarray]]


@dataclass
class _Series:
    """The samples of one time base: of a topic, or of one joint of it."""

    topic: str
    names: list[str]
    recorded: list[int] = field(default_factory=list)  # ns
    stamped: list[int] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)


class _UnfitError(Exception):
    """Content of a topic that is no set of channels."""


def read_bag(path: str, words: Sequence[str]) -> Answer:
    """Return the numeric fields of all topics: columns as (name, group, is_time), and their values.

    Parameters
    ----------
    path : str
    words : sequence of str
        None are understood.

    Returns
    -------
    (dict, list of array)

    Raises
    ------
    ValueError
        When the file is damaged, unpacks to far more than its size, or a message cannot be decoded.
    """
    with open(path, "rb") as stream:
        packed = stream.read(8) == b"\x89MCAP0\r\n"
    if packed:
        _bound_expansion(path)
    series: dict[tuple[str, str], _Series] = {}
    unfit: dict[str, None] = {}
    for topic, kind, recorded, content in (_mcap_messages if packed else _sqlite_messages)(path, unfit):
        if topic in unfit:
            continue
        try:
            for part, names, row in _rows(kind, content):
                one = series.setdefault((topic, part), _Series(topic, names))
                if one.names != names:
                    raise _UnfitError
                one.recorded.append(recorded)
                one.stamped.append(_stamp(content))
                one.rows.append(row)
                if len(series) > MAX_COLUMNS or len(names) > MAX_COLUMNS:
                    raise ValueError(f"more than {MAX_COLUMNS} columns")
        except _UnfitError:
            unfit[topic] = None
    return _columns({key: one for key, one in series.items() if key[0] not in unfit}, list(unfit))


def _columns(series: dict[tuple[str, str], _Series], left: list[str]) -> Answer:
    columns: list[list[Any]] = []
    values: list[np.ndarray] = []
    start = min((min(_times(one)) for one in series.values()), default=0)
    recorded = []
    for group, ((topic, part), one) in enumerate(series.items()):
        table = np.asarray(one.rows, dtype=np.float64)
        columns.append([f"{topic}{part}.stamp", group, True])
        # a double does not hold nanoseconds since 1970
        values.append(np.asarray([time - start for time in _times(one)], dtype=np.float64) * 1e-9)
        if _times(one) is one.recorded:
            recorded.append(f"{topic}{part}")
        for k, name in enumerate(one.names):
            if np.isnan(table[:, k]).all():  # a driver that does not measure it
                left.append(f"{topic}{part}{name}")
                continue
            columns.append([f"{topic}{part}{name}", group, False])
            values.append(np.ascontiguousarray(table[:, k]))
    answer = {"columns": columns, "left": left, "recorded": recorded, "sizes": [int(one.size) for one in values]}
    return answer, values


def _times(one: _Series) -> list[int]:
    """Return the time of the measurement where the messages state one, else that of the recorder."""
    stated = all(stamp > 0 for stamp in one.stamped) and len(set(one.stamped)) > len(one.stamped) // 2
    return one.stamped if stated else one.recorded


def _stamp(content: Any) -> int:
    """Return ``header.stamp`` in ns, 0 where there is none."""
    stamp = getattr(getattr(content, "header", None), "stamp", None)
    return int(getattr(stamp, "sec", 0)) * 1_000_000_000 + int(getattr(stamp, "nanosec", 0))


def _rows(kind: str, content: Any) -> Iterator[tuple[str, list[str], list[float]]]:
    """Yield what one message adds: the part of the topic, its fields, their numbers."""
    if kind == JOINT_STATE:
        arrays = [(name, list(getattr(content, name))) for name in ARRAYS]
        if any(len(values) not in (0, len(content.name)) for _, values in arrays) or len(content.name) > MAX_VALUES:
            raise _UnfitError
        for k, joint in enumerate(content.name):
            held = [(f".{name}", float(values[k])) for name, values in arrays if values]
            yield f".{joint}", [name for name, _ in held], [value for _, value in held]
        return
    found: list[tuple[str, float]] = []
    _numbers(content, "", 0, found)
    if not found:
        raise _UnfitError
    yield "", [name for name, _ in found], [value for _, value in found]


def _numbers(content: Any, prefix: str, depth: int, found: list[tuple[str, float]]) -> None:
    """Add the numeric fields of a message, those of messages inside it as dotted names."""
    for name in getattr(type(content), "__slots__", None) or [key for key in vars(content) if key[0] != "_"]:
        value, full = getattr(content, name), f"{prefix}.{name}"
        if isinstance(value, bool | int | float):
            found.append((full, float(value)))
        elif hasattr(value, "__dict__"):
            if name != "header" and depth < MAX_DEPTH:
                _numbers(value, full, depth + 1, found)
        elif not isinstance(value, str | bytes) and hasattr(value, "__len__"):
            if len(value) > MAX_VALUES:
                raise _UnfitError
            for k, one in enumerate(value):
                if isinstance(one, bool | int | float):
                    found.append((f"{full}.{k + 1}", float(one)))
        if len(found) > MAX_COLUMNS:
            raise _UnfitError


def _decoder(kind: str, text: bytes) -> Callable[[bytes], Any]:
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory

    decode = DecoderFactory().decoder_for("cdr", Schema(id=1, name=kind, encoding="ros2msg", data=text))
    if decode is None:
        raise ValueError(f"messages of the type {kind} cannot be decoded")
    return decode


def _short(kind: str) -> str:
    """Return ``package/Name``, also of ``package/msg/Name``."""
    return kind.replace("/msg/", "/")


def _mcap_messages(path: str, unfit: dict[str, None]) -> Iterator[Message]:
    from mcap.records import Channel, Schema
    from mcap.records import Message as Record
    from mcap.stream_reader import StreamReader

    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    decoders: dict[int, Callable[[bytes], Any]] = {}
    with open(path, "rb") as stream:
        for record in StreamReader(stream, validate_crcs=True, record_size_limit=int(ALWAYS)).records:
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Record):
                channel = channels[record.channel_id]
                schema = schemas.get(channel.schema_id)
                if channel.topic in unfit:
                    continue
                if schema is None or schema.encoding != "ros2msg" or channel.message_encoding != "cdr":
                    unfit[channel.topic] = None
                    continue
                if schema.id not in decoders:
                    decoders[schema.id] = _decoder(schema.name, schema.data)
                content = decoders[schema.id](record.data)
                yield channel.topic, _short(schema.name), int(record.log_time), content


def _sqlite_messages(path: str, unfit: dict[str, None]) -> Iterator[Message]:
    place = f"file:{pathname2url(os.path.abspath(path))}?mode=ro&immutable=1"
    connection = sqlite3.connect(place, uri=True)
    try:
        connection.execute("PRAGMA trusted_schema = OFF")
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise ValueError("an SQLite file without the tables topics and messages, which a ROS 2 bag has")
        stated = {}
        if "message_definitions" in tables:
            rows = connection.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
            stated = {str(kind): str(text) for kind, encoding, text in rows if encoding == "ros2msg" and text}
        topics, decoders = {}, {}
        for number, name, kind, written in connection.execute(
            "SELECT id, name, type, serialization_format FROM topics"
        ):
            text = stated.get(kind) or STANDARD.get(_short(kind))
            if written != "cdr" or text is None:
                unfit[str(name)] = None
                continue
            topics[number] = str(name), _short(kind)
            decoders[number] = _decoder(kind, text.encode())
        for number, stamp, data in connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id"):
            if number in topics and topics[number][0] not in unfit:
                yield *topics[number], int(stamp), decoders[number](data)
    finally:
        connection.close()


def _bound_expansion(path: str) -> None:
    """Refuse an MCAP file whose chunks unpack to far more than a log does, by what their headers declare."""
    size = os.path.getsize(path)
    most, total = max(ALWAYS, EXPANSION * size), 0.0
    with open(path, "rb") as stream:
        stream.seek(8)
        while len(head := stream.read(9)) == 9:
            kind, length = struct.unpack("<BQ", head)
            begin = stream.tell()
            if begin + length > size:
                raise ValueError("it ends within a record; `mcap recover` repairs a recording that was cut off")
            if kind == 0x06:  # Chunk: two times, the unpacked size, a checksum, the compression, the packed records
                total += float(struct.unpack("<Q", stream.read(24)[16:24])[0])
                (words,) = struct.unpack("<I", stream.read(8)[4:8])
                compression = stream.read(min(words, 8))
                stream.seek(begin + 24 + 8 + words + 8)
                total = max(total, _frame(compression, stream.read(18)))
            if total > most:
                raise ValueError(f"it unpacks to more than {1e-6 * most:.3g} MB, which no log of its size does")
            stream.seek(begin + length)


def _frame(compression: bytes, head: bytes) -> float:
    """Return the size that a compressed frame states of itself, which may be another one; 0 where it states none."""
    if compression != b"zstd":
        return 0.0  # LZ4 packs at most 255 times, and the process has a bound
    import zstandard

    stated = zstandard.frame_content_size(head)
    return float(stated) if stated > 0 else 0.0
