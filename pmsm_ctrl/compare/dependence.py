"""Where a model fails: its residual against speed, direction, position, acceleration, current, temperature and time.

A coordinate counts when its curve is significant in the residual's own correlated noise, holds on blocks of time that
were left out, and is large enough to matter. The next one is judged on what the first ones leave.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.coordinates import Curve, curves, grid_coordinates
from pmsm_ctrl.evidence.blocks import Bench, Noise, Outcome, bench, noise_of
from pmsm_ctrl.evidence.tests import holm
from pmsm_ctrl.regression.conditioning import Prepared

__all__ = ["Dependence", "Where", "where"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SIGNIFICANCE = 0.01  # family-wise, by Holm
SURE = 2.8  # standard errors by which the gain of left-out blocks must be above zero
# And how many are enough for a curve, whose ends a block left out takes with it, where the F-test rules noise out: on
# 134 clean logs of two simulators, of machines and of other sizes of drives, no curve that explains a hundredth of what
# is left came below 7e-7.
CERTAIN, ENOUGH = 1e-12, 2.0
# Of the measured channel: smaller curves are not worth a word. A voltage follows the sampled current no closer.
MATERIAL, MATERIAL_VOLTAGE = 0.004, 0.02
WORTH = 0.05  # least share of what is left that is worth a word: aliased edges of the torque make up to 3 %
ALIKE = 0.97  # of two coordinates that explain the same to within this, the simpler is named
MOST = 3  # coordinates that are named
POINTS = 121
REVERSAL = 2.0  # periods of the cutoff around a reversal that are left out
LARGE = 0.7  # of the greatest height: where the curve counts as large


@dataclass(frozen=True, eq=False)
class Dependence:
    """How much of the residual one coordinate explains.

    Attributes
    ----------
    coordinate, unit : str
    share : float
        Of the residual's mean square, on blocks left out; 0 when the curve does not hold there.
    added : float
        The same beyond the coordinates named before it; NaN when it is not named.
    rank : int
        1 for the coordinate that is named first, 0 for one that is not named.
    p_value : float
        Of the prewhitened F-test, corrected for the number of coordinates and of curves tried.
    errors : float
        Mean gain of the left-out blocks in its standard errors.
    significant : bool
        Whether it passes all gates by itself.
    why_not : str
        The gate that it fails; empty when it passes.
    values : array, shape (m,)
        The coordinate of every sample.
    x, forward, backward : array
        The fitted residual over the coordinate, moving either way; NaN where the log has nothing.
    largest : str
        Where the curve is large, in words.
    orders, spectrum
        Of position on a rotary axis: the orders in the curve; amplitude of every order and what noise makes of it,
        shape (2, highest).
    """

    coordinate: str
    unit: str
    share: float
    added: float
    rank: int
    p_value: float
    errors: float
    significant: bool
    why_not: str
    values: Array
    x: Array
    forward: Array
    backward: Array
    largest: str
    orders: tuple[int, ...] = ()
    spectrum: Array | None = None

    @property
    def peak(self) -> float:
        """Greatest height of the curve, in the residual's unit."""
        return float(np.nanmax(np.abs([self.forward, self.backward])))

    @property
    def name(self) -> str:
        """The coordinate as a sentence says it."""
        if self.coordinate == "speed" and np.isfinite(self.backward).any():
            return "speed and direction"
        if self.orders and self.rank:
            many = "orders" if len(self.orders) > 1 else "order"
            return f"position ({many} {', '.join(map(str, self.orders))} of a turn)"
        return self.coordinate


