"""The workers: the same rows as in one process, whatever happens to a worker."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path

import pytest

from pmsm_ctrl import fleet
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.fleet import Engine, Manifest, Store, read_manifest
from pmsm_ctrl.fleet.engine import completed
from pmsm_ctrl.fleet.evaluate import Job
from pmsm_ctrl.fleet.manifest import Item, Settings

pytest.importorskip("pyarrow")

pytestmark = [
    # Workers close sockets and files of their own when they are ended; that is theirs.
    pytest.mark.filterwarnings("ignore"),
    # Looked for and not imported: that takes a second, in every process that collects tests.
    pytest.mark.skipif(find_spec("distributed") is None, reason="DISTRIBUTED ABSENT: pip install 'pmsm-ctrl[dev]'"),
]
COST = ("processor_time", "memory")


def numbers(results: str | Path) -> dict[tuple[str, int], tuple[object, ...]]:
    """Return every row of the results but what it cost."""
    return {
        (row.record, row.row): (row.source, row.kind, row.name, row.value, row.stderr, row.p_value, row.text)
        for row in Store(results).read() if row.name not in COST
    }  # fmt: skip


def jobs(count: int) -> list[Job]:
    """Return jobs that fail at once."""
    when = datetime(2026, 3, 1, tzinfo=UTC)
    return [Job(Item((f"l{k}",), "a", "", when, "", "no log"), f"k{k}", None, Settings()) for k in range(count)]


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """A scheduler with one worker in this process: the protocol, without the start of processes."""
    import distributed

    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50,
        protocol="tcp", host="127.0.0.1",
    ) as cluster:  # fmt: skip
        yield cluster.scheduler_address


def test_every_job_comes_back_once_from_a_scheduler(scheduler: str) -> None:
    found = [rows for ready in completed(jobs(7), Engine(scheduler=scheduler)) for rows in ready]
    assert sorted(rows[-1].key for rows in found) == [f"k{k}" for k in range(7)]
    assert {rows[-1].text for rows in found} == {"no log"}


def test_a_scheduler_that_does_not_answer_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pmsm_ctrl.fleet.engine.PATIENCE", "1s")
    with pytest.raises(RequestError, match="does not answer"):
        list(completed(jobs(2), Engine(scheduler="tcp://127.0.0.1:1")))


@pytest.mark.slow
def test_workers_give_the_same_numbers_as_one_process(two_axes: Path, tmp_path: Path) -> None:
    manifest = read_manifest(two_axes / "run.toml")
    for name, jobs_ in (("one", 1), ("two", 2)):
        fleet(replace(manifest, results=str(tmp_path / name)), engine=Engine(jobs_))
    assert numbers(tmp_path / "one") == numbers(tmp_path / "two")


@pytest.mark.slow
def test_workers_load_own_effects(own: Manifest, tmp_path: Path) -> None:
    for name, jobs_ in (("one", 1), ("two", 2)):
        fleet(replace(own, results=str(tmp_path / name)), engine=Engine(jobs_))
    assert numbers(tmp_path / "one") == numbers(tmp_path / "two")
    assert any(row[2] == "k_seal" for row in numbers(tmp_path / "two").values())


KILLER = """
import os
from pathlib import Path
import pmsm_ctrl.identify as room
from pmsm_ctrl import identify as _
original = room.identify
def identify(design, logs, **more):
    name = logs[0].provenance.file
    if MARK in name and TIMES > sum(1 for _ in Path(FOLDER).glob("death*")):
        Path(FOLDER, f"death{os.getpid()}").touch()
        os._exit(9)
    return original(design, logs, **more)
room.identify = identify
"""


@pytest.mark.slow
@pytest.mark.parametrize(("times", "aside"), [(2, 0), (99, 1)])
def test_a_killed_worker_changes_no_number_and_three_set_a_log_aside(
    times: int, aside: int, two_axes: Path, tmp_path: Path
) -> None:
    """A scheduler and two workers as processes of their own, whose `identify` ends them on one log."""
    values = {"MARK": repr("a1/2026-03-02"), "TIMES": str(times), "FOLDER": repr(str(tmp_path))}
    plugin = KILLER
    for name, value in values.items():
        plugin = plugin.replace(name, value)
    (tmp_path / "killer.py").write_text(plugin, encoding="utf-8")
    manifest = read_manifest(two_axes / "run.toml")
    with processes(tmp_path) as address:
        found = fleet(replace(manifest, results=str(tmp_path / "r")), engine=Engine(scheduler=address))
    assert len(list(tmp_path.glob("death*"))) == (3 if aside else 2)
    assert [one.record.endswith("a1/2026-03-02.csv") for one in found.lost if one.set_aside] == [True] * aside
    fleet(replace(manifest, results=str(tmp_path / "plain")), engine=Engine(1))
    plain, here = numbers(tmp_path / "plain"), numbers(tmp_path / "r")
    assert {k: v for k, v in plain.items() if not (aside and "a1/2026-03-02" in k[0])} == {
        k: v for k, v in here.items() if not (aside and "a1/2026-03-02" in k[0])
    }


class processes:  # noqa: N801 - a context manager
    """A scheduler and two workers with nannies, as processes on 127.0.0.1."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.running: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> str:
        environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "2", "PYTHONPATH": os.pathsep.join(
            (str(self.folder), str(Path(__file__).resolve().parents[3])))}  # fmt: skip
        told = self.folder / "scheduler.json"
        self._start(environment, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
                    "--scheduler-file", str(told))  # fmt: skip
        while not told.exists() or not told.read_text(encoding="utf-8").strip():
            time.sleep(0.1)
        address = str(json.loads(told.read_text(encoding="utf-8"))["address"])
        for _ in range(2):
            self._start(environment, "worker", address, "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard",
                        "--preload", "killer")  # fmt: skip
        return address

    def _start(self, environment: dict[str, str], *words: str) -> None:
        self.running.append(
            subprocess.Popen(
                [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:]], env=environment,
                cwd=self.folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
            )
        )  # fmt: skip

    def __exit__(self, *_: object) -> None:
        """End them with what they started: each has a group of its own."""
        for one in reversed(self.running):
            with suppress(ProcessLookupError):
                os.killpg(one.pid, signal.SIGKILL)
            one.wait(20)
