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
    "the first log holds {gain:.0%} of this feedforward already: the gain is what the second one has more",
)
RETUNED = Template(
    "verify_retuned",
    "the gains of the controller differ between the logs: each has its own law, and the tracking errors also changed "
    "by them",
)
UNEXPLAINED = Template(
    "verify_unexplained_law",
    "position, speed and their references explain {share:.0%} of the varying current only: the channels do not belong "
    "together, or the controller has a form that is not known here",
)
NOT_TOLD = Template(
    "verify_part_not_told",
    "this motion does not tell the gain of '{effect}' apart ({gain}): it makes {share:.0%} of the compensated current",
)
PART_MISSING = Template(
    "verify_part_missing",
    "'{effect}' was not applied (gain {gain}); in this motion it makes {share:.1%} of the compensated current",
)
OTHER_CHANNEL = Template(
    "verify_behind_reference",
    "the logged current reference does not hold the feedforward, the measured current does: it is added behind the "
    "logged reference",
)
LESS_GAINED = Template(
    "verify_less_gained",
    "the {what} error fell by {measured:.0%}, the simulated drive promised {promised:.0%}: the friction of the axis is "
    "not the design's",
)
NO_PROMISE = Template(
    "verify_no_promise",
    "the drive cannot be simulated on this motion, so that nothing is promised: it needs loops, winding data and a "
    "log with its reference",
)
CROPPED = Template("verify_cropped", "only the first {count} samples of each log were evaluated")
CLIPPED = Template("verify_current_limit", "{share:.1%} of the samples are at the current limit and were left out")
NO_SPIKE = Template(
    "quadrants_no_spike",
    "the largest deviation behind a reversal ({spike:.2g} {unit}) is not three times that elsewhere ({rest:.2g} {unit} "
    "rms): there is no spike to speak of",
)
OTHER_CIRCLE = Template(
    "quadrants_other_circle", "radius or speed of the two circles differ by {share:.0%}: the spikes depend on both"
)
