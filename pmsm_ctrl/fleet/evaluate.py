"""One log, or the records of an axis, as rows: import with its doubts, identify, compare, diagnose."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError, RequestError
from pmsm_ctrl.files import sha256
from pmsm_ctrl.fleet.manifest import Item, Settings
from pmsm_ctrl.fleet.remote import local_copy
from pmsm_ctrl.fleet.store import Row
from pmsm_ctrl.log import Log
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice

if TYPE_CHECKING:
    from pmsm_ctrl.effects import Effect

__all__ = ["Job", "evaluated", "own_effects", "set_aside"]

DONE, FAILED, SET_ASIDE = "done", "failed", "set_aside"  # words of the status


@dataclass(frozen=True)
class Job:
    """What a worker gets: an item with its design and its key.

    Attributes
    ----------
    item : Item
    key : str
    design : Design or None
        None where the item cannot be evaluated.
    settings : Settings
    effects, digest : str
        File with own effects, and its hash; empty where there is none. A worker runs the file once.
    """

    item: Item
    key: str
    design: Design | None
    settings: Settings
    effects: str = ""
    digest: str = ""


@cache
def own_effects(path: str, digest: str) -> tuple[Effect, ...]:
    """Run a file of own effects, once in a process.

    Parameters
    ----------
    path : str
    digest : str
        Its SHA-256.

    Returns
    -------
    tuple of Effect

    Raises
    ------
    RequestError
        When it is no longer the file of this hash, cannot be run, or defines an id of the catalogue.
    """
    from pmsm_ctrl.effects import catalogue_with
    from pmsm_ctrl.effects.loading import load_effects

    found = load_effects(path)
    if sha256(path) != digest:
        raise RequestError(f"{path}: was changed while the fleet was evaluated; start the run again")
    catalogue_with(found)
    return found


@dataclass
class _Rows:
    """Rows of one job, in the order in which they are found."""

    job: Job
    started: datetime = field(default_factory=lambda: datetime.now(UTC))
    rows: list[Row] = field(default_factory=list)
    copies: dict[str, str] = field(default_factory=dict)  # of remote logs; a reason names the log

    def add(self, source: str, kind: str, name: str, **values: Any) -> None:
        item = self.job.item
        for copy, file in self.copies.items():
            values = {**values, "text": values.get("text", "").replace(copy, file)}
        self.rows.append(
            Row(self.job.key, len(self.rows), item.axis, item.type, item.files[-1], item.time, self.started,
                source, kind, name, **values)
        )  # fmt: skip

    def estimate(self, source: str, kind: str, name: str, found: Estimate, **more: Any) -> None:
        self.add(source, kind, name, value=_finite(found.value), stderr=_finite(found.stderr), unit=found.unit,
                 nominal=_finite(found.nominal), **more)  # fmt: skip

    def doubts(self, source: str, notices: Iterable[Notice]) -> None:
        for notice in notices:
            self.add(source, "doubt", notice.code, text=notice.text)


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def evaluated(job: Job) -> tuple[Row, ...]:
    """Evaluate what a job names; whatever goes wrong becomes a row.

    Parameters
    ----------
    job : Job

    Returns
    -------
    tuple of Row
        The last one is its status.
    """
    out, started = _Rows(job), time.thread_time()
    logs: list[Log] = []
    reasons = [_attempt(out, "import", lambda: logs.extend(_imported(out)))]
    if not reasons[0]:
        verbs = {"identify": _identified, "compare": _compared, "diagnose": _diagnosed}
        wanted = [verb for verb in verbs if getattr(job.settings, verb, True)]
        reasons = [_attempt(out, verb, lambda verb=verb: verbs[verb](out, logs)) for verb in wanted]  # type: ignore[misc]
    out.add("fleet", "quantity", "processor_time", value=time.thread_time() - started, unit="s")
    if (memory := _memory()) is not None:
        out.add("fleet", "quantity", "memory", value=memory, unit="B")
    worthless = all(reasons)
    out.add("fleet", "status", FAILED if worthless else DONE, text=reasons[0] if worthless else "")
    return tuple(out.rows)


def _memory() -> float | None:
    """Return the resident memory of this process, B; None without psutil, which dask.distributed brings."""
    try:
        import psutil
    except ImportError:
        return None
    return float(psutil.Process().memory_info().rss)


def _attempt(out: _Rows, source: str, step: Callable[[], None]) -> str:
    """Run a step; return why it failed, and keep that as a row."""
    try:
        step()
        return ""
    except PmsmCtrlError as error:
        name, reason = type(error).__name__, str(error)
    except MemoryError:
        name, reason = "MemoryError", "not enough memory for this log"
    except Exception as error:  # one log must not end the run of all
        name, reason = type(error).__name__, f"unexpected {type(error).__name__}: {error}"
    reason = " ".join(reason.split())
    out.add(source, "error", name, text=reason)
    return reason


def _imported(out: _Rows) -> list[Log]:
    """Return the logs, and say what they hold; one in doubt is refused."""
    from pmsm_ctrl.importers import read_log, require_confirmed

    if out.job.item.problem:
        raise PmsmCtrlError(out.job.item.problem)
    if out.job.effects and out.job.design is not None:
        known = own_effects(out.job.effects, out.job.digest)
        out.job = replace(out.job, design=out.job.design.with_own_effects(*known))
    job, logs = out.job, []
    for file in job.item.files:
        with local_copy(file) as path:
            out.copies[str(path)] = file
            log = read_log(path, job.design, job.settings.mapping)
            out.doubts("import", log.provenance.notices)
            require_confirmed(log, job.design, job.settings.mapping)
        logs.append(log)
    out.add("import", "quantity", "duration", value=sum(log.duration for log in logs), unit="s")
    out.add("import", "quantity", "rate", value=_finite(min(log.rate for log in logs)), unit="Hz")
    out.add("import", "quantity", "records", value=float(len(logs)), unit="1")
    if all("temperature" in log for log in logs):
        mean = sum(float(log["temperature"].mean()) for log in logs) / len(logs)
        out.add("import", "quantity", "temperature", value=_finite(mean), unit="degC")
    return logs


def _identified(out: _Rows, logs: list[Log]) -> None:
    from pmsm_ctrl.identify import identify

    assert out.job.design is not None
    found = identify(out.job.design, logs)
    for name, estimate in found.estimates.items():
        out.estimate("identify", "parameter", name, estimate)
    for name, why in found.unidentifiable.items():
        out.add("identify", "doubt", why.code, text=f"{name}: {why.text}")
    out.doubts("identify", found.notices)


def _compared(out: _Rows, logs: list[Log]) -> None:
    from pmsm_ctrl.compare import compare

    assert out.job.design is not None
    found = compare(out.job.design, logs)
    out.add("compare", "verdict", found.verdict.value, text="; ".join(reason.text for reason in found.reasons))
    for channel, error in found.log.errors.items():
        out.add("compare", "quantity", f"error_{channel}", value=_finite(error.relative), unit="1")


def _diagnosed(out: _Rows, logs: list[Log]) -> None:
    from pmsm_ctrl.diagnose import diagnose

    assert out.job.design is not None
    found = diagnose(out.job.design, logs, plan=False)
    out.add("diagnose", "verdict", found.verdict.value, text="; ".join(reason.text for reason in found.reasons))
    for when, errors in found.errors.items():
        for channel, error in errors.items():
            out.add("diagnose", "quantity", f"error_{when}_{channel}", value=_finite(error["relative"]), unit="1")
    for step in found.steps:
        explained = _finite(_explained(found.ranking, step.effect))
        out.add("diagnose", "finding", step.effect, p_value=_finite(step.evidence["p_holm"]),
                text=", ".join(step.equivalents), value=explained, unit="1")  # fmt: skip
        for symbol, estimate in step.parameters.items():
            out.estimate("diagnose", "parameter", f"{step.name}.{symbol}", estimate)
    for row in found.ranking:
        out.add("diagnose", "candidate", row.effect, value=_finite(row.explained), unit="1",
                p_value=_finite(row.p_value), flag=row.accepted, text=row.why_not)  # fmt: skip
    for deviation in found.parameter_deviations:
        estimate = Estimate(deviation.estimate, deviation.unit, deviation.stderr, deviation.nominal)
        out.estimate(
            "diagnose", "deviation", deviation.parameter, estimate, flag=deviation.flagged, text=deviation.note
        )
    out.doubts("diagnose", found.notices)


def _explained(ranking: Iterable[Any], effect: str) -> float | None:
    return next((row.explained for row in ranking if row.effect == effect), None)


def set_aside(job: Job, reason: str) -> tuple[Row, ...]:
    """Return the rows of a job that ended its workers.

    Parameters
    ----------
    job : Job
    reason : str

    Returns
    -------
    tuple of Row
    """
    out = _Rows(job)
    out.add("fleet", "error", SET_ASIDE, text=reason)
    out.add("fleet", "status", SET_ASIDE, text=reason)
    return tuple(out.rows)
