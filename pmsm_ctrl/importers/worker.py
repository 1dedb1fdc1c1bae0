"""Readers in a separate process: the C code of libraries crashes on some damaged files.

Started by `pmsm_ctrl.importers.isolated` as ``worker.py FORMAT PATH [WORD ...]``; imports nothing of this package, so
that it starts quickly. Nothing in a file is executed.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import struct
import sys
import warnings
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

__all__ = ["Record", "flattened", "main"]

MAX_DEPTH = 4
# The bounds of `guard.afford`: bytes per byte of the file, and bytes that are always allowed.
EXPANSION, ALWAYS = 100.0, float(1 << 28)
PIECE = 1 << 20  # bytes
Answer = tuple[dict[str, Any], list[np.ndarray]]


def main(arguments: Sequence[str]) -> int:
    """Write the reader's answer as a line of JSON, then its values as float64."""
    warnings.simplefilter("ignore")
    logging.disable(logging.CRITICAL)
    _bound_memory()
    reader, path, *words = arguments
    values: list[np.ndarray] = []
    try:
        answer, values = READERS[reader](path, words)
    except Exception as error:  # damaged bytes can raise any error in a library
        answer = {"error": str(error).strip() or type(error).__name__}
    output = sys.stdout.buffer
    output.write(json.dumps(answer).encode() + b"\n")
    for array in values:
        output.write(array.tobytes())
    output.flush()
    return 0


def _bound_memory() -> None:
    """A damaged file may declare any size; the process must not exhaust the memory."""
    try:
        import resource
    except ImportError:  # Windows
        return
    limit = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))


def read_mat(path: str, words: Sequence[str]) -> Answer:
    """Return name and shape of every variable, and the values of the numeric ones."""
    import scipy.io

    _bound_expansion(path)
    content = scipy.io.loadmat(path, struct_as_record=True, squeeze_me=False)
    flat = flattened({name: value for name, value in content.items() if not name.startswith("__")})
    variables = [[name, None if value is None else list(value.shape)] for name, value in flat.items()]
    return {"variables": variables}, [value for value in flat.values() if value is not None]


def _bound_expansion(path: str) -> None:
    """Refuse a MAT file of version 5 whose compressed variables unpack to far more than a log does.

    They are unpacked in pieces and counted, because a variable may declare any size and structs hide theirs.
    """
    most, total = max(ALWAYS, EXPANSION * os.path.getsize(path)), 0
    with open(path, "rb") as stream:
        header = stream.read(128)
        order = {b"IM": "<", b"MI": ">"}.get(header[126:128])
        while order is not None and len(tag := stream.read(8)) == 8:
            kind, left = struct.unpack(f"{order}II", tag)
            if kind != 15:  # miCOMPRESSED
                stream.seek(left, os.SEEK_CUR)
                continue
            unpack = zlib.decompressobj()
            while left > 0 and (piece := stream.read(min(left, PIECE))):
                left -= len(piece)
                while piece:
                    total += len(unpack.decompress(piece, PIECE))
                    piece = unpack.unconsumed_tail
                    if total > most:
                        raise ValueError(f"it unpacks to more than {1e-6 * most:.3g} MB, which no log of its size does")


class Record(dict[str, Any]):
    """One element of an array of structs: its fields by name."""


# Fields in which recorders keep a channel's name, unit and values: dSPACE (Name, Unit, Data), Simulink (label, values).
NAMES = ("Name", "name", "label", "Label", "signalName", "SignalName", "title", "blockName", "BlockName")
UNIT_FIELDS = ("Unit", "unit", "Units", "units")
DATA = ("Data", "data", "values", "Values", "Value", "value")
MAX_RECORDS = 4096


def flattened(content: dict[str, Any], prefix: str = "", depth: int = 0) -> dict[str, np.ndarray | None]:
    """Return structs as dotted names, numeric arrays as float64, and None for what is no numeric array.

    An element of an array of structs that holds a name, values and perhaps a unit becomes ``name [unit]``.
    """
    out: dict[str, np.ndarray | None] = {}
    for name, value in content.items():
        full = f"{prefix}{name}"
        records = _records(value)
        if records and depth < MAX_DEPTH:
            for k, record in enumerate(records):
                own = full if len(records) == 1 else f"{full}.{k + 1}"
                for key, array in _of_record(record, own, len(records) > 1, depth).items():
                    out[key if key not in out else f"{key}.{k + 1}"] = array
            continue
        # a sparse matrix is an object of its own class and cannot be a channel
        array = np.asarray(value) if isinstance(value, np.ndarray | np.generic | float | int) else np.empty(0, object)
        numeric = array.dtype.kind in "fiub" and array.dtype.names is None
        out[full] = np.ascontiguousarray(array, dtype=np.float64) if numeric else None
    return out


