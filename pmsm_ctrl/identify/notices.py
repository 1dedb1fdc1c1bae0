"""The words of the identification's notices."""

from __future__ import annotations

from pmsm_ctrl.regression.least_squares import Cause, Combination, Unidentifiable
from pmsm_ctrl.section import Notice, Template

__all__ = [
    "BETWEEN_SAMPLES", "BIASED", "BIAS_UNTESTED", "BOUND", "CURRENT_LIMIT", "DIFFERS", "DIRECTION_DEPENDENT",
    "EFFECTIVE_BY_DELAY", "EFFECTIVE_BY_FLOOR", "EFFECTIVE_VALUES", "EFFECT_LEFT_OUT",
    "FEW_DEGREES_OF_FREEDOM", "ILL_CONDITIONED",
    "INERTIA_BY_INSTRUMENTS", "INERTIA_FAR", "INERTIA_NEGATIVE", "INERTIA_OFF", "INERTIA_OVER_CUTOFF", "LARGE_ERROR",
    "MISFIT", "NEGATIVE", "NOT_BIASED", "NOT_CONVERGED", "OPEN_LOOP", "REPLAYED_CURRENT",
    "UNSETTLED", "WRONG_LOOPS", "beyond_error", "not_identifiable",
]  # fmt: skip

# -- of any method
BOUND = Template(
    "parameter_at_bound",
    "{name} is held at its bound {bound:g}, and the others are fitted with it; without bounds it would be {value:.4g} "
    "+- {stderr:.2g} {unit}; beyond its error that is a missing effect: diagnose this log",
)
BETWEEN_SAMPLES = Template(
    "torque_between_samples",
    "the torque moves between the samples of this log, which may shift {shifts}; the intervals allow for that; log at "
    "the rate of the speed loop, {rate:g} Hz, or the mean over a period, and state it in [log]",
)
EFFECT_LEFT_OUT = Template("effect_left_out", "{effect} of the design is left out of the torque: {why}")
ILL_CONDITIONED = Template(
    "ill_conditioned", "condition number {condition:.3g}: some parameters are nearly inseparable on this motion"
)
FEW_DEGREES_OF_FREEDOM = Template(
    "few_degrees_of_freedom",
    "only {dof:.1f} effective degrees of freedom: the standard errors are themselves uncertain by {percent:.0f} %; a "
    "longer log is needed",
)
LARGE_ERROR = Template(
    "large_error",
    "the residual is {percent:.0f} % of the torque: the parameters explain {explained:.0f} % of its mean square, the "
    "rest is noise or a missing effect; compare and diagnose distinguish the two",
)
EFFECTIVE_VALUES = Template(
    "effective_values",
    "effective values only: {explained:.0f} % of the residual's mean square depends on {names}, which these "
    "parameters do not describe: diagnose this log",
)
EFFECTIVE_BY_FLOOR = Template(
    "effective_values",
    "effective values only: the residual is {ratio:.2g} times its noise floor, with no significant dependence on any "
    "coordinate: diagnose this log",
)
EFFECTIVE_BY_DELAY = Template(
    "effective_values",
    "effective values only: the {quantity} is {late:.3g} ms later than the motion, and sampling can make it {most:.3g} "
    "ms late: diagnose this log",
)
OPEN_LOOP = Template(
    "open_loop",
    "the axis alone was simulated, driven by the logged torque: the drive with its controller needs one log with its "
    "references, and a design with loops and electrical data",
)
INERTIA_NEGATIVE = Template(
    "inertia_negative", "J = {value:.3g} +- {stderr:.2g} is below zero: current and acceleration differ in sign"
)
INERTIA_FAR = Template(
    "inertia_far",
    "J = {value:.3g} is {ratio:.2g} times the design's: check the unit of the current, the torque constant, the gear "
    "and the load",
)
INERTIA_OFF = Template(
    "inertia_off",
    "J is {percent:+.0f} % off the design, beyond its tolerance of {tolerance:.0f} %: check the torque constant, the "
    "units and the load",
)
INERTIA_OVER_CUTOFF = Template(
    "inertia_over_cutoff",
    "J changes with the cutoff by more than its interval: {value:.4g} {unit} at {at:.3g} Hz, "
    "{other:.4g} at {cutoff:.3g} Hz; noise in the acceleration lowers it as the band grows (--cutoff narrows it), "
    "or an effect is missing",
)
INERTIA_BY_INSTRUMENTS = Template(
    "inertia_by_instruments",
    "J by regression, {value:.4g} +- {stderr:.2g} {unit}, is {percent:+.2g} % off the one by instruments from the "
    "simulated drive, {other:.4g} +- {others:.2g}, and outside of both intervals: the samples of the torque are no "
    "means over their time (a reference that is held for a sample), or noise in the motion biases the regression. "
    "Use --method iv or output_error, where the loops of the design are those of the drive",
)

