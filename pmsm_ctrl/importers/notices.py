"""Reasons to doubt a log, in words: what `check` finds, by code."""

from __future__ import annotations

from pmsm_ctrl.section import Template

__all__ = [
    "ANGLE_UNWRAPPED", "ANGLE_WRAPS", "CHANNEL_WITHOUT_NUMBERS", "CHANNEL_WITHOUT_TIME", "COLUMN_WITHOUT_TIME",
    "COLUMN_WITH_GAPS", "CONSTANT_CHANNEL", "CURRENT_BEYOND_LIMIT", "FEW_DIGITS", "FEW_SAMPLES", "FROM_PHYSICS",
    "FROZEN_CHANNEL", "HEADER_PERIOD", "HELD_CHANNEL", "IRREGULAR_TIME", "NOT_READABLE", "NO_RATE", "OTHER_UNIT",
    "PEAK_OR_RMS", "POSITION_JUMPS", "QUANTISED_CHANNEL", "RATED_FROM_INERTIA", "RATED_UNKNOWN", "RATE_FROM_MOTION",
    "REFERENCE_FACTOR", "SATURATED_CHANNEL", "SEVERAL_COLUMNS", "SPEED_FACTOR", "SPEED_LEADS", "SPEED_SPIKES",
    "SPEED_UNRELATED", "TIME_GAPS", "TORQUE_FACTOR", "TORQUE_SIGN", "TORQUE_UNRELATED", "TWO_COLUMNS_FIT",
    "UNIT_ASSUMED", "UNLIKELY_INERTIA", "UNLIKELY_PERIOD", "UNSURE_NAME", "UNUSABLE",
]  # fmt: skip

# -- time ----
FEW_SAMPLES = Template("few_samples", "too few samples: {count}")
IRREGULAR_TIME = Template(
    "irregular_time",
    "time stamps jitter by {rms_ms:.3g} ms rms, {largest_ms:.3g} ms at most, around a period of {period_ms:.4g} ms",
)
HEADER_PERIOD = Template(
    "header_period", "the header says '{line}', and the time of the log has steps of {period_ms:.6g} ms"
)
TIME_GAPS = Template("time_gaps", "gaps in the time stamps: {count}, the longest {longest_ms:.4g} ms at t = {at:.6g} s")
UNLIKELY_PERIOD = Template("unlikely_period", "sampling period of {period:.3g} s: check the unit of time")

# -- single channels ----
COLUMN_WITH_GAPS = Template(
    "column_with_gaps",
    "'{column}' would be {channel}, and cells of it hold no number: {count}, first {place}; fill them in, or cut "
    "the file",
)
COLUMN_WITHOUT_TIME = Template(
    "column_without_time",
    "'{column}' would be {channel}, and has {count} samples, as many as no time: export it with its time, or as long "
    "as the others",
)
# of a column that a log needs, and that no mapping makes usable
UNUSABLE = (COLUMN_WITH_GAPS.code, COLUMN_WITHOUT_TIME.code)
CHANNEL_WITHOUT_NUMBERS = Template(
    "channel_without_numbers", "{channel} is left out: cells without a number: {count}, first {place}"
)
CHANNEL_WITHOUT_TIME = Template(
    "channel_without_time",
    "{channel} is left out: column '{column}' has {count} samples, and no time has as many",
)
CONSTANT_CHANNEL = Template("constant_channel", "{channel} is constant ({value:.6g} {unit})")
SATURATED_CHANNEL = Template(
    "saturated_channel", "{channel} is at its limit of {limit:.4g} {unit} in {percent:.2g} % of the samples"
)
CURRENT_BEYOND_LIMIT = Template(
    "current_beyond_limit",
    "i_q reaches {factor:.3g} times the design's i_max: {cause}",
)
QUANTISED_CHANNEL = Template(
    "quantised_channel",
    "{channel} is quantised to {step:.4g} {unit}, {percent:.2g} % of its standard deviation",
)
FEW_DIGITS = Template(
    "few_digits",
    "theta was written with few digits: its resolution falls with its size, to {step:.2g} {unit}; export more digits, "
    "or the angle within one turn",
)

