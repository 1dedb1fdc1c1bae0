"""The words of every notice about a downloaded compensator."""

from pmsm_ctrl.section import Template

OTHER_MOTION = Template(
    "verify_other_motion",
    "the two logs do not hold the same motion: their tracking errors cannot be compared; the gain can",
)
NO_REST = Template(
    "verify_no_rest",
    "the reference does not rest for 1.3 s in the second log: a limit cycle at rest would not be seen",
)
HUNTED_BEFORE = Template(
    "verify_cycle_before",
    "the axis has a limit cycle at rest in the first log already ({amplitude:.2g} {unit} at {frequency:.3g} Hz)",
)
BEFORE = Template(
    "verify_acts_before",
    "the first log already contains this feedforward, with a gain of {gain:.2f}: the gain stated is the difference of "
    "the two logs",
)
RETUNED = Template(
    "verify_retuned",
    "the controller gains differ between the logs: the control law is fitted to each log, and the change of the "
    "tracking error is partly due to these gains",
)
UNEXPLAINED = Template(
    "verify_unexplained_law",
    "position, speed and their references explain only {share:.0%} of the varying current: the channels do not belong "
    "together, or the structure of the controller is not supported",
)
ROUNDED = Template(
    "verify_rounded_error",
    "the logs hold the error of the controller at {rate:.4g} Hz, and not in every cycle of the speed loop: its "
    "integral is not separable from the feedforward",
)
BEFORE_NOT_TOLD = Template(
    "verify_before_not_told",
    "by the measured current, this feedforward is found in the first log already, with a gain of {gain:.2f}: it acts "
    "there, or it is an error of the integrator's part; the gain stated is uncertain by as much",
)
NOT_TOLD = Template(
    "verify_part_not_told",
    "the gain of '{effect}' is not separable on this motion ({gain}): it contributes {share:.0%} of the compensated "
    "current",
)
SMOOTHED = Template(
    "verify_smoothed_sign",
    "the drive smooths the sign of the speed over {width} {unit} ({shape}; the design: {stated:.3g} {unit}); the gain "
    "is stated with that smoothing",
)
SMOOTHING_NOT_TOLD = Template(
    "verify_smoothing_not_told",
    "the drive smooths the sign of the speed over {width:.2g} {unit} or more, beside {peak:.2g} {unit} of this motion: "
    "the gain is not separable from the smoothing; a faster motion is needed",
)
PART_IMPLAUSIBLE = Template(
    "verify_part_implausible",
    "the fitted gain of '{effect}' ({gain}) does not belong to one download with the others ({total:.2g} in all): the "
    "drive forms its feedforward otherwise than assumed, or reads this value in another unit; no factor is advised",
)
PART_MISSING = Template(
    "verify_part_missing",
    "'{effect}' was not applied (gain {gain}); in this motion it contributes {share:.1%} of the compensated current",
)
OTHER_CHANNEL = Template(
    "verify_behind_reference",
    "the measured current contains the feedforward, the logged current reference does not: the drive adds it after the "
    "point at which the reference is logged",
)
LESS_GAINED = Template(
    "verify_less_gained",
    "the {what} error fell by {measured:.0%}, and by {promised:.0%} in simulation: the friction of the axis differs "
    "from the design's",
)
NO_PROMISE = Template(
    "verify_no_promise",
    "the drive cannot be simulated on this motion, so that there is no predicted error: a simulation needs loops, "
    "winding data and a log with its reference",
)
CROPPED = Template("verify_cropped", "only the first {count} samples of each log were evaluated")
CLIPPED = Template("verify_current_limit", "{share:.1%} of the samples are at the current limit and were left out")
NO_SPIKE = Template(
    "quadrants_no_spike",
    "the largest deviation behind a reversal ({spike:.2g} {unit}) is not three times that elsewhere ({rest:.2g} {unit} "
    "rms): there is no significant spike",
)
OTHER_CIRCLE = Template(
    "quadrants_other_circle", "radius or speed of the two circles differ by {share:.0%}: the spikes depend on both"
)
