"""The notices of the conditioning of a log."""

from __future__ import annotations

from pmsm_ctrl.regression.drive_timing import DriveTiming
from pmsm_ctrl.rendering.numbers import with_error
from pmsm_ctrl.section import Notice, Template

__all__ = [
    "ASSUMED_I_D",
    "AS_STATED",
    "CHANNEL_LEFT_OUT",
    "COARSE_ANGLE",
    "DEAD_VOLTAGES",
    "DRIVEN_ONE_WAY",
    "DRIVE_AHEAD",
    "DRIVE_COMMANDED",
    "DRIVE_FILTERED",
    "DRIVE_LATE",
    "ENCODER_LINES",
    "EQUAL_STEPS",
    "GAPS",
    "LONG_LOG",
    "MEASUREMENT_EFFECT_LEFT_IN",
    "NO_REGRESSION",
    "ONE_DIRECTION",
    "ORDERS_BEYOND_BAND",
    "OTHER_ZERO",
    "RECORD_DISAGREES",
    "RESAMPLED",
    "RESOLVER_ERROR",
    "SAMPLED_IN_STEP",
    "SPEED_FOR_COARSE_ANGLE",
    "TORQUE_EDGES",
    "TORQUE_JUMPS",
    "WORSE_THAN_GIVEN",
    "sampling_text",
    "timing_notice",
]  # fmt: skip

CHANNEL_LEFT_OUT = Template(
    "channel_left_out", "channel {channel} is not used, because not all records have it (without it: {records})"
)
COARSE_ANGLE = Template(
    "coarse_angle",
    "theta was written with few digits, in steps of up to {step:.2g} {unit}: results that depend on the "
    "acceleration, such as the inertia, are unreliable; export more digits",
)
SPEED_FOR_COARSE_ANGLE = Template(
    "speed_for_coarse_angle",
    "theta was written with few digits, in steps of up to {step:.2g} {unit}: the speed is used instead; export "
    "more digits",
)
LONG_LOG = Template(
    "long_log",
    "{samples} samples are evaluated at {rate:.4g} Hz in place of {given:.4g} Hz, to limit the memory: "
    "content above {fastest:.2g} Hz is lost; a shorter part of the log is evaluated at its own rate",
)
ASSUMED_I_D = Template(
    "i_d_assumed",
    "i_d is not logged: u_d and u_q are evaluated with {assumed}, as of a drive that keeps it there; log i_d where the "
    "field is weakened",
)
DEAD_VOLTAGES = Template("dead_voltages", "{channels} zero throughout: not used")
ENCODER_LINES = Template(
    "encoder_lines",
    "the angle has an error of {lines} periods a turn and {amplitude:.2g} rad, the interpolation error of an encoder "
    "with so many lines: it is part of the model",
)
RESOLVER_ERROR = Template(
    "resolver_error",
    "the angle has an error of {order} periods a turn and {amplitude:.2g} rad, as of a resolver: it is part of the "
    "model",
)
DRIVE_COMMANDED = Template(
    "drive_signal_command",
    "the {quantity} looks like the command of a current loop: at changes of the acceleration it exceeds what acts, by "
    "what the loop lets through of the back-emf (part of the model); if it is one, state sampling = 'command' in [log]",
)
DRIVE_FILTERED = Template(
    "drive_signal_filtered",
    "the {quantity} was filtered before it was logged, with a time constant of about {lag:.2g} ms (corrected); "
    "if the time constant is known, state it as filter in [log]",
)
DRIVE_LATE = Template(
    "drive_signal_late",
    "the {quantity} is {delay:.2g} ms late, more than sampling can make it: this log does not tell a filter (assumed "
    "here, and corrected) from a delay; state which it is as filter or late in [log]",
)
DRIVE_AHEAD = Template(
    "drive_signal_ahead",
    "the {quantity} is {ahead:.2g} ms ahead of what acts, more than sampling can make it: this log does not tell the "
    "command of a slow current loop (assumed here, and corrected) from a delay of the motion; state which it is in "
    "[log]",
)
EQUAL_STEPS = Template(
    "equal_steps",
    "time stamps jitter by up to {jitter:.1f} % of a period, the motion does not: equal sampling intervals are used",
)
OTHER_ZERO = Template("other_zero", "the position has a different zero in {records}: the records were aligned")
RECORD_DISAGREES = Template(
    "record_disagrees",
    "inertia or friction differs from that of the other records by more than their spread: {records} (p = {p:.2g}); "
    "evaluate it alone, or leave it out",
)
RESAMPLED = Template("resampled", "time stamps jitter by up to {jitter:.1f} % of a period: resampled at {rate:.6g} Hz")
GAPS = Template("gaps", "gaps in time: {count}, {seconds:.3g} s in total, not used")
TORQUE_JUMPS = Template(
    "torque_jumps", "the torque jumps at {percent:.2g} % of the samples; the samples around these jumps are not used"
)
TORQUE_EDGES = Template(
    "torque_edges",
    "the {quantity} has edges between the samples: they falsify {percent:.2g} % of the samples by more than the noise, "
    "and these count less; a log of means over its period, or of a higher rate, holds the edges",
)
SAMPLED_IN_STEP = Template(
    "sampled_in_step",
    "the {quantity} falls with the speed by {slope:.2g} {unit}, as no friction does: taken for a {quantity} that was "
    "sampled in step with a position reference that is held; this log does not tell {parameter}, and one of a higher "
    "rate or of means over its period does",
)
DRIVEN_ONE_WAY = Template(
    "driven_one_way",
    "the axis goes one way and is driven by a load: {parameter}, which the log does not tell from a constant load, is "
    "kept as the design states it; a log of both directions tells both",
)
ONE_DIRECTION = Template(
    "one_direction",
    "only one direction: F_c is the sum of the dry friction and any constant load, which a log of both directions "
    "tells apart",
)
MEASUREMENT_EFFECT_LEFT_IN = Template(
    "measurement_effect_left_in", "{effect} is not corrected: the log lacks a channel that its term needs"
)
AS_STATED = Template(
    "as_stated",
    "{parameters}: this log does not show them apart from the other parameters; held at what the design states",
)
NO_REGRESSION = Template(
    "no_regression",
    "{effect} has an internal state: the regression leaves it as the design states it; method 'output_error' finds it",
)
ORDERS_BEYOND_BAND = Template(
    "orders_beyond_band",
    "order {orders} of a turn (up to {amplitude:.2g} {unit}) lies above the bandwidth of {cutoff:.3g} Hz at "
    "{percent:.0f} % of the speeds and is not judged: a log of slower motion (below {slow:.2g} rad/s) shows it",
)

