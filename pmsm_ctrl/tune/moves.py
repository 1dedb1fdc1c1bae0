"""Profiled moves of the position loop: what the linear cascade promises, and what the sampled drive does.

The profiles are those of the design's own limits, as far as voltage and current let the drive follow (`tune.reach`),
and long enough to reach full speed. Dry friction is not linear: the promise is checked on the axis without it, and with
it the linear cascade takes the Coulomb torque as a load that changes its sign with the reference speed, which is larger
than the friction at the moments of rest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.simulate import Scenario, scenario, simulate
from pmsm_ctrl.simulate.motions import Limits
from pmsm_ctrl.tune.reach import RESERVE, largest, reachable
from pmsm_ctrl.tune.sampled import Cascade

__all__ = ["PEAK_TOLERANCE", "Move", "MovePair", "friction_load", "move_limits", "moves", "stable_speed"]

Array = NDArray[np.float64]

PEAK_TOLERANCE = 0.05  # share of the promised peak error, without dry friction
PROFILES = ("trapezoid", "s_curve")
LONGEST_RAMP = 0.5  # s; slower axes move below their full speed
REST = 0.3  # s after a move
PASSES = 2  # of the promise: about the reference, and about the motion that it gives
SPEEDS = 9  # from rest to full speed, at which the linear cascade is set up; between them its map is interpolated
WINDOW_COUNTS, WINDOW_SHARE = 10.0, 1e-4  # settled: within counts of the encoder, or a share of the move without one
ROUNDING = 1e-6  # rad; below this a peak is not compared


@dataclass(frozen=True)
class Move:
    """The position error of one move, in rad (m).

    Attributes
    ----------
    peak : float
        Largest error, reference less angle.
    overshoot : float
        Largest angle beyond the target; 0 when there is none.
    settling : float
        From the end of the profile until the error stays within the window, s; NaN when it does not.
    """

    peak: float
    overshoot: float
    settling: float


@dataclass(frozen=True)
class MovePair:
    """A move as promised and as simulated, without dry friction and with it.

    Attributes
    ----------
    profile : str
        "trapezoid" or "s_curve".
    distance, speed : float
        rad and rad/s (m, m/s).
    window : float
        rad (m).
    promised, simulated : Move
        With the axis' own friction.
    smooth_promised, smooth_simulated : Move
        Without dry friction, other nonlinear effects and sensor errors.
    limited : bool
        Whether the drive met its current or voltage limit, so that it is not linear.
    """

    profile: str
    distance: float
    speed: float
    window: float
    promised: Move
    simulated: Move
    smooth_promised: Move
    smooth_simulated: Move
    limited: bool

    @property
    def agrees(self) -> bool:
        """Whether the peak without dry friction is as promised."""
        wanted, found = self.smooth_promised.peak, self.smooth_simulated.peak
        return abs(found - wanted) <= PEAK_TOLERANCE * wanted + ROUNDING


def moves(cascade: Cascade, plant: Design, *, seed: int = 0) -> tuple[MovePair, ...]:
    """Return the moves that the design's limits allow, promised and simulated.

    Parameters
    ----------
    cascade : Cascade
        With its position loop; the promise is made for it.
    plant : Design
        The drive that is simulated.
    seed : int
        Of the measurement noise.
    """
    assert cascade.position is not None
    return tuple(_pair(cascade, plant, profile, seed) for profile in PROFILES)


def move_limits(cascade: Cascade, profile: str) -> Limits:
    """Return the limits of a profile that the drive can follow; its full speed is reached within `LONGEST_RAMP`.

    Parameters
    ----------
    cascade : Cascade
        With its position loop.
    profile : {"trapezoid", "s_curve"}
    """
    limits = Limits.of(cascade.design)
    limits = replace(limits, speed=stable_speed(cascade, min(limits.speed, LONGEST_RAMP * limits.acceleration)))
    return reachable(cascade.design, cascade.current, limits, jumps=profile == "trapezoid")


def stable_speed(cascade: Cascade, wanted: float) -> float:
    """Return the speed, at most the one that is wanted, that keeps a reserve to where the loops become unstable.

    Parameters
    ----------
    cascade : Cascade
    wanted : float
        rad/s.
    """

    def stable(speed: float) -> bool:
        poles = cascade.moving(speed, 0.0).system(("angle_noise",), ("i_q_ref",)).poles()
        return float(np.abs(poles).max()) < 1.0 + ROUNDING

    top = wanted / RESERVE
    if stable(top):
        return wanted
    below = 0.0
    for speed in np.linspace(0.0, top, SPEEDS)[1:].tolist():
        if not stable(speed):
            return RESERVE * largest(stable, below, speed)
        below = speed
    return wanted


def friction_load(design: Design) -> float:
    """Return the dry friction of an axis in motion, N m, from the effects' own terms."""
    p = float(design.motor.p or 0)
    acting = [b for b in bound_effects(design) if b[0].dry and not b[0].has_state and not b[0].bends_over]
    return sum(effect.standing(values, p=p) for effect, values in acting)


