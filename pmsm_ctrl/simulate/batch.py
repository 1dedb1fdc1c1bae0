"""Many drives at once: the same scenario for designs with different parameters, on all cores.

Threads share one compiled kernel, which runs without the interpreter's lock; processes would each load their own.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError, RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate.lanes import LANES, Group, groups, simulate_group
from pmsm_ctrl.simulate.motions import Scenario
from pmsm_ctrl.simulate.run import Prepared, prepare, simulate

__all__ = ["simulate_batch"]

Work = tuple[tuple[int, ...], Callable[[], list[Any]]]  # numbers of drives, and what simulates them


def simulate_batch(
    designs: Sequence[Design],
    scenario: str | Scenario = "sweep",
    *,
    truths: Sequence[Design] | None = None,
    seed: int = 0,
    keep_truth: bool = False,
    keep: Callable[[Log], Any] | None = None,
    workers: int | None = None,
    lanes: bool | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Any]:
    """Simulate many drives; drive k equals ``simulate(designs[k], scenario, seed=seed + k)``.

    Drives with the same effects and timing run side by side in vector instructions when there are enough of them;
    those whose effects or speed controllers have a memory (two masses, filters, an observer) run alone.
    They differ from their single runs by rounding: 1e-11 of the largest value, until rounding moves an angle across
    the edge of an encoder count.

    Parameters
    ----------
    designs : sequence of Design
        The controllers' designs, and the plants' without `truths`.
    scenario : str or Scenario
        The motion of all drives; a named one takes its parameters from each design.
    truths : sequence of Design, optional
        The plants, as many as designs.
    seed : int
        Seed of the first drive's noise; drive k has ``seed + k``.
    keep_truth : bool
        Also log ``theta_true`` and ``omega_true``, which no drive can.
    keep : function of a log, optional
        Called with each finished log, in the thread that made it; its value is returned in place of the log, which
        saves memory.
    workers : int, optional
        Threads; by default as many as cores.
    lanes : bool, optional
        False simulates every drive alone, bit for bit as `simulate` does; True puts any number of drives side by
        side. By default it is done where it saves more time than its kernel takes to compile.
    progress : function, optional
        Called with the share of drives done, 0 to 1.

    Returns
    -------
    list
        A log, or a value of `keep`, for each design, in order.

    Raises
    ------
    RequestError
        When the numbers of designs and truths differ, or `workers` is not positive.
    PmsmCtrlError
        The error of the first drive that failed, with its number; drives that have not begun are dropped.
    """
    if truths is not None and len(truths) != len(designs):
        raise RequestError(f"batch: {len(designs)} designs but {len(truths)} truths; as many were expected")
    if workers is not None and workers < 1:
        raise RequestError(f"batch: workers: found {workers}; it should be at least 1")
    if not designs:
        return []
    batch = _Batch(designs, scenario, truths, seed, keep_truth, keep, progress)
    together = []
    if lanes or (lanes is None and len(designs) >= LANES):
        together = groups(_prepared(designs, scenario, truths), always=bool(lanes))
    grouped = {k for group in together for k in group.numbers}
    work: list[Work] = [(group.numbers, partial(batch.several, group)) for group in together]
    work += [((k,), partial(batch.alone, (k,))) for k in range(len(designs)) if k not in grouped]
    return _in_threads(work, workers or os.cpu_count() or 1)


class _Batch:
    """The drives of a batch, each of which is simulated and counted; arguments are those of `simulate_batch`."""

    def __init__(
        self, designs: Sequence[Design], scenario: str | Scenario, truths: Sequence[Design] | None, seed: int,
        keep_truth: bool, keep: Callable[[Log], Any] | None, progress: Callable[[float], None] | None,
    ) -> None:  # fmt: skip
        self.designs, self.scenario, self.truths = designs, scenario, truths
        self.seed, self.keep_truth, self.keep, self.progress = seed, keep_truth, keep, progress
        self.done, self.counting = 0, threading.Lock()

    def alone(self, numbers: tuple[int, ...]) -> list[Any]:
        """Simulate drives one after the other."""
        return [self._finish(self._one(k)) for k in numbers]

    def several(self, group: Group) -> list[Any]:
        """Simulate drives side by side, or one after the other where that is not possible."""
        logs = simulate_group(group, self.seed, self.keep_truth)
        return self.alone(group.numbers) if logs is None else [self._finish(log) for log in logs]

    def _one(self, k: int) -> Log:
        truth = self.truths[k] if self.truths is not None else None
        try:
            return simulate(self.designs[k], self.scenario, truth=truth, seed=self.seed + k, keep_truth=self.keep_truth)
        except PmsmCtrlError as error:
            raise type(error)(f"drive {k} of {len(self.designs)}: {error}") from error

    def _finish(self, log: Log) -> Any:
        kept = log if self.keep is None else self.keep(log)
        if self.progress is not None:
            with self.counting:
                self.done += 1
                self.progress(self.done / len(self.designs))
        return kept


def _prepared(
    designs: Sequence[Design], scenario: str | Scenario, truths: Sequence[Design] | None
) -> dict[int, Prepared]:
    """Return the drives that can be simulated; the single runs of the others raise their errors."""
    found = {}
    for k, design in enumerate(designs):
        with contextlib.suppress(PmsmCtrlError):
            found[k] = prepare(design, scenario, truth=truths[k] if truths is not None else None)
    return found


def _in_threads(work: list[Work], workers: int) -> list[Any]:
    """Run pieces of work, each with the numbers of its drives; return one value for each drive, in order."""
    work = sorted(work, key=lambda piece: piece[0])
    results: dict[int, Any] = {}
    with ThreadPoolExecutor(workers) as pool:
        futures = [(numbers, pool.submit(call)) for numbers, call in work]
        try:
            for numbers, future in futures:
                results.update(zip(numbers, future.result(), strict=True))
        except BaseException:  # also an interrupt: do not wait for results that are not read
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [results[k] for k in range(len(results))]
