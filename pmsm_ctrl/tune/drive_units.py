"""The gains in the units that drives take, by manufacturer.

Sources: B&R ACP10 parameter list (SCTRL_SPEED_ACT in 1/s, SCTRL_KV in As, SCTRL_TN in s); Beckhoff Infosys: AX5000
IDN description S-0-0100, 0101, 0104, 0106, 0107, AX8000 object 0x3140, EL72xx object 0x8010; Siemens SINAMICS
S120/S150 list manual p1416, p1441, p1460, p1462, p1715, p1717 and SINUMERIK MD 32200.
Drives count current in A rms, this package in A peak: a gain in A becomes smaller by sqrt(2), one in V/A or in
N m stays. A speed in 1/s is turns per second.
"""

from __future__ import annotations

import math

from pmsm_ctrl.design import Design, Filter
from pmsm_ctrl.units import axis_unit

__all__ = ["NOTE", "drive_units"]

NOTE = (
    "Check two things before the download: whether the drive counts amperes rms (assumed here) or peak, and volts "
    "per phase (assumed here) or line-to-line; both differ between firmware versions."
)

# Gains over turns per second, which a linear axis does not have.
_PER_TURN = ("speed K_p [A s] peak, per turn/s", "SCTRL_KV [A s] rms")


def drive_units(design: Design) -> dict[str, dict[str, float]]:
    """Return the gains of a design by manufacturer, each key with the parameter's name and unit.

    Position gains are at the motor shaft; behind a gear the number in 1/s is the same at both ends.
    """
    loops = design.require_loops()
    current, speed, position = loops.current, loops.speed, loops.position
    rms = 1.0 / math.sqrt(2.0)
    torque_gain = speed.K_p * design.K_t_assumed  # N m/(rad/s)
    ms = 1e3
    found = {
        "general": {
            "current K_p [V/A]": current.K_p,
            "current T_n [ms]": ms * current.T_n,
            "speed K_p [A/(rad/s)] peak": speed.K_p,
            "speed K_p [A s] peak, per turn/s": 2.0 * math.pi * speed.K_p,
            "speed K_p [N m s/rad]": torque_gain,
            "speed T_n [ms]": ms * speed.T_n,
            "speed reference filter [ms]": ms * speed.reference_filter,
            "speed filter [ms]": ms * design.sensor.speed_filter,
            "position K_v [1/s]": position.K_v,
            "position control, reference speed filter [ms]": ms * loops.reference_filter(in_position=True),
        },
        "B&R": {
            "SCTRL_KV [A s] rms": 2.0 * math.pi * speed.K_p * rms,
            "SCTRL_TN [s]": speed.T_n,
            "SCTRL_TI_FIL [s]": design.sensor.speed_filter,
            "POS_CTRL_KV [1/s]": position.K_v,
        },
        "Beckhoff": {
            "AX5000 S-0-0106 current loop K_p [V/A]": current.K_p,
            "AX5000 S-0-0107 current loop T_n [ms]": ms * current.T_n,
            "AX5000 S-0-0100 velocity loop K_p [A/(rad/s)] rms": speed.K_p * rms,
            "AX5000 S-0-0100 velocity loop K_p [N m/(rad/s)], P-0-0010 bit 15 set": torque_gain,
            "AX5000 S-0-0101 velocity loop T_n [ms]": ms * speed.T_n,
            "AX5000 S-0-0104 position loop K_v [1000/min]": position.K_v * 60.0 / 1000.0,
            "AX8000 0x3140:01 velocity K_p [N m/(rad/s)]": torque_gain,
            "AX8000 0x3140:02 velocity T_n [s]": speed.T_n,
            "EL72xx current loop K_p [0.1 V/A]": 10.0 * current.K_p,
            "EL72xx current loop T_n [0.1 ms]": 1e4 * current.T_n,
            "EL72xx velocity loop K_p [mA/(rad/s)] rms": 1e3 * speed.K_p * rms,
            "EL72xx velocity loop T_n [0.1 ms]": 1e4 * speed.T_n,
        },
        "Siemens": {
            "p1715 current controller K_p [V/A]": current.K_p,
            "p1717 current controller T_n [ms]": ms * current.T_n,
            "p1460 speed controller K_p [N m s/rad]": torque_gain,
            "p1462 speed controller T_n [ms]": ms * speed.T_n,
            "p1416 speed setpoint filter [ms]": ms * speed.reference_filter,
            "p1441 actual speed smoothing [ms]": ms * design.sensor.speed_filter,
            "MD32200 K_v [1000/min]": position.K_v * 60.0 / 1000.0,
        },
    }
    for number, one in enumerate(speed.filters, start=1):
        found["general"] |= _general(number, one)
        found["Siemens"] |= _siemens(number, one)
    if design.motion == "rotary":
        return found
    return {
        maker: {axis_unit(name, design.motion): value for name, value in gains.items() if name not in _PER_TURN}
        for maker, gains in found.items()
    }


def _general(number: int, one: Filter) -> dict[str, float]:
    """Return a filter as numerator and denominator, which every drive with a filter of second order takes."""
    (n_2, n_1, n_0), (d_2, d_1, d_0) = one.biquad.numerator, one.biquad.denominator
    name = f"current filter {number}, {one.kind.replace('_', '-')}"
    turn = 2.0 * math.pi
    if d_2 == 0.0:
        found = {f"{name}: pole [Hz]": d_0 / d_1 / turn}
        return found | ({f"{name}: zero [Hz]": n_0 / n_1 / turn} if n_1 > 0.0 else {})
    found = {
        f"{name}: denominator frequency [Hz]": math.sqrt(d_0) / turn,
        f"{name}: denominator damping [1]": 0.5 * d_1 / math.sqrt(d_0),
    }
    if n_2 > 0.0:
        found[f"{name}: numerator frequency [Hz]"] = math.sqrt(n_0) / turn
        found[f"{name}: numerator damping [1]"] = 0.5 * n_1 / math.sqrt(n_0)
    return found


def _siemens(number: int, one: Filter) -> dict[str, float]:
    """Return a filter as STARTER asks for it (SINAMICS S120 Function Manual FH1, Current setpoint filter)."""
    name = f"current setpoint filter {number}"
    if one.kind == "notch":
        found = {f"{name}, blocking frequency [Hz]": one.frequency, f"{name}, bandwidth -3 dB [Hz]": one.width or 0.0}
        return found | ({f"{name}, notch depth [dB]": -one.depth} if one.depth is not None else {})
    if one.kind == "low_pass" and one.order != 1:
        damping = math.sqrt(0.5) if one.damping is None else one.damping
        return {f"{name}, characteristic frequency [Hz]": one.frequency, f"{name}, damping [1]": damping}
    return {}
