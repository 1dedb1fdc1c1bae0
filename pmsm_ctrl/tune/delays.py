"""The drive's delays by name, and the error of the usual approximations of them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import control as ct
import numpy as np

from pmsm_ctrl.design import CurrentLoop, Design, Filter
from pmsm_ctrl.sampling import filter_delay
from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.sampled import current_loop

__all__ = ["Delays", "compare_delay_models", "delays"]


@dataclass(frozen=True)
class Delays:
    """Small time constants of the cascade by origin, s.

    Attributes
    ----------
    computation, holding : float
        Of the current loop.
    current_loop : float
        The closed current loop as one lag: the reciprocal of its crossover.
    speed_holding, difference_quotient, speed_filter : float
        Sampling and measurement of the speed.
    current_filters : float
        Filters of the current reference.
    """

    computation: float
    holding: float
    current_loop: float
    speed_holding: float
    difference_quotient: float
    speed_filter: float
    current_filters: float = 0.0

    @property
    def current(self) -> float:
        """Delay in the current loop: computation and half a control period of holding, s."""
        return self.computation + self.holding

    @property
    def speed(self) -> float:
        """Sum of small time constants in the speed loop, s."""
        measured = self.speed_holding + self.difference_quotient + self.speed_filter
        return self.current_loop + measured + self.current_filters

    def explain_current(self) -> str:
        """Return where the delay of the current loop comes from, in words."""
        return (
            f"{self.current * 1e6:.4g} us of delay ({self.computation * 1e6:.4g} us computation, "
            f"{self.holding * 1e6:.4g} us zero-order hold)"
        )

    def explain_speed(self) -> str:
        """Return where the small time constants of the speed loop come from, in words."""
        filtered = f", filters of the current {self.current_filters * 1e3:.3g} ms" if self.current_filters else ""
        return (
            f"{self.speed * 1e3:.4g} ms of small time constants (current loop {self.current_loop * 1e3:.3g} ms, "
            f"speed filter {self.speed_filter * 1e3:.3g} ms, difference quotient "
            f"{self.difference_quotient * 1e3:.3g} ms, zero-order hold {self.speed_holding * 1e3:.3g} ms{filtered})"
        )


def delays(design: Design, current: CurrentLoop, filters: Iterable[Filter] = ()) -> Delays:
    """Return the delays of a design with a current loop and filters of the current reference.

    A filter counts with its discrete delay at low frequency.
    """
    m = Plant.of(design)
    T_s = design.drive.speed_period
    # A PI that does not cancel the pole has the velocity constant K_p / (R T_n); both agree where it does.
    crossover = current.K_p / max(m.L_q, m.R * current.T_n)
    return Delays(
        computation=m.delay * m.period,
        holding=0.5 * m.period,
        current_loop=1.0 / crossover,
        speed_holding=0.5 * T_s,
        difference_quotient=0.5 * T_s,
        speed_filter=filter_delay(T_s, design.sensor.speed_filter),
        current_filters=sum(one.biquad.delay(T_s) for one in filters),
    )


def compare_delay_models(
    design: Design, current: CurrentLoop, orders: tuple[int, ...] = (1, 2, 3)
) -> dict[str, Margins]:
    """Return the margins of the current loop by the model of its delay: sampled, continuous, left out, Pade.

    The sampled loop is what runs, the others are what a design in s assumes; their error grows with the crossover.
    """
    m = Plant.of(design)
    tau = (m.delay + 0.5) * m.period
    omega = np.geomspace(1e-3, 1.0, 1000) * math.pi / m.period
    s = 1j * omega
    plain = ct.tf([current.K_p * current.T_n, current.K_p], [current.T_n, 0.0]) * ct.tf([1.0], [m.L_q, m.R])
    exact = current.K_p * (1.0 + 1.0 / (current.T_n * s)) / (m.L_q * s + m.R) * np.exp(-s * tau)
    return {
        "sampled, exact (as it runs)": margins(current_loop(design, current)),
        "continuous, exact delay": margins(ct.frd(exact, omega)),
        "continuous, no delay": margins(plain, omega),
        **{f"continuous, Pade of order {n}": margins(plain * ct.tf(*ct.pade(tau, n)), omega) for n in orders},
    }
