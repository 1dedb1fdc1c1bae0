"""The thresholds of a fleet's answers, each with its reason; those of changes over time are in `evidence.trends`."""

from __future__ import annotations

__all__ = ["OUTLYING", "REPEATED"]

# Records that have to show an effect, where an axis has as many: what happened once is no property of an axis.
REPEATED = 2

# Modified z-score from which an axis is unlike the others. Source: B. Iglewicz, D. C. Hoaglin, How to Detect and Handle
# Outliers, ASQC (1993), p. 11.
OUTLYING = 3.5
