"""What a residual depends on: speed, direction, position, acceleration, current, temperature or time.

A coordinate counts when its curve is significant in the residual's own correlated noise, confirmed by cross-validation
on blocks of time, and large enough to matter. The next one is judged on what the first ones leave.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.evidence.linalg import factored, in_blocks, triangle
from pmsm_ctrl.evidence.residual import Bench, Noise, Outcome, bench, noise_of
from pmsm_ctrl.evidence.tests import holm
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.residuals import policy
from pmsm_ctrl.residuals.coordinates import TIME, Curve, Drive, curves, grid_coordinates, with_orders

__all__ = [
    "Dependence",
    "Extent",
    "Objection",
    "Relevance",
    "ResidualStructure",
    "Trace",
    "residual_structure",
    "run_around",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

POINTS = 121  # of a curve that is drawn


class Objection(Enum):
    """The criterion that a dependence does not meet."""

    NOT_SIGNIFICANT = "not_significant"
    NOT_CONFIRMED = "not_confirmed"
    TOO_SMALL = "too_small"


@dataclass(frozen=True)
class Extent:
    """Where a curve is large: from `low` to `high`, None up to that end; 1 or -1 moving forward or backward alone."""

    low: float | None
    high: float | None
    direction: int


@dataclass(frozen=True, eq=False)
class Trace:
    """Measured and predicted channel on the thinned grid.

    Attributes
    ----------
    t, measured, predicted : array, shape (m,)
    mask : bool array, shape (m,)
        Samples that count.
    unit : str
    """

    t: Array
    measured: Array
    predicted: Array
    mask: Mask
    unit: str

    @property
    def residual(self) -> Array:
        """Measured less predicted, shape (m,)."""
        return self.measured - self.predicted


@dataclass(frozen=True)
class Relevance:
    """How large a dependence must be.

    Attributes
    ----------
    share : float
        Of the residual's mean square.
    size : float or None
        Rms as a share of the channel's; None: by the kind of channel.
    """

    share: float = policy.SHARE
    size: float | None = None

    def least(self, trace: Trace) -> float:
        """Return the least size of a curve in the unit of the channel."""
        usual = policy.VOLTAGE_SIZE if trace.unit == "V" else policy.SIZE
        share = usual if self.size is None else self.size
        return share * float(np.sqrt(np.mean(trace.measured[trace.mask] ** 2)))


@dataclass(frozen=True, eq=False)
class Dependence:
    """How much of the residual one coordinate explains.

    Attributes
    ----------
    coordinate, unit : str
    share : float
        Of the residual's mean square, by cross-validation; 0 when the curve is not confirmed.
    added : float
        The same beyond the coordinates named before it; NaN when it is not named.
    rank : int
        1 for the coordinate that is named first, 0 for one that is not named.
    p_value : float
        Of the prewhitened F-test, corrected for the number of coordinates and of curves tried.
    errors : float
        Cross-validation gain in its standard errors.
    objection : Objection or None
        The criterion that it does not meet by itself.
    values : array, shape (m,)
        The coordinate of every sample.
    x, forward, backward : array
        The fitted residual over the coordinate, moving either way; NaN where the log has nothing.
    orders : tuple of int
        Of position on a rotary axis: the orders in the curve.
    spectrum : array, shape (2, highest), or None
        Amplitude of every order, and what noise makes of it.
    period : float
        Of a wave over several turns in the curve, rad; 0 without one.
    """

    coordinate: str
    unit: str
    share: float
    added: float
    rank: int
    p_value: float
    errors: float
    objection: Objection | None
    values: Array
    x: Array
    forward: Array
    backward: Array
    orders: tuple[int, ...] = ()
    spectrum: Array | None = None
    period: float = 0.0

    @property
    def significant(self) -> bool:
        """Whether it meets all criteria by itself."""
        return self.objection is None

    @property
    def peak(self) -> float:
        """Greatest height of the curve, in the residual's unit."""
        return float(np.nanmax(np.abs([self.forward, self.backward])))

    @property
    def strongest_order(self) -> int:
        """Of the orders in the curve the one with the greatest amplitude; 0 where there are none."""
        if self.spectrum is None or not self.orders:
            return 0
        return max((self.spectrum[0, k - 1], k) for k in self.orders)[1]

    @property
    def extent(self) -> Extent:
        """Where the curve is large."""
        both = np.nan_to_num(np.abs([self.forward, self.backward]))
        height = both.max(axis=0)
        first, last = run_around(height >= policy.LARGE * height.max(), int(np.argmax(height)))
        ways = both[:, first : last + 1].max(axis=1)
        moves = np.isfinite(self.forward).any() and np.isfinite(self.backward).any()
        one_way = bool(moves and ways.min() < 0.5 * ways.max())
        return Extent(
            None if first == 0 else float(self.x[first]),
            None if last == len(self.x) - 1 else float(self.x[last]),
            (1 if ways[0] > ways[1] else -1) if one_way else 0,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "coordinate": self.coordinate, "unit": self.unit, "share": self.share, "share_beyond": self.added,
            "rank": self.rank or None, "p_value": self.p_value, "errors": self.errors,
            "significant": self.significant, "why_not": None if self.objection is None else self.objection.value,
            "largest": vars(self.extent), "peak": self.peak, "orders": self.orders or None,
            "curve": {"x": self.x, "forward": self.forward, "backward": self.backward},
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class ResidualStructure:
    """What the residual of one channel depends on, the greatest share first.

    Attributes
    ----------
    dependences : tuple of Dependence
    unit : str
    floor : float
        Rms that none of the coordinates explains, in `unit`: the noise floor.
    offset, offset_share : float
        Mean of the residual, and its share of the mean square.
    offset_significant : bool
    left : array, shape (m,)
        The residual without what they explain, zero where a sample does not count.
    mask : bool array, shape (m,)
        Samples that were judged: moving, and away from reversals.
    """

    dependences: tuple[Dependence, ...]
    unit: str
    floor: float
    offset: float
    offset_share: float
    offset_significant: bool
    left: Array
    mask: Mask

    @property
    def named(self) -> tuple[Dependence, ...]:
        """The coordinates that are named, in order."""
        return tuple(sorted((d for d in self.dependences if d.rank), key=lambda d: d.rank))

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "unit": self.unit,
            "noise_floor": self.floor,
            "offset": {"value": self.offset, "share": self.offset_share, "significant": self.offset_significant},
            "named": [d.coordinate for d in self.named],
            "coordinates": [d.to_dict() for d in self.dependences],
        }


