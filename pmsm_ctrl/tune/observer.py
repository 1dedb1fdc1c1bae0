"""A disturbance observer beside a tuned cascade: what it does to the loop, and the bandwidth that the margins allow.

With a first-order filter of bandwidth g, a = 1 - exp(-g T) and gain 1 the speed controller C becomes
``C (z - 1 + a) / (z - 1)``, one more integrator, and the speed is fed back through ``g J (1 - a) / K_t``, more damping.
Beside a P controller the observer is therefore a PI controller. Filters F of the current reference delay what the
observer sees of its own current: the controllers then act through F / (1 - F H), H from this current to the observed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import control as ct
import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.simulate.feedforward import observer_inertia, observer_share
from pmsm_ctrl.tune.linearise import default_speed
from pmsm_ctrl.tune.margins import Margins, margins, response
from pmsm_ctrl.tune.robust import Corner, corners, varied
from pmsm_ctrl.tune.sampled import Cascade, filters, frequencies, pi

__all__ = ["ObserverDesign", "design_observer", "loop_with_observer"]

SENSITIVITY = 2.0  # largest abs(S) at the motor's current that is accepted, as `Requirements` asks of the speed loop
RISE = 1.25  # or the factor by which the observer may raise that of the position loop, where this is more
LOWEST = 1.0  # rad/s, below which an observer has no use


@dataclass(frozen=True)
class ObserverDesign:
    """The bandwidth of a disturbance observer, and what it costs.

    Attributes
    ----------
    bandwidth : float
        rad/s.
    before, after : Margins
        Of the loop at the motor's current, position controlled, without and with the observer.
    worst : Corner
        The corner of the motor's tolerances with the largest abs(S) with the observer; its `speed` has the margins of
        the same loop.
    worst_before : Margins
        At that corner without the observer.
    """

    bandwidth: float
    before: Margins
    after: Margins
    worst: Corner
    worst_before: Margins


def loop_with_observer(
    design: Design, bandwidth: float, *, gain: float = 1.0, truth: Design | None = None, at: float | None = None
) -> Any:
    """Return the open loop at the motor's current in z (control.StateSpace), all other loops closed.

    The loop is cut where the current reference goes to the current controller; what comes back is the controllers'
    answer, the observer's included. Its margins are those against an error of gain or delay of the whole drive.

    Parameters
    ----------
    design : Design
        With its loops set.
    bandwidth : float
        Of the observer, rad/s; 0 for none.
    gain : float
        Share of the observed disturbance that is fed back.
    truth : Design, optional
        The plant, where it differs.
    at : float, optional
        Speed of the operating point, rad/s; by default a tenth of the no-load speed.
    """
    loops = design.require_loops()
    cascade = Cascade.of(design, loops.current, truth=truth, at=default_speed(design) if at is None else at)
    T, outputs = cascade.period, ("omega_hat", "theta") if loops.position.K_v > 0.0 else ("omega_hat",)
    plant = cascade.system(("i_q_ref",), outputs)
    a, inertia = observer_share(design, bandwidth), observer_inertia(design)
    control = pi(loops.speed.K_p, loops.speed.T_n, T)
    passed = filters(loops.speed.filters, T)  # what is asked for, the observer's share included
    speed = [1.0, *[0.0] * (len(outputs) - 1)]
    weights = [1.0, loops.position.K_v][: len(outputs)]
    if bandwidth == 0.0:
        return passed * ct.ss(control) * _combined(plant, [weights])
    if loops.speed.filters:  # the observer sees the current behind them
        seen = passed * ct.ss(ct.tf([gain * a], [1.0, a - 1.0], T))
        share = gain * bandwidth * inertia * (1.0 - a) / design.K_t_assumed
        both = ct.append(ct.ss(control), ct.ss(ct.tf([share, -share], [1.0, a - 1.0], T)))
        asked = ct.ss([], [], [], [[1.0, 1.0]], T) * both * _combined(plant, [weights, speed])
        return passed * ct.feedback(ct.ss([], [], [], [[1.0]], T), seen, sign=1) * asked
    pole = a * (1.0 - gain) - 1.0
    damping = gain * bandwidth * inertia * (1.0 - a) / design.K_t_assumed
    damped = ct.ss([], [], [], [[damping]], T) if gain == 1.0 else ct.ss(ct.tf([damping, -damping], [1.0, pole], T))
    controllers = ct.append(ct.ss(control * ct.tf([1.0, a - 1.0], [1.0, pole], T)), damped)
    # The speed error, both measurements in one, and the speed: so that every integrator stands once.
    return ct.ss([], [], [], [[1.0, 1.0]], T) * controllers * _combined(plant, [weights, speed])


def _combined(plant: Any, rows: list[list[float]]) -> Any:
    """Return the plant with combinations of its outputs in their place."""
    weights = np.array(rows)
    return ct.ss(plant.A, plant.B, weights @ plant.C, weights @ plant.D, plant.dt)


def design_observer(design: Design) -> ObserverDesign:
    """Return the highest bandwidth of a disturbance observer that the margins of the loop allow.

    Parameters
    ----------
    design : Design
        With its loops set.

    Returns
    -------
    ObserverDesign

    Raises
    ------
    RequestError
        When the loops leave no room for an observer.
    """
    before = margins(loop_with_observer(design, 0.0))
    limit = max(SENSITIVITY, RISE * before.sensitivity_peak)
    grid = frequencies(design.drive.speed_period, 1e-3, 600)

    def accepted(bandwidth: float) -> bool:
        loop = loop_with_observer(design, bandwidth)
        if np.abs(1.0 / (1.0 + response(loop, grid))).max() > limit:
            return False
        return bool(np.all(np.abs(ct.feedback(loop, 1).poles()) < 1.0))

    low, high = LOWEST, 0.5 / design.drive.speed_period
    if not accepted(low):
        raise RequestError("disturbance observer: the loops leave no margin for one")
    while high / low > 1.01:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if accepted(middle) else (low, middle)
    found = [
        Corner(point, before, margins(loop_with_observer(design, low, truth=varied(design, point)), grid))
        for point in corners(design)
    ]
    worst = max(found, key=lambda corner: corner.speed.sensitivity_peak)
    there = margins(loop_with_observer(design, 0.0, truth=varied(design, worst.deviations)), grid)
    return ObserverDesign(low, before, margins(loop_with_observer(design, low)), worst, there)
