"""Which effects could be missing, with the grid over which each one's nonlinear parameters are searched."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.orders import order_spectrum
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import Group, UnavailableError, candidate_group, missing_signals
from pmsm_ctrl.regression.motion import spring_response

__all__ = ["REPEATED", "Candidate", "candidates_for"]

Array = NDArray[np.float64]

# Effects of which an axis can have several, told apart by their order.
REPEATED = ("cogging", "torque_ripple")
ELECTRICAL_ORDERS = (1.0, 2.0, 6.0, 12.0)
# Mechanical orders that are looked at for cogging, and how many of them are tried.
HIGHEST, TRIED = 240, 6
# Lowest frequency of a load on its spring, Hz, and the dampings of those that ring.
LOWEST, RINGING = 10.0, (0.01, 0.03, 0.1)


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect that might be missing.

    Attributes
    ----------
    grid : tuple of shapes (values of the nonlinear parameters)
    searched : int
        Independent shapes tried, paid for in the significance.
    why_not : str
        Why it cannot be tried on this log; the grid is empty then.
    """

    effect: Effect
    grid: tuple[Mapping[str, float], ...]
    searched: int = 1
    why_not: str = ""

    def groups(self, record: Record) -> Iterator[Group]:
        """Columns for every shape of the grid."""
        for shape in self.grid:
            try:
                yield candidate_group(record, self.effect, shape)
            except UnavailableError:
                return

    @property
    def free(self) -> int:
        """Number of nonlinear parameters that the search settles."""
        return sum(len({s[name] for s in self.grid}) > 1 for name in (self.grid[0] if self.grid else {}))


def candidates_for(
    record: Record, design: Design, effects: Mapping[str, Effect], residual: Array, present: Iterable[str]
) -> list[Candidate]:
    """Return every candidate that is not in the model yet. `residual` is that of the torque, shape (m,)."""
    out = []
    present = set(present)
    sprung = any(effects[name].structure == "transmission" for name in present if name in effects)
    for effect in effects.values():
        if effect.id in present and effect.id not in REPEATED:
            continue
        if sprung and effect.structure == "transmission":
            continue  # an axis has one: `exchange` tries the other in its place
        why = missing_signals(record, effect)
        if why:
            out.append(Candidate(effect, (), 1, why))
            continue
        if effect.id == "cogging":
            out.append(_cogging(record, effect, residual))
            continue
        if effect.id == "compliance":
            out.append(_compliance(record, effect, residual))
            continue
        grid = tuple(_grid(record, effect))
        out.append(Candidate(effect, grid, max(1, len(grid))))
    return out


def _cogging(record: Record, effect: Effect, residual: Array) -> Candidate:
    weight = record.weight[0]
    _, score = order_spectrum(record.prepared, residual, record.mask, weight, HIGHEST, friction=False)
    best = np.argsort(score)[::-1][:TRIED]
    # the first mechanical order is called unbalance
    grid = tuple({"order": float(k + 1)} for k in best if k > 0 and score[k] > 0.0)
    if not grid:
        return Candidate(effect, (), 1, "no turn is slow enough to see an order above the first")
    return Candidate(effect, grid, max(int(np.sum(score > 0.0)), 1))


def _compliance(record: Record, effect: Effect, residual: Array) -> Candidate:
    """Springs over a coarse grid, and the best of a fine one, in which one that is hardly damped can't be missed."""
    ringing = list(_ringing(record, residual))
    best = (max(one for one in ringing if one[2] == zeta) for zeta in RINGING)
    grid = (*_spring(record), *(one[1:] for one in best))
    shapes = tuple({"w_a": w, "zeta": zeta} for w, zeta in grid)
    return Candidate(effect, shapes, len(grid) + len(ringing))


