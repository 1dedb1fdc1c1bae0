"""Thresholds of the frequency responses, each with its unit and its reason."""

from __future__ import annotations

import math

# Standard errors of its modulus above which a response counts: noise alone exceeds them in less than 1 of 1e5 lines.
SEEN = 5.0
# Share of the median speed below which samples are left out: friction is not linear near standstill.
SLOWEST = 0.5
# s; shorter stretches give no response that is worth a fit.
SHORTEST = 1.0
# Share of the lines in which a reference must be seen to be the instrument.
INSTRUMENT = 0.5
# Share of the log's rate up to which responses are evaluated: beyond, images of the excitation fold back.
HIGHEST = 0.4
# Periods of the log by which the channels may be apart before a response no longer counts as that of a passive axis,
# and rad for its error. A response that leads more is that of the controller, driven by noise of the measured speed.
APART, LEAD = 2.0, 0.35
# Chance of a false resonance, over all frequencies that are tried.
RESONANCE = 0.001
# Chance of a false deviation from the design, over all third octaves, and over all parameters.
DEVIATION = 0.01
# Share of a response below which a deviation from the design is not reported, however surely it is seen: 0.4 dB.
SMALLEST_DEVIATION = 0.05
# Residual of the fitted axis over the noise from which on the response is not that of the axis: twice its power.
MISFIT = math.sqrt(2.0)
# Standard error of the inertia's logarithm from which on a response says nothing about the axis: its 95 % interval
# reaches beyond a factor of e either way.
UNDETERMINED = 0.5
# Share of the excitation's power above HIGHEST from which on it may reach beyond half the log's rate and fold back:
# 2e-6 with the default chirp, 5e-3 with a binary sequence of 20 ms in a log of 1 kHz.
BEYOND = 1e-3
# Frequencies below which a response has no fit: a rigid axis has four parameters, and a frequency two numbers.
FEWEST_SEEN = 3
# Fewest points of a local line around a crossover, which has two complex numbers; and how far from it they may lie, in
# ln f: an octave.
FEWEST_POINTS, WIDEST = 6, math.log(2.0)
# Standard error of the logarithm of an open loop from which on its points say nothing, and nepers or rad by which they
# may be away from the fitted axis: beyond that they are another system.
UNSURE, FAR = 1.0, 5.0