@dataclass(frozen=True, eq=False)
class Where:
    """What the residual of one channel depends on, the greatest share first.

    Attributes
    ----------
    floor : float
        Rms that none of the coordinates explains, in `unit`: the noise floor.
    left : array, shape (m,)
        What they leave over, zero where a sample does not count.
    mask : bool array, shape (m,)
        Samples that were judged: moving, and away from reversals.
    offset : float
        Mean of the residual.
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
        """The coordinates that stand, in order."""
        return tuple(sorted((d for d in self.dependences if d.rank), key=lambda d: d.rank))

    def sentence(self) -> str:
        """Say it in words."""
        parts = []
        if self.offset_significant:
            parts.append(
                f"{100 * self.offset_share:.0f} % of what is left is a constant {self.offset:+.2g} {self.unit}"
            )
        for number, d in enumerate(self.named):
            share = f"{100 * d.added:.0f} %"
            start = f"{share} of what is left depends" if not parts else f"a further {share} depends"
            text = f"{start} on {d.name}"
            if number == 0 and d.coordinate != "direction":
                place = "; it is up to" if len(d.orders) == 1 else f"; it is largest {d.largest}, up to"
                text += f"{place} {d.peak:.2g} {self.unit}"
            parts.append(text)
        return "; ".join(parts) if parts else "what is left depends on no coordinate of this log"

    def to_dict(self) -> dict[str, object]:
        """Return plain values."""
        return {
            "sentence": self.sentence(),
            "unit": self.unit,
            "noise_floor": self.floor,
            "offset": {"value": self.offset, "share": self.offset_share, "significant": self.offset_significant},
            "coordinates": [
                {
                    "coordinate": d.coordinate, "unit": d.unit, "share": d.share, "share_beyond": d.added,
                    "rank": d.rank or None, "p_value": d.p_value, "errors": d.errors, "significant": d.significant,
                    "why_not": d.why_not or None,
                    "largest": d.largest, "peak": d.peak, "orders": d.orders or None,
                    "curve": {"x": d.x, "forward": d.forward, "backward": d.backward},
                }
                for d in self.dependences
            ],
        }  # fmt: skip


def where(
    prepared: Prepared, measured: Array, predicted: Array, mask: Mask, unit: str, torque: Array, J: float,
    per_ampere: float | None = None, worth: float = WORTH, material: float | None = None,
    skipped: Collection[str] = (),
) -> Where:  # fmt: skip
    """Find what a residual depends on.

    Parameters
    ----------
    measured, predicted : array, shape (m,)
        One channel on the thinned grid.
    mask : bool array, shape (m,)
        Samples that count.
    torque : array, shape (m,)
        Drive torque as the model predicts it.
    J : float
        Inertia that this prediction holds.
    per_ampere : float, optional
        Torque constant, where the log has a current.
    worth : float
        Least share of what is left that is worth a word.
    material : float, optional
        Least size of a curve, as a share of the measured channel; by its unit when left out.
    skipped : names of coordinates
        Those that this log knows too badly.
    """
    t, residual = prepared.t[prepared.keep], measured - predicted
    jitter = _from_sample_to_sample(residual[mask]) if unit != "V" else 0.0
    every = grid_coordinates(prepared, torque, per_ampere, J, jitter)
    coordinates = {name: x for name, x in every.items() if name not in skipped}
    used = mask & _away_from_reversals(prepared, coordinates["speed"])
    if int(used.sum()) < 100:
        used = mask
    if material is None:
        material = MATERIAL_VOLTAGE if unit == "V" else MATERIAL
    made, noise = _modelled(prepared, coordinates, residual, used)
    case = _case(t, residual, used, noise, made, prepared.cutoff, measured, coordinates["direction"],
                 (worth, material))  # fmt: skip
    constant = case.bench.judge([], [1])
    offset_sure = constant is not None and not case.objection(constant, constant.p_value, 0.0)
    alone = {c.name: case.bench.judge(case.base[c.name], case.own[c.name]) for c in made}
    chosen = _chosen(case, made, alone)
    corrected = _corrected(made, {n: o.p_value if o is not None else 1.0 for n, o in alone.items()})
    found = [
        _dependence(case, curve, outcome, corrected[curve.name], chosen)
        for curve in made
        if (outcome := alone[curve.name]) is not None
    ]
    found.sort(key=lambda d: (d.rank or 99, -d.share))
    return Where(
        tuple(found), unit, noise.rms, float(np.mean(residual[used])),
        max(0.0, constant.share) if constant is not None else 0.0, bool(offset_sure), noise.left, used,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Case:
    """One residual laid out with the columns of all curves; `base` and `own` hold their numbers on the bench."""

    residual: Array
    mask: Mask
    bench: Bench
    base: Mapping[str, list[int]]
    own: Mapping[str, list[int]]
    worth: float
    least: float
    direction: Array

    def objection(self, outcome: Outcome, p: float, certain: float = CERTAIN) -> str:
        """Return the gate that a dependence fails; empty when it passes all."""
        if p >= SIGNIFICANCE:
            return "not significant"
        sure = ENOUGH if p < certain else SURE
        holds = outcome.gain > sure * outcome.stderr or (outcome.p_rank < 0.5 * SIGNIFICANCE and outcome.gain > 0.0)
        if not holds or outcome.share <= 0.0:
            return "does not hold on blocks left out"
        if outcome.share <= self.worth or outcome.size <= self.least:
            return "too small to matter"
        return ""


def _case(
    t: Array, residual: Array, mask: Mask, noise: Noise, made: list[Curve], cutoff: float, measured: Array,
    direction: Array, matter: tuple[float, float],
) -> _Case:  # fmt: skip
    """Put residual, constant, direction and every curve's own columns side by side."""
    columns = [np.ones(len(t)), direction]
    base, own = {}, {}
    for curve in made:
        base[curve.name] = [1, 2][: curve.base.shape[1]]
        own[curve.name] = list(range(len(columns) + 1, len(columns) + 1 + curve.own.shape[1]))
        columns += list(curve.own.T)
    least = matter[1] * float(np.sqrt(np.mean(measured[mask] ** 2)))
    laid = bench(noise, t, residual, mask, np.column_stack(columns), cutoff)
    return _Case(residual, mask, laid, base, own, matter[0], least, direction)


