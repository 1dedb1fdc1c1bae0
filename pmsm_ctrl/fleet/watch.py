"""A folder that is followed: logs are evaluated as they arrive."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import count

from pmsm_ctrl.fleet.engine import Engine
from pmsm_ctrl.fleet.manifest import Manifest, NoLogError
from pmsm_ctrl.fleet.result import FleetResult
from pmsm_ctrl.fleet.run import fleet

__all__ = ["watch"]

QUIET = 5.0  # s since the last change of a file, from which it is taken for complete


def watch(
    manifest: Manifest,
    on_result: Callable[[FleetResult], None],
    *,
    every: float = 60.0,
    passes: int = 0,
    engine: Engine | None = None,
) -> None:
    """Evaluate what is new in a fleet's logs, again and again.

    Parameters
    ----------
    manifest : Manifest
    on_result : function
        Called after each pass that evaluated something, with its result.
    every : float
        Time between two scans, s.
    passes : int
        Scans after which it ends; 0 for no end.
    engine : Engine, optional
        As for `fleet`.
    """
    for number in count(1):
        done = _one_pass(manifest, engine)
        if done is not None and (done.evaluated or number == 1):
            on_result(done)
        if number == passes:
            return
        time.sleep(every)


def _one_pass(manifest: Manifest, engine: Engine | None) -> FleetResult | None:
    """Run once; None where there is no log yet."""
    try:
        return fleet(manifest, engine=engine, quiet=QUIET)
    except NoLogError:
        return None