# -- lost samples ----
ANGLE_WRAPS = Template(
    "angle_wraps",
    "{channel} jumps by about {size:.4g} {unit} {count} times, first at t = {at:.6g} s: it may wrap there{turn}",
)
ANGLE_UNWRAPPED = Template(
    "angle_unwrapped", "{channel} wraps at {period:.6g} {unit} ({count} times) and not at a turn: unwrapped"
)
POSITION_JUMPS = Template(
    "position_jumps",
    "{channel} jumps by {size:.4g} {unit}, first at t = {at:.6g} s (jumps: {count}): lost samples or encoder counts",
)
SPEED_SPIKES = Template(
    "speed_spikes",
    "omega spikes to {value:.4g} {unit}, first at t = {at:.6g} s (spikes: {count}), faster than any inertia allows: "
    "lost samples or encoder counts",
)
FROZEN_CHANNEL = Template(
    "frozen_channel",
    "{channel} is frozen at {value:.4g} {unit} for {duration:.4g} s from t = {at:.6g} s{more}: lost samples",
)
HELD_CHANNEL = Template(
    "held_channel", "{channel} is held for {periods} samples ({held_ms:.3g} ms): it was recorded at a lower rate"
)

# -- one channel against another ----
SPEED_UNRELATED = Template("speed_unrelated", "omega is not proportional to dtheta/dt")
SPEED_MAGNITUDE = Template(
    "speed_magnitude", "omega never changes its sign, although theta goes both ways: it contains magnitudes"
)
SPEED_LEADS = Template(
    "speed_leads",
    "omega leads dtheta/dt by {lead_ms:.3g} ms, which a measured speed does not: it may be the reference, or theta is "
    "late",
)
SPEED_FACTOR = Template("speed_factor", "dtheta/dt is {factor:.4g} times omega{cause}")
REFERENCE_FACTOR = Template("reference_factor", "omega is {factor:.4g} times omega_ref{cause}")
TORQUE_UNRELATED = Template("torque_unrelated", "torque is not proportional to K_t i_q (correlation {correlation:.2f})")
TORQUE_FACTOR = Template("torque_factor", "torque is {factor:.4g} times K_t i_q{cause}")
PEAK_OR_RMS = Template(
    "peak_or_rms",
    "i_q ('{column}') is read as A peak, and nothing states that it is not A rms, which makes torque, inertia and "
    "friction 1.41 times as large: --map i_q='{name} [A rms]', or [A peak]{hint}",
)
OTHER_UNIT = Template(
    "other_unit",
    "{channel}: the file states [{file}], the design's [log] table [{design}]; that of the file was taken, as of a log "
    "in SI units: --map '{mapping}' where the design is right",
)
TORQUE_SIGN = Template(
    "torque_sign", "{channel} has the opposite sign of the acceleration: one of the two sign conventions is wrong"
)
UNLIKELY_INERTIA = Template(
    "unlikely_inertia",
    "{channel} over acceleration gives an inertia of {inertia:.3g} {unit}, {factor:.3g} times the design's J",
)

# -- a proposed mapping ----
UNIT_ASSUMED = Template("unit_assumed", "units that the file does not state were assumed: {units}")
SEVERAL_COLUMNS = Template(
    "several_columns", "{channel}: {count} columns are named so; '{column}' is taken and '{other}' is not"
)
TWO_COLUMNS_FIT = Template(
    "two_columns_fit",
    "{channel}: '{column}' is taken, '{other}' fits as well, and nothing tells which of them is measured: "
    "--map {channel}='{other}' takes the other one",
)
UNSURE_NAME = Template("unsure_name", "'{column}' is taken for {channel}: {reason}")
FROM_PHYSICS = Template("from_physics", "{columns}: taken for {what} by the numbers alone; the names do not state it")
NO_RATE = Template(
    "no_rate", "{what}, and no column gives the rate: state it, with --rate 1000 or rate = 1000 in [log]"
)
RATE_FROM_MOTION = Template(
    "rate_from_motion",
    "{what}: a rate of {rate:.6g} Hz follows from position and speed, and is as uncertain as their units",
)
RATED_UNKNOWN = Template(
    "rated_unknown", "{channel} ('{column}') is a share of a rated value that the file does not state"
)
RATED_FROM_INERTIA = Template(
    "rated_from_inertia",
    "{channel} ('{column}') is a share of a rated value that the file does not state: [{unit}] makes the inertia that "
    "of the design; take the value of the data sheet where there is one",
)
NOT_READABLE = Template("not_readable", "with this mapping the file is refused: {reason}")
