"""Thresholds of `verify`, each with its unit and its reason.

Set on seeds 80000 to 80003 of `tests.benchmarks.downloads`.
"""

from __future__ import annotations

# Probability of the intervals of the gain, of its parts and of the delay.
COVERAGE = 0.95
# Share of the expected gain below which nothing was applied, and above which an error by the integral leaves a delay in
# doubt as well; and share by which a gain is wrong: compensators off by 20 % still remove two thirds of the error
# (docs/compensation.md); a smaller deviation is worth a number, no verdict.
NOTHING, WRONG = 0.1, 0.15
# Half of the interval of the gain, as a share of the expected one, above which the logs tell too little.
VAGUE = 0.3
# Standard error of a part's gain, as a share of the expected one, up to which the gain is separable on a motion.
SEPARABLE_WITHIN = 0.15
# Share of the expected gain below which a part is missing, and above which it is there.
MISSING, THERE = 0.25, 0.5
# Periods of the log by which the delay is uncertain in the errors of the gain at least: samples do not tell less. And
# periods by which logs differ in the reference that stands beside a current: that of the same cycle of the controller,
# of the one before or behind, or of the middle.
RESOLVED, CONVENTION = 0.25, 0.5
# Share that a delay or a sign of the speed must leave of what the first one leaves: below, none is clearer.
CLEARER = 0.999
# Widths of the sign of the speed at which a delay is looked for first, and those that are tried then: shares of the
# highest speed, and how many between the ends. A wider one is a viscous friction in this motion.
FIRST_WIDTHS = (1e-4, 3e-3, 0.02, 0.1)
NARROWEST, WIDEST, WIDTHS = 1e-4, 0.5, 19
# Widths of a hyperbolic tangent, over that of the sign found, by which another shape of it is fitted.
SHAPES = (1.0 / 3.0, 1.0, 3.0, 9.0)
# Share of the highest speed from which on the width of a sign is not told from a viscous friction.
WIDEST_TOLD = 0.4
# Share of the highest speed up to which a reference rests: the digits of a file.
AT_REST = 1e-6
# Standard errors, and expected gains, by which the gain of a part may differ from that of all parts: a drive takes its
# parts from one download. More is an error of what was assumed of the drive.
ODD_ERRORS, ODD = 4.0, 3.0
# Steps between the delays of a grid that are looked at first, of 31; then those like the best are followed.
APART = 5
# Times the delay may move on to the end of what was tried.
MOVES = 4
# Share of the compensated current that a part must make to be missed.
WORTH = 0.1
# s; and periods of the log: a later feedforward leaves a pulse of the friction at every reversal. Drives apply within
# a period of their speed loop, logs of measured currents lag by the current loop: both stay below.
LATE, LATE_PERIODS = 1e-3, 1.0
# s; range of delays that is searched, negative ones are early, and the most steps of it.
EARLIEST, LATEST, STEPS = -0.01, 0.05, 240
# Share of the varying current that the controller's law must explain, and s over which both are averaged for that: the
# noise of a measured current is no fault of the law.
EXPLAINED, SLOW = 0.95, 0.01
# Ratio of the residuals from which on the gains of the controller are taken as changed between the logs.
RETUNED = 2.0
# In a log that is slower than the speed loop, ratio of what the sum of the error misses per sample, were all that is
# left of the current due to that, to what its samples differ by from a smooth course, up to which the sum and not the
# current is in error: 0.6 to 1.0 in logs of the current reference at 500 Hz with coarse encoders, above 4 where a
# measured current has its own noise. With fine encoders the cycles between the samples differ by more than rounding, so
# that current references of speed control lie above 2 as well: their integral is in doubt, and their rows stay.
WALK = 2.0
# Periods of the speed loop beyond which a log lacks cycles of it: the digits of its times make no difference.
SLOWER = 1.01
# Share of the current limit above which samples are left out: there the law is cut off.
LIMIT = 0.98
# s over which a measured current and all that explains it are averaged: its noise is in the speed that the controller
# reads as well, and makes gains too small.
AVERAGED = 0.005
# Errors of the gain that no block shows, as a share of the expected one: the law is sampled faster than the log; a
# measured current lags its reference by the current loop besides; a sign whose shape is neither of the two that are
# known need not end within the speeds of the motion (an arc tangent of another simulator: 2 to 4 %).
SAMPLED, MEASURED, SHAPED = 0.002, 0.015, 0.02
# Blocks of the two records whose differences bound the standard errors from below.
BLOCKS = 24
# Samples of a record that are evaluated.
MOST = 200_000
# Share by which rms and peak of the reference speed, and the number of reversals, may differ between equal motions.
OTHER_MOTION = 0.03
# Ratio of the amplitudes at rest from which on a limit cycle is new.
CYCLE = 1.5
# Share of the promised reduction of the error that must be reached.
REACHED = 0.5
