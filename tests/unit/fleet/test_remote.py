"""Logs and results by fsspec's protocols: the same rows as from a folder, whole objects, and clear refusals."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from pmsm_ctrl import fleet
from pmsm_ctrl.cli import main
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.fleet import Engine, Manifest, Store, fleet_report, read_manifest
from pmsm_ctrl.fleet import evaluate as evaluation
from pmsm_ctrl.fleet.folders import folder_at
from pmsm_ctrl.fleet.keys import Hashes
from pmsm_ctrl.fleet.manifest import items_of
from pmsm_ctrl.fleet.remote import changed, local_copy, plain
from tests.unit.fleet.rows import of_record

fsspec = pytest.importorskip("fsspec")
pytest.importorskip("pyarrow")
ALONE = Engine(jobs=1)


@pytest.fixture
def memory() -> Iterator[Any]:
    """Return fsspec's store in memory, empty."""
    system = fsspec.filesystem("memory")
    system.store.clear()
    yield system
    system.store.clear()


@pytest.fixture
def remote(memory: Any, two_axes: Path) -> Manifest:
    """Return the manifest of one log of each axis and of the empty one, all in memory."""
    for name in ("a1/2026-03-01", "a2/2026-03-03"):
        memory.pipe_file(f"/plant/logs/{name}.csv", (two_axes / "logs" / f"{name}.csv").read_bytes())
    manifest = read_manifest(two_axes / "run.toml")
    return replace(manifest, logs=("memory://plant/logs/*/*.csv",), results="memory://plant/results")


def test_a_remote_log_gives_the_rows_of_a_local_one(remote: Manifest, two_axes: Path, tmp_path: Path) -> None:
    found = fleet(remote, engine=ALONE)
    here = fleet(
        replace(remote, logs=(str(two_axes / "logs/a1/2026-03-01.csv"),), results=str(tmp_path / "r")), engine=ALONE
    )
    assert (found.axes, found.logs, found.evaluated, here.evaluated) == (2, 2, 2, 1)
    (lost,) = found.lost
    assert lost.record == "memory://plant/logs/a2/2026-03-03.csv"
    assert lost.reason.startswith(lost.record), "the log, not its copy, is named"
    assert estimates(remote.results) == estimates(tmp_path / "r")
    assert {f"{one.time:%Y-%m-%d}" for one in Store(remote.results).read(("parameter",))} == {"2026-03-01"}
    assert fleet(remote, engine=ALONE).evaluated == 0, "what is done is not done again"


def estimates(results: str | Path) -> list[tuple[str, float | None, float | None]]:
    return [(one.name, one.value, one.stderr) for one in Store(results).read(("parameter",))]


def test_parts_are_whole_objects_and_are_joined(memory: Any) -> None:
    store = Store("memory://plant/results")
    written = [list(of_record("a", day, 0.02)) for day in range(3)]
    for rows in written:
        store.add(rows)
    assert len(memory.ls("/plant/results/rows")) == 3
    store.join()
    assert len(memory.ls("/plant/results/rows")) == 1
    assert list(store.read()) == [row for rows in written for row in rows]
    store.forget(["a-1"])
    assert store.done() == {"a-0": "done", "a-2": "done"}
    assert store.noted("limits") == {}
    store.note("limits", {"F_c": 0.03})
    assert store.noted("limits") == {"F_c": 0.03}
    assert [one.name for one in fleet_report("memory://plant/results").axes] == ["a"]
    with pytest.raises(RequestError, match="no results of a fleet"):
        Store("memory://plant/nowhere", create=False)
    with pytest.raises(RequestError, match="holds other files"):
        Store("memory://plant")


def test_the_command_writes_and_reads_remote_results(
    remote: Manifest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, memory: Any
) -> None:
    monkeypatch.setattr("pmsm_ctrl.fleet.engine.evaluated", lambda job: evaluation.set_aside(job, "test"))
    words = ["memory://plant/logs", "--design", remote.design, "-o", remote.results, "-j", "1"]
    for command in (["fleet", *words], ["fleet", "report", remote.results, "-o", str(tmp_path / "p.html")]):
        with pytest.raises(SystemExit) as left:
            main(command)
        assert left.value.code in (0, None)
    assert "a2" in (tmp_path / "p.html").read_text(encoding="utf-8")
    assert [row.axis for row in Store(remote.results).read(("status",))] == ["a1", "a2"]
    assert not list(Path().glob("memory:*"))


