"""Two parameter objects: the true plant, and what the controller believes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, NextCommand
from pmsm_ctrl.sampling import smoothing, speed_lag, time_constant
from pmsm_ctrl.units import encoder_span, psi_f_from

__all__ = ["Controller", "Plant", "matched_filter"]

Array = NDArray[Any]


@dataclass(frozen=True)
class Plant:
    """The true machine, inverter and sensors.

    Attributes
    ----------
    R, L_d, L_q : float
        Ohm, H, H.
    p : float
        Pole pairs, of a linear axis in 2 pi m.
    psi_f : float
        Flux linkage, Wb.
    J : float
        Inertia, kg m^2.
    u_dc : float
        dc-link voltage, V.
    period : float
        Control period, s.
    counts : float
        Of the encoder, in 2 pi rad (m), as `p` has its pole pairs; 0 for an ideal encoder.
    current_noise : float
        A rms.
    steps : int
        Integration steps per control period.
    speed_divider, log_divider : int
        Control periods per speed period and per logged sample.
    delay : int
        Control periods from measurement to voltage, 0 or 1.
    """

    R: float
    L_d: float
    L_q: float
    p: float
    psi_f: float
    J: float
    u_dc: float
    period: float
    counts: float
    current_noise: float
    steps: int
    speed_divider: int
    log_divider: int
    delay: int

    @classmethod
    def of(cls, design: Design) -> Plant:
        """Read the plant from a design.

        Parameters
        ----------
        design : Design

        Returns
        -------
        Plant

        Raises
        ------
        DesignError
            When the motor's electrical data are missing.
        """
        motor = design.motor
        if motor.R is None or motor.L_d is None or motor.L_q is None or motor.p is None or motor.psi_f is None:
            raise DesignError(
                f"{design.source or design.name}: motor: the drive is simulated from p, psi_f, R, L_d and L_q; "
                "this design knows only K_t",
                next_command=NextCommand.ELECTRICAL_DATA,
            )
        counts = design.sensor.encoder_counts * (2.0 * math.pi / encoder_span(design.motion))
        return cls(
            motor.R, motor.L_d, motor.L_q, motor.p, motor.psi_f, design.J, design.drive.u_dc,
            1.0 / design.drive.f_control, counts, design.sensor.current_noise,
            design.drive.plant_steps, design.drive.speed_divider, design.sensor.log_divider,
            design.drive.delay_periods,
        )  # fmt: skip

    def array(self) -> Array:
        """Return the numbers in the kernel's order."""
        return np.array([
            self.R, self.L_d, self.L_q, self.p, self.psi_f, self.J, self.u_dc, self.period, self.counts,
            self.current_noise, self.steps, self.speed_divider, self.log_divider, self.delay,
        ], dtype=np.float64)  # fmt: skip


