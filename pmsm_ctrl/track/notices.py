"""The words of every notice of a tracking."""

from __future__ import annotations

from pmsm_ctrl.section import Template

__all__ = [
    "CHANGED", "CHANGING", "CONSTANT_SPEED", "EFFECT_LEFT_OUT", "INCONSISTENT", "MEASUREMENT_EFFECT_IN_STREAM",
    "NOT_EXCITED", "NOT_MOVED", "ONE_DIRECTION", "REJECTED", "STREAM_CLOCK", "STREAM_LOST", "STREAM_REOPENED",
    "UNDERSAMPLED", "UNMODELLED_TORQUE",
]  # fmt: skip

EFFECT_LEFT_OUT = Template(
    "effect_left_out", "{effect} is not modelled: the tracker cannot evaluate it from the motor's signals alone"
)
MEASUREMENT_EFFECT_IN_STREAM = Template(
    "measurement_effect_in_stream",
    "{effect} is not corrected: a single sample does not tell it; `track` corrects a log",
)
NOT_MOVED = Template("not_moved", "the axis never moved long enough: the estimates are the design's values")
UNMODELLED_TORQUE = Template(
    "unmodelled_torque",
    "the {drive} noise is {factor:.2g} times that of the sensors: the log contains {drive} that the design does not "
    "model; the error bands cover its size, not its shape{remedy}",
)
UNDERSAMPLED = Template(
    "torque_undersampled",
    "the {drive} scatters by {scatter:.2g} {unit} from sample to sample, {times:.2g} times F_c and {louder:.2g} times "
    "the sensors' noise: the speed loop answers the encoder's steps faster than the log samples that, and a sample is "
    "no mean; F_c and J may be off by more than their standard errors; log at the speed loop's rate, {rate:g} Hz",
)
INCONSISTENT = Template(
    "inconsistent_innovations",
    "the mean normalised innovation squared is {nis:.2g}, expected 1: the error bands are too {fault}",
)
CONSTANT_SPEED = Template(
    "constant_speed",
    "the speed was constant during {percent:.0f} % of the motion: only the sum F_c + F_v abs(omega) is observable "
    "there, and their ratio was kept",
)
NOT_EXCITED = Template(
    "not_excited", "the log hardly reduces the uncertainty of {state}: the motion does not excite it"
)
ONE_DIRECTION = Template("one_direction", "the axis turns in one direction: T_load and F_c are not separable")
CHANGED = Template("changed_abruptly", "friction or load changed abruptly (changes: {count})")
CHANGING = Template("friction_changed", "friction changed over the stream (alarms: {count})")
REJECTED = Template("measurements_rejected", "measurements rejected as outliers: {count}")
STREAM_LOST = Template(
    "stream_samples_lost",
    "the stream is not whole (samples missing: {lost}, lines damaged: {damaged}, not advancing in time: {repeated})",
)
STREAM_CLOCK = Template("stream_clock_set_back", "the clock of the stream was set back (times: {count}); time goes on")
STREAM_REOPENED = Template("stream_reopened", "the source was opened again (times: {count})")