# -- of the methods that simulate
CURRENT_LIMIT = Template(
    "current_limit", "the current limit was reached: the feedforward in this log is unknown and not simulated"
)
REPLAYED_CURRENT = Template(
    "replayed_current",
    "the current reference contains {rms:.2g} A rms that is not the speed controller's output (feedforward or "
    "excitation); the simulation adds it",
)
NOT_CONVERGED = Template("not_converged", "{method}: not converged after {rounds} iterations{names}")
WRONG_LOOPS = Template(
    "wrong_loops",
    "the residual of the simulated drive is {ratio:.2g} times that of inverse dynamics: its loops or references "
    "differ from those of the log, and the parameters may be off by more than their standard errors",
)
DIFFERS = Template(
    "differs_from_inverse_dynamics",
    "differs from inverse dynamics, in standard errors: {names}; either the loops and references of the simulation "
    "differ from those of the log, or noise in the motion biases inverse dynamics: method iv tests this",
)
BIAS_UNTESTED = Template(
    "bias_untested", "least squares cannot be tested for bias: no parameter is identifiable by both methods"
)
NOT_BIASED = Template(
    "not_biased", "bias of least squares: not significantly above half a standard error (zero bias: {shown})"
)
BIASED = Template("biased", "least squares is biased on this log: {names}")

# -- of the speed sweep
UNSETTLED = Template(
    "unsettled_plateaus", "{left_out} of {count} plateaus did not settle and are not used ({speeds} {unit})"
)
MISFIT = Template(
    "misfit",
    "the points scatter about the line {ratio:.1f} times as much as their standard errors allow ({percent:.2g} % of "
    "the torque): F_c and F_v do not describe it completely, and their standard errors are those of lines through the "
    "lower and the upper half of the speeds",
)
NEGATIVE = Template(
    "negative_friction", "{symbol} = {value:.3g} {unit} is negative: it is held at 0, and the line is fitted with that"
)
DIRECTION_DEPENDENT = Template(
    "direction_dependent", "{symbol} differs by direction: {positive:.4g} and {negative:.4g} {unit}"
)

_CAUSES = {
    Cause.NOT_EXCITED: "its term is zero throughout the log",
    Cause.COLLINEAR: "not separable from {partners} on this motion",
    Cause.UNCERTAIN: "uncertain by +- {half_width:.2g} {unit}, more than its expected size of {limit:.2g} {unit}",
    Cause.NO_ACCELERATION: "the torque of the acceleration, {torque:.2g} {unit} rms, is below the residual of "
    "{residual:.2g} {unit}",
    Cause.IMPOSSIBLE: "its estimate, {value:.4g} +- {stderr:.2g} {unit}, is below its physical minimum",
    Cause.EFFECT_ABSENT: "its effect may be absent: the interval of {sizes} includes zero",
}
# Causes that another motion can remedy.
_NEEDS = (Cause.NOT_EXCITED, Cause.COLLINEAR, Cause.NO_ACCELERATION)


def not_identifiable(lost: Unidentifiable, needs: str) -> Notice:
    """Return why a parameter gets no number; `needs` says what excitation shows it, where that is known."""
    names = {key: ", ".join(value) for key, value in lost.detail.items() if isinstance(value, tuple)}
    text = _CAUSES[lost.cause].format(**{**lost.detail, **names})
    if needs and lost.cause in _NEEDS:
        text += f"; it needs {needs}"
    if lost.known is not None:
        text += f"; identifiable: {_sum(lost.known)}"
    if lost.held:
        text += "; held at the design's value"
    return Notice(lost.cause.value, text, lost.detail)


def _sum(known: Combination) -> str:
    terms = [f"{'-' if w < 0 else '+'} {_factor(abs(w))}{name}" for name, w in known.weights.items()]
    return f"{' '.join(terms).removeprefix('+ ')} = {known.value:.4g} +- {known.stderr:.2g} {known.unit}"


def _factor(value: float) -> str:
    return "" if f"{value:.3g}" == "1" else f"{value:.3g} "


def beyond_error(bound: Notice) -> bool:
    """Whether a parameter would lie beyond its bound by more than its error: a missing effect, and no detail.

    Parameters
    ----------
    bound : Notice
        Of `BOUND`.
    """
    told = bound.detail
    return abs(float(told["value"]) - float(told["bound"])) > 2.0 * float(told["stderr"])
