"""Whether a log and a design belong together: signs, units, factors, swapped and foreign channels, the recorder."""

from __future__ import annotations

from pmsm_ctrl.plausibility.examination import examine
from pmsm_ctrl.plausibility.result import Plausibility, Stretch

__all__ = ["Plausibility", "Stretch", "examine"]