def smooth(plant: Design) -> Design:
    """Return a plant without sensor errors and with effects that are linear alone: viscous friction, a spring."""
    keep = tuple(
        entry
        for entry, (effect, values) in zip(plant.effects, bound_effects(plant), strict=True)
        if (effect.structure.splits_inertia and not _gap(effect, values)) or _viscous(effect, values)
    )
    return plant.replace_effects(keep).replace(sensor={"encoder_counts": 0, "current_noise": 0.0})


def _gap(effect: Effect, values: Mapping[str, float]) -> bool:
    mass = effect.structure.second_mass(values)
    return mass is not None and mass.gap > 0.0


def _viscous(effect: Effect, values: Mapping[str, float]) -> bool:
    """Whether a term is a torque proportional to the speed."""
    if effect.enters != "torque" or effect.has_state or effect.signals != ("omega",):
        return False
    one, ten, back = (effect.standing(values, omega=speed) for speed in (1.0, 10.0, -10.0))
    return math.isclose(ten, 10.0 * one, rel_tol=1e-9, abs_tol=1e-15) and math.isclose(back, -ten, abs_tol=1e-15)


def _pair(cascade: Cascade, plant: Design, profile: str, seed: int) -> MovePair:
    design = cascade.design
    off = design.compensation.model_copy(update={"gain": 0.0})
    design = design.model_copy(update={"compensation": off})
    limits = move_limits(cascade, profile)
    speed = min(limits.speed, LONGEST_RAMP * limits.acceleration)
    distance = 1.5 * speed * (speed / limits.acceleration + limits.acceleration / limits.jerk)
    built_up = {"jerk": limits.jerk} if profile == "s_curve" else {}
    motion = scenario(
        profile, design, distance=distance, speed=speed, acceleration=limits.acceleration, dwell=REST, cycles=1.0,
        **built_up,
    )  # fmt: skip
    window = WINDOW_COUNTS * plant.encoder_step or WINDOW_SHARE * distance
    bare = smooth(plant)
    runs, limited = [], False
    for truth in (plant, bare):
        run, met = _simulated(design, truth, motion, seed)
        runs.append(_judged(*run, motion, distance, window))
        limited = limited or (truth is bare and met)
    linear = Cascade.of(
        smooth(cascade.design), cascade.current, cascade.speed, cascade.position, at=cascade.model.point.speed
    )
    promises = [
        _judged(*_promised(model, motion, load), motion, distance, window)
        for model, load in ((cascade, friction_load(design)), (linear, 0.0))
    ]
    return MovePair(profile, distance, speed, window, promises[0], runs[0], promises[1], runs[1], limited)


def _promised(cascade: Cascade, motion: Scenario, load: float) -> tuple[Array, Array, Array]:
    """Return time, reference and angle of the linear cascade until the move back begins.

    Friction is a load of the reference's direction. The products of speed and currents, and the turn of the rotor under
    the held voltage, are linear about the reference's speed and the current that it takes, then about the motion that
    this gives.
    """
    assert cascade.position is not None
    design, (_, back, _) = cascade.design, motion.segments[1]
    t: Array = cascade.period * np.arange(math.ceil(back / cascade.period), dtype=np.float64)
    reference, speed, acceleration = motion.inputs(t)[:, :3].T
    inertia = cascade.position.acceleration_feedforward * (design.assumed.J or design.J) / design.K_t_assumed
    opposing = load * np.sign(speed)
    driven = np.column_stack([reference, speed, inertia * acceleration, opposing])
    plant = cascade.truth
    current = (plant.J * acceleration + cascade.model.point.friction_slope * speed + opposing) / plant.K_t
    currents = np.column_stack([current, np.zeros_like(current)])
    for _ in range(PASSES):
        theta, speed, *both = _along(cascade, driven, speed, currents).T
        currents = np.column_stack(both)
    return t, reference, theta


