"""Tracking: F_c and F_v while the axis runs, by Kalman filters. filterpy lives here and nowhere else."""

from pmsm_ctrl.track.live import FrictionTracker, Reading
from pmsm_ctrl.track.settings import Settings
from pmsm_ctrl.track.tracking import Tracking, track

__all__ = ["FrictionTracker", "Reading", "Settings", "Tracking", "track"]