def _ringing(record: Record, residual: Array) -> Iterator[tuple[float, float, float]]:
    """Gain of the torque's sum of squares by springs a fraction of their resonance's width apart, w_a and zeta.

    By Parseval over the spectra, so that each costs one product. One that would need a negative load gains nothing.
    """
    square = (record.weight[0] * record.mask) ** 2
    alpha = record.shaped(record.signals["alpha"])
    f = np.fft.rfftfreq(len(alpha), 1.0 / record.rate)
    band = (f > 0.0) & (f < record.prepared.cutoff)
    s = 2j * np.pi * f[band]
    motion, wanted, own = (np.fft.rfft(x)[band] for x in (alpha, square * residual, square * alpha))
    scale = 2.0 / len(alpha)
    size = max(float(square @ alpha**2), 1e-300)
    level = scale * float(square.mean())
    top = max(1.2 * record.prepared.cutoff, LOWEST)
    for zeta in RINGING:
        for w in 2.0 * np.pi * np.geomspace(LOWEST, top, int(np.log(top / LOWEST) / (1.2 * zeta)) + 1):
            above, below = spring_response(float(w), zeta)
            column = np.polyval(above, s) / np.polyval(below, s) * motion
            along = scale * float(np.vdot(wanted, column).real)
            beside = scale * float(np.vdot(own, column).real)
            left = level * float(np.vdot(column, column).real) - beside**2 / size
            yield (along**2 / left if along > 0.0 and left > 0.0 else 0.0), float(w), zeta


def _grid(record: Record, effect: Effect) -> Iterator[dict[str, float]]:
    own = _SHAPES.get(effect.id)
    if own is not None:
        yield from own(record)
        return
    axes = []
    for p in effect.searched:
        values = [p.start * f for f in (0.25, 0.5, 1.0, 2.0, 4.0)] if p.start else [p.start]
        axes.append(sorted({float(min(max(v, p.lower), p.upper)) for v in values}))
    for combination in itertools.product(*axes):
        yield dict(zip((p.symbol for p in effect.searched), combination, strict=True))


def _top(record: Record) -> float:
    return float(np.quantile(np.abs(record.signals["omega"]), 0.99))


def _stribeck(record: Record) -> Iterator[dict[str, float]]:
    for w_s in np.geomspace(0.003, 0.4, 9) * _top(record):
        for delta in (1.0, 2.0):
            yield {"w_s": float(w_s), "delta": delta}


def _power(record: Record) -> Iterator[dict[str, float]]:
    for n in (0.33, 0.5, 2.0 / 3.0, 0.8, 1.3, 1.6, 2.0, 2.5, 3.0):
        yield {"n": n}


def _thermal(record: Record) -> Iterator[dict[str, float]]:
    for share in (0.1, 0.3, 1.0, 3.0):
        yield {"tau": share * record.duration}


def _ripple(record: Record) -> Iterator[dict[str, float]]:
    for order in ELECTRICAL_ORDERS:
        yield {"order": order}


def _spring(record: Record) -> Iterator[tuple[float, float]]:
    for k, f in enumerate(np.geomspace(LOWEST, 250.0, 15)):
        for zeta in (0.02, 0.15) if k % 2 == 0 else (0.02,):
            yield 2.0 * np.pi * float(f), zeta


def _gap(record: Record) -> Iterator[dict[str, float]]:
    # A load that bounces off its flanks can't be followed: small errors of the motion grow with each bounce. One
    # that stays where it struck explains most of the same torque, so contacts are searched as well damped ones.
    for gap in np.geomspace(0.002, 0.08, 11):
        for f in (80.0, 300.0):
            for zeta in (0.4, 1.2):
                yield {"gap": float(gap), "w_a": 2.0 * np.pi * f, "zeta": zeta}


def _bristle(record: Record) -> Iterator[dict[str, float]]:
    scale = 1.0 if not record.linear else float(np.ptp(record.signals["theta"])) / 100.0
    for z_s in np.geomspace(2e-4, 0.2, 10) * scale:
        yield {"z_s": float(z_s), "z_b": 0.5, "tau_z": 1e-3}


def _dead(record: Record) -> Iterator[dict[str, float]]:
    s = record.signals
    level = float(np.quantile(np.hypot(s["i_d"], s["i_q"]), 0.9))
    for share in (0.1, 0.3, 1.0, 2.0):
        yield {"i_0": max(share * level, 1e-5)}


def _frame(record: Record) -> Iterator[dict[str, float]]:
    yield {"frame": 1.0}
    if "u_d" in record.channels:
        yield {"frame": 0.0}


_SHAPES = {
    "encoder_eccentricity": _frame,
    "stribeck": _stribeck,
    "viscous_power": _power,
    "thermal_drift": _thermal,
    "torque_ripple": _ripple,
    "backlash": _gap,
    "presliding": _bristle,
    "dead_time": _dead,
}
