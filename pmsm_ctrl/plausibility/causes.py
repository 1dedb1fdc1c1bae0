"""One cause behind several ratios: what a wrong sign, factor or number does to J, R, psi_f and the cross-coupling.

A channel that is `s` times what it should be scales each coefficient by a power of `s`. The log's ratios to the design
scatter by the tolerances of a sound log; the cause is the one that, with its best factor, brings all of them inside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from pmsm_ctrl.design import Design
from pmsm_ctrl.plausibility.policy import POLICY
from pmsm_ctrl.plausibility.relations import Ratio

__all__ = ["Cause", "Finding", "likeliest", "strange"]


class Cause(Enum):
    """What is off by a factor."""

    CURRENT = "current"
    TORQUE = "torque"
    VOLTAGE = "voltage"
    MOTION = "motion"
    TIME = "time"
    POLE_PAIRS = "pole pairs"
    INERTIA = "J"
    FLUX = "psi_f"
    RESISTANCE = "R"
    CROSS = "X"


# Powers of the cause's factor in the ratio of each coefficient to the design's number. A torque that is computed from
# currents grows with the flux and the pole pairs that the design states; the inertia is then off as well.
_POWERS: dict[Cause, dict[str, int]] = {
    Cause.CURRENT: {"J": 1, "R": -1, "X": -1},
    Cause.TORQUE: {"J": 1},
    Cause.VOLTAGE: {"R": 1, "psi_f": 1, "X": 1},
    Cause.MOTION: {"J": -1, "psi_f": -1, "X": -1},
    Cause.TIME: {"J": 2, "psi_f": 1, "X": 1},
    Cause.POLE_PAIRS: {"J": -1, "psi_f": 1, "X": 1},
    Cause.INERTIA: {"J": 1},
    Cause.FLUX: {"J": -1, "psi_f": 1},
    Cause.RESISTANCE: {"R": 1},
    Cause.CROSS: {"X": 1},
}
# A dead time is as well a resistance of several times the design's: that alone is for the diagnosis to tell.
_IMITATED = ("R",)
_SIGNED = (Cause.CURRENT, Cause.TORQUE, Cause.VOLTAGE, Cause.MOTION)


@dataclass(frozen=True)
class Finding:
    """A cause, its factor, and how badly the ratios fit without and with it.

    Attributes
    ----------
    cause : Cause
    factor : float
        What the channel or number is times what it should be; negative for a wrong sign.
    before, after : float
        Sums of squares of the ratios' deviations, in usual spreads.
    """

    cause: Cause
    factor: float
    before: float
    after: float


def _deviations(ratios: Mapping[str, Ratio]) -> dict[str, tuple[float, float, int]]:
    """Return log ratio, its standard error and its sign, of every ratio that says something."""
    out = {}
    for name, ratio in ratios.items():
        size = abs(ratio.value)
        if size <= POLICY.least_t * ratio.stderr or size == 0.0:
            continue
        out[name] = math.log(size), ratio.stderr / size, 1 if ratio.value > 0 else -1
    return out


def strange(ratios: Mapping[str, Ratio]) -> list[str]:
    """Return the names of the ratios that no sound log has: negative, or far beyond the tolerance."""
    return [
        name
        for name, (deviation, stderr, sign) in _deviations(ratios).items()
        if sign < 0
        or (0.0 if name in _IMITATED else deviation) > (reach := math.log(POLICY.limit[name]) + 2.0 * stderr)
        or deviation < -reach
    ]


def likeliest(design: Design, ratios: Mapping[str, Ratio], from_current: bool) -> tuple[Finding, ...]:
    """Return the causes that explain the ratios, best first; empty where the ratios are those of a sound log.

    Parameters
    ----------
    design : Design
    ratios : mapping of str to Ratio
    from_current : bool
        Whether the torque was computed from the currents.
    """
    seen = _deviations(ratios)
    before = _misfit(seen, {}, 1.0)
    if set(seen) == {"J"} and strange(ratios):
        return (_of_inertia(ratios["J"].value, from_current, before),)
    if not strange(ratios) and not _together(design, seen, before):
        return ()
    found = []
    for cause, powers in _POWERS.items():
        if cause in (Cause.POLE_PAIRS, Cause.FLUX) and not from_current:
            powers = {name: power for name, power in powers.items() if name != "J"}
        if cause is (Cause.TORQUE if from_current else Cause.CURRENT) or not set(powers) & set(seen):
            continue
        factor = _factor(design, cause, powers, seen)
        found += [
            Finding(cause, sign * factor, before, _misfit(seen, powers, sign * factor))
            for sign in ((1, -1) if cause in _SIGNED else (1,))
        ]
    best = min((finding.after for finding in found), default=math.inf)
    kept = [f for f in found if f.after < best + POLICY.as_good and f.after < 0.5 * f.before]
    # what involves more of the coefficients says more: a parameter of its own comes last
    kept.sort(key=lambda f: f.after + POLICY.alone * (len(_POWERS[f.cause]) == 1))
    return tuple(kept[:2])


def _of_inertia(ratio: float, from_current: bool, before: float) -> Finding:
    """Return what an inertia alone tells: a wrong sign, or a factor of which nobody knows whose it is."""
    cause = (Cause.CURRENT if from_current else Cause.TORQUE) if ratio < 0.0 else Cause.INERTIA
    return Finding(cause, ratio, before, 0.0)


def _together(design: Design, seen: Mapping[str, tuple[float, float, int]], before: float) -> bool:
    """Whether another whole number of pole pairs explains what no ratio shows alone.

    A flux that a hot or damaged magnet has lost makes the same of voltage and torque as fewer pole pairs, up to the
    cross-coupling, whose inductance is known least: where that does not decide, it is a wrong parameter.
    """
    p = design.motor.p
    if p is None or "psi_f" not in seen or "X" not in seen:
        return False
    powers = _POWERS[Cause.POLE_PAIRS]
    factor = _factor(design, Cause.POLE_PAIRS, powers, seen)
    if -math.log(POLICY.limit["psi_f"]) < seen["psi_f"][0] < 0.0:
        lost = _POWERS[Cause.FLUX]
        before = min(before, _misfit(seen, lost, _factor(design, Cause.FLUX, lost, seen)))
    return abs(factor - 1.0) > 0.5 / p and before - _misfit(seen, powers, factor) > POLICY.together


def _factor(
    design: Design, cause: Cause, powers: Mapping[str, int], seen: Mapping[str, tuple[float, float, int]]
) -> float:
    weights = {name: 1.0 / (POLICY.spread[name] ** 2 + seen[name][1] ** 2) for name in powers if name in seen}
    above = sum(weights[name] * powers[name] * seen[name][0] for name in weights)
    factor = math.exp(above / sum(weights[name] * powers[name] ** 2 for name in weights))
    if cause is Cause.POLE_PAIRS and design.motor.p is not None:
        return max(1, round(design.motor.p * factor)) / design.motor.p
    return factor


def _misfit(seen: Mapping[str, tuple[float, float, int]], powers: Mapping[str, int], factor: float) -> float:
    total = 0.0
    for name, (deviation, stderr, sign) in seen.items():
        power = powers.get(name, 0)
        expected = -1 if factor < 0 and power % 2 else 1
        wrong = POLICY.wrong_sign if sign != expected else 0.0
        total += (deviation - power * math.log(abs(factor))) ** 2 / (POLICY.spread[name] ** 2 + stderr**2) + wrong
    return total
