"""The notices of the examination of a log, by code."""

from __future__ import annotations

from pmsm_ctrl.section import Template

__all__ = [
    "CLIPPED_CHANNEL", "CURRENTS_SWAPPED", "CURRENT_FACTOR", "CURRENT_FILTERED", "CURRENT_OFFSET", "CURRENT_SIGN",
    "CUT_IN_TIME", "EVEN_STAMPS", "INERTIA_FACTOR", "LOST_SAMPLES", "MAGNITUDE_CHANNEL",
    "MOTION_FACTOR", "MOTION_SIGN", "NOT_SYNCHRONOUS", "PARAMETER_FACTOR", "POLE_PAIRS", "REFERENCE_AS_MEASURED",
    "STATIONARY_CURRENTS", "TIME_FACTOR", "UNRELATED_TORQUE", "VOLTAGES_SWAPPED", "VOLTAGE_FACTOR", "VOLTAGE_SIGN",
]  # fmt: skip

# -- log and design do not belong together ----
CURRENT_SIGN = Template(
    "current_sign",
    "{channel} and the acceleration disagree in sign: map {channel} as '-COLUMN'{other}",
)
MOTION_SIGN = Template(
    "motion_sign",
    "{channel} has the opposite sign of current and voltages: the encoder counts backwards; map it as '-COLUMN'",
)
VOLTAGE_SIGN = Template(
    "voltage_sign",
    "u_d and u_q have the opposite sign of R i + p psi_f omega: map them as '-COLUMN'",
)
VOLTAGE_FACTOR = Template(
    "voltage_factor",
    "u_d and u_q are {factor:.4g} times what R, psi_f and L of the design require{cause}; map them as "
    "'{inverse:.4g} * COLUMN'",
)
CURRENT_FACTOR = Template(
    "current_factor",
    "{channel} is {factor:.4g} times what the motion requires{cause}; map it as '{inverse:.4g} * COLUMN'",
)
MOTION_FACTOR = Template(
    "motion_factor",
    "{channel} is {factor:.4g} times what torque and voltages require{cause}; map it as '{inverse:.4g} * COLUMN'",
)
TIME_FACTOR = Template(
    "time_factor",
    "the time is {factor:.4g} times what torque and voltages require{cause}; map t as '{inverse:.4g} * COLUMN'",
)
POLE_PAIRS = Template(
    "pole_pairs",
    "the voltages are those of a motor with {found} pole pairs, the design has {p:g}: correct motor.p, or psi_f if p "
    "is right",
)
INERTIA_FACTOR = Template(
    "inertia_factor",
    "torque over acceleration is {factor:.3g} times the design's J{cause}: a wrong unit of the torque, the current, "
    "the motion or the time, or another axis",
)
PARAMETER_FACTOR = Template(
    "parameter_factor",
    "the log requires {factor:.3g} times the design's {parameter}: another motor, or a wrong unit in the design",
)
CURRENTS_SWAPPED = Template(
    "currents_swapped", "i_d and i_q seem to be swapped: i_d drives the motion; swap their columns in the mapping"
)
VOLTAGES_SWAPPED = Template(
    "voltages_swapped", "u_d and u_q seem to be swapped: u_d holds the back-emf; swap their columns in the mapping"
)
STATIONARY_CURRENTS = Template(
    "stationary_currents",
    "i_d and i_q oscillate with the electrical angle: they are currents of the stator frame (alpha, beta); log d and q",
)
CURRENT_OFFSET = Template(
    "current_offset_dc",
    "i_q is {offset:.3g} A too large, in the torque and in R i_q alike: an offset of the sensor, or one added later; a "
    "constant load would show in the torque alone; subtract the offset",
)
UNRELATED_TORQUE = Template(
    "unrelated_torque",
    "{channel} does not drive this motion: it explains {percent:.2g} % of the acceleration torque, and {left:.2g} % of "
    "it is not explained by the motion; it belongs to another axis or another time base, or is noise",
)
MAGNITUDE_CHANNEL = Template(
    "magnitude_channel",
    "{channel} contains magnitudes: its sign never changes, although the motion requires both signs; log the sign",
)
REFERENCE_AS_MEASURED = Template(
    "reference_as_measured", "{channel} is the same as {reference}: the reference was logged as the measured value"
)

# -- doubts ----
NOT_SYNCHRONOUS = Template(
    "not_synchronous",
    "{channel} lags the motion by about {lag_ms:.3g} ms: it is delayed or filtered by the drive, or the channels are "
    "not sampled together",
)
CLIPPED_CHANNEL = Template(
    "clipped_channel",
    "{channel} was clipped at {limit:.4g} {unit} in {percent:.2g} % of the samples: the motion requires more there",
)
CURRENT_FILTERED = Template(
    "current_filtered",
    "{channel} was filtered before it was logged: it lags the torque of the motion as a first-order low-pass with a "
    "time constant of about {lag_ms:.3g} ms",
)
LOST_SAMPLES = Template(
    "lost_samples",
    "samples are missing without a gap in time, about {percent:.2g} % of them: theta advances by two "
    "periods at once; log the time as well, or at a lower rate",
)
CUT_IN_TIME = Template(
    "cut_in_time",
    "{channel} jumps by {size:.4g} {unit} at t = {at:.6g} s: samples are missing there, or the count was reset; the "
    "log is split there",
)
VOLTAGES_IN_STEP = Template(
    "voltages_in_step",
    "u_d and u_q were left out: by them psi_f is {percent:+.2g} % off, and voltages that are sampled every "
    "{period:.3g} ms in step with a held reference show the same; log faster, or state the sampling in [log]",
)

# -- repairs ----
EVEN_STAMPS = Template(
    "even_stamps",
    "time stamps are off by up to {periods:.2g} periods, the motion is not: equal steps at {rate:.6g} Hz are used",
)
