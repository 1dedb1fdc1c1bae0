"""Whether a log and a design belong together: signs, units, factors, swapped and foreign channels, the recorder."""

from __future__ import annotations

from pmsm_ctrl.plausibility.doubts import ACCOUNTED, doubts_about, of_holdout
from pmsm_ctrl.plausibility.examination import examine
from pmsm_ctrl.plausibility.inertia import with_inertia
from pmsm_ctrl.plausibility.result import Plausibility, Stretch

__all__ = ["ACCOUNTED", "Plausibility", "Stretch", "doubts_about", "examine", "of_holdout", "with_inertia"]
