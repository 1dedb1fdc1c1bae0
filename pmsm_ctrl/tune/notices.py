"""The words of the reasons to doubt a tuning."""

from pmsm_ctrl.section import Template

__all__ = ["CHECK", "CORNER", "ENCODER", "FILTER", "MARGIN", "NO_FILTER", "POINT", "RIPPLE", "SLOWED", "VOLTAGE"]

MARGIN = Template("margin_missed", "{loop} loop: {missed}")
CORNER = Template("margin_missed_at_corner", "{loop} loop, worst corner of the tolerances ({corner}): {missed}")
POINT = Template("margin_missed_at_point", "speed loop at {speed:.3g} {per_second} and {load:.3g} {torque}: {missed}")
SLOWED = Template(
    "slowed_by_resonance", "resonance at {resonance:.4g} Hz: the speed loop was slowed down to run without a filter"
)
NO_FILTER = Template(
    SLOWED.code,
    SLOWED.words + "; no notch and no low-pass keeps the requirements with the stiffness and the inertias of motor and "
    "load at the ends of their tolerances",
)
FILTER = Template(
    SLOWED.code,
    SLOWED.words
    + "; the best filter, a {kind} at {frequency:.4g} Hz, keeps the requirements at {crossover:.3g} Hz also "
    "with the stiffness and the inertias of motor and load at the ends of their tolerances; without a filter they are "
    "kept {how} at {unfiltered:.3g} Hz, and with such a load at {plain:.3g} Hz",
)
RIPPLE = Template(
    "encoder_ripple",
    "the encoder resolution causes {ripple:.3g} mA rms of current ripple, more than {share:g} % of the current limit; "
    "filter the speed or reduce the bandwidth",
)
VOLTAGE = Template(
    "limited_by_voltage",
    "the current loop is {factor:.3g} times slower than the rule: at full bandwidth a step of 5 % of the current limit "
    "would need more than the voltage",
)
ENCODER = Template(
    "limited_by_encoder",
    "the speed loop is {factor:.3g} times slower than the rule: at full bandwidth the counts of the encoder would take "
    "more than a tenth of the current",
)
CHECK = Template(
    "check_failed",
    "check in simulation failed: {subject}, {quantity}: predicted {predicted:.4g} {unit}, simulated {simulated:.4g} "
    "{unit}, cause not found",
)
