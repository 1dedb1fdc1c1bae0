"""The reference experiment: a speed staircase, averaged torque, and a straight line per direction.

Source: the reference paper on friction identification in PMSM; the line is F_c + F_v omega.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, NextCommand, RequestError, require_kind
from pmsm_ctrl.identify import notices as words
from pmsm_ctrl.identify import policy
from pmsm_ctrl.identify.plateaus import Plateau, find_plateaus
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.least_squares import t_quantile
from pmsm_ctrl.regression.measurement_correction import left_in
from pmsm_ctrl.regression.notices import ONE_DIRECTION
from pmsm_ctrl.result import Estimate, Result, jsonable
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["Level", "Line", "SweepResult", "evaluate_sweep", "simulated_records", "sweep"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Level:
    """Mean over the repeats of one reference speed: rad/s and N m (m/s and N), and the standard error of the torque."""

    omega: float
    torque: float
    stderr: float
    dof: float
    repeats: int


@dataclass(frozen=True)
class Line:
    """Straight line F_c + F_v omega through one direction or, symmetrically, through both.

    Attributes
    ----------
    F_c, F_v : Estimate
        The standard errors come from the scatter about the line. Where the levels lie on no line, a curve is missing,
        and scatter says too little of what it does: they are then at least half of what lines through the lower and
        through the upper half of the speeds differ by.
    dof : float
        Degrees of freedom of the standard errors.
    misfit : float
        That scatter over the one expected from the plateaus' own errors; 1 is good.
    p_value : float
        The probability of that scatter if a line is right.
    """

    F_c: Estimate
    F_v: Estimate
    dof: float
    misfit: float
    p_value: float

    @property
    def rejected(self) -> bool:
        """Whether a line is not what the levels lie on."""
        return self.p_value < policy.MISFIT_P and self.misfit > policy.MISFIT_RATIO

    def interval(self, symbol: str, coverage: float = 0.95) -> tuple[float, float]:
        """Return the two-sided interval of ``F_c`` or ``F_v`` by Student's t."""
        estimate = self.F_c if symbol == "F_c" else self.F_v
        half = t_quantile(coverage, self.dof) * estimate.stderr
        return estimate.value - half, estimate.value + half

    def torque(self, omega: Array) -> Array:
        """Return the line's torque at speeds of shape (n,)."""
        return self.F_c.value * np.sign(omega) + self.F_v.value * omega


@dataclass(frozen=True, eq=False)
class SweepResult(Result):
    """Friction from a speed staircase.

    Attributes
    ----------
    design : Design
        The given design with the friction of the joint fit.
    lines : dict of str to Line
        ``both_directions``: one F_c and one F_v for both; ``positive`` and ``negative`` where a direction has three
        levels, both values positive for friction that opposes motion.
    rms_percent : float
        rms(measured - joint line) / rms(measured) over the levels, in percent: the paper's error.
    levels : tuple of Level
    plateaus : tuple of Plateau
        All of them, untrusted ones included.
    motion : {"rotary", "linear"}
    notices : tuple of Notice
    """

    design: Design
    lines: dict[str, Line]
    rms_percent: float
    levels: tuple[Level, ...]
    plateaus: tuple[Plateau, ...]
    motion: str = "rotary"
    notices: tuple[Notice, ...] = ()

    @property
    def joint(self) -> Line:
        """The line through both directions."""
        return self.lines["both_directions"]

    @property
    def estimates(self) -> dict[str, Estimate]:
        """F_c and F_v of the joint fit."""
        return {"F_c": self.joint.F_c, "F_v": self.joint.F_v}

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        fits = {
            name: {
                "F_c": line.F_c, "F_v": line.F_v, "F_c_interval_95": line.interval("F_c"),
                "F_v_interval_95": line.interval("F_v"), "degrees_of_freedom": line.dof,
                "misfit": line.misfit, "misfit_p_value": line.p_value,
            }
            for name, line in self.lines.items()
        }  # fmt: skip
        return jsonable({
            "schema": "pmsm-ctrl/sweep/1",
            **self.doubts(),
            "fits": fits,
            "rms_percent": self.rms_percent,
            "levels": [vars(level) for level in self.levels],
        })  # fmt: skip


