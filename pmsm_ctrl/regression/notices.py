"""What is to be said of a log that was made ready for an evaluation."""

from __future__ import annotations

from pmsm_ctrl.section import Template

__all__ = [
    "COARSE_ANGLE", "DEAD_VOLTAGES", "EQUAL_STEPS", "GAPS", "MEASUREMENT_EFFECT_LEFT_IN", "NO_REGRESSION", "RESAMPLED",
    "SPEED_FOR_COARSE_ANGLE", "TORQUE_JUMPS",
]  # fmt: skip

COARSE_ANGLE = Template(
    "coarse_angle",
    "theta was written with few digits, in steps of up to {step:.2g} {unit}: what depends on the acceleration is not "
    "to be trusted; write more digits",
)
SPEED_FOR_COARSE_ANGLE = Template(
    "speed_for_coarse_angle",
    "theta was written with few digits, in steps of up to {step:.2g} {unit}: the speed is used in its place; write "
    "more digits",
)
DEAD_VOLTAGES = Template("dead_voltages", "{channels} zero throughout: left out")
EQUAL_STEPS = Template(
    "equal_steps",
    "time stamps jitter by up to {jitter:.1f} % of a period, and the motion does not: taken at equal steps",
)
RESAMPLED = Template("resampled", "time stamps jitter by up to {jitter:.1f} % of a period: resampled at {rate:.6g} Hz")
GAPS = Template("gaps", "{count} gap(s) in time, {seconds:.3g} s in all, left out")
TORQUE_JUMPS = Template(
    "torque_jumps", "the torque jumps between samples ({percent:.2g} % of them): those moments are left out"
)
MEASUREMENT_EFFECT_LEFT_IN = Template(
    "measurement_effect_left_in", "{effect} is not corrected: the log lacks a channel that its term reads"
)
NO_REGRESSION = Template(
    "no_regression", "{effect} has a state of its own and takes no part in the regression: use method 'output_error'"
)
