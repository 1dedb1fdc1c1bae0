"""The results: one Parquet dataset that only grows, part by part.

A part is written under a temporary name and renamed, so that a reader sees whole parts alone. Small parts are joined at
the end of a run; the joined part names those that it replaces, so that a run that was killed in between counts nothing
twice.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import atomic_path

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
        Made where it does not exist.

    Raises
    ------
    RequestError
        When pyarrow is not installed, or the folder cannot be made or holds something else.
    """

    def __init__(self, folder: str | os.PathLike[str], *, create: bool = True) -> None:
        self.arrow = require_pyarrow()
        self.folder = Path(folder)
        self.rows = self.folder / "rows"
        if not create and not self.rows.is_dir():
            raise RequestError(f"{folder}: no results of a fleet; a folder that `pmsm-ctrl fleet` wrote was expected")
        if self.folder.is_dir() and not self.rows.is_dir() and any(self.folder.iterdir()):
            raise RequestError(f"{folder}: holds other files; an empty or a new folder was expected for the results")
        try:
            self.rows.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RequestError(f"{folder}: cannot be made ({error.strerror})") from None

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
        with atomic_path(self.rows / name) as temporary:
            self.arrow.parquet.write_table(table.replace_schema_metadata(told), temporary, compression="zstd")

    def parts(self) -> list[Path]:
        """Return the parts that count: neither unfinished nor replaced by a joined one."""
        found = self._all()
        gone = set(chain.from_iterable(self._replaced(path) for path in found if path.name.startswith(JOINED)))
        return [path for path in found if path.name not in gone]

    def _all(self) -> list[Path]:
        """Return every whole part, in the order of their writing; an unfinished one is hidden."""
        found = (path for prefix in (PART, JOINED) for path in self.rows.glob(f"{prefix}*{SUFFIX}"))
        return sorted(found, key=lambda path: path.name.partition("-")[2])

    def _replaced(self, path: Path) -> list[str]:
        told = self.arrow.parquet.read_schema(path).metadata or {}
        return list(json.loads(told.get(b"replaces", b"[]")))

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

        parts = [str(path) for path in self.parts()]
        if not parts:
            return self.schema.empty_table()
        wanted = None if kinds is None else pyarrow.dataset.field("kind").isin(list(kinds))
        names = None if columns is None else list(columns)
        return pyarrow.dataset.dataset(parts, schema=self.schema).to_table(columns=names, filter=wanted)

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
        parquet = self.arrow.parquet
        counting = self.parts()
        for stale in set(self._all()) - set(counting):
            stale.unlink(missing_ok=True)
        small = [path for path in counting if parquet.read_metadata(path).num_rows < SMALL]
        if len(small) > 1:
            tables = [parquet.read_table(path, schema=self.schema) for path in small]
            self._write(self.arrow.concat_tables(tables), [path.name for path in small])
            for path in small:
                path.unlink(missing_ok=True)

    def forget(self, keys: Collection[str]) -> None:
        """Take the rows of some keys out: their parts are written again without them, and replaced at once.

        Parameters
        ----------
        keys : collection of str
        """
        if not keys:
            return
        parquet, compute = self.arrow.parquet, self.arrow.compute
        wanted = self.arrow.array(sorted(keys))
        for path in self.parts():
            table = parquet.read_table(path, schema=self.schema)
            gone = compute.is_in(table["key"], value_set=wanted)
            if compute.any(gone).as_py():
                self._write(table.filter(compute.invert(gone)), [path.name])
                path.unlink(missing_ok=True)

    # -- beside the rows --------------------------------------------------------------------------------------

    def note(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a small JSON file beside the rows.

        Parameters
        ----------
        name : str
        content : dict
        """
        with atomic_path(self.folder / f"{name}.json") as temporary:
            temporary.write_text(json.dumps(content, indent=1, default=str), encoding="utf-8")

    def noted(self, name: str) -> dict[str, Any]:
        """Return what `note` wrote; nothing where it did not.

        Parameters
        ----------
        name : str
        """
        try:
            content = json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return {}
        return content if isinstance(content, dict) else {}