# ms; a smaller lag is not reported, nor is one of less than so many standard errors.
SHOWN_MS, SURELY = 0.01, 2.0
WORSE_THAN_GIVEN = Template(
    "worse_than_given",
    "the torque error is {percent:.3g} % with the fitted parameters and {given:.3g} % with those of the given design: "
    "the design is left unchanged",
)


def timing_notice(timing: DriveTiming, quantity: str) -> Notice:
    """Return what was undone of the drive signal, and that the log does not tell it from a delay where it does not.

    Parameters
    ----------
    timing : DriveTiming
        With a filter, or not sure.
    quantity : str
        The word for what drives the axis: torque or force.
    """
    if timing.sure:
        return DRIVE_FILTERED(quantity=quantity, lag=1e3 * timing.lag)
    if timing.delay < 0.0:
        return DRIVE_AHEAD(quantity=quantity, ahead=-1e3 * timing.delay)
    return DRIVE_LATE(quantity=quantity, delay=1e3 * timing.delay)


def sampling_text(
    timing: DriveTiming, quantity: str, stderr: float = 0.0, lacking: bool = False
) -> str | None:  # fmt: skip
    """Return how the drive signal was sampled; None where it was in time with the position, as far as the log tells.

    Parameters
    ----------
    timing : DriveTiming
    quantity : str
        The word for what drives the axis: torque or force.
    stderr : float
        Standard error of the delay, s; 0 where it is not known.
    lacking : bool
        Whether the model leaves more than noise: what it lacks is met by another time as well.
    """
    late, lag, error = 1e3 * timing.late, 1e3 * timing.lag, 1e3 * stderr
    parts = [f"was filtered, time constant {lag:.3g} ms"] if lag >= SHOWN_MS else []
    if abs(late) >= max(SHOWN_MS, SURELY * error):
        size = with_error(abs(late), error) if error > 0.0 else f"{abs(late):.3g}"
        parts.append(f"is {size} ms {'later' if late > 0.0 else 'earlier'} than the position")
    doubt = "; an effect that the model lacks may look like it" if lacking else ""
    return f"Sampling: the {quantity} {' and '.join(parts)} (corrected{doubt})." if parts else None
