"""sweep: the reference experiment. A speed staircase, averaged torque, and a straight line per direction.

Source: the reference paper on friction identification in PMSM; the line is F_c + F_v omega.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, NextCommand, RequestError
from pmsm_ctrl.identify.plateaus import Plateau, find_plateaus
from pmsm_ctrl.identify.regression import t_quantile
from pmsm_ctrl.log import Log
from pmsm_ctrl.result import Estimate, Result, Section, jsonable
from pmsm_ctrl.units import axis_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Level", "Line", "SweepResult", "evaluate_sweep", "sweep"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Level:
    """Mean over the repeats of one reference speed."""

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
    dof : float
        Degrees of freedom of the standard errors, which come from the scatter about the line.
    misfit : float
        Scatter about the line over the scatter expected from the plateaus' own errors (1 is good).
    p_value : float
        Chance of such a misfit or a larger one if a line is right.
    """

    F_c: Estimate
    F_v: Estimate
    dof: float
    misfit: float
    p_value: float

    def interval(self, symbol: str, coverage: float = 0.95) -> tuple[float, float]:
        """Return the two-sided interval of ``F_c`` or ``F_v`` by Student's t."""
        estimate = self.F_c if symbol == "F_c" else self.F_v
        half = t_quantile(coverage, self.dof) * estimate.stderr
        return estimate.value - half, estimate.value + half


