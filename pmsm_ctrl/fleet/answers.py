"""From the rows of a fleet to its answers: frozen numbers, no words."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.trends import FALSE_DISCOVERIES, Regression, Step, changing, q_values, regression
from pmsm_ctrl.fleet import notices as words
from pmsm_ctrl.fleet.axis import AxisRows, by_axis
from pmsm_ctrl.fleet.policy import OUTLYING, REPEATED
from pmsm_ctrl.fleet.result import Lost
from pmsm_ctrl.fleet.single_logs import WORTHLESS, latest_with, unexplained, without_copies, worthless
from pmsm_ctrl.fleet.store import Row, Store
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice

__all__ = ["AxisAnswer", "Change", "Finding", "FleetReport", "Series", "Unlike", "answered", "fleet_report"]

Array = NDArray[np.float64]
DAY = 86400.0
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, eq=False)
class Series:
    """A parameter of an axis over its records.

    Attributes
    ----------
    name, unit : str
    days : array, shape (n,)
        Since 1970, UTC.
    value, stderr : array, shape (n,)
    nominal : float
        Of the design; NaN where it states none.
    """

    name: str
    unit: str
    days: Array
    value: Array
    stderr: Array
    nominal: float = float("nan")


@dataclass(frozen=True)
class Finding:
    """An effect that an axis lacks.

    Attributes
    ----------
    effect : str
    equivalents : tuple of str
        Effects that the logs cannot tell from it.
    records, of : int
        Records that show it, and all that were diagnosed.
    p_value : float
        Over all records of the axis.
    since, before : datetime or None
        The first record from which it shows, and the last one before; None where it shows from the first record on.
    """

    effect: str
    equivalents: tuple[str, ...]
    records: int
    of: int
    p_value: float
    since: datetime
    before: datetime | None


@dataclass(frozen=True, eq=False)
class Change:
    """A trend or a step of a parameter.

    Attributes
    ----------
    axis, parameter, unit : str
    p_value, q_value : float
        Of no change; the share of false ones among all that are at least as sure.
    step : Step or None
    trend : Regression or None
        Per day. The one of the two that explains the series.
    when, earliest, latest : datetime or None
        Of a step: the first record of the new level; the dates between which it lies, at 95 %.
    limit : float
        Highest allowed value; NaN where none is stated.
    reached, reached_stderr : float
        Days after the last record until a trend reaches the limit; NaN where it does not.
    beside : tuple of str
        Effects that appear on the axis between the dates of a step: one cause, of which the parameter takes a part.
    """

    axis: str
    parameter: str
    unit: str
    p_value: float
    q_value: float
    step: Step | None
    trend: Regression | None
    when: datetime | None = None
    earliest: datetime | None = None
    latest: datetime | None = None
    limit: float = float("nan")
    reached: float = float("nan")
    reached_stderr: float = float("nan")
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unlike:
    """A parameter of an axis that is unlike those of the other axes of its type.

    Attributes
    ----------
    axis, parameter, unit : str
    value, median : float
        Of the axis, and of its type.
    score : float
        Distance in robust standard deviations.
    """

    axis: str
    parameter: str
    unit: str
    value: float
    median: float
    score: float


@dataclass(frozen=True, eq=False)
class AxisAnswer:
    """What the logs say of one axis.

    Attributes
    ----------
    name, type : str
    records, answered : int
        All, and those with a verdict that says something.
    verdicts : dict of str to int
    missing : bool
        Whether it is among the discoveries of the fleet.
    p_value, q_value : float
        Of an axis that lacks nothing.
    findings : tuple of Finding
        Where `missing`.
    series : dict of str to Series
    per_degree : Regression or None
        F_c over the temperature, where that is logged.
    """

    name: str
    type: str
    records: int
    answered: int
    verdicts: Mapping[str, int]
    missing: bool
    p_value: float
    q_value: float
    findings: tuple[Finding, ...]
    series: Mapping[str, Series]
    per_degree: Regression | None = None

    @property
    def consistent(self) -> bool:
        """Whether its design explains it: nothing is missing, and more than half of its records say so."""
        return not self.missing and 2 * self.verdicts.get("consistent", 0) > self.records


@dataclass(frozen=True, eq=False)
class FleetReport(Result):
    """What the logs of a fleet say of its axes.

    Attributes
    ----------
    results : str
    axes : tuple of AxisAnswer
        By name.
    changes : tuple of Change
        Those that are discoveries, the surest first.
    judged : int
        Parameters of axes over time that were judged.
    unlike : tuple of Unlike
        The least alike first.
    worthless : tuple of Lost
        Logs without an answer, and why.
    notices : tuple of Notice
    unexplained : tuple of Lost
        Logs whose residual no effect of the catalogue explains, and what is said of it.
    odd_log, odd_design : str
        Of the axis that surest lacks an effect, or changes: what to look at next; empty where there is none.
    """

    results: str
    axes: tuple[AxisAnswer, ...]
    changes: tuple[Change, ...]
    judged: int
    unlike: tuple[Unlike, ...]
    worthless: tuple[Lost, ...]
    notices: tuple[Notice, ...] = ()
    unexplained: tuple[Lost, ...] = ()
    odd_log: str = ""
    odd_design: str = ""

    @property
    def changing(self) -> tuple[str, ...]:
        """The axes that change over time by more than an effect that appears."""
        return tuple(dict.fromkeys(one.axis for one in self.changes if not one.beside))

    @property
    def missing(self) -> tuple[AxisAnswer, ...]:
        """The axes that lack an effect, the surest first."""
        return tuple(sorted((one for one in self.axes if one.missing), key=lambda one: one.p_value))

    def to_dict(self) -> dict[str, Any]:
        """Return the schema ``pmsm-ctrl/fleet_report/1``."""
        axes = [
            {
                "axis": one.name, "type": one.type, "records": one.records, "answered": one.answered,
                "verdicts": one.verdicts, "missing": one.missing, "consistent": one.consistent,
                "p_value": one.p_value, "q_value": one.q_value,
                "findings": [_dated(vars(found)) for found in one.findings],
            }
            for one in self.axes
        ]  # fmt: skip
        changes = [
            _dated({name: vars(value) if name in ("step", "trend") and value else value
                    for name, value in vars(one).items()}) for one in self.changes
        ]  # fmt: skip
        plain: dict[str, Any] = jsonable({
            "schema": "pmsm-ctrl/fleet_report/1", "results": self.results, "axes": axes, "changes": changes,
            "judged": self.judged, "unlike": [vars(one) for one in self.unlike],
            "worthless": [vars(one) for one in self.worthless],
            "unexplained": [vars(one) for one in self.unexplained], **self.doubts(),
        })  # fmt: skip
        return plain


def _dated(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value.isoformat() if isinstance(value, datetime) else value for name, value in values.items()}


KINDS = ("status", "verdict", "parameter", "deviation", "finding", "quantity")


def fleet_report(results: str | os.PathLike[str]) -> FleetReport:
    """Answer the questions of a fleet from the table of its results; of each log the newest evaluation counts.

    Parameters
    ----------
    results : path
        A folder that `fleet` wrote, or writes at the moment.

    Returns
    -------
    FleetReport

    Raises
    ------
    RequestError
        When it is no such folder.
    """
    store = Store(results, create=False)
    limits = {name: float(value) for name, value in store.noted("limits").items()}
    digests = {name: str(known[2]) for name, known in store.noted("hashes").items() if len(known) > 2}
    return answered(str(results), store.read(KINDS), limits, digests, store.noted("designs"))


def answered(
    results: str, rows: Iterable[Row], limits: Mapping[str, float], digests: Mapping[str, str] | None = None,
    designs: Mapping[str, str] | None = None,
) -> FleetReport:  # fmt: skip
    """Answer from rows.

    Parameters
    ----------
    results : str
        Their name.
    rows : iterable of Row
    limits : dict of str to float
        Highest allowed value by parameter.
    digests, designs : dict of str to str, optional
        Hash of each log, of which equal ones of an axis count once; path of the design of each axis.

    Returns
    -------
    FleetReport
    """
    axes = by_axis(rows)
    copies = without_copies(axes, digests or {})
    found = [(axis, *_findings(axis)) for axis in axes]
    shares = q_values([p for _, p, _ in found])
    answers = tuple(_answer(axis, p, q, findings) for (axis, p, findings), q in zip(found, shares, strict=True))
    changes, judged = _changes(answers, limits)
    lost = tuple(one for axis in axes for one in worthless(axis))
    odd = tuple(one for axis in axes for one in unexplained(axis))
    report = FleetReport(
        results, answers, changes, judged, tuple(_unlike(answers)), lost, tuple(_notices(answers, lost, copies)), odd
    )
    surest = [(one.name, one.findings[0].effect) for one in report.missing if one.findings]
    axis, effect = next(iter((*surest, *((one.axis, "") for one in changes))), ("", ""))
    return replace(report, odd_log=latest_with(axes, axis, effect), odd_design=(designs or {}).get(axis, ""))


def _findings(axis: AxisRows) -> tuple[float, tuple[Finding, ...]]:
    """Return the p-value of an axis that lacks nothing, and every effect that its records name.

    A record's p-value of an effect allows for all candidates (Holm). That of the axis is the one of the second surest
    record, times the number of pairs left to it: an effect has to show twice. Source: Y. Benjamini, R. Heller,
    Biometrics 64 (2008) 1215, the partial conjunction.
    """
    records = [name for name in axis.ordered() if any(row.source == "diagnose" for row in axis.rows[name])]
    n, named = len(records), defaultdict(dict)  # type: int, dict[str, dict[str, Row]]
    for record in records:
        for row in axis.rows[record]:
            if row.kind == "finding" and row.p_value is not None:
                named[row.name][record] = row
    needed, out = min(REPEATED, n), []
    for effect, by_record in named.items():
        p = sorted([row.p_value or 0.0 for row in by_record.values()] + [1.0] * n)[needed - 1]
        shows = np.array([record in by_record for record in records])
        first = _onset(shows)
        alike = {word for row in by_record.values() for word in row.text.split(", ") if word}
        out.append(
            Finding(
                effect, tuple(sorted(alike)), len(by_record), n, min(1.0, p * (n - needed + 1)),
                axis.times[records[first]], axis.times[records[first - 1]] if first else None,
            )
        )  # fmt: skip
    out.sort(key=lambda one: one.p_value)
    return (out[0].p_value if out else 1.0), tuple(out)


def _onset(shows: NDArray[np.bool_]) -> int:
    """Return the record from which an effect shows: the likeliest place where its frequency rises."""
    best, place = -np.inf, 0
    for k in range(len(shows)):
        before, after = shows[:k], shows[k:]
        if k and before.mean() >= after.mean():
            continue
        likelihood = sum(_bernoulli(part) for part in (before, after))
        if likelihood > best + 1e-12:
            best, place = likelihood, k
    return place


def _bernoulli(shows: NDArray[np.bool_]) -> float:
    count, n = int(shows.sum()), len(shows)
    return sum(m * float(np.log(m / n)) for m in (count, n - count) if m)


def _answer(axis: AxisRows, p: float, q: float, findings: tuple[Finding, ...]) -> AxisAnswer:
    verdicts: dict[str, int] = defaultdict(int)
    answered_records = 0
    for rows in axis.rows.values():
        word = next((row.name for row in rows if row.kind == "verdict" and row.source == "diagnose"), "")
        verdicts[word] += bool(word)
        answered_records += bool(word) and word not in WORTHLESS
    missing = bool(q <= FALSE_DISCOVERIES)
    series = _series(axis)
    return AxisAnswer(
        axis.name, axis.type, len(axis.rows), answered_records, {k: v for k, v in verdicts.items() if v}, missing, p,
        float(q), tuple(one for one in findings if one.p_value <= FALSE_DISCOVERIES) if missing else (), series,
        _per_degree(axis, series),
    )  # fmt: skip


def _series(axis: AxisRows) -> dict[str, Series]:
    """Return every parameter that at least two records found.

    Where an effect was found, the identified values lack it: they bear its error, and a standard error of many times
    the scatter, beside which that of all other records looks like a change. There the model with the effect counts.
    """
    points: dict[str, list[tuple[float, Row]]] = defaultdict(list)
    for record in axis.ordered():
        rows = axis.rows[record]
        lacking = any(row.kind == "finding" for row in rows)
        whole = {row.name: row for row in rows if lacking and row.kind == "deviation" and row.value is not None}
        for row in (whole.get(row.name, row) for row in rows if row.kind == "parameter"):
            if row.value is not None:
                points[row.name].append(((axis.times[record] - EPOCH).total_seconds() / DAY, row))
    return {name: _as_series(name, of_name) for name, of_name in points.items() if len(of_name) > 1}


def _as_series(name: str, points: list[tuple[float, Row]]) -> Series:
    nominal = points[-1][1].nominal
    return Series(
        name, points[-1][1].unit, np.array([day for day, _ in points]),
        np.array([row.value for _, row in points], dtype=float),
        np.array([np.nan if row.stderr is None else row.stderr for _, row in points], dtype=float),
        float("nan") if nominal is None else nominal,
    )  # fmt: skip


def _per_degree(axis: AxisRows, series: Mapping[str, Series]) -> Regression | None:
    """Fit F_c over the temperature where every record has both."""
    if "F_c" not in series:
        return None
    degrees = [
        row.value for record in axis.ordered() for row in axis.rows[record]
        if row.name == "temperature" and row.value is not None
    ]  # fmt: skip
    found = series["F_c"]
    if len(degrees) != len(found.value):
        return None
    return regression(np.array(degrees, dtype=float), found.value, found.stderr)


def _changes(axes: tuple[AxisAnswer, ...], limits: Mapping[str, float]) -> tuple[tuple[Change, ...], int]:
    """Return the changes that are discoveries, the surest first, and how many series were judged."""
    tried = [change for axis in axes for one in axis.series.values() if (change := _change(axis, one, limits))]
    shares = q_values([one.p_value for one in tried])
    findings = {axis.name: axis.findings for axis in axes}
    found = [
        replace(one, q_value=float(q), beside=tuple(_appear_with(one, findings[one.axis])))
        for one, q in zip(tried, shares, strict=True) if q <= FALSE_DISCOVERIES
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda one: one.p_value)), len(tried)


def _change(axis: AxisAnswer, series: Series, limits: Mapping[str, float]) -> Change | None:
    """Judge a series: a trend or a step, whichever leaves less at its number of parameters."""
    found = changing(series.days, series.value, series.stderr)
    if found is None:
        return None
    limit = limits.get(series.name, float("nan"))
    base = Change(axis.name, series.name, series.unit, found.p_value, 1.0, found.step, found.trend, limit=limit)
    if found.step is not None:
        first, last = max(0, found.step.first - 1), found.step.last
        when, earliest, latest = (_moment(series.days[k]) for k in (found.step.index, first, last))
        return replace(base, when=when, earliest=earliest, latest=latest)
    assert found.trend is not None
    reached, own = _until(found.trend, limit)
    return replace(base, reached=reached, reached_stderr=own)


def _appear_with(change: Change, findings: Iterable[Finding]) -> Iterator[str]:
    """Yield the effects whose first record, or the last one without them, lies between the dates of a step."""
    if change.earliest is None or change.latest is None:
        return
    for one in findings:
        if one.before is not None and one.before <= change.latest and change.earliest <= one.since:
            yield one.effect


def _until(trend: Regression, limit: float) -> tuple[float, float]:
    """Return the days from the last record until a trend reaches a limit, and their standard error."""
    if not np.isfinite(limit) or trend.slope == 0.0:
        return float("nan"), float("nan")
    days = (limit - trend.level) / trend.slope
    if days <= 0.0:
        return (0.0, 0.0) if trend.level >= limit else (float("nan"), float("nan"))
    # the level is stated at the last record; its covariance with the slope is positive, so that this is an upper bound
    own = (trend.level_stderr + days * trend.stderr) / abs(trend.slope)
    return days, own


def _moment(day: float) -> datetime:
    return EPOCH + timedelta(days=float(day))


def _unlike(axes: tuple[AxisAnswer, ...]) -> Iterator[Unlike]:
    """Yield the parameters that are far from the median of their type, the farthest first."""
    groups: dict[tuple[str, str], list[tuple[str, Series]]] = defaultdict(list)
    for axis in axes:
        for one in axis.series.values():
            groups[axis.type, one.name].append((axis.name, one))
    out = []
    for (_, name), of_type in groups.items():
        centres = np.array([np.median(one.value) for _, one in of_type])
        median = float(np.median(centres))
        spread = float(np.median(np.abs(centres - median)))
        if len(of_type) < 5 or spread <= 0.0:
            continue
        scores = 0.6745 * (centres - median) / spread
        out += [
            Unlike(axis, name, one.unit, float(centre), median, float(score))
            for (axis, one), centre, score in zip(of_type, centres, scores, strict=True) if abs(score) > OUTLYING
        ]  # fmt: skip
    yield from sorted(out, key=lambda one: -abs(one.score))


def _notices(axes: tuple[AxisAnswer, ...], lost: tuple[Lost, ...], copies: list[str]) -> Iterator[Notice]:
    records = sum(one.records for one in axes)
    silent = [one.name for one in axes if not one.answered]
    if silent:
        yield words.SILENT(count=len(silent), names=", ".join(silent[:8]))
    if lost:
        yield words.WORTHLESS(count=len(lost), logs=records)
    if copies:
        yield words.COPIES(count=len(copies), names=", ".join(copies[:5]))