@dataclass(frozen=True)
class Controller:
    """The sampled cascade as it runs in the drive: gains per tick and the model it uses for decoupling.

    Discretisation: forward Euler of the integrators, exact (zero-order hold) first-order filters.

    Attributes
    ----------
    current_gain, current_integral : tuple of float
        Of the d and q current controllers: proportional gain, V/A, and control period over T_n.
    speed_gain : float
        A s/rad.
    speed_integral : float
        Speed period over T_n.
    speed_filter, reference_filter : float
        Gain per speed period of the first-order filters of measured speed and reference, 1 for none.
    position_gain : float
        1/s; 0 without position control.
    velocity_feedforward : float
        Share of the reference speed.
    acceleration_feedforward : float
        A s^2/rad.
    i_max : float
        Current limit, A.
    L_d, L_q, psi_f : float
        Motor model of the decoupling, H, H, Wb.
    filters : tuple of tuple of float
        b_0, b_1, b_2, a_1, a_2 of every filter of the current reference; none in current control.
    """

    current_gain: tuple[float, float]
    current_integral: tuple[float, float]
    speed_gain: float
    speed_integral: float
    speed_filter: float
    reference_filter: float
    position_gain: float
    velocity_feedforward: float
    acceleration_feedforward: float
    i_max: float
    L_d: float
    L_q: float
    psi_f: float
    filters: tuple[tuple[float, ...], ...] = ()

    @classmethod
    def of(cls, design: Design, control: str = "speed") -> Controller:
        """Read the controller from a design.

        Parameters
        ----------
        design : Design
        control : {"position", "speed", "current"}
            The outermost closed loop.

        Returns
        -------
        Controller

        Raises
        ------
        DesignError
            When the design has no loops, no position gain where one is needed, or no electrical data.
        """
        loops, motor, assumed = design.require_loops(), design.motor, design.assumed
        if motor.p is None or motor.L_d is None or motor.L_q is None:
            raise DesignError(f"{design.source or design.name}: motor: electrical data missing for the current loop")
        T, T_s = 1.0 / design.drive.f_control, design.drive.speed_period
        current, speed, position = loops.current, loops.speed, loops.position
        K_d, T_d = current.K_p_d or current.K_p, current.T_n_d or current.T_n
        inertia = assumed.J or design.J
        in_position = control == "position"
        if in_position and position.K_v == 0.0:
            raise DesignError(
                f"{design.source or design.name}: loops.position.K_v: found 0; position control needs a gain above 0"
            )
        return cls(
            current_gain=(K_d, current.K_p),
            current_integral=(T / T_d, T / current.T_n),
            speed_gain=0.0 if control == "current" else speed.K_p,
            speed_integral=0.0 if control == "current" else T_s / speed.T_n,
            speed_filter=smoothing(T_s, design.sensor.speed_filter),
            reference_filter=smoothing(T_s, loops.reference_filter(in_position=in_position)),
            position_gain=position.K_v if in_position else 0.0,
            velocity_feedforward=position.velocity_feedforward if in_position else 1.0,
            acceleration_feedforward=position.acceleration_feedforward * inertia / design.K_t_assumed,
            i_max=design.drive.i_max,
            L_d=assumed.L_d or motor.L_d,
            L_q=assumed.L_q or motor.L_q,
            psi_f=psi_f_from(design.K_t_assumed, motor.p),
            filters=tuple(one.biquad.sampled(T_s) for one in speed.filters) if control != "current" else (),
        )

    def array(self) -> Array:
        """Return the numbers in the kernel's order."""
        return np.array([
            self.current_gain[0], self.current_integral[0], self.current_gain[1], self.current_integral[1],
            self.speed_gain, self.speed_integral, self.speed_filter, self.reference_filter, self.position_gain,
            self.velocity_feedforward, self.acceleration_feedforward, self.i_max, self.L_d, self.L_q, self.psi_f,
            *(value for one in self.filters for value in one),
        ], dtype=np.float64)  # fmt: skip

    def speed_answer(self, theta: Array, omega: Array, period: float) -> Array:
        """Return what the PI subtracts from its output for the measured motion alone, A, shape (n,).

        The sum of the filtered speed over the ticks between two samples follows from the angle turned and from the
        filter's own equation, exactly and at any rate of the samples.

        Parameters
        ----------
        theta, omega : array, shape (n,)
            Measured angle and filtered speed at ticks of the controller; the integrator starts at the first.
        period : float
            Of the speed controller, s.
        """
        turned = (theta - theta[0]) / period - (omega - omega[0]) / self.speed_filter
        return np.asarray(self.speed_gain * (omega + self.speed_integral * turned))


def matched_filter(design: Design) -> float:
    """Return the time constant that delays the reference speed as the measured speed lags, s.

    With velocity and inertia fed forward the position error at constant acceleration is then zero: it is the
    acceleration times the difference of the two delays over K_v, since the integrator rests where its input is zero.

    Parameters
    ----------
    design : Design

    Returns
    -------
    float
    """
    period = design.drive.speed_period
    return time_constant(period, speed_lag(period, design.sensor.speed_filter))