def _from_sample_to_sample(residual: Array) -> float:
    """Noise, rms, from what a residual changes by: what it depends on changes slowly most of the time."""
    return 1.4826 * float(np.median(np.abs(np.diff(residual)))) / np.sqrt(2.0)


def _away_from_reversals(prepared: Prepared, omega: Array) -> Mask:
    """False within the filter's memory of a reversal: there the friction's jump is filtered, and its moment unsure."""
    from scipy.ndimage import maximum_filter1d

    turned = np.concatenate([[False], omega[1:] * omega[:-1] < 0.0]).astype(np.int8)
    reach = round(REVERSAL * prepared.thinned_rate / prepared.cutoff)
    return maximum_filter1d(turned, 2 * reach + 1) == 0


def _modelled(
    prepared: Prepared, coordinates: dict[str, Array], residual: Array, mask: Mask
) -> tuple[list[Curve], Noise]:
    """Curves and noise; the orders of a turn are looked for twice, the second time with the noise's level known."""
    rate = prepared.thinned_rate
    made = curves(prepared, coordinates, residual, mask, mask.astype(np.float64))
    noise = noise_of(residual, [np.hstack([c.base, c.own]) for c in made], mask, rate)
    if any(c.orders for c in made):
        made = curves(prepared, coordinates, residual, mask, noise.weight)
        noise = noise_of(residual, [np.hstack([c.base, c.own]) for c in made], mask, rate)
    return made, noise


def _corrected(made: list[Curve], p_values: Mapping[str, float]) -> dict[str, float]:
    """Return p-values that allow for the curves tried per coordinate and for the number of coordinates."""
    paid = [min(1.0, c.tried * p_values[c.name]) for c in made]
    return dict(zip([c.name for c in made], holm(paid), strict=True))


