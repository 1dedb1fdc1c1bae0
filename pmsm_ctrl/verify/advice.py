"""What to change in the drive, in one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pmsm_ctrl.verify import notices as words
from pmsm_ctrl.verify.result import Outcome, Verification

__all__ = ["advice_of"]


def advice_of(found: Verification, missing: Sequence[str]) -> Verification:
    """Return the result with the sentence that says what to change.

    Parameters
    ----------
    found : Verification
    missing : sequence of str
        Effects that were not applied.
    """
    gain, expected = found.gain.value, found.expected
    late = found.delay.value if found.delay is not None else 0.0
    match found.verdict:
        case Outcome.APPLIED:
            text = "Nothing: the drive applies the feedforward of the design."
        case Outcome.PARTLY_APPLIED:
            text = (f"Download the part that is missing ({', '.join(missing)}): the drive's field for it is empty, or "
                    "in another unit.")  # fmt: skip
        case Outcome.NOT_APPLIED:
            text = ("Switch the compensation on and check that its values were stored: the drive adds nothing that "
                    "resembles it.")  # fmt: skip
        case Outcome.WRONG_SIGN:
            text = "Switch it off and reverse the sign: it acts against the motion."
        case Outcome.WRONG_GAIN:
            text = (f"Multiply the drive's values by {expected / gain:.3g}: they act {gain / expected:.3g} times as "
                    "strongly as the design says (a unit, peak or rms, per mille of another rated value).")  # fmt: skip
        case Outcome.LATE:
            text = (f"Feed it forward {1e3 * late:.3g} ms earlier (look-ahead, a faster task, or no filter behind it): "
                    "at every reversal the friction is missing for that time.")  # fmt: skip
        case Outcome.LIMIT_CYCLE:
            text = (f"Lower the gain at once: a limit cycle at rest of {found.after.cycle_frequency:.3g} Hz has begun; "
                    "`pmsm-ctrl compensate` finds the highest safe gain.")  # fmt: skip
        case _ if wanted := _wanted(found):
            text = f"Log the same motion again {wanted}: these logs advise no factor."
        case _ if found.implausible:
            text = (f"Check how the drive forms its feedforward, and the unit of {', '.join(found.implausible)}; these "
                    "logs advise no factor.")  # fmt: skip
        case _:
            text = ("Log the same motion again with several reversals and with position and speed references, and both "
                    "logs with the same controller gains.")  # fmt: skip
    return replace(found, advice=text)


def _wanted(found: Verification) -> str:
    """Return how to log so that the integrator's part is known; empty where it is not in doubt."""
    said = {one.code for one in found.notices}
    ways = ["at the rate of the speed loop"] if words.ROUNDED.code in said else []
    # a drive that adds its feedforward behind the current reference has that in the log already
    if words.BEFORE_NOT_TOLD.code in said and words.OTHER_CHANNEL.code not in said:
        ways.append("with the current reference beside the measured current")
    return " and ".join(ways)
