"""Thresholds of the identification: value, unit and reason."""

from __future__ import annotations

__all__: list[str] = []

# -- doubts about an estimate ------------------------------------------------------------------------------------

# Condition number of the columns, scaled to unit length, above which some of them are nearly alike.
ILL_CONDITIONED = 100.0
# Effective degrees of freedom below which a standard error is itself uncertain by more than 16 %.
FEW_DEGREES_OF_FREEDOM = 20.0
# Tolerance of the inertia, as a share, where the design gives none: load and coupling are rarely known better.
INERTIA_TOLERANCE = 0.15
# Residual, as a share of the torque, above which the parameters describe too little of a log to be used: a sixth of the
# mean square of the torque is something else, noise or a missing effect.
LARGE_ERROR = 0.4
# Factor by which no inertia differs from its design's: another unit, another gear or another axis. Standard errors.
IMPLAUSIBLE, SURE = 3.0, 3.0

# Cutoffs at which the inertia is looked at again, as shares of its own; standard errors of both by which it has moved.
CUTOFFS, MOVED = (0.25, 0.5, 2.0), 3.0

# -- replay of the log's experiment ------------------------------------------------------------------------------

# A current beside the speed controller's output below this share of the reference current is rounding.
ADDED_CURRENT = 0.02

# -- instrumental variables --------------------------------------------------------------------------------------

# Most simulations; from 40 % off five are enough.
IV_ROUNDS = 10
# They end when no parameter moves by more than this share of its standard error.
IV_CONVERGED = 0.01

# -- output error ------------------------------------------------------------------------------------------------

# Most evaluations of the simulated torque in one fit.
FIT_ROUNDS = 30
# Differences are taken over this share of a parameter: smaller ones are lost in the steps of the simulation.
DIFFERENCE = 2e-3
# Over what makes this share of the torque, for a linear parameter that is zero.
FIRST_DIFFERENCE = 0.01
# A parameter that changes the torque by less than this share when it is doubled has no effect.
NO_EFFECT = 1e-6
# Least torque of the acceleration, as a share of the residual: below it the inertia hangs on a handful of moments.
LEAST_ACCELERATION = 0.1
# Residual, in multiples of the torque, of a plant that could not be simulated.
UNSTABLE = 100.0
# Residual of the simulation over that of inverse dynamics from which on loops or references are not those of the log.
WRONG_LOOPS = 1.5
# Standard errors by which two methods may differ that share most of their noise.
DIFFERENT = 5.0

# -- output error in open loop ------------------------------------------------------------------------------------

# Length of a stretch, s, without and with effects that have states of their own: friction that falls with speed makes
# errors of the speed grow e-fold in some 50 ms; a spring wants its run-in to be the smaller part. Fewest steps of one.
STRETCH, FEWEST_STEPS = (0.06, 0.5), 8
# Time from a restart until it is scored, s, where effects have states that the log does not show: they settle.
RUN_IN = 0.2
# Rate of the second differences, Hz: the torque below about half of it is judged.
INCREMENTS = 250.0
# Time on either side of a reversal that is not scored where dry friction sticks, s.
TURNING = 0.012
# Band of the measured signals as a share of the log's rate: so wide that nothing is filtered before it is compared.
OPEN_LOOP_BAND = 0.2
# Rate of the integration at most, Hz: what is faster moves the shaft by nothing that the second differences show.
FASTEST_STEP = 8000.0
# Share of the inertia behind a spring from which on the start is half of it.
HEAVIEST = 0.9
# How far noise of the torque moves the shaft in a sample, over the noise of the angle, where a simulation is corrected
# at every sample: the values that are tried.
TRACKING = (0.03, 0.1, 0.3, 0.6, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
# Standard error of an inertia that is held, as a share, where nobody says another one.
INERTIA_KNOWN = 0.002
# Width of the prior, in standard errors of the start, which come from the same log: it adds a ninth of what is known.
PRIOR = 3.0
# Most starts beside the regression's, and the evaluations that each gets before the best is followed to its end.
STARTS, TRIAL_ROUNDS = 6, 5

# Bands of the instruments that are tried, Hz: a narrow one holds little noise, and of a fast motion little as well.
INSTRUMENT_BANDS = (1.25, 2.5, 5.0, 10.0, 20.0, 40.0, 80.0)
# Band of those of the sampling at most, Hz: noise of the torque's curvature grows with the square of the frequency.
SAMPLING_BAND = 20.0
# Standard error of an inertia in a narrow band, over the smallest one, up to which the narrow band is taken.
NARROWER = 1.1
# Fits by instruments, each followed by one of the other columns: the second moves nothing by a tenth of its error.
INSTRUMENT_ROUNDS = 2
# Bandwidth for noise of a second difference, which is a mean with triangular weights, over the rate of the differences.
TRIANGLE = 1.0 / 3.0

# -- speed sweep -------------------------------------------------------------------------------------------------

# Least samples of a plateau: fewer leave nothing to average after settling.
SHORTEST_PLATEAU = 40
# A plateau has settled when its halves agree within so many standard errors, or within this share of the level.
HALVES, LEVEL = 4.0, 1e-4
# The axis follows a reference when its mean speed is within this share of it.
REACHED = 0.5
# A line misfits when the scatter about it is improbable, so many times what the plateaus allow, and more than this
# share of the torque: a noise-free simulation misses it by parts in a million. A drive of 8 kHz at p omega = 1500 rad/s
# misses it by 4e-4: between two samples its current runs along a chord, which costs (p omega T)^2/12 of the torque.
MISFIT_P, MISFIT_RATIO, MISFIT_SHARE = 0.01, 1.5, 1e-4
# Directions differ at this confidence, and by more than this share of the mean.
DIRECTION_CONFIDENCE, DIRECTION_SHARE = 0.999, 0.01