def _chosen(case: _Case, made: list[Curve], alone: Mapping[str, Outcome | None]) -> dict[str, tuple[int, float]]:
    """Name coordinates one at a time, each judged on what the earlier ones leave: name -> (rank, share beyond)."""
    named: dict[str, tuple[int, float]] = {}
    taken: list[int] = []
    for rank in range(1, MOST + 1):
        left = [c for c in made if c.name not in named]
        base = {c.name: sorted({*taken, *case.base[c.name]}) for c in left}
        p = _corrected(left, {c.name: case.bench.significance(base[c.name], case.own[c.name]) for c in left})
        good = []
        for curve in left:
            if p[curve.name] >= SIGNIFICANCE:
                continue
            found = alone[curve.name] if rank == 1 else case.bench.judge(base[curve.name], case.own[curve.name])
            if found is not None and not case.objection(found, p[curve.name]):
                good.append((curve, found))
        if not good:
            break
        best = max(found.share for _, found in good)
        alike = [(c, f) for c, f in good if f.share >= ALIKE * best]
        curve, found = min(alike, key=lambda pair: (pair[0].own.shape[1], -pair[1].share))
        # on blocks left out the gains need not add up to the whole
        named[curve.name] = (rank, min(found.share, 1.0 - sum(share for _, share in named.values())))
        taken = sorted({*taken, *case.base[curve.name], *case.own[curve.name]})
    return named


def _dependence(
    case: _Case, curve: Curve, outcome: Outcome, p: float, chosen: Mapping[str, tuple[int, float]]
) -> Dependence:
    rank, added = chosen.get(curve.name, (0, float("nan")))
    x, forward, backward = _drawn(case, curve)
    why = case.objection(outcome, p)
    return Dependence(
        coordinate=curve.name,
        unit=curve.unit,
        share=max(0.0, outcome.share),
        added=added,
        rank=rank,
        p_value=p,
        errors=outcome.gain / outcome.stderr if outcome.stderr > 0.0 else 0.0,
        significant=not why,
        why_not=why,
        values=curve.x,
        x=x,
        forward=forward,
        backward=backward,
        largest=_largest(curve, x, forward, backward),
        orders=curve.orders,
        spectrum=curve.spectrum,
    )


def _drawn(case: _Case, curve: Curve) -> tuple[Array, Array, Array]:
    """The curve over its coordinate for either direction, where the log has samples."""
    mask = case.mask
    columns = np.hstack([curve.base, curve.own])
    beta = np.linalg.lstsq(columns[mask], case.residual[mask], rcond=1e-6)[0]
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
            y = np.where((x >= there.min()) & (x <= there.max()), y, np.nan)
        out.append(y)
    return x, out[0], out[1]


def _largest(curve: Curve, x: Array, forward: Array, backward: Array) -> str:
    """Say where the curve is large."""
    both = np.nan_to_num(np.abs([forward, backward]))
    if curve.name == "direction":
        return f"{forward[1]:+.2g} forward, {backward[0]:+.2g} backward"
    if curve.orders and curve.spectrum is not None:
        seen = [(curve.spectrum[0, k - 1], k) for k in curve.orders]
        return f"in order {max(seen)[1]}"
    height = both.max(axis=0)
    strong = height >= LARGE * height.max()
    peak = int(np.argmax(height))
    first = peak - int(np.argmin(strong[: peak + 1][::-1])) + 1 if not strong[: peak + 1].all() else 0
    rest = strong[peak:]
    last = peak + int(np.argmin(rest)) - 1 if not rest.all() else len(x) - 1
    low, high = f"{x[first]:.3g}", f"{x[last]:.3g}"
    unit = f" {curve.unit}".rstrip()
    place = f"between {low} and {high}{unit}" if low != high else f"near {low}{unit}"
    if first == 0 and last == len(x) - 1:
        place = "everywhere alike"
    elif first == 0:
        place = f"below {high}{unit}"
    elif last == len(x) - 1:
        place = f"above {low}{unit}"
    ways = both[:, first : last + 1].max(axis=1)
    if np.isfinite(forward).any() and np.isfinite(backward).any() and ways.min() < 0.5 * ways.max():
        place += " moving forward" if ways[0] > ways[1] else " moving backward"
    return place
