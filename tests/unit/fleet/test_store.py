"""The dataset of results: whole parts alone, nothing lost to a kill, units in the metadata."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
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
    schema = pyarrow.parquet.read_schema(part)
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


WRITER = """
import sys
from datetime import UTC, datetime
from pmsm_ctrl.fleet.store import Row, Store
now = datetime.now(UTC)
def row(key, number, kind="parameter", name="F_c"):
    return Row(key, number, "a", "", "l.csv", now, now, "identify", kind, name)
store = Store(sys.argv[1])
for k in range(100000):
    key = f"{sys.argv[2]}-{k}"
    store.add([row(key, n) for n in range(20)] + [row(key, 20, "status", "done")])
    print(key, flush=True)
    if k % 7 == 6:
        store.join()
"""


def test_kill_at_any_moment_loses_no_log_that_was_done(tmp_path: Path) -> None:
    rng, store, told = np.random.default_rng(3), Store(tmp_path / "r"), []
    for number in range(amount(2, 50)):
        command = [sys.executable, "-c", WRITER, str(tmp_path / "r"), str(number)]
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            told.append(writer.stdout.readline().strip())  # it runs
            time.sleep(float(rng.uniform(0.0, 0.15)))
            writer.send_signal(signal.SIGKILL)
            told += [line.strip() for line in writer.stdout if line.endswith("\n")]
        rows = list(store.read())
        done = {one.key for one in rows if one.kind == "status"}
        assert set(told) <= done
        assert len(rows) == 21 * len(done), "every log is there once and whole"


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
