"""Inverter dead time: a voltage lost against the sign of each phase current."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, inf, sin, sqrt

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView
from pmsm_ctrl.kernels import kernel


@kernel
def term(theta: float, p: float, i_d: float, i_q: float, dU: float, i_0: float) -> tuple[float, float]:
    """Voltage lost, in rotor coordinates: dU sgn(i) per phase, linear where abs(i) < i_0.

    Averaged over a PWM period, with dU = u_dc f_pwm t_dead.
    """
    c, s = cos(p * theta), sin(p * theta)
    i_alpha = c * i_d - s * i_q
    i_beta = s * i_d + c * i_q
    half = 0.5 * sqrt(3.0) * i_beta
    a = min(max(i_alpha / i_0, -1.0), 1.0)
    b = min(max((-0.5 * i_alpha + half) / i_0, -1.0), 1.0)
    d = min(max((-0.5 * i_alpha - half) / i_0, -1.0), 1.0)
    u_alpha = dU * (2.0 * a - b - d) / 3.0
    u_beta = dU * (b - d) / sqrt(3.0)
    return c * u_alpha + s * u_beta, c * u_beta - s * u_alpha


def search(log: LogView) -> Iterator[dict[str, float]]:
    """Yield shares of the log's current."""
    for share in (0.1, 0.3, 1.0, 2.0):
        yield {"i_0": max(share * log.current, 1e-5)}


effect = Effect(
    id="dead_time",
    title="Inverter dead time",
    equation=r"\Delta U\,\mathrm{sgn}(i_a, i_b, i_c),\quad \Delta U = u_{dc} f_{PWM} t_{dead}",
    source="S.-G. Jeong, M.-H. Park, IEEE Trans. Ind. Electron. 38 (1991) 108",
    enters="voltage",
    parameters=(
        Parameter("dU", "V", 0.0, 0.0, inf, "voltage lost per phase, averaged over a PWM period", linear=True),
        Parameter("i_0", "A", 0.05, 1e-6, inf, "phase current below which the loss is proportional to it"),
    ),
    term=term,
    search=search,
    example={"dU": 6.0, "i_0": 0.05},
    needs="voltages in the log, and motion with phase currents of either sign",
    look_alikes={
        "R": "at one current amplitude the lost voltage is a resistance",
        "torque_ripple": "its current distortion makes the sixth electrical order",
    },
)
