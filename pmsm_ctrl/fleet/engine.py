"""Where the jobs run: in this process, or on the workers of dask.distributed.

A worker has one thread and one job at a time, so that a job that ends its worker is blamed alone; the scheduler runs it
again elsewhere, and gives it up when it has ended three.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.fleet.evaluate import Job, evaluated, set_aside
from pmsm_ctrl.fleet.store import Row
from pmsm_ctrl.threads import ONE_THREAD

__all__ = ["Engine", "completed"]

DEATHS = 3  # workers that a job may end
PATIENCE = "20s"  # for a scheduler to answer
LONGEST = 900.0  # s a job may take before its worker is ended: 100 times the usual

# dask looks after tasks of milliseconds: it polls 10 to 50 times a second, and moves tasks and data between workers.
# A log takes seconds and its rows are small.
UNHURRIED = {
    "distributed.worker.profile.enabled": False, "distributed.admin.tick.interval": "1s",
    "distributed.worker.memory.monitor-interval": "500ms", "distributed.admin.system-monitor.interval": "10s",
    "distributed.admin.system-monitor.gil.enabled": False, "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.active-memory-manager.start": False,
}  # fmt: skip


@dataclass(frozen=True)
class Engine:
    """How the work is spread.

    Attributes
    ----------
    jobs : int
        Worker processes on this machine; 1 runs in this process, 0 means as many as the machine has cores.
    scheduler : str
        Address of a running scheduler, such as ``tcp://10.0.0.5:8786``; its workers must see the files by the same
        paths. Empty for workers of this machine.
    memory : str
        Limit of a worker, such as ``2GB``; a worker beyond it is ended. ``auto`` shares out the machine's memory.
    longest : float
        s; a job that takes longer ends its worker and is tried again.
    """

    jobs: int = 0
    scheduler: str = ""
    memory: str = "auto"
    longest: float = LONGEST


def completed(jobs: Sequence[Job], engine: Engine) -> Iterator[list[tuple[Row, ...]]]:
    """Evaluate jobs and yield the rows of those that are ready, as they become ready.

    Parameters
    ----------
    jobs : sequence of Job
    engine : Engine

    Yields
    ------
    list of tuple of Row

    Raises
    ------
    RequestError
        When dask.distributed is needed and not installed, or the scheduler does not answer.
    """
    processes = engine.jobs or os.cpu_count() or 1
    if not engine.scheduler and min(processes, len(jobs)) <= 1:
        for job in jobs:
            yield [evaluated(job)]
        return
    with _client(engine, min(processes, len(jobs))) as client:
        yield from _spread(client, jobs, engine)


def _spread(client: Any, jobs: Sequence[Job], engine: Engine) -> Iterator[list[tuple[Row, ...]]]:
    """Keep every worker at one job, and yield what is ready."""
    from distributed import as_completed

    waiting = iter(jobs)
    running: dict[Any, Job] = {}
    ready = as_completed([], with_results=False)
    while True:
        for job in _some(waiting, _room(client) - len(running)):
            future = client.submit(_guarded, job, engine.longest, key=f"log-{job.key}", pure=False)
            running[future] = job
            ready.add(future)
        if not running:
            return
        batch = [next(ready), *_at_hand(ready)]
        yield [_rows_of(future, running.pop(future)) for future in batch]


def _some(jobs: Iterator[Job], most: int) -> Iterator[Job]:
    for _ in range(most):
        job = next(jobs, None)
        if job is None:
            return
        yield job


def _room(client: Any) -> int:
    """Return how many jobs the workers take at once; one that has just died comes back."""
    threads = sum(client.nthreads().values())
    return max(1, int(threads))


def _at_hand(ready: Any) -> list[Any]:
    """Return what else is ready, without waiting."""
    return list(ready.next_batch(block=False)) if not ready.is_empty() else []


def _rows_of(future: Any, job: Job) -> tuple[Row, ...]:
    from distributed.scheduler import KilledWorker

    try:
        rows: tuple[Row, ...] = future.result()
        return rows
    except KilledWorker:
        reason = f"set aside: {DEATHS} workers ended while they evaluated it (memory, time or a crash)"
        return set_aside(job, reason)
    except Exception as error:  # lost on the way: the scheduler's words are the reason
        return set_aside(job, f"set aside: {type(error).__name__}: {error}")
    finally:
        future.release()


def _guarded(job: Job, longest: float) -> tuple[Row, ...]:
    """Evaluate a job on a worker; one that takes too long ends the process, and the scheduler tries it elsewhere."""
    import threading

    watch = threading.Timer(longest, os._exit, (1,))
    watch.daemon = True
    watch.start()
    try:
        return evaluated(job)
    finally:
        watch.cancel()


@contextmanager
def _client(engine: Engine, processes: int) -> Iterator[Any]:
    """Yield a client of a running scheduler, or of workers made for this run."""
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise RequestError(
            "fleet: dask.distributed not installed: pip install 'pmsm-ctrl[fleet]'; --jobs 1 does without"
        ) from None
    quiet = {"distributed.scheduler.allowed-failures": DEATHS - 1, "distributed.logging.distributed": "critical",
             "distributed.worker.memory.terminate": 0.95, "distributed.admin.tick.limit": "1h",
             # dask has workers give memory back at once, and each large array then costs its page faults: 1.6 times
             "distributed.nanny.pre-spawn-environ": ONE_THREAD, **UNHURRIED}  # fmt: skip
    with dask.config.set(quiet):
        if engine.scheduler:
            try:
                client = Client(engine.scheduler, timeout=PATIENCE)
            except (OSError, ValueError) as error:
                raise RequestError(f"--scheduler {engine.scheduler}: does not answer ({error})") from None
            with client:
                client.wait_for_workers(1, timeout=60)
                yield client
            return
        with (
            LocalCluster(
                n_workers=processes, threads_per_worker=1, processes=True, memory_limit=engine.memory,
                dashboard_address=None, host="127.0.0.1", silence_logs=50,
            ) as cluster,
            Client(cluster) as client,
        ):  # fmt: skip
            yield client
