"""Thresholds of the comparison: value, unit and reason; set on simulated logs, clean ones above all."""

from __future__ import annotations

__all__: list[str] = []

# -- worst stretches of time -------------------------------------------------------------------------------------

# The running rms is taken over this share of the log, at least and at most so many seconds.
STRETCH_SHARE, STRETCH_SHORTEST, STRETCH_LONGEST = 1 / 60, 0.2, 2.0
# A stretch reaches as far as the running rms stays above this share of its peak.
EXTENT = 0.7
# Least rms of a stretch over that of the whole log.
STANDS_OUT = 1.25
# A speed that varies by less than this share of its mean is constant; below this share of the fast one the axis rests.
CONSTANT, AT_REST = 0.1, 0.002

# -- the verdict -------------------------------------------------------------------------------------------------

# Least share of the torque's mean square that a design explains. With less, most of the torque is something else.
EXPLAINED = 0.5
# -- simulation --------------------------------------------------------------------------------------------------

# Time between two restarts of the free run, s.
WINDOW = 0.5
# A longer log is simulated in closed loop only so far, s.
LONGEST = 120.0
