"""Tracking: F_c and F_v while the axis runs, by a Kalman filter. filterpy lives here and nowhere else."""

from pmsm_ctrl.track import present  # noqa: F401 - registers what a tracking says
from pmsm_ctrl.track.alarms import Alarm
from pmsm_ctrl.track.live import FrictionTracker, Reading
from pmsm_ctrl.track.result import Tracking
from pmsm_ctrl.track.settings import Settings
from pmsm_ctrl.track.tracking import track
from pmsm_ctrl.track.watching import Watched, watch

__all__ = ["Alarm", "FrictionTracker", "Reading", "Settings", "Tracking", "Watched", "track", "watch"]
