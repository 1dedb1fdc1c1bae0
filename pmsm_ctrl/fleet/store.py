"""The results: one Parquet dataset that only grows, part by part.

A part is written under a temporary name and renamed, or put into an object store as one object, so that a reader sees
whole parts alone. Small parts are joined at the end of a run; the joined part names those that it replaces, so that a
run that was killed in between counts nothing twice.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from itertools import chain
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.fleet.folders import folder_at

__all__ = ["COLUMNS", "Row", "Store", "require_pyarrow"]

SCHEMA = "pmsm-ctrl/fleet/1"
SMALL = 50_000  # rows; a part with fewer is joined with others
PART, JOINED, SUFFIX = "part-", "joined-", ".parquet"

# name -> (kind, unit or what the unit is, meaning)
COLUMNS: dict[str, tuple[str, str, str]] = {
    "key": ("string", "", "hash of logs, design, settings and package: what is done once"),
    "row": ("int32", "1", "number of the row among those of its key, from 0"),
    "axis": ("string", "", "the axis"),
    "type": ("string", "", "its type; empty where the manifest states none"),
    "record": ("string", "", "the log file; of several records together the last one"),
    "time": ("timestamp", "us since 1970, UTC", "when the log was recorded"),
    "evaluated": ("timestamp", "us since 1970, UTC", "when it was evaluated"),
    "source": ("string", "", "import, identify, compare, diagnose or fleet"),
    "kind": ("string", "", "status, quantity, verdict, error, parameter, finding, candidate, deviation or doubt"),
    "name": ("string", "", "of the parameter, effect, quantity or code, by kind"),
    "value": ("double", "as in the column unit", "the number"),
    "stderr": ("double", "as in the column unit", "its standard error; null where it is not known"),
    "unit": ("string", "", "SI unit of value, stderr and nominal; 1 for a share"),
    "nominal": ("double", "as in the column unit", "what the design states"),
    "p_value": ("double", "1", "of a finding or a candidate, before any correction for their number"),
    "flag": ("bool", "", "accepted candidate, deviation outside its tolerance; null elsewhere"),
    "text": ("string", "", "words: a reason, the effects that cannot be told apart"),
}


@dataclass(frozen=True)
class Row:
    """One row of the results.

    Attributes
    ----------
    key, row, axis, type, record, time, evaluated, source, kind, name, value, stderr, unit, nominal, p_value, flag, text
        As described in `COLUMNS`.
    """

    key: str
    row: int
    axis: str
    type: str
    record: str
    time: datetime
    evaluated: datetime
    source: str
    kind: str
    name: str
    value: float | None = None
    stderr: float | None = None
    unit: str = ""
    nominal: float | None = None
    p_value: float | None = None
    flag: bool | None = None
    text: str = ""


_NAMES = tuple(one.name for one in fields(Row))


def require_pyarrow() -> Any:
    """Return the module pyarrow.

    Raises
    ------
    RequestError
        When it is not installed.
    """
    try:
        import pyarrow
        import pyarrow.compute
        import pyarrow.parquet
    except ImportError:
        raise RequestError("fleet: pyarrow not installed: pip install 'pmsm-ctrl[fleet]'") from None
    return pyarrow


class Store:
    """A folder of results.

    Parameters
    ----------
    folder : path
        Here, or elsewhere by a protocol of fsspec such as ``s3://``. Made where it does not exist.

    Raises
    ------
    RequestError
        When pyarrow or what the protocol needs is not installed, or the folder cannot be made or holds something else.
    """

    def __init__(self, folder: str | os.PathLike[str], *, create: bool = True) -> None:
        self.arrow = require_pyarrow()
        self.folder = folder_at(folder)
        self.rows = folder_at(f"{os.fspath(folder).rstrip('/')}/rows")
        try:
            known = self.rows.exists()
            if not create and not known:
                raise RequestError(
                    f"{folder}: no results of a fleet; a folder that `pmsm-ctrl fleet` wrote was expected"
                )
            if not known and self.folder.occupied():
                raise RequestError(
                    f"{folder}: holds other files; an empty or a new folder was expected for the results"
                )
            self.rows.make()
        except OSError as error:
            raise RequestError(f"{folder}: cannot be made ({error.strerror or error})") from None

    @property
    def schema(self) -> Any:
        """The Arrow schema of the rows, with the unit and the meaning of each column in its metadata."""
        pa = self.arrow
        kinds = {"string": pa.string(), "int32": pa.int32(), "double": pa.float64(), "bool": pa.bool_(),
                 "timestamp": pa.timestamp("us", tz="UTC")}  # fmt: skip
        return pa.schema(
            [
                pa.field(name, kinds[kind], metadata={"unit": unit, "meaning": meaning})
                for name, (kind, unit, meaning) in COLUMNS.items()
            ],
            metadata={"schema": SCHEMA},
        )

    def add(self, rows: Sequence[Row]) -> None:
        """Add rows as one part: a reader sees all of them or none.

        Parameters
        ----------
        rows : sequence of Row
        """
        if rows:
            columns = {name: [getattr(row, name) for row in rows] for name in _NAMES}
            self._write(self.arrow.table(columns, schema=self.schema))

    def _write(self, table: Any, replaces: Sequence[str] = ()) -> None:
        told = {b"schema": SCHEMA.encode(), b"replaces": json.dumps(list(replaces)).encode()}
        # a name that no other writer takes; the time keeps the order of a listing
        prefix = JOINED if replaces else PART
        name = f"{prefix}{datetime.now(UTC):%Y%m%dT%H%M%S%f}-{os.urandom(4).hex()}{SUFFIX}"
        content = self.arrow.BufferOutputStream()
        self.arrow.parquet.write_table(table.replace_schema_metadata(told), content, compression="zstd")
        self.rows.write(name, content.getvalue().to_pybytes())

    def parts(self) -> list[str]:
        """Return the names of the parts that count: neither unfinished nor replaced by a joined one."""
        found = self._all()
        gone = set(chain.from_iterable(self._replaced(name) for name in found if name.startswith(JOINED)))
        return [name for name in found if name not in gone]

    def _all(self) -> list[str]:
        """Return every whole part, in the order of their writing; an unfinished one is hidden."""
        found = (one for one in self.rows.names() if one.startswith((PART, JOINED)) and one.endswith(SUFFIX))
        return sorted(found, key=lambda name: name.partition("-")[2])

    def _replaced(self, name: str) -> list[str]:
        told = self.arrow.parquet.read_schema(self.rows.path(name), filesystem=self.rows.arrow).metadata or {}
        return list(json.loads(told.get(b"replaces", b"[]")))

    def _part(self, name: str) -> Any:
        return self.arrow.parquet.read_table(
            self.rows.path(name), schema=self.schema, filesystem=self.rows.arrow, partitioning=None
        )

    def table(self, columns: Iterable[str] | None = None, kinds: Iterable[str] | None = None) -> Any:
        """Return the rows as an Arrow table, in the order of their writing.

        Parameters
        ----------
        columns : iterable of str, optional
            All if left out.
        kinds : iterable of str, optional
            Of the column `kind`.

        Returns
        -------
        pyarrow.Table
        """
        import pyarrow.dataset

        parts = [self.rows.path(name) for name in self.parts()]
        if not parts:
            return self.schema.empty_table()
        wanted = None if kinds is None else pyarrow.dataset.field("kind").isin(list(kinds))
        names = None if columns is None else list(columns)
        found = pyarrow.dataset.dataset(parts, schema=self.schema, filesystem=self.rows.arrow)
        return found.to_table(columns=names, filter=wanted)

    def read(self, kinds: Iterable[str] | None = None) -> Iterator[Row]:
        """Yield the rows.

        Parameters
        ----------
        kinds : iterable of str, optional
            Of the column `kind`; all if left out.

        Yields
        ------
        Row
        """
        for values in self.table(_NAMES, kinds).to_pylist():
            yield Row(**values)

    def done(self) -> dict[str, str]:
        """Return the keys that are done, with the word of their status."""
        table = self.table(("key", "name"), ("status",))
        return dict(zip(table["key"].to_pylist(), table["name"].to_pylist(), strict=True))

    def join(self) -> None:
        """Join small parts into one."""
        counting = self.parts()
        for stale in set(self._all()) - set(counting):
            self.rows.remove(stale)
        small = [name for name in counting if self._length(name) < SMALL]
        if len(small) > 1:
            self._write(self.arrow.concat_tables([self._part(name) for name in small]), small)
            for name in small:
                self.rows.remove(name)

    def _length(self, name: str) -> int:
        about = self.arrow.parquet.read_metadata(self.rows.path(name), filesystem=self.rows.arrow)
        return int(about.num_rows)

    def forget(self, keys: Collection[str]) -> None:
        """Take the rows of some keys out: their parts are written again without them, and replaced at once.

        Parameters
        ----------
        keys : collection of str
        """
        if not keys:
            return
        compute = self.arrow.compute
        wanted = self.arrow.array(sorted(keys))
        for name in self.parts():
            table = self._part(name)
            gone = compute.is_in(table["key"], value_set=wanted)
            if compute.any(gone).as_py():
                self._write(table.filter(compute.invert(gone)), [name])
                self.rows.remove(name)

    # -- beside the rows --------------------------------------------------------------------------------------

    def note(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a small JSON file beside the rows.

        Parameters
        ----------
        name : str
        content : dict
        """
        self.folder.write(f"{name}.json", json.dumps(content, indent=1, default=str).encode())

    def noted(self, name: str) -> dict[str, Any]:
        """Return what `note` wrote; nothing where it did not.

        Parameters
        ----------
        name : str
        """
        try:
            content = json.loads(self.folder.read(f"{name}.json"))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}
