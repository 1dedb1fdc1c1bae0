"""The words of the diagnosis' warnings, each with its code."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum

from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.result import Calibration
from pmsm_ctrl.regression.drive_timing import IN_STEP
from pmsm_ctrl.regression.timed_record import FRICTION
from pmsm_ctrl.section import Notice, Template

__all__ = [
    "ABOVE_FLOOR",
    "AS_SENSOR",
    "BAND_OF_A_SPRING",
    "BEYOND_BAND",
    "BEYOND_LOG",
    "COMMUTATION",
    "DEPENDENCE",
    "EDGES_ABOVE_FLOOR",
    "EFFECT_NOT_EXCITED",
    "ESTIMATE_AT_BOUND",
    "EVENT_BRAKE",
    "EVENT_PUSH",
    "EVENT_STEP",
    "FACTOR_OFF",
    "FRICTION_UNKNOWN",
    "HELD_OUT_DISAGREES",
    "LARGE_REFUSED",
    "LITTLE_EXPLAINED",
    "LITTLE_KNOWN",
    "MINOR_PART",
    "NARROWER_BAND",
    "NEGATIVE_PARAMETER",
    "NOT_CALIBRATED",
    "NOT_EXCITED",
    "NOT_POLISHED",
    "NOT_SEPARABLE",
    "NO_FRICTION",
    "OTHER_ANGLE",
    "OUTSIDE_TOLERANCE",
    "POLISHED",
    "RESEMBLANCE",
    "RESONANCES_DIFFER",
    "RESONANCE_NOT_MEASURED",
    "RESONANCE_NOT_NAMED",
    "RESONANCE_STATED",
    "SLOW_TORQUE",
    "SPEED_FILTERED",
    "SPEED_LAG",
    "TAKEN_TOGETHER",
    "TOO_SHORT",
    "TORQUE_CONSTANT",
    "TURNS_TOO_OFTEN",
    "UNRELATED_TORQUE",
    "WIDER_BAND",
    "WINDING_IMPOSSIBLE",
    "WINDING_SUBSTITUTE",
    "Doubt",
    "at_bounds",
    "calibration_text",
    "errors_caption",
    "of_calibration",
    "of_log",
    "why",
]

NOT_EXCITED = Template("not_excited", "{parameters} not excited by this motion")
NOT_POLISHED = Template("not_polished", "the parameters are not refined by simulation: {why}")
POLISHED = Template(
    "polished",
    "the parameters are refined by simulation: the error on left-out stretches is {after:.4g} in place of {before:.4g} "
    "{unit}",
)
NOT_SEPARABLE = Template("not_separable", "{parameters} not separable on this motion")
EFFECT_NOT_EXCITED = Template("effect_not_excited", "{effect}: {why}")
AS_SENSOR = Template(
    "as_sensor",
    "{effect}: {sensor} is the same in every log; with the drive switched off the channel shows the offset alone",
)
BEYOND_LOG = Template(
    "beyond_log",
    "{effect}: {parameter} is at least {value:.3g}: the log is too short to tell how much larger; the size of "
    "the effect within the log is determined",
)
ESTIMATE_AT_BOUND = Template(
    "estimate_at_bound",
    "{parameter} is held at its bound {bound:g}, and the others are fitted with it; without bounds it would be "
    "{value:.3g} +- {stderr:.2g}",
)
TORQUE_CONSTANT = Template(
    "torque_constant",
    "the torque constant of the evaluation, {nominal:.4g} N m/A, is {percent:+.1f} % off the one that the voltages "
    "show ({estimate:.4g} N m/A): J, F_c, F_v and every other torque are off by the same factor{other}",
)
COMMUTATION = Template(
    "commutation",
    "the drive's d axis {leads} the magnets' by {angle} degrees (electrical), so that u_d holds {percent:.2g} % of the "
    "back-emf (part of the model): the zero of the encoder, or half of its step; the torque is {lost:.2g} % smaller",
)
SPEED_LAG = Template(
    "speed_lag",
    "the logged speed lags the torque by {lag} ms (corrected): a filter of the drive, or a delay between channels; a "
    "log with theta distinguishes the two",
)
SPEED_FILTERED = Template(
    "speed_filtered",
    "the logged speed lags the torque by {lag} ms (corrected): it passed a filter with a time constant of about "
    "{filter:.2g} ms; if the time constant is known, state it as filter of omega in [log.sampled]",
)
WINDING_SUBSTITUTE = Template(
    "winding_substitute",
    "{effect}: without it {parameter} would be {value:.3g} {unit}, {ratio:.2g} times its nominal value, and the "
    "voltages would be explained nearly as well",
)
OTHER_ANGLE = Template(
    "other_angle",
    "{effect}: the voltages do not contain the error of the logged angle, so the drive commutates with another sensor; "
    "a design cannot describe that: in a simulation the error rotates the dq frame of the drive as well",
)
BEYOND_BAND = Template(
    "resonance_beyond_band",
    "{effect}: the load resonates at {resonance:.0f} Hz, above the band of this log ({band:.0f} Hz): J_load^2 / k is "
    "identified, the two separately are not",
)
NARROWER_BAND = Template(
    "narrower_band",
    "evaluated in a band of {band:.0f} Hz: in the usual one, {usual:.0f} Hz, noise hides what is missing",
)
WIDER_BAND = Template(
    "wider_band",
    "evaluated in a band of {band:.0f} Hz: in the usual one, {usual:.0f} Hz, order {orders} of a turn is too fast at "
    "nearly all speeds",
)
BAND_OF_A_SPRING = Template(
    "band_of_a_spring",
    "evaluated in a band of {band:.0f} Hz: the load rings on its spring beyond the usual one, {usual:.0f} Hz, in which "
    "it acts as a filter does",
)
MINOR_PART = Template(
    "minor_part",
    "the first effect explains a minor part of what the residual has above its noise floor: most of it is something "
    "else",
)
TAKEN_TOGETHER = Template(
    "taken_together",
    "{effects}: accepted together; each is confirmed beside all others, and a minor part of the residual without them, "
    "so that the errors after the single steps say little",
)


class Doubt(StrEnum):
    """What else may have left a structure of the residual, so that it is an open question."""

    DRIVE_PATH = "drive_path"
    EDGES = "edges"
    LITTLE_WEIGHT = "little_weight"
    SMALL = "small"
    AS_WELL = "as_well"
    HELD_OUT = "held_out"


WHY: Mapping[Doubt | None, str] = {
    None: "no effect of the catalogue explains it",
    Doubt.DRIVE_PATH: "a drive signal that is late, averaged or filtered by about a period of the log or of the speed "
    "loop may have left it as well",
    Doubt.EDGES: "edges of the torque, which sampling and current loop blur, leave as much elsewhere as around "
    "reversals",
    Doubt.LITTLE_WEIGHT: "what is there weighs less than what is left elsewhere, since the torque around reversals is "
    "hardly known",
    Doubt.AS_WELL: "an effect of the catalogue explains it, but the log does not tell that effect from something else",
    Doubt.HELD_OUT: "an effect of the catalogue explains it, but raises the error on the held-out record",
    Doubt.SMALL: "it is less than {percent:.1g} % of the balance, as errors of any model are",
}


def why(doubt: Doubt | None, policy: Policy = POLICY) -> str:
    """Return what is said of a structure: that no effect explains it, or what else may have left it."""
    return WHY[doubt].format(percent=100.0 * policy.size)


DEPENDENCE = Template(
    "residual_dependence",
    "{percent:.0f} % of the residual of the {balance} balance depends on {coordinate}, up to {peak}{place}; {why}",
)
RESEMBLANCE = Template(
    "residual_resembles_effect",
    "the residual of the {balance} balance is not noise{place}: {effect} would explain {percent:.0f} % of it, but is "
    "{refusal}; {why}",
)
SLOW_TORQUE = Template(
    "slow_torque",
    "a part of the {balance} balance, {percent:.0f} % of it, changes slowly (over more than {seconds:.2g} s) and "
    "depends on no coordinate of the axis, as a load of the process does; no effect of the catalogue explains it",
)
HELD_OUT_DISAGREES = Template(
    "held_out_disagrees",
    "{record}, which is held out, leaves {ratio:.2g} times as much of the torque as the log, with friction and a "
    "constant torque of its own: another axis, load or state; it may refuse an effect that the log has",
)
WINDING_IMPOSSIBLE = Template(
    "winding_impossible",
    "{parameter} would be {value:.3g} {unit}, {ratio:.2g} times its nominal value: another winding, or a missing "
    "voltage term that resembles {like}; {explained}",
)
# -- events
EVENT_PUSH = Template(
    "event_push",
    "from {start:.4g} to {stop:.4g} s a torque of {size:+.2g} {unit} acts that the motion does not explain: a push, "
    "or a load; the stretch is left out of the fit",
)
EVENT_BRAKE = Template(
    "event_brake",
    "from {start:.4g} to {stop:.4g} s the friction is {size:+.2g} {unit} higher than elsewhere: a brake, or contact; "
    "the stretch is left out of the fit",
)
EVENT_STEP = Template(
    "event_friction_step",
    "at {at:.4g} s the friction changes by {size:+.2g} {unit} and stays so; the change is part of the fit",
)
# -- why a verdict is what it is
NEGATIVE_PARAMETER = Template(
    "negative_parameter",
    "{parameter} would be {value:.3g}, below zero: a channel has the wrong sign, or is not the right one",
)
FACTOR_OFF = Template(
    "parameter_factor_off",
    "{parameter} would be {value:.3g}, {ratio:.2g} times the design's {nominal:.3g}: a unit or a scale of the log, the "
    "gear, the load, or another motor",
)
UNRELATED_TORQUE = Template(
    "unrelated_torque",
    "the model explains {percent:.0f} % of the mean square of the torque, and the rest is not noise: the motion does "
    "not follow from this torque",
)
TOO_SHORT = Template(
    "record_too_short",
    "the log holds {count:.0f} independent samples; at least {least:.0f} are needed to distinguish effects",
)
LITTLE_EXPLAINED = Template(
    "little_explained",
    "the model explains {percent:.0f} % of the mean square of the torque, less than half: most of this log is noise",
)
LITTLE_KNOWN = Template(
    "little_known",
    "the model explains {percent:.0f} % of the mean square of the torque, less than half, and what is left is no "
    "noise: a load that no channel holds, or a wrong sign or channel of the torque",
)
ABOVE_FLOOR = Template(
    "above_noise_floor",
    "the residual of the {balance} is {ratio:.2g} times its noise floor",
)
TURNS_TOO_OFTEN = Template(
    "turns_too_often",
    "in {percent:.0f} % of the samples the axis turns more than twice in a row, or rests in between, and nothing tells "
    "its direction: they are left out, so that an effect that acts there alone is not detectable",
)
EDGES_ABOVE_FLOOR = Template(
    "edges_above_noise_floor",
    "the residual of the {balance} at its edges is {ratio:.2g} times the noise floor: this log does not sample the "
    "edges, so that an effect that acts there alone is not detectable",
)
OUTSIDE_TOLERANCE = Template(
    "parameter_outside_tolerance",
    "{parameter} is {percent:+.0f} % off the design, beyond its tolerance: a wrong value in the design, or an effect "
    "that resembles it",
)
FRICTION_UNKNOWN = Template(
    "friction_unknown",
    "{parameter} is not determined by this log (standard error {stderr:.2g} {unit}), nor is an effect that resembles "
    "it: a motion in both directions determines it",
)
NO_FRICTION = Template("no_friction", "{parameter} = {value:.3g}: this log shows none of the design's dry friction")
LARGE_REFUSED = Template(
    "refused_but_large", "{effect} would explain {percent:.0f} % of the residual, but is {refusal}"
)
RESONANCE_NOT_NAMED = Template(
    "frf_resonance_not_named",
    "the frequency response of {log} has an antiresonance at {antiresonance} Hz, but no second mass is named on this "
    "log ({why}); load inertia: {load}",
)
RESONANCE_NOT_MEASURED = Template(
    "frf_resonance_not_measured",
    "{effect}: its antiresonance at {antiresonance} Hz is not in the frequency response of {log}, which is that of a "
    "rigid axis up to {highest:.4g} Hz",
)
RESONANCES_DIFFER = Template(
    "frf_resonance_differs",
    "{effect}: the {quantity} is {own} {unit} by this log and {other} {unit} by the frequency response, {errors:.2g} "
    "joint standard errors apart",
)
RESONANCE_STATED = Template(
    "frf_resonance_stated",
    "the design already states the second mass that frf compared the response with: it is not a candidate",
)
NOT_CALIBRATED = Template("not_calibrated", "too many false alarms on this motion: {calibration}")
LOG_CONDITIONING = Template("log_conditioning", "{note}")


def of_log(notes: Iterable[Notice | str]) -> tuple[Notice, ...]:
    """Return the remarks of the conditioning of a log as notices.

    Parameters
    ----------
    notes : iterable of Notice or str
    """
    return tuple(note if isinstance(note, Notice) else LOG_CONDITIONING(note=note) for note in notes)


def calibration_text(found: Calibration) -> str:
    """Return the false-alarm rate in words.

    Parameters
    ----------
    found : Calibration
    """
    count, named = len(found.alarms), ", ".join(sorted(set(found.alarms)))
    return (
        f"{count} false alarm{'' if count == 1 else 's'} in {found.runs} simulations of the accepted model"
        f"{f' ({named})' if named else ''}; false-alarm rate on this motion at most {100.0 * found.most:.0f} % "
        "(95 % confidence)"
    )


def errors_caption(cutoff: float) -> str:
    """Return what a table of errors holds; as a held-out record a log is filtered as the fitted one, not as its own.

    Parameters
    ----------
    cutoff : float
        Of the low-pass of both sides of a balance, Hz.

    Returns
    -------
    str
    """
    return f"Relative rms error of each balance, low-passed at {cutoff:.4g} Hz, which the fitted log allows"


def of_calibration(found: Calibration, policy: Policy = POLICY) -> tuple[Notice, ...]:
    """Return a warning where too many false alarms were raised.

    Parameters
    ----------
    found : Calibration
    policy : Policy
    """
    if len(found.alarms) <= policy.alarms * found.runs:
        return ()
    return (NOT_CALIBRATED(calibration=calibration_text(found)),)


def at_bounds(fit: Fitted) -> Iterator[Notice]:
    """Yield which parameters stay at their bounds.

    Parameters
    ----------
    fit : Fitted
    """
    for k, bound in fit.estimate.held.items():
        if IN_STEP in fit.model.names and fit.model.names[k] == FRICTION["viscous"]:
            continue  # it is not told, and a notice of its own says so
        value, stderr = float(fit.plain.values[k]), float(fit.plain.stderr[k])
        yield ESTIMATE_AT_BOUND(parameter=fit.model.names[k], bound=bound, value=value, stderr=stderr)