def evaluate_sweep(design: Design, logs: Log | Sequence[Log]) -> SweepResult:
    """Evaluate one or more records of a speed staircase.

    Parameters
    ----------
    design : Design
        ``design.K_t_assumed`` turns i_q into torque.
    logs : Log or sequence of Log
        Repeats of the staircase, each with ``omega_ref``; equal levels are averaged.

    Returns
    -------
    SweepResult

    Raises
    ------
    RequestError
        When no log is given.
    LogError
        When fewer than two speeds settle, so that F_c and F_v cannot be told apart.
    """
    records = [logs] if isinstance(logs, Log) else list(logs)
    if not records:
        raise RequestError("evaluate_sweep: no log given; at least one was expected")
    motion = records[0].motion
    plateaus = tuple(p for record in records for p in find_plateaus(design, record))
    levels = _average_levels(plateaus)
    if len({round(abs(level.omega), 9) for level in levels}) < 2 or len(levels) < 3:
        message = f"{len(levels)} settled speed level(s); F_c and F_v need at least three, of two different speeds"
        raise LogError(message, next_command=NextCommand.IDENTIFY)
    free = joint = _line(levels, motion)
    held: tuple[str, ...] = ()
    while below := tuple(name for name in ("F_c", "F_v") if getattr(joint, name).value < 0.0):
        held += below  # friction below zero is none, and the other one is fitted beside that
        joint = _line(levels, motion, held)
    lines = {"both_directions": joint}
    for name, sign in (("positive", 1.0), ("negative", -1.0)):
        side = [level for level in levels if sign * level.omega > 0]
        if len(side) >= 3:
            lines[name] = _line(side, motion)
    torque = np.array([level.torque for level in levels])
    residual = torque - joint.torque(np.array([level.omega for level in levels]))
    error = float(np.sqrt(np.mean(residual**2) / np.mean(torque**2)))
    found = design
    for effect, symbol, estimate in (("coulomb", "F_c", joint.F_c), ("viscous", "F_v", joint.F_v)):
        known = {symbol: estimate.stderr} if np.isfinite(estimate.stderr) else {}
        found = found.with_effect(effect, {symbol: estimate.value}, known)
    negative = (
        words.NEGATIVE(symbol=name, value=getattr(free, name).value, unit=getattr(free, name).unit) for name in held
    )
    notices = (*_unsettled(plateaus, motion), *negative, *_doubts(lines, error), *left_in(design, records))
    return SweepResult(found, lines, 100.0 * error, levels, plateaus, motion, notices)