def residual_structure(
    prepared: Prepared, trace: Trace, drive: Drive, relevance: Relevance | None = None, table: bool = True
) -> ResidualStructure:
    """Find what the residual of one channel of a log depends on.

    Without the `table` the coordinates that are not significant are left out, and so is the offset: nearly all of the
    time goes into cross-validation.
    """
    residual = trace.residual
    # a residual depends on what changes slowly most of the time: its noise is what changes from sample to sample
    jumps = np.abs(np.diff(residual[trace.mask]))
    jitter = 1.4826 * float(np.median(jumps)) / np.sqrt(2.0) if trace.unit != "V" else 0.0
    coordinates = grid_coordinates(prepared, drive, jitter)
    used = trace.mask & _away_from_reversals(prepared, coordinates["speed"])
    if int(used.sum()) >= policy.FEWEST:
        trace = replace(trace, mask=used)
    used = trace.mask
    made, noise = _modelled(prepared, coordinates, residual, used)
    case = _case(trace, noise, made, coordinates["direction"], relevance or Relevance(), prepared.cutoff)
    constant = case.bench.judge([], [1]) if table else None
    offset_sure = constant is not None and case.objection(constant, constant.p_value, certain=0.0) is None
    corrected = _corrected(made, {c.name: case.bench.significance(case.base[c.name], case.own[c.name]) for c in made})
    alone = {
        c.name: case.bench.judge(case.base[c.name], case.own[c.name])
        if table or corrected[c.name] < policy.SIGNIFICANCE
        else None
        for c in made
    }
    chosen = _chosen(case, made, alone)
    found = [
        _dependence(case, curve, outcome, corrected[curve.name], chosen)
        for curve in made
        if (outcome := alone[curve.name]) is not None
    ]
    found.sort(key=lambda d: (d.rank or 99, -d.share))
    return ResidualStructure(
        tuple(found), trace.unit, noise.rms, float(np.mean(residual[used])),
        max(0.0, constant.share) if constant is not None else 0.0, offset_sure, noise.left, used,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Case:
    """One residual laid out with the columns of all curves; `base` and `own` hold their numbers on the bench."""

    residual: Array
    mask: Mask
    bench: Bench
    base: Mapping[str, list[int]]
    own: Mapping[str, list[int]]
    share: float
    size: float
    direction: Array

    def objection(self, outcome: Outcome, p: float, certain: float = policy.CERTAIN) -> Objection | None:
        """Return the criterion that a dependence does not meet."""
        if p >= policy.SIGNIFICANCE:
            return Objection.NOT_SIGNIFICANT
        sure = policy.SURE_IF_CERTAIN if p < certain else policy.SURE
        by_rank = outcome.p_rank < 0.5 * policy.SIGNIFICANCE and outcome.gain > 0.0
        if outcome.share <= 0.0 or not (outcome.gain > sure * outcome.stderr or by_rank):
            return Objection.NOT_CONFIRMED
        if outcome.share <= self.share or outcome.size <= self.size:
            return Objection.TOO_SMALL
        return None


def _case(
    trace: Trace, noise: Noise, made: list[Curve], direction: Array, relevance: Relevance, cutoff: float
) -> _Case:
    """Put residual, constant, direction and every curve's own columns side by side."""
    columns = [np.ones(len(trace.t)), direction]
    base, own = {}, {}
    for curve in made:
        base[curve.name] = [1, 2][: curve.base.shape[1]]
        own[curve.name] = list(range(len(columns) + 1, len(columns) + 1 + curve.own.shape[1]))
        columns += list(curve.own.T)
    laid = bench(noise, trace.t, trace.residual, columns, policy.GAP / cutoff)
    return _Case(trace.residual, trace.mask, laid, base, own, relevance.share, relevance.least(trace), direction)


def _away_from_reversals(prepared: Prepared, omega: Array) -> Mask:
    """False within the filter's memory of a reversal: there the friction's jump is filtered, and its moment unsure."""
    from scipy.ndimage import maximum_filter1d

    turned = np.concatenate([[False], omega[1:] * omega[:-1] < 0.0]).astype(np.int8)
    reach = round(policy.REVERSAL * prepared.thinned_rate / prepared.cutoff)
    return np.asarray(maximum_filter1d(turned, 2 * reach + 1) == 0)


def _modelled(
    prepared: Prepared, coordinates: dict[str, Array], residual: Array, mask: Mask
) -> tuple[list[Curve], Noise]:
    """Curves and noise; the orders of a turn are looked for twice, the second time with the noise's level known."""
    rate = prepared.thinned_rate
    made = curves(prepared, coordinates, residual, mask, mask.astype(np.float64))
    noise = noise_of(residual, _parts(made), mask, rate)
    first = [c.orders for c in made]
    if any(first):
        made = with_orders(made, prepared, residual, mask, noise.weight, coordinates["direction"])
        if [c.orders for c in made] != first:  # the noise is the same beside the same curves
            noise = noise_of(residual, _parts(made), mask, rate)
    return made, noise


def _parts(made: list[Curve]) -> list[Array]:
    """Return the columns of all curves as they are: side by side they would be a copy, half a GB of an hour's log."""
    return [part for curve in made for part in (curve.base, curve.own)]


def _corrected(made: list[Curve], p_values: Mapping[str, float]) -> dict[str, float]:
    """Return p-values that allow for the curves tried per coordinate and for the number of coordinates."""
    paid = [min(1.0, c.tried * p_values[c.name]) for c in made]
    return dict(zip([c.name for c in made], holm(paid), strict=True))


def _chosen(case: _Case, made: list[Curve], alone: Mapping[str, Outcome | None]) -> dict[str, tuple[int, float]]:
    """Name coordinates one at a time, each judged on what the earlier ones leave: name -> (rank, share beyond)."""
    named: dict[str, tuple[int, float]] = {}
    taken: list[int] = []
    for rank in range(1, policy.MOST + 1):
        left = [c for c in made if c.name not in named]
        base = {c.name: sorted({*taken, *case.base[c.name]}) for c in left}
        p = _corrected(left, {c.name: case.bench.significance(base[c.name], case.own[c.name]) for c in left})
        good = []
        for curve in left:
            if p[curve.name] >= policy.SIGNIFICANCE:
                continue
            found = alone[curve.name] if rank == 1 else case.bench.judge(base[curve.name], case.own[curve.name])
            if found is not None and case.objection(found, p[curve.name]) is None:
                good.append((curve, found))
        if not good:
            break
        best = max(found.share for _, found in good)
        alike = [(c, f) for c, f in good if f.share >= policy.ALIKE * best]
        # whatever a motion does one after the other is a function of the time as well
        curve, found = min(alike, key=lambda pair: (pair[0].name == TIME, pair[0].own.shape[1], -pair[1].share))
        # gains of a cross-validation need not add up to the whole
        named[curve.name] = (rank, min(found.share, 1.0 - sum(share for _, share in named.values())))
        taken = sorted({*taken, *case.base[curve.name], *case.own[curve.name]})
    return named


def _dependence(
    case: _Case, curve: Curve, outcome: Outcome, p: float, chosen: Mapping[str, tuple[int, float]]
) -> Dependence:
    rank, added = chosen.get(curve.name, (0, float("nan")))
    x, forward, backward = _drawn(case, curve)
    return Dependence(
        coordinate=curve.name,
        unit=curve.unit,
        share=max(0.0, outcome.share),
        added=added,
        rank=rank,
        p_value=p,
        errors=outcome.gain / outcome.stderr if outcome.stderr > 0.0 else 0.0,
        objection=case.objection(outcome, p),
        values=curve.x,
        x=x,
        forward=forward,
        backward=backward,
        orders=curve.orders,
        spectrum=curve.spectrum,
        period=curve.period,
    )


def _beside(there: Array, x: Array, reach: float) -> Mask:
    """Whether a sample lies within reach of each x, and samples on both sides: in a gap a curve is free to swing."""
    ordered = np.sort(there)
    after = np.searchsorted(ordered, x)
    near = np.minimum(x - ordered[np.maximum(after - 1, 0)], ordered[np.minimum(after, len(ordered) - 1)] - x)
    return np.asarray((x >= ordered[0]) & (x <= ordered[-1]) & (near <= reach))


def _drawn(case: _Case, curve: Curve) -> tuple[Array, Array, Array]:
    """The curve over its coordinate for either direction, where the log has samples."""
    mask = case.mask
    rows, parts = np.flatnonzero(mask), (curve.base, curve.own, case.residual[:, None])
    upper = triangle(np.hstack([part[rows[some]] for part in parts]) for some in in_blocks(len(rows)))
    beta = factored(upper[:, :-1]).solve(upper[:, -1])
    values, speed = curve.x[mask], curve.name in ("speed", "direction")
    if curve.name == "direction":
        x = np.array([-1.0, 1.0])
        points = np.hstack(curve.draw(x, 1.0)) @ beta
        return x, np.array([np.nan, points[1]]), np.array([points[0], np.nan])
    low, high = (0.0, np.quantile(np.abs(values), 0.999)) if speed else np.quantile(values, [0.001, 0.999])
    if curve.orders:
        low, high = 0.0, 2.0 * np.pi
    count = POINTS if not curve.orders else max(POINTS, 12 * max(curve.orders) + 1)
    x = np.linspace(low, high, count)
    if speed:
        x = np.sort(np.concatenate([x[1:], high * np.geomspace(1e-3, 0.1, 30)]))
    out = []
    direction = case.direction[mask]
    for sign in (1.0, -1.0):
        there = np.abs(values[direction == sign]) if speed else values[direction == sign]
        y = np.hstack(curve.draw(x, sign)) @ beta
        if len(there) < 8:
            y = np.full(len(x), np.nan)
        elif not curve.orders:
            y = np.where(_beside(there, x, (high - low) / count), y, np.nan)
        out.append(y)
    return x, out[0], out[1]


def run_around(true: Mask, place: int) -> tuple[int, int]:
    """Return the first and the last sample of the run of true ones that holds a place.

    Parameters
    ----------
    true : bool array, shape (m,)
    place : int
    """
    false = np.flatnonzero(~true)
    after = int(np.searchsorted(false, place))
    first = int(false[after - 1]) + 1 if after > 0 else 0
    last = int(false[after]) - 1 if after < len(false) else len(true) - 1
    return first, last
