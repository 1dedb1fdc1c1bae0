"""The dataset of results: whole parts alone, nothing lost to a kill, units in the metadata."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.fleet.store import COLUMNS, Row, Store
from tests.effort import amount

pytest.importorskip("pyarrow")
NOW = datetime(2026, 3, 1, 22, 15, 0, 123456, tzinfo=UTC)
ROOT = Path(__file__).resolve().parents[3]


def row(key: str, number: int = 0, kind: str = "parameter", name: str = "F_c") -> Row:
    return Row(
        key, number, "a", "", "l.csv", NOW, NOW, "identify", kind, name, 0.02, 1e-4, "N m", None, None, True, "µ"
    )


def test_what_is_written_is_read(tmp_path: Path) -> None:
    store = Store(tmp_path / "r")
    assert store.done() == {}
    store.add([row("k"), row("k", 1, "status", "done")])
    assert list(store.read()) == [row("k"), row("k", 1, "status", "done")]
    assert store.done() == {"k": "done"}


def test_every_column_has_its_unit_and_meaning_in_the_file(tmp_path: Path) -> None:
    import pandas as pd
    import pyarrow.parquet

    store = Store(tmp_path / "r")
    store.add([row("k")])
    (part,) = store.parts()
    schema = pyarrow.parquet.read_schema(tmp_path / "r" / "rows" / part)
    assert {one.name: (one.metadata[b"unit"].decode(), one.metadata[b"meaning"].decode()) for one in schema} == {
        name: (unit, meaning) for name, (_, unit, meaning) in COLUMNS.items()
    }
    frame = pd.read_parquet(tmp_path / "r" / "rows")  # the folder is a dataset for anybody
    assert frame.loc[0, ["axis", "name", "value", "unit"]].tolist() == ["a", "F_c", 0.02, "N m"]


def test_joined_parts_hold_the_same_rows(tmp_path: Path) -> None:
    store = Store(tmp_path / "r")
    rows = [row(f"k{k}", name=f"n{k}") for k in range(5)]
    for one in rows:
        store.add([one])
    store.join()
    assert len(store.parts()) == 1
    store.add([row("k9")])
    store.join()
    assert list(store.read()) == [*rows, row("k9")]


def test_a_join_that_was_killed_counts_nothing_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path / "r")
    for k in range(3):
        store.add([row(f"k{k}")])
    monkeypatch.setattr(Path, "unlink", lambda *_, **__: None)  # as killed after the rename
    store.join()
    monkeypatch.undo()
    assert len(list((tmp_path / "r" / "rows").glob("*.parquet"))) == 4
    assert len(list(store.read())) == 3
    store.join()
    assert len(list((tmp_path / "r" / "rows").glob("*.parquet"))) == 1


# One process imports once; each of its children writes until it is killed.
WRITER = """
import os, random, signal, sys, time
import pyarrow.dataset, pyarrow.parquet
from datetime import UTC, datetime
from pmsm_ctrl.fleet.store import Row, Store
now = datetime.now(UTC)
def row(key, number, kind="parameter", name="F_c"):
    return Row(key, number, "a", "", "l.csv", now, now, "identify", kind, name)
def write(number):
    store = Store(sys.argv[1])
    for k in range(100000):
        key = f"{number}-{k}"
        store.add([row(key, n) for n in range(20)] + [row(key, 20, "status", "done")])
        os.write(1, f"{key}\\n".encode())
        if k % 7 == 6:
            store.join()
random.seed(3)
for number in range(int(sys.argv[2])):
    child = os.fork()
    if not child:
        write(number)
    time.sleep(random.uniform(0.02, 0.4))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
"""


def test_kill_at_any_moment_loses_no_log_that_was_done(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITER, str(tmp_path / "r"), str(amount(3, 50))]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()
    rows = list(Store(tmp_path / "r").read())
    done = {one.key for one in rows if one.kind == "status"}
    assert told
    assert set(told) <= done
    assert len(rows) == 21 * len(done), "every log is there once and whole"
    Store(tmp_path / "r").join()
    assert len(list((tmp_path / "r" / "rows").glob("*.parquet"))) == 1


def test_a_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").touch()
    with pytest.raises(RequestError, match="holds other files"):
        Store(tmp_path)
    with pytest.raises(RequestError, match="no results of a fleet"):
        Store(tmp_path, create=False)


def test_a_row_cannot_be_changed() -> None:
    assert replace(row("k"), key="l").key == "l"
    with pytest.raises(AttributeError):
        row("k").key = "l"  # type: ignore[misc]
