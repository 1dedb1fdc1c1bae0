"""The words of every notice of the frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pmsm_ctrl.frf.result import NO_EXCITATION as NOT_TO_BE_TAKEN
from pmsm_ctrl.frf.result import NOT_LINEAR as OF_NO_AXIS
from pmsm_ctrl.section import Notice, Template

if TYPE_CHECKING:
    from pmsm_ctrl.frf.from_bode import MeasuredBode

REVERSES = Template(
    "frf_axis_reverses",
    "the axis reverses while it is excited: Coulomb friction then acts like damping that falls with the amplitude, and "
    "the friction slope holds for this amplitude only; excite around a constant speed",
)
NO_REFERENCE = Template(
    "frf_no_reference",
    "the log has no reference that follows the excitation: noise of the measured {quantity} makes the response too "
    "small, by about {bias:.1%} where the {quantity} is weakest; log i_q_ref as well",
)
NO_EXCITATION = Template(
    NOT_TO_BE_TAKEN,
    "{why}: inertia, delay and resonance of the fitted axis are not to be taken; `simulate --scenario multisine` shows "
    "a motion that excites the axis; `identify` takes the inertia from a log like this one",
)
NOT_LINEAR = Template(
    OF_NO_AXIS,
    "the residual of the fitted axis is {misfit:.2g} times the noise, and {why}: inertia, delay and resonance of the "
    "fitted axis are not to be taken, nor their standard errors; excite around a constant speed, at which the axis "
    "keeps its direction: `simulate --scenario multisine` shows such a motion",
)
NOISE_ANSWERED = Template(
    "frf_noise_answered",
    "the response above {frequency:.4g} Hz is left out, because its phase is not that of a passive axis: the "
    "controller responds to noise of the measured speed, or the channels are more than two log periods apart",
)
FOLDED = Template(
    "frf_excitation_beyond_log",
    "{percent:.2g} % of the power of {channel} lies above {highest:.4g} Hz, near half the log's rate of {rate:.4g} Hz: "
    "what the current holds beyond folds onto the response, which can bias inertia and delay by far more than their "
    "errors; log in every period of the speed loop, or excite below {highest:.4g} Hz",
)
COARSE = Template(
    "frf_resolution_coarse",
    "the resolution of {resolution:.2g} Hz is too coarse: it changes the {parameter} by {bias:+.2g} %, which is "
    "{errors:.2g} times its standard error; log longer",
)
MISFIT = Template(
    "frf_misfit",
    "the residual of the fitted axis is {misfit:.2g} times the noise: the response has more than one resonance, or the "
    "friction is not linear; standard errors are multiplied by this factor",
)
INERTIA = Template(
    "frf_inertia_deviates",
    "the {quantity} is {found} {unit}; the design states {design:.4g} {unit} ({share:+.1%})",
)
NEW_RESONANCE = Template(
    "frf_resonance_not_in_design",
    "an antiresonance at {antiresonance} Hz and a resonance at {resonance} Hz are not in the design: it lacks a "
    "compliance",
)
OTHER_RESONANCE = Template(
    "frf_resonance_deviates",
    "the resonance is at {found} Hz; that of the design is at {design:.4g} Hz",
)
NO_RESONANCE = Template(
    "frf_resonance_not_seen",
    "the measured response does not show the design's resonance at {design:.4g} Hz",
)
LATE = Template(
    "frf_delay",
    "the speed lags the torque by {found} ms: the channels are not sampled together, or one of them is filtered",
)
BODE_DOUBT = Template("frf_file_interpreted", "{file}: {doubt}")


def taken(given: MeasuredBode) -> list[Notice]:
    """Return what was found from the numbers of a measured Bode diagram and not stated."""
    return [BODE_DOUBT(file=given.file, doubt=doubt) for doubt in given.doubts]