@dataclass(frozen=True, eq=False)
class SweepResult(Result):
    """Friction from a speed staircase.

    Attributes
    ----------
    design : Design
        The given design with the friction of the joint fit.
    joint : Line
        One F_c and one F_v for both directions.
    positive, negative : Line or None
        One line per direction; both values positive for friction that opposes motion.
    rms_percent : float
        rms(measured - joint line) / rms(measured) over the levels, in percent: the paper's error.
    levels : tuple of Level
    plateaus : tuple of Plateau
        All of them, untrusted ones included.
    """

    design: Design
    joint: Line
    positive: Line | None
    negative: Line | None
    rms_percent: float
    levels: tuple[Level, ...]
    plateaus: tuple[Plateau, ...]
    motion: str = "rotary"
    reasons: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers."""
        return self.reasons

    @property
    def estimates(self) -> dict[str, Estimate]:
        """F_c and F_v of the joint fit."""
        return {"F_c": self.joint.F_c, "F_v": self.joint.F_v}

    def _lines(self) -> list[tuple[str, Line]]:
        named = (("both directions", self.joint), ("positive", self.positive), ("negative", self.negative))
        return [(name, line) for name, line in named if line is not None]

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for name, line in self._lines():
            for symbol, estimate in (("F_c", line.F_c), ("F_v", line.F_v)):
                low, high = line.interval(symbol)
                text = (f"{estimate.value:.5g}", f"{estimate.stderr:.2g}", estimate.unit, f"{low:.5g} to {high:.5g}")
                rows.append((name, symbol, *text))
        return rows

    def summary(self) -> str:
        """Return the result as text, trust first."""
        lines = [f"speed sweep of {self.design.name}: {len(self.levels)} levels, {len(self.plateaus)} plateaus"]
        lines += [f"  warning: {text}" for text in self.warnings] or ["  no reason to doubt the numbers was found"]
        lines += [
            f"  {name:<16} {symbol} = {value:>10} +- {stderr:<8} {unit:<10} 95 % {interval}"
            for name, symbol, value, stderr, unit, interval in self._rows()
        ]
        lines.append(f"  model-to-measurement error {self.rms_percent:.2f} % rms")
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw torque against speed with the joint line, and what remains."""
        from matplotlib.figure import Figure

        from pmsm_ctrl.identify.figures import BLACK, BLUE, VERMILION

        torque_unit, speed_unit = axis_unit("N m", self.motion), axis_unit("rad/s", self.motion)
        omega = np.array([level.omega for level in self.levels])
        torque = np.array([level.torque for level in self.levels])
        error = np.array([t_quantile(0.95, level.dof) * level.stderr for level in self.levels])
        model = self.joint.F_c.value * np.sign(omega) + self.joint.F_v.value * omega
        figure = Figure(figsize=(8.0, 5.0), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        upper.errorbar(omega, torque, error, fmt="o", color=BLACK, markersize=3, label="measured, 95 %")
        for side in (omega < 0, omega > 0):
            upper.plot(
                omega[side], model[side], color=BLUE, label="$F_c + F_v\\omega$" if omega[side].max() > 0 else None
            )
        upper.set_ylabel(f"torque [{torque_unit}]" if self.motion != "linear" else f"force [{torque_unit}]")
        upper.set_title("Friction against speed: the intercept is $F_c$, the slope $F_v$")
        upper.legend(loc="upper left", fontsize="small")
        lower.errorbar(omega, torque - model, error, fmt="o", color=VERMILION, markersize=3)
        lower.axhline(0.0, color=BLACK, linewidth=0.5)
        lower.set_ylabel(f"residual [{torque_unit}]")
        lower.set_xlabel(f"speed [{speed_unit}]")
        for axes in (upper, lower):
            axes.grid(alpha=0.3)
        return figure

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        fits = {
            name.replace(" ", "_"): {
                "F_c": line.F_c, "F_v": line.F_v, "F_c_interval_95": line.interval("F_c"),
                "F_v_interval_95": line.interval("F_v"), "degrees_of_freedom": line.dof,
                "misfit": line.misfit, "misfit_p_value": line.p_value,
            }
            for name, line in self._lines()
        }  # fmt: skip
        return jsonable({
            "schema": "pmsm-ctrl/sweep/1",
            "warnings": self.warnings,
            "fits": fits,
            "rms_percent": self.rms_percent,
            "levels": [vars(level) for level in self.levels],
        })  # fmt: skip

    def section(self) -> Section:
        """Return the section of the report."""
        header = ("fit", "parameter", "value", "standard error", "unit", "95 % interval")
        return Section(
            title="Speed sweep",
            paragraphs=(
                *(f"Warning: {text}" for text in self.warnings),
                f"Averaged torque at {len(self.levels)} settled speeds; the line misses {self.rms_percent:.2f} % rms.",
            ),
            tables=((header, tuple(self._rows())),),
            captions=("Friction from the settled speeds",),
            figures=(
                (self.plot(), "Points on the line and a residual without a shape: F_c and F_v are all there is."),
            ),
        )


def evaluate_sweep(design: Design, logs: Log | Sequence[Log]) -> SweepResult:
    """Evaluate one or more records of a speed staircase.

    Parameters
    ----------
    design : Design
        ``design.K_t_assumed`` turns i_q into torque.
    logs : Log or sequence of Log
        Repeats of the staircase, each with ``omega_ref``; equal levels are averaged.

    Raises
    ------
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
    joint = _fit(levels, motion)
    sides = []
    for sign in (1.0, -1.0):
        side = [level for level in levels if sign * level.omega > 0]
        sides.append(_fit(side, motion) if len(side) >= 3 else None)
    omega = np.array([level.omega for level in levels])
    torque = np.array([level.torque for level in levels])
    residual = torque - joint.F_c.value * np.sign(omega) - joint.F_v.value * omega
    found = design
    for effect, symbol, estimate in (("coulomb", "F_c", joint.F_c), ("viscous", "F_v", joint.F_v)):
        found = found.with_effect(effect, {symbol: max(estimate.value, 0.0)}, {symbol: estimate.stderr})
    return SweepResult(
        design=found,
        joint=joint,
        positive=sides[0],
        negative=sides[1],
        rms_percent=100.0 * float(np.sqrt(np.mean(residual**2) / np.mean(torque**2))),
        levels=levels,
        plateaus=plateaus,
        motion=motion,
        reasons=_doubts(plateaus, joint, sides, float(np.sqrt(np.mean(residual**2) / np.mean(torque**2)))),
    )


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
    """
    return evaluate_sweep(design, simulated_records(design, truth, repeats, seed, progress))


def simulated_records(
    design: Design,
    truth: Design | None = None,
    repeats: int = 3,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> list[Log]:
    """Simulate the staircase `repeats` times, with independent noise per record."""
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


def _fit(levels: Sequence[Level], motion: str) -> Line:
    """Least squares with equal weights; its errors come from the scatter about the line.

    Weighting by the plateaus' own errors would weigh by noise: those are known to a few per cent at best, and the
    levels last equally long.
    """
    from scipy.special import fdtrc

    omega = np.array([level.omega for level in levels])
    torque = np.array([level.torque for level in levels])
    matrix = np.column_stack([np.sign(omega), omega])
    inverse = np.linalg.inv(matrix.T @ matrix)
    F_c, F_v = inverse @ (matrix.T @ torque)
    residual = torque - matrix @ np.array([F_c, F_v])
    dof = len(levels) - 2
    variance = float(residual @ residual) / dof
    stderr = np.sqrt(variance * np.diag(inverse))
    expected = float(np.mean([level.stderr**2 for level in levels]))
    ratio = variance / expected if expected > 0 else float("nan")
    pooled = sum(level.dof for level in levels)
    p_value = float(fdtrc(dof, min(pooled, 1e9), ratio)) if expected > 0 else float("nan")
    return Line(
        Estimate(float(F_c), axis_unit("N m", motion), float(stderr[0])),
        Estimate(float(F_v), axis_unit("N m s/rad", motion), float(stderr[1])),
        float(dof),
        float(np.sqrt(ratio)),
        p_value,
    )


def _doubts(plateaus: Sequence[Plateau], joint: Line, sides: Sequence[Line | None], relative: float) -> tuple[str, ...]:
    doubts = []
    unsettled = [plateau.omega_ref for plateau in plateaus if not plateau.trusted]
    if unsettled:
        shown = ", ".join(f"{value:g}" for value in unsettled[:6]) + (", ..." if len(unsettled) > 6 else "")
        doubts.append(f"{len(unsettled)} of {len(plateaus)} plateaus did not settle and are left out ({shown} rad/s)")
    # without any noise the points miss the line by parts in a million, which nobody needs to hear
    if joint.p_value < 1e-3 and joint.misfit > 1.5 and relative > 1e-3:
        doubts.append(
            f"the points scatter {joint.misfit:.1f} times more about the line than their own errors allow: "
            "a straight line is not the whole friction"
        )
    for symbol, estimate in (("F_c", joint.F_c), ("F_v", joint.F_v)):
        if estimate.value < 0:
            doubts.append(f"{symbol} = {estimate.value:.3g} {estimate.unit} is negative; the design takes 0")
    positive, negative = sides
    if positive is None or negative is None:
        doubts.append("only one direction: a constant load is indistinguishable from F_c")
        return tuple(doubts)
    for symbol in ("F_c", "F_v"):
        a, b = getattr(positive, symbol), getattr(negative, symbol)
        limit = t_quantile(0.999, min(positive.dof, negative.dof)) * float(np.hypot(a.stderr, b.stderr))
        if abs(a.value - b.value) > limit and abs(a.value - b.value) > 0.01 * abs(a.value + b.value) / 2:
            doubts.append(f"{symbol} differs by direction: {a.value:.4g} and {b.value:.4g} {a.unit}")
    return tuple(doubts)
