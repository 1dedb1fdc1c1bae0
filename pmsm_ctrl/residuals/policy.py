"""Thresholds of what a residual depends on: value, unit and reason; set on simulated logs, clean ones above all."""

from __future__ import annotations

import math

__all__: list[str] = []

# -- what a residual depends on ----------------------------------------------------------------------------------

# Family-wise significance, by Holm.
SIGNIFICANCE = 0.01
# Standard errors by which the cross-validation gain must exceed zero; fewer are enough where the F-test leaves no
# doubt, for a block left out takes the ends of a curve with it. On 134 clean logs no curve that explains a
# hundredth of the residual had a p-value below 7e-7.
SURE, SURE_IF_CERTAIN, CERTAIN = 2.8, 2.0, 1e-12
# Least size of a curve as a share of the measured channel; a model of the voltage is not as good.
SIZE, VOLTAGE_SIZE = 0.004, 0.02
# Least share of the residual's mean square: aliased edges of the torque make up to 3 %.
SHARE = 0.05
# Of two coordinates that explain the same to within this share, the simpler is named.
ALIKE = 0.97
# Most coordinates that are named.
MOST = 3
# Periods of the cutoff around a reversal that are left out.
REVERSAL = 2.0
# Periods of the cutoff that are left out on either side of a block of the cross-validation, at least.
GAP = 4.0
# Share of what is left that a single wave has to explain.
MOST_OF_IT = 0.5
# A direction that holds less than this share of the samples has no curve of its own.
ONE_WAY = 0.03
# Share of its greatest height above which a curve counts as large.
LARGE = 0.7

# -- the acceleration as a coordinate ----------------------------------------------------------------------------

# Share of the cutoff above which nearly all of a twice differentiated angle is noise.
SLOW = 0.25
# Share of the fast acceleration that the torque must confirm for it to be taken.
CONFIRMED = 0.7
# Times the noise of the torque over the inertia: by less the drive's own noise changes the acceleration.
PLAY = 3.0

# -- orders of a turn --------------------------------------------------------------------------------------------

# Highest mechanical order that is looked for, and most orders that are named.
HIGHEST_ORDER, MOST_ORDERS = 120, 4
# Samples from which an order is judged, at least.
FEWEST = 100
# Periods of an order that are seen at different angles of a turn, at least, where not all samples are slow enough for
# it: fewer are any smooth function.
PERIODS = 2
# Least score of a further order, and as a share of the first one's.
ORDER_SCORE, ORDER_SHARE = 30.0, 0.04

# rad: less than this on the way is a turn, and has orders; of the strongest waves over the way, one may be longer.
SEVERAL_TURNS, STRONGEST = 2.5 * math.pi, 24

# -- beside what it depends on -----------------------------------------------------------------------------------

# Residual over its noise floor from which on it is more than noise although no curve is significant; the model of a
# voltage, its age and its frame are not fitted here and never as good. Clean logs of three simulators.
ABOVE_FLOOR, VOLTAGE_ABOVE_FLOOR = 1.5, 5.0
# Weight of a sample, of at most 1, from which on its residual is judged where a fit has weighed edges and reversals
# lightly: what is left there is no noise, and no lack of the model.
SOUND = 0.5