def _along(cascade: Cascade, driven: Array, speed: Array, currents: Array) -> Array:
    """Return angle, speed, i_q and i_d of a cascade whose map goes with speed and currents.

    It is affine in the currents, and interpolated between some speeds.
    """
    names = ("theta_ref", "omega_ref", "i_q_add", "T_load", "omega_point")
    slowest, top, most = float(speed.min()), float(speed.max()), np.abs(currents).max()
    systems = [
        cascade.moving(at, i_q, i_d).system(names, ("theta", "omega", "i_q", "i_d"))
        for at in np.linspace(slowest, top, SPEEDS)
        for i_q, i_d in ((0.0, 0.0), (most, 0.0), (0.0, most))
    ]
    A, B = (np.array([getattr(system, name) for system in systems]) for name in "AB")
    place = (speed - slowest) / (top - slowest) * (SPEEDS - 1)
    lower = np.minimum(place.astype(np.intp), SPEEDS - 2)
    faster, more = (place - lower)[:, None], currents / most
    by_current = np.column_stack([1.0 - more.sum(axis=1), more])
    shares = np.column_stack([(1.0 - faster) * by_current, faster * by_current])
    return _carried(A, B, systems[0].C, np.column_stack([driven, speed]), 3 * lower, shares)


def _carried(A: Array, B: Array, C: Array, driven: Array, first: NDArray[np.intp], shares: Array) -> Array:
    """Return the outputs of a system that is the weighted sum of some systems in a row, from rest."""
    count, n, pushed = shares.shape[1], A.shape[1], np.zeros((len(driven), A.shape[1]))
    for k in np.unique(first):
        seen = first == k
        for j in range(count):
            pushed[seen] += shares[seen, j, None] * (driven[seen] @ B[k + j].T)
    stacked = [A[k : k + count].reshape(count * n, n) for k in range(len(A) - count + 1)]
    state, out = np.zeros(n), np.empty((len(driven), len(C)))
    for k, (at, share, push) in enumerate(zip(first.tolist(), shares, pushed, strict=True)):
        out[k] = C @ state
        state = share @ (stacked[at] @ state).reshape(count, n) + push
    return out


def _simulated(design: Design, plant: Design, motion: Scenario, seed: int) -> tuple[tuple[Array, Array, Array], bool]:
    """Return time, reference and true angle, and whether a limit of the drive was met."""
    sampled = {"log_divider": design.drive.speed_divider}
    log = simulate(
        design.replace(sensor=sampled), motion, truth=plant.replace(sensor=sampled), seed=seed, keep_truth=True
    )
    voltage = float(np.hypot(log["u_d"], log["u_q"]).max())
    current = float(np.abs(log["i_q_ref"]).max())
    met = voltage >= 0.999 * plant.drive.u_dc / math.sqrt(3.0) or current >= design.drive.i_max
    return (log.t, log["theta_ref"], log["theta_true"]), met


def _judged(t: Array, reference: Array, theta: Array, motion: Scenario, distance: float, window: float) -> Move:
    """Evaluate the move forth: its error until the move back begins."""
    (_, _, end), (_, back, _) = motion.segments
    seen = t < back - 1e-9
    error, after = (reference - theta)[seen], t[seen] >= end - 1e-9
    outside = np.flatnonzero(after & (np.abs(error) > window))
    settled = outside.size == 0 or outside[-1] + 1 < error.size
    last = float(t[outside[-1] + 1]) - end if outside.size and settled else 0.0
    return Move(
        peak=float(np.abs(error).max()),
        overshoot=max(float(theta[seen].max()) - distance, 0.0),
        settling=last if settled else math.nan,
    )
