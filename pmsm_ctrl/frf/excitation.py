"""The excitation in a log whose current reference was excited inside a closed loop.

The speed controller answers noise of the measured current and of the encoder, so that the logged current reference
contains noise that also moves the axis. As an instrument it biases the response: by the share of that noise in its
power, at low frequency by far the largest part of it. What the controller answers follows from the logged angle and
speed and from its gains. Without this answer a test signal added to the reference is left, and what the references ask
for: neither contains noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.sampling import speed_lag
from pmsm_ctrl.simulate.parameters import Controller

__all__ = ["excitation"]

Array = NDArray[np.float64]


def excitation(design: Design, channels: Mapping[str, Array], period: float) -> Array | None:
    """Return the current reference less what the speed controller answers to the measured motion, A, shape (n,).

    None where the log does not tell: it lacks the current reference, the speed reference or the measured motion; the
    speed loop is open; or the design has no loops or no motor data. A speed loop is closed where the mean speed is
    that of the reference, within the variation of the speed.

    Parameters
    ----------
    design : Design
        Its speed and position loops ran in the drive.
    channels : mapping of str to array, shape (n,)
        Of an even rate, angles unwrapped.
    period : float
        Of the samples, s.
    """
    known = design.loops is not None and design.motor.electrical
    if not known or not {"i_q_ref", "omega_ref"} <= channels.keys() or not {"theta", "omega"} & channels.keys():
        return None
    theta, omega = _motion(design, channels, period)
    error = channels["omega_ref"] - omega
    if abs(float(np.mean(error))) > float(np.std(error)):
        return None
    controller = _controller(design, "theta_ref" in channels)
    wanted = controller.velocity_feedforward * channels["omega_ref"]
    if controller.position_gain > 0.0:
        wanted = wanted + controller.position_gain * (channels["theta_ref"] - theta)
    T_s = design.drive.speed_period
    before = _integral(wanted) * (period / T_s) - 0.5 * wanted  # the sum over the ticks before each sample
    asked = controller.speed_gain * (wanted + controller.speed_integral * before)
    answer = asked - controller.speed_answer(theta, omega, T_s)
    return np.asarray(channels["i_q_ref"] - _filtered(design, answer, period))


def _motion(design: Design, channels: Mapping[str, Array], period: float) -> tuple[Array, Array]:
    """Return angle and speed as the controller reads them; one is made from the other where only one is logged."""
    lag = speed_lag(design.drive.speed_period, design.sensor.speed_filter)
    if "theta" not in channels:
        omega = channels["omega"]
        return _integral(omega) * period + lag * omega, omega
    theta = channels["theta"]
    if "omega" in channels:
        return theta, channels["omega"]
    t = np.arange(len(theta)) * period
    return theta, np.interp(t - lag, t, np.gradient(theta, period))


def _integral(values: Array) -> Array:
    """Return the integral over the samples, by trapezoids, in periods."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))])


def _controller(design: Design, in_position: bool) -> Controller:
    assert design.loops is not None
    believed = design.with_parameters(J=1.0) if design.motor.J is None else design  # its feedforward is not asked for
    position = in_position and design.loops.position.K_v > 0.0
    return Controller.of(believed, "position" if position else "speed")


def _filtered(design: Design, current: Array, period: float) -> Array:
    """Pass a current through the filters of the speed controller's output; their memory is short beside a record."""
    assert design.loops is not None
    behind = design.loops.speed.filters
    if not behind:
        return current
    T_s = design.drive.speed_period
    z = np.exp(-2j * math.pi * np.fft.rfftfreq(len(current), period) * T_s)
    passed = np.fft.rfft(current)
    for b_0, b_1, b_2, a_1, a_2 in (one.biquad.sampled(T_s) for one in behind):
        passed = passed * (b_0 + b_1 * z + b_2 * z**2) / (1.0 + a_1 * z + a_2 * z**2)
    return np.fft.irfft(passed, len(current))