def _records(value: Any) -> list[Record]:
    """Return the elements of a struct or an array of structs; none for anything else."""
    if isinstance(value, Record):
        return [value]
    if isinstance(value, dict):
        return [Record(value)]
    if isinstance(value, list):
        return [one for one in value if isinstance(one, Record)]
    if not isinstance(value, np.ndarray) or not value.dtype.names or not 0 < value.size <= MAX_RECORDS:
        return []
    return [Record({field: one[field] for field in value.dtype.names}) for one in value.reshape(-1)]


def _of_record(record: Record, own: str, many: bool, depth: int) -> dict[str, np.ndarray | None]:
    """Return the arrays of one struct: under its own label where it describes a single channel."""
    label = next((text for field in NAMES if (text := _text(record.get(field)))), "")
    unit = next((text for field in UNIT_FIELDS if (text := _text(record.get(field)))), "")
    field = next((field for field in DATA if _is_vector(record.get(field))), "")
    if not field or not (label or unit or many):
        return flattened(record, f"{own}.", depth + 1)
    rest = {key: value for key, value in record.items() if key != field and _records(value)}
    named = f"{label or own} [{unit}]" if unit else label or own
    return {named: np.ascontiguousarray(record[field], dtype=np.float64), **flattened(rest, f"{own}.", depth + 1)}


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and not value.dtype.names and value.size > 1


def _text(value: Any) -> str:
    """Return a text of a MAT file, which may stand in an array of one element."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    return value.strip() if isinstance(value, str) else ""


def read_mdf(path: str, words: Sequence[str]) -> Answer:
    """Return the columns; with words ``G:I`` the values of channel I of group G instead."""
    from asammdf import MDF

    with open(path, "rb") as stream:
        content = MDF(stream)
        if words:
            values = [_mdf_values(content, *map(int, place.split(":"))) for place in words]
            answer: dict[str, Any] = {"sizes": [int(array.size) for array in values]}
        else:
            answer, values = _mdf_columns(content), []
        content.close()
    return answer, values


def _mdf_columns(content: Any) -> dict[str, Any]:
    columns, left = [], []
    for number, group in enumerate(content.groups):
        master = content.masters_db.get(number)
        if master is None:
            continue
        for index, channel in enumerate(group.channels):
            # data types 0 to 5 are integers and floats of either byte order; the rest are text, bytes and dates
            if index != master and int(channel.data_type) > 5:
                left.append(str(channel.name))
                continue
            unit = "s" if index == master else str(content.get_channel_unit(group=number, index=index) or "")
            columns.append([str(channel.name), unit, number, index, index == master])
    return {"version": str(content.version), "columns": columns, "left": left}


def _mdf_values(content: Any, group: int, index: int) -> np.ndarray:
    if content.masters_db.get(group) == index:
        return np.asarray(content.get_master(group), dtype=np.float64)
    samples = content.get(group=group, index=index).samples
    if samples.ndim != 1 or samples.dtype.kind not in "fiub":
        raise ValueError(f"channel '{content.groups[group].channels[index].name}' holds no single numbers")
    return np.asarray(samples, dtype=np.float64)


def read_ros(path: str, words: Sequence[str]) -> Answer:
    """Return the numeric fields of all topics of a ROS 2 bag, by the module beside this one."""
    from importlib.util import module_from_spec, spec_from_file_location

    place = os.path.join(os.path.dirname(os.path.abspath(__file__)), "bag_worker.py")
    spec = spec_from_file_location("bag_worker", place)
    if spec is None or spec.loader is None:
        raise ImportError(place)
    module = sys.modules["bag_worker"] = module_from_spec(spec)
    spec.loader.exec_module(module)
    answer: Answer = module.read_bag(path, words)
    return answer


READERS = {"mat": read_mat, "mdf": read_mdf, "ros 2": read_ros}


if __name__ == "__main__":
    if sys.argv[1:2] == ["mat"]:
        # In a process of its own: scipy imports all that numpy offers, its tests and its Fortran tool too, which is
        # half of the time that starting takes.
        vars(np).update(testing=None, f2py=None)
    sys.exit(main(sys.argv[1:]))
