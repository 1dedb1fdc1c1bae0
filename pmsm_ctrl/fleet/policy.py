"""The thresholds of a fleet's answers, each with its reason."""

from __future__ import annotations

__all__ = ["FALSE_DISCOVERIES", "FEWEST_RECORDS", "LOCATION", "OUTLYING", "REPEATED"]

# Expected share of false ones among the axes that are named. Source of the procedure: Y. Benjamini, Y. Hochberg,
# J. R. Stat. Soc. B 57 (1995) 289.
FALSE_DISCOVERIES = 0.05

# Records that have to show an effect, where an axis has as many: what happened once is no property of an axis.
REPEATED = 2

# Records from which a trend or a change is judged: two parameters leave two degrees of freedom.
FEWEST_RECORDS = 4

# Quantile 0.95 of the likelihood ratio of the place of a change, -2 ln(1 - sqrt(0.95)).
# Source: B. E. Hansen, Econometrica 68 (2000) 575, table I.
LOCATION = 7.352

# Modified z-score from which an axis is unlike the others. Source: B. Iglewicz, D. C. Hoaglin, How to Detect and Handle
# Outliers, ASQC (1993), p. 11.
OUTLYING = 3.5