def test_which_remote_logs_there_are(remote: Manifest, memory: Any, tmp_path: Path) -> None:
    memory.pipe_file("/plant/logs/a1/notes.md", b"")
    for logs in (("memory://plant/logs",), ("memory://plant/logs/**/*",)):
        assert [one.axis for one in items_of(replace(remote, logs=logs))] == ["a1", "a2"]
    exact = ("memory://plant/logs/a1/notes.md",)
    (one,) = items_of(replace(remote, logs=exact, path="", time="modified"))
    assert one.files == exact
    assert one.time == changed(exact[0])
    assert abs((one.time - datetime.now(UTC)).total_seconds()) < 60.0
    (tmp_path / "list.csv").write_text("file,axis\nmemory://plant/logs/a1/2026-03-01.csv,17\n", encoding="utf-8")
    (listed,) = items_of(replace(remote, logs=(), table=str(tmp_path / "list.csv"), time="column"))
    assert listed.axis == "17"


def test_the_tag_of_an_object_stands_for_its_hash(memory: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    memory.pipe_file("/l.csv", b"a")
    hashes = Hashes()
    first = hashes("memory://l.csv")
    assert first == "ca978112ca1bbdcafac231b39a23dc4da786eff8147c4e72b9807785afee48bb"  # FIPS 180: SHA-256 of "a"
    memory.pipe_file("/l.csv", b"b")
    assert hashes("memory://l.csv") != first
    monkeypatch.setattr(type(memory), "cat_file", lambda *_, **__: pytest.fail("was read"))
    monkeypatch.setattr(type(memory), "open", lambda *_, **__: pytest.fail("was read"))
    monkeypatch.setattr(
        type(memory), "info", lambda *_: {"name": "/l.csv", "size": 1, "ETag": '"0cc1"', "type": "file"}
    )
    assert hashes("memory://l.csv") == '1 ETag "0cc1"'


def test_file_is_a_path_of_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)  # and needs nothing
    (tmp_path / "a b.csv").write_text("x", encoding="utf-8")
    name = (tmp_path / "a b.csv").as_uri()
    assert plain(name) == str(tmp_path / "a b.csv")
    with local_copy(name) as path:
        assert path == tmp_path / "a b.csv"
    folder_at(tmp_path.as_uri()).write("c", b"1")
    assert (tmp_path / "c").read_bytes() == b"1"


@pytest.mark.parametrize(
    ("name", "said"),
    [("nonsense://b/l", "protocol 'nonsense' cannot be used"), ("s3://b/l", r"pip install 'fsspec\[s3\]'")],
)
def test_what_cannot_be_reached_is_refused(name: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "s3fs", None)
    with pytest.raises(RequestError, match=said):
        folder_at(name)


def test_a_missing_fsspec_is_said_in_one_line(
    remote: Manifest, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(SystemExit) as left:
        main(["fleet", "memory://plant/logs", "--design", remote.design])
    assert left.value.code == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "fsspec not installed: pip install 'pmsm-ctrl[remote]'" in line


def test_the_same_over_the_protocol_of_s3(
    remote: Manifest, two_axes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A server of this machine speaks it; `pip install s3fs 'moto[server]'`."""
    s3fs = pytest.importorskip("s3fs", reason="S3FS ABSENT: pip install s3fs 'moto[server]'")
    server = pytest.importorskip("moto.server", reason="MOTO ABSENT: pip install 'moto[server]'")
    running = server.ThreadedMotoServer("127.0.0.1", port=0, verbose=False)
    running.start()
    try:
        host, port = running.get_host_and_port()
        for name, value in (("ACCESS_KEY_ID", "t"), ("SECRET_ACCESS_KEY", "t"), ("DEFAULT_REGION", "us-east-1")):
            monkeypatch.setenv(f"AWS_{name}", value)
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        system = s3fs.S3FileSystem(skip_instance_cache=True)
        system.mkdir("plant")
        for name in ("a1/2026-03-01", "a2/2026-03-03"):
            system.put(str(two_axes / "logs" / f"{name}.csv"), f"plant/logs/{name}.csv")
        there = replace(remote, logs=("s3://plant/logs/*/*.csv",), results="s3://plant/results")
        found = fleet(there, engine=ALONE)
        assert [one.record for one in found.lost] == ["s3://plant/logs/a2/2026-03-03.csv"]
        fleet(remote, engine=ALONE)
        assert estimates(there.results) == estimates(remote.results)
        assert fleet(there, engine=ALONE).evaluated == 0
        assert [one.name for one in fleet_report(there.results).axes] == ["a1", "a2"]
        assert len(system.ls("plant/results/rows")) == 1
    finally:
        running.stop()
