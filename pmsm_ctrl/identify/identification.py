"""identify: friction and inertia from any log, by inverse dynamics or by simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import SMALL, Design, EffectEntry
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.identify.band import regression_problem, searches_shapes, widest
from pmsm_ctrl.identify.instrumental import BiasTest, instrumental
from pmsm_ctrl.identify.output_error import output_error
from pmsm_ctrl.identify.problem import Problem, build_problem
from pmsm_ctrl.identify.regression import Fit, solve
from pmsm_ctrl.identify.replay import Replay, build_replay
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Processing, prepare
from pmsm_ctrl.result import Estimate, Result, Section, jsonable
from pmsm_ctrl.units import drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Identification", "Method", "identify"]

Array = NDArray[np.float64]
Method = Literal["regression", "iv", "output_error"]
_TITLES = {
    "regression": "Inverse-dynamics least squares",
    "iv": "Inverse dynamics by instrumental variables",
    "output_error": "Simulation of the drive with its sampled controller, fitted to the torque",
}


@dataclass(frozen=True, eq=False)
class Identification(Result):
    """What a log says about a design's parameters.

    Attributes
    ----------
    design : Design
        The given design with the identified values and their standard errors; parameters that could not be
        identified keep the values they had.
    estimates : dict of name to Estimate
    intervals : dict of name to (float, float)
        95 % intervals by Student's t with the effective degrees of freedom.
    unidentifiable : dict of name to str
        Parameters that got no number, and why.
    shown : Problem
        The regression with nothing blanked, for errors and figures.
    unexplained : array, shape (m,)
        Measured less predicted torque of `shown`.
    relative_error : float
        norm(unexplained) / norm(torque) on its moving samples.
    method : {"regression", "iv", "output_error"}
    bias : BiasTest or None
        Whether least squares is biased on this log; of the method "iv".
    remarks : tuple of str
        What was understood of the log's experiment; no reason to doubt anything.
    """

    design: Design
    estimates: Mapping[str, Estimate]
    intervals: Mapping[str, tuple[float, float]]
    unidentifiable: Mapping[str, str]
    relative_error: float
    rms: float
    problem: Problem
    fit: Fit
    shown: Problem
    unexplained: Array
    log_name: str
    reasons: tuple[str, ...] = ()
    method: Method = "regression"
    bias: BiasTest | None = None
    remarks: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers."""
        return self.reasons

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks, and the verdict on least squares where it was tested."""
        if self.bias is None:
            return self.remarks
        return (*self.remarks, self.bias.text({name: e.value for name, e in self.estimates.items()}))

    def summary(self) -> str:
        """Return the result as text, trust first."""
        lines = [f"identification of {self.design.name} from {self.log_name}"]
        if self.method != "regression":
            lines.append(f"  {_TITLES[self.method][0].lower()}{_TITLES[self.method][1:]}")
        lines += [f"  warning: {text}" for text in self.warnings] or ["  no reason to doubt the numbers was found"]
        lines += [f"  note: {text}" for text in self.notes]
        lines += [f"  {name}: not identifiable, because {why}" for name, why in self.unidentifiable.items()]
        for name, estimate in self.estimates.items():
            low, high = self.intervals[name]
            unit = "" if estimate.unit == "1" else estimate.unit
            lines.append(
                f"  {name:<10} {estimate.value:>12.5g} +- {estimate.stderr:<9.2g} {unit:<12}"
                f" 95 % [{low:.5g}, {high:.5g}]   design {estimate.nominal:.5g}"
            )
        lines.append(
            f"  relative error {100 * self.relative_error:.2f} % of the {drives(self.design.motion)} "
            f"({self.rms:.3g} {self.problem.unit} rms, {int(self.problem.mask.sum())} samples at "
            f"{self.problem.rate:.4g} Hz, low-pass {self.problem.cutoff:.3g} Hz{self._inertia_band()})"
        )
        lines.append(
            f"  condition number {self.fit.condition:.3g}, residual correlated with order {self.fit.noise.order},"
            f" {self.fit.dof:.0f} effective degrees of freedom"
        )
        return "\n".join(lines)

    def _inertia_band(self) -> str:
        return f", the inertia from {b:.3g} Hz" if (b := self.problem.inertia_cutoff) is not None else ""

    def plot(self) -> Figure:
        """Draw measured and predicted torque, and the residual, against time."""
        from pmsm_ctrl.identify.figures import measured_against_predicted

        p = self.shown
        return measured_against_predicted(
            p.t, p.torque, p.torque - self.unexplained, p.mask, drives(self.design.motion), p.unit
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return jsonable({
            "schema": "pmsm-ctrl/identification/1",
            "log": self.log_name,
            "method": self.method,
            "warnings": self.warnings,
            "parameters": self.estimates,
            "intervals_95": self.intervals,
            "not_identifiable": self.unidentifiable,
            "relative_error": self.relative_error,
            "rms": {"value": self.rms, "unit": self.problem.unit},
            "condition_number": self.fit.condition,
            "effective_degrees_of_freedom": self.fit.dof,
            "samples": int(self.problem.mask.sum()),
            "rate": self.problem.rate,
            "cutoff": self.problem.cutoff,
            "inertia_cutoff": self.problem.inertia_cutoff,
            "notes": self.notes,
            "least_squares_bias": None if self.bias is None else vars(self.bias),
        })  # fmt: skip

    def section(self) -> Section:
        """Return the section of the report."""
        rows = tuple(
            (n, f"{e.value:.5g}", f"{e.stderr:.2g}", e.unit, "{:.5g} to {:.5g}".format(*self.intervals[n]))
            for n, e in self.estimates.items()
        )
        rows += tuple((n, "not identifiable", "", "", why) for n, why in self.unidentifiable.items())
        return Section(
            title=f"Identification from {Path(self.log_name).name}",
            paragraphs=(
                *(f"Warning: {text}" for text in self.warnings),
                *(f"Note: {text}." for text in self.notes),
                f"{_TITLES[self.method]}; what remains is {100 * self.relative_error:.2f} % of the "
                f"{drives(self.design.motion)}. The standard errors allow for the correlation of the residual.",
            ),
            tables=(
                (("parameter", "value", "standard error", "unit", "95 % interval"), rows),
                *(() if self.bias is None or not self.bias.bias else (self.bias.table(),)),
            ),
            captions=("What the log says of every parameter", "Least squares against instruments"),
            figures=((self.plot(), "The residual below should look like noise; a shape in it is a missing effect."),),
        )


def identify(
    design: Design,
    log: Log,
    *,
    method: Method = "regression",
    processing: Processing | None = None,
) -> Identification:
    """Identify the inertia and the parameters of the design's effects from a log.

    ``T_em - T_load = J alpha + sum of effect terms``, both sides through the same zero-phase filter. Source of the
    method: M. Gautier, A. Janot, P. O. Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428.

    Parameters
    ----------
    design : Design
    log : Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``; for the methods that simulate, the references as well.
    method : {"regression", "iv", "output_error"}
        "regression": least squares for every linear parameter of the torque effects; needs nothing but the log.
        "iv": the same by instrumental variables from the simulated drive, unbiased by noise in the motion; also
        tests whether least squares is biased. "output_error": all parameters, nonlinear ones included, by fitting
        the simulated drive's torque. These two need the design's loops and the log's ``omega_ref`` or ``theta_ref``.
    processing : Processing, optional
        Filter, derivative and mask; the defaults suit a log of 1 kHz. Without a cutoff given, the methods that
        simulate work up to 100 Hz or an eighth of the log's rate, and up to 250 Hz or a quarter of it where an effect
        has a shape; least squares does so where the log tells much beyond 40 Hz and its angle is fine enough. Rests
        and reversals are blanked unless told otherwise.

    Raises
    ------
    RequestError
        For an unknown method.
    LogError
        When a channel is missing or the axis hardly moves.
    DesignError
        When the design names an unknown effect, or lacks what a simulation needs.
    SimulationError
        When the design's loops are not stable on the plant that the log suggests.
    """
    if method not in get_args(Method):
        known = ", ".join(get_args(Method))
        raise RequestError(f"identification method '{method}'{nearest(method, get_args(Method))} (known: {known})")
    processing = processing or Processing()
    if processing.blank is None:
        processing = replace(processing, blank=True)
    bias: BiasTest | None = None
    warnings: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    if method == "regression":
        problem = regression_problem(design, log, processing)
        fit = solve(problem, catalogue_of(design))
    else:
        replay = build_replay(design, log)
        problem, fit, bias, warnings = _by_simulation(method, design, log, replay, processing)
        remarks = replay.notes
        if why := fit.unidentifiable.get("J"):
            # An inertia that the log does not show would take the others' errors with it.
            problem, fit, bias, warnings = _by_simulation(method, design, log, replay, processing, inertia=False)
            fit = replace(fit, unidentifiable={"J": f"{why}; held at the design's value", **fit.unidentifiable})
    found, bounds = _identified(design, problem, fit)
    shown, unexplained = problem, fit.residual
    if method != "output_error":
        plain = replace(processing, blank=False, cutoff=problem.cutoff)
        shown, unexplained = _shown(design, log, problem, fit, plain)
    mask = shown.mask
    return Identification(
        design=found,
        estimates={
            c.name: Estimate(fit.values[c.name], c.unit, fit.stderr[c.name], c.nominal)
            for c in problem.columns
            if c.name in fit.values
        },
        intervals={name: fit.interval(name) for name in fit.values},
        unidentifiable=fit.unidentifiable,
        relative_error=float(np.linalg.norm(unexplained[mask]) / np.linalg.norm(shown.torque[mask])),
        rms=float(np.sqrt(np.mean(unexplained[mask] ** 2))),
        problem=problem,
        fit=fit,
        shown=shown,
        unexplained=unexplained,
        log_name=log.provenance.file or "the given log",
        reasons=(*problem.notes, *warnings, *bounds, *_doubts(design, problem, fit)),
        method=method,
        bias=bias,
        remarks=remarks,
    )


def _by_simulation(
    method: Method,
    design: Design,
    log: Log,
    replay: Replay,
    processing: Processing,
    inertia: bool = True,
) -> tuple[Problem, Fit, BiasTest | None, tuple[str, ...]]:
    cutoff = processing.cutoff if processing.cutoff is not None else widest(log, searches_shapes(design))
    wide = replace(processing, cutoff=cutoff)
    if method == "iv":
        plain = regression_problem(design, log, processing)
        usual = replace(processing, cutoff=plain.cutoff, inertia_cutoff=plain.inertia_cutoff)
        return instrumental(design, log, replay, processing=wide, usual=usual, inertia=inertia)
    wide = replace(wide, through_reversals=True)
    prepared = prepare(design, log, wide, as_logged=True)
    problem = build_problem(design, log, processing=wide, inertia=inertia)
    problem, fit, warnings = output_error(design, problem, prepared, replay)
    return problem, fit, None, warnings


def _shown(design: Design, log: Log, problem: Problem, fit: Fit, processing: Processing) -> tuple[Problem, Array]:
    """Return the regression with nothing blanked, and what the fit leaves of it: reversals are part of the error."""
    inertia = any(column.entry < 0 for column in problem.columns)
    shown = build_problem(design, log, processing=processing, inertia=inertia)
    return shown, shown.target - shown.matrix() @ fit.coefficients


def _identified(design: Design, problem: Problem, fit: Fit) -> tuple[Design, tuple[str, ...]]:
    """The design with the identified values; a value beyond a bound is set to the bound, and said."""
    notes = []
    changed: dict[int, EffectEntry] = {}
    for column in problem.columns:
        if column.name not in fit.values:
            continue
        value, stderr = fit.values[column.name], fit.stderr[column.name]
        inside = min(max(value, column.lower), column.upper)
        if inside != value:
            notes.append(
                f"{column.name} = {value:.4g} +- {stderr:.2g} {column.unit} is beyond its bound {inside:g}; "
                "the design takes the bound"
            )
        if column.entry < 0:
            if inside - design.load.J / design.load.gear**2 >= SMALL:
                design = design.with_parameters(J=inside)
            continue
        entry = changed.get(column.entry, design.effects[column.entry])
        changed[column.entry] = EffectEntry(
            id=entry.id,
            parameters={**entry.parameters, column.symbol: inside},
            stderr={**entry.stderr, column.symbol: stderr},
        )
    effects = tuple(changed.get(k, entry) for k, entry in enumerate(design.effects))
    return design.replace_effects(effects), tuple(notes)


def _doubts(design: Design, problem: Problem, fit: Fit) -> list[str]:
    doubts = []
    if fit.condition > 100.0:
        doubts.append(f"condition number {fit.condition:.3g}: some columns are nearly alike on this motion")
    if fit.dof < 20.0:
        doubts.append(
            f"only {fit.dof:.1f} effective degrees of freedom: the standard errors are themselves uncertain by "
            f"{100.0 / np.sqrt(2.0 * fit.dof):.0f} %; a longer log is needed"
        )
    if "J" in fit.values:
        deviation = fit.values["J"] / design.J - 1.0
        tolerance = design.motor.tolerance.get("J", 0.15)
        if abs(deviation) > tolerance:
            doubts.append(
                f"J is {100 * deviation:+.0f} % off the design, beyond its tolerance of {100 * tolerance:.0f} %: "
                "check the torque constant, the units and the load"
            )
    return doubts
