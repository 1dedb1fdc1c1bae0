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
    SLOWED.words + "; no notch and no low-pass keeps the requirements over the tolerances of the stiffness and of the "
    "inertias of motor and load",
)
FILTER = Template(
    SLOWED.code,
    SLOWED.words + "; over the tolerances of stiffness and inertias the requirements are kept up to a crossover of "
    "{crossover:.3g} Hz "
    "with the best filter, a {kind} at {frequency:.4g} Hz, and up to {plain:.3g} Hz without one; the gains chosen "
    "without a filter keep them {how} at {unfiltered:.3g} Hz",
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
    "the speed loop is {factor:.3g} times slower than the rule: at full bandwidth the encoder resolution would cause "
    "a current ripple of more than a tenth of the current",
)
CHECK = Template(
    "check_failed",
    "check in simulation failed: {subject}, {quantity}: predicted {predicted:.4g} {unit}, simulated {simulated:.4g} "
    "{unit}, cause not found",
)
