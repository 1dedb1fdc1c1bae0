"""Many drives at once: the same scenario for designs with different parameters, on all cores.

Threads share one compiled kernel, which runs without the interpreter's lock; processes would each load their own.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar, overload

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect
from pmsm_ctrl.errors import PmsmCtrlError, RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate.run import simulate
from pmsm_ctrl.simulate.scenarios import Scenario

__all__ = ["simulate_batch"]

T = TypeVar("T")


@overload
def simulate_batch(
    designs: Sequence[Design],
    scenario: str | Scenario = ...,
    *,
    truths: Sequence[Design] | None = ...,
    seed: int = ...,
    own: Iterable[Effect] = ...,
    keep_truth: bool = ...,
    keep: None = ...,
    workers: int | None = ...,
    progress: Callable[[float], None] | None = ...,
) -> list[Log]: ...


@overload
def simulate_batch(
    designs: Sequence[Design],
    scenario: str | Scenario = ...,
    *,
    truths: Sequence[Design] | None = ...,
    seed: int = ...,
    own: Iterable[Effect] = ...,
    keep_truth: bool = ...,
    keep: Callable[[Log], T],
    workers: int | None = ...,
    progress: Callable[[float], None] | None = ...,
) -> list[T]: ...


def simulate_batch(
    designs: Sequence[Design],
    scenario: str | Scenario = "sweep",
    *,
    truths: Sequence[Design] | None = None,
    seed: int = 0,
    own: Iterable[Effect] = (),
    keep_truth: bool = False,
    keep: Callable[[Log], Any] | None = None,
    workers: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> list[Any]:
    """Simulate many drives; drive k gives what ``simulate(designs[k], scenario, seed=seed + k)`` gives.

    Parameters
    ----------
    designs : sequence of Design
        What each controller believes, and each plant where `truths` does not say otherwise.
    scenario : str or Scenario
        The motion of all; a name takes its parameters from each design.
    truths : sequence of Design, optional
        The plants, as many as designs.
    seed : int
        Seed of the first drive's noise; the next has the next.
    own : iterable of Effect
        A user's own effects.
    keep_truth : bool
        Also log what no drive can.
    keep : function of a log, optional
        Called with each log as it is finished, in the thread that made it; its value is kept in place of the
        log, so that memory does not grow with logs nobody needs.
    workers : int, optional
        Threads; as many as cores when left out.
    progress : function, optional
        Called with the share of drives done, 0 to 1.

    Returns
    -------
    list
        One log, or one value of `keep`, a design, in the order of `designs`.

    Raises
    ------
    RequestError
        When the numbers of designs and truths differ, or `workers` is not positive.
    PmsmCtrlError
        What the first drive that failed says, with its number in front; the drives not yet begun are dropped.
    """
    if truths is not None and len(truths) != len(designs):
        raise RequestError(f"batch: {len(designs)} designs but {len(truths)} truths; as many were expected")
    if workers is not None and workers < 1:
        raise RequestError(f"batch: workers: found {workers}; it should be at least 1")
    effects = tuple(own)
    done = 0
    counting = threading.Lock()

    def one(k: int) -> Any:
        nonlocal done
        truth = truths[k] if truths is not None else None
        try:
            log = simulate(designs[k], scenario, truth=truth, seed=seed + k, own=effects, keep_truth=keep_truth)
        except PmsmCtrlError as error:
            raise type(error)(f"drive {k} of {len(designs)}: {error}") from error
        kept = log if keep is None else keep(log)
        if progress is not None:
            with counting:
                done += 1
                progress(done / len(designs))
        return kept

    if not designs:
        return []
    first = one(0)  # compiles what all of them need, once
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        futures = [pool.submit(one, k) for k in range(1, len(designs))]
        try:
            return [first, *(future.result() for future in futures)]
        except BaseException:  # an interrupt as well: do not wait for what nobody will read
            pool.shutdown(wait=False, cancel_futures=True)
            raise
