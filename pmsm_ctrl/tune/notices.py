"""The words of the reasons to doubt a tuning."""

from pmsm_ctrl.section import Template

__all__ = ["CHECK", "CORNER", "ENCODER", "FILTER", "MARGIN", "POINT", "RIPPLE", "SLOWED", "VOLTAGE"]

MARGIN = Template("margin_missed", "{loop} loop: {missed}")
CORNER = Template("margin_missed_at_corner", "{loop} loop, worst corner of the tolerances ({corner}): {missed}")
POINT = Template("margin_missed_at_point", "speed loop at {speed:.3g} {per_second} and {load:.3g} {torque}: {missed}")
SLOWED = Template(
    "slowed_by_resonance", "resonance at {resonance:.4g} Hz: the speed loop was slowed down to run without a filter"
)
FILTER = Template(
    SLOWED.code,
    SLOWED.words + "; a {kind} at {frequency:.4g} Hz meets the requirements at {crossover:.3g} Hz also with "
    "the stiffness and the inertias of motor and load at the ends of their tolerances; without it {plain:.3g} Hz",
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