def sweep(
    design: Design,
    *,
    truth: Design | None = None,
    repeats: int = 3,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> SweepResult:
    """Run the reference experiment: simulate the staircase `repeats` times and evaluate it.

    Parameters
    ----------
    design : Design
        What the controller and the evaluation believe.
    truth : Design, optional
        The plant; `design` itself when left out.
    repeats, seed : int
        Number of records, each with noise of its own.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    SweepResult

    Raises
    ------
    RequestError
        When `repeats` is below 1.
    """
    return evaluate_sweep(design, simulated_records(design, truth, repeats, seed, progress))


def simulated_records(
    design: Design,
    truth: Design | None = None,
    repeats: int = 3,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> list[Log]:
    """Simulate the staircase `repeats` times, with independent noise per record; the arguments are those of `sweep`.

    Raises
    ------
    RequestError
        When `repeats` is below 1.
    """
    require_kind(design, Design, "design")
    from pmsm_ctrl.simulate import simulate

    if repeats < 1:
        raise RequestError(f"repeats = {repeats}: at least 1 is needed")
    seeds = np.random.SeedSequence(seed).generate_state(repeats)
    records = []
    for k, each in enumerate(seeds.tolist()):
        records.append(simulate(design, "sweep", truth=truth, seed=each))
        if progress is not None:
            progress((k + 1) / repeats)
    return records


def _average_levels(plateaus: Sequence[Plateau]) -> tuple[Level, ...]:
    groups: dict[float, list[Plateau]] = {}
    for plateau in plateaus:
        if plateau.trusted:
            groups.setdefault(float(f"{plateau.omega_ref:.6g}"), []).append(plateau)
    levels = []
    for _, group in sorted(groups.items()):
        m = len(group)
        variances = np.array([plateau.stderr**2 for plateau in group])
        total = float(np.sum(variances))
        # Welch and Satterthwaite: degrees of freedom of a sum of independent variances
        dof = total**2 / float(np.sum(variances**2 / [p.dof for p in group])) if total > 0 else float("inf")
        omega, torque = (float(np.mean([getattr(p, name) for p in group])) for name in ("omega", "torque"))
        levels.append(Level(omega, torque, total**0.5 / m, dof, m))
    return tuple(levels)


def _line(levels: Sequence[Level], motion: str, held: Sequence[str] = ()) -> Line:
    """Return the line, with standard errors that allow for a curve where a line is not what the levels lie on."""
    line = _fit(levels, motion, held)
    middle = float(np.median([abs(level.omega) for level in levels]))
    halves = [[one for one in levels if (abs(one.omega) > middle) is upper] for upper in (False, True)]
    fewest = 3 - len(held)
    if not line.rejected or any(len({round(abs(one.omega), 9) for one in half}) < fewest for half in halves):
        return line
    low, high = (_fit(half, motion, held) for half in halves)

    def widened(name: str) -> Estimate:
        own: Estimate = getattr(line, name)
        apart = getattr(high, name).value - getattr(low, name).value
        return replace(own, stderr=max(own.stderr, 0.5 * abs(apart))) if np.isfinite(own.stderr) else own

    return replace(line, F_c=widened("F_c"), F_v=widened("F_v"))


def _fit(levels: Sequence[Level], motion: str, held: Sequence[str] = ()) -> Line:
    """Least squares with equal weights; its errors come from the scatter about the line. What is held is zero.

    Weighting by the plateaus' own errors would weigh by noise: those are known to a few per cent at best, and the
    levels last equally long.
    """
    from scipy.special import fdtrc

    omega = np.array([level.omega for level in levels])
    torque = np.array([level.torque for level in levels])
    free = [k for k, name in enumerate(("F_c", "F_v")) if name not in held]
    matrix = np.column_stack([np.sign(omega), omega])[:, free]
    inverse = np.linalg.inv(matrix.T @ matrix)
    values, stderr = np.zeros(2), np.full(2, np.nan)
    values[free] = inverse @ (matrix.T @ torque)
    residual = torque - matrix @ values[free]
    dof = len(levels) - len(free)
    variance = float(residual @ residual) / dof
    stderr[free] = np.sqrt(variance * np.diag(inverse))
    expected = float(np.mean([level.stderr**2 for level in levels]))
    ratio = variance / expected if expected > 0 else float("nan")
    pooled = sum(level.dof for level in levels)
    return Line(
        Estimate(float(values[0]), axis_unit("N m", motion), float(stderr[0])),
        Estimate(float(values[1]), axis_unit("N m s/rad", motion), float(stderr[1])),
        dof=float(dof),
        misfit=float(np.sqrt(ratio)),
        p_value=float(fdtrc(dof, min(pooled, 1e9), ratio)) if expected > 0 else float("nan"),
    )


def _unsettled(plateaus: Sequence[Plateau], motion: str) -> list[Notice]:
    speeds = [plateau.omega_ref for plateau in plateaus if not plateau.trusted]
    if not speeds:
        return []
    shown = ", ".join(f"{value:g}" for value in speeds[:6]) + (", ..." if len(speeds) > 6 else "")
    unit = axis_unit("rad/s", motion)
    return [words.UNSETTLED(left_out=len(speeds), count=len(plateaus), speeds=shown, unit=unit)]


def _doubts(lines: dict[str, Line], error: float) -> list[Notice]:
    doubts, joint = [], lines["both_directions"]
    if joint.rejected and error > policy.MISFIT_SHARE:
        doubts.append(words.MISFIT(ratio=joint.misfit, percent=100.0 * error))
    if len(lines) < 3:
        return [*doubts, ONE_DIRECTION()]
    positive, negative = lines["positive"], lines["negative"]
    for symbol in ("F_c", "F_v"):
        a, b = getattr(positive, symbol), getattr(negative, symbol)
        quantile = t_quantile(policy.DIRECTION_CONFIDENCE, min(positive.dof, negative.dof))
        apart, mean = abs(a.value - b.value), 0.5 * abs(a.value + b.value)
        if apart > quantile * float(np.hypot(a.stderr, b.stderr)) and apart > policy.DIRECTION_SHARE * mean:
            doubts.append(words.DIRECTION_DEPENDENT(symbol=symbol, positive=a.value, negative=b.value, unit=a.unit))
    return doubts
