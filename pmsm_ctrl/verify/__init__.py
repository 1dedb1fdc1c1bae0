"""Does a downloaded compensator act: gain, delay and part of friction, and the quadrant error, from logs."""

from pmsm_ctrl.verify import present as _present  # noqa: F401 - registers the section
from pmsm_ctrl.verify.quadrants import Circle, QuadrantError, quadrants
from pmsm_ctrl.verify.result import Outcome, Verification
from pmsm_ctrl.verify.verify import verify

__all__ = ["Circle", "Outcome", "QuadrantError", "Verification", "quadrants", "verify"]
