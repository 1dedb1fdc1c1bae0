"""The direction of motion, which the dry friction opposes; at rest, or where noise changes the sign, there is none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.evidence.noise import stretches
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.encoder_steps import StepErrors
from pmsm_ctrl.regression.filters import low_pass, shifted
from pmsm_ctrl.regression.measurement_correction import undone
from pmsm_ctrl.regression.reversals import reversals, timed_sign
from pmsm_ctrl.regression.signals import logged_torque
from pmsm_ctrl.regression.weights import on_grid, prefilter

__all__ = ["acting_torques", "direction_of", "share_back"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Share of a log at most that is left out where the shaft stops and goes on as before, and where it turns many times.
MOST_UNKNOWN, MOST_SHAKEN = 0.2, 0.8
BAND = 250.0  # Hz: of the torque at reversals
REST = 0.004  # s: what is shorter is a reversal
MOST_TAKEN = 0.5  # share of the acceleration's power at most that is taken for noise
LEAST_BACK = 0.02  # share of its way that an axis goes back at least, where a load is another thing than friction
FEWEST_MIXED = 4  # samples on either side of a reversal that smoothing mixes at least


def direction_of(
    driving: Array,
    fast: Array,
    prepared: Prepared,
    measured: Mask,
    standstill: float,
    steps: StepErrors | None = None,
    unresolved: float = 0.0,
) -> tuple[Array, Mask, tuple[float, float], float]:
    """Direction of motion; while the shaft rests, or nearly, the share of the dry friction that balances the drive.

    What bridges a hole in the log is not `measured`.

    Taking the sign of a resting shaft's speed for the direction would smear errors over the filter's memory into
    the moving samples beside it.

    Parameters
    ----------
    driving : array, shape (n,)
        What drives the axis, N m (N), as smooth as the speed.
    fast : array, shape (n,)
        The same as it was logged, or nearly. At a reversal the drive's torque rises by twice the friction: smoothed
        it rises too early, and so the axis would turn too early.
    prepared : Prepared
    measured : bool array, shape (n,)
    standstill : float
        Share of the fast speed below which the direction is uncertain.
    steps : StepErrors, optional
        What the steps of the angle do to the acceleration. The inertia is corrected for their noise.
        Source: W. A. Fuller, Measurement Error Models, Wiley 1987, sec. 1.2.
    unresolved : float
        Speed, rad/s (m/s), at which a coarse encoder counts no more than once in the filters' memory: nothing tells
        motion from rest below it.

    Returns
    -------
    direction : array, shape (n,)
    sure : bool array, shape (n,)
        False where the shaft rests, where its direction is not known, and beside either.
    kink : (float, float)
        Level of the dry friction, N m (N), and the inertia.
    unknown : float
        Share of the moving samples whose direction is not known.
    """
    omega = prepared.signals["omega"]
    top = float(np.quantile(np.abs(omega[measured]), 0.99))
    rests = np.abs(omega) <= max(standstill * top, unresolved)
    direction = timed_sign(omega)
    long = np.zeros(len(omega), dtype=bool)
    for piece in stretches(rests):
        if piece.stop - piece.start > round(REST * prepared.rate, 6):  # a rate of 250 Hz may be one of 249.999
            long[piece] = True
    free = ~long & measured
    level = J = 0.0
    reach = max(FEWEST_MIXED, round(prepared.rate / prefilter(prepared)))
    direction[long] = 0.0
    unknown = np.zeros(len(omega), dtype=bool)
    both = share_back(omega[measured]) > LEAST_BACK
    for _ in range(3):  # again with what the reversals say of the level
        used = free & ~unknown
        columns = np.full((int(used.sum()), 4), float(both))
        for k, values in enumerate((prepared.alpha, direction, omega)):
            columns[:, k] = values[used]
        products, right = columns.T @ columns, columns.T @ driving[used]
        del columns  # those of a long log are large
        if steps is not None:  # noise of the acceleration would make the inertia too small by its share
            products[0, 0] -= min(float(np.sum(steps.acceleration[used] ** 2)), MOST_TAKEN * products[0, 0])
        weights = np.linalg.lstsq(products, right, rcond=None)[0]
        level, J = float(weights[1]), float(weights[0])
        if level <= 0.0 or J <= 0.0:
            break
        left = (driving - weights[2] * omega - weights[3]) / level
        pushed = (fast - weights[2] * omega - weights[3]) / level
        balanced = np.clip(left - J / level * prepared.alpha, -1.0, 1.0)
        direction[long] = balanced[long]
        period = 1.0 / prepared.rate
        ends = _followed(prepared, pushed, J / level)
        unknown[:] = False
        found = reversals(direction, long, omega, ends, pushed, J / level, period, reach)
        for pieces, most in zip(found, (MOST_UNKNOWN, MOST_SHAKEN), strict=True):
            some = np.zeros(len(omega), dtype=bool)
            for piece in pieces:
                some[piece] = True
            if np.mean(some & ~long) <= most:  # else noise turns the shaft, or its speed, everywhere
                unknown |= some
        direction[unknown] = balanced[unknown]
    sure, dilate = ~long, round(prepared.rate / prepared.cutoff)
    for piece in stretches(long | unknown):
        sure[max(0, piece.start - dilate) : piece.stop + dilate] = False
    share = float(np.mean(unknown[free])) if free.any() else 0.0
    return direction, sure, (max(level, 0.0), J), share


def share_back(speed: Array) -> float:
    """Return the smaller one of the two ways that an axis goes, as a share of both.

    Parameters
    ----------
    speed : array, shape (n,)
        At equal intervals.
    """
    ways = [float(np.maximum(side * speed, 0.0).sum()) for side in (1.0, -1.0)]
    return min(ways) / max(sum(ways), 1e-300)


def _followed(prepared: Prepared, pushed: Array, J: float) -> tuple[Array, Array]:
    """Return speed and position in the band of the torque: measured ones below, by the torque above their own band.

    Ripple of the torque changes the speed at which a reversal begins and ends, and the smoothed speed does not show it.
    A complementary filter: W. T. Higgins, IEEE Trans. Aerospace Electr. Systems 11 (1975) 321.
    """
    period, wide = 1.0 / prepared.rate, prefilter(prepared)
    if wide >= 0.45 * prepared.rate:
        return prepared.signals["omega"], prepared.signals["theta"]
    made = np.cumsum(pushed) * (period / J)
    made -= low_pass(made, prepared.rate, wide)
    travel = np.cumsum(made) * period
    travel -= low_pass(travel, prepared.rate, wide)
    return prepared.signals["omega"] + made, prepared.signals["theta"] + travel


def acting_torques(design: Design, log: Log, prepared: Prepared, late: float = 0.0) -> tuple[Array, Array]:
    """Return the drive's torque, N m (N), shape (n,): as smooth as the speed, and in the band of reversals.

    Without what measurement effects of the design put into the channels. A known delay, left in, would make each
    reversal late.

    Parameters
    ----------
    design : Design
    log : Log
    prepared : Prepared
    late : float
        Delay of the drive signal, s.
    """
    names = ("torque",) if "torque" in log else tuple(name for name in ("i_d", "i_q") if name in log)
    channels = {name: on_grid(log, prepared, name) for name in names}
    band = max(BAND, prefilter(prepared))
    if band < 0.45 * prepared.rate:
        channels = {name: low_pass(values, prepared.rate, band) for name, values in channels.items()}
    motion = {name: prepared.signals[name] for name in ("theta", "omega")}
    smooth, fast = (
        logged_torque(design, undone(design, prepared.t, motion | currents, scaled=True)[0])
        for currents in ({name: prepared.signals[name] for name in names}, channels)
    )
    if late:
        smooth, fast = (shifted(values, 1.0 / prepared.rate, late) for values in (smooth, fast))
    return smooth, fast
