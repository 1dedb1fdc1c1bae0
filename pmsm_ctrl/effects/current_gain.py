"""Gain of the phase-current sensors: a common scale, and a mismatch that shows as the second electrical order."""

from __future__ import annotations

from math import cos, sin

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(theta: float, p: float, i_d: float, i_q: float, g: float, g_c: float, g_s: float) -> tuple[float, float]:
    """Measured less true current: g i, and a mismatch [[g_c, g_s], [g_s, -g_c]] of the stator-fixed currents."""
    c, s = cos(2.0 * p * theta), sin(2.0 * p * theta)
    m_c = g_c * c + g_s * s
    m_s = g_s * c - g_c * s
    return g * i_d + m_c * i_d + m_s * i_q, g * i_q + m_s * i_d - m_c * i_q


effect = Effect(
    id="current_gain",
    title="Current sensor gain",
    equation=r"\Delta i_{\alpha\beta} = g\,i + M(g_c, g_s)\,i",
    source="D.-W. Chung, S.-K. Sul, IEEE Trans. Ind. Appl. 34 (1998) 1089",
    enters="measurement",
    parameters=(
        Parameter("g", "1", 0.0, -0.5, 0.5, "scale error common to all phases", linear=True),
        Parameter("g_c", "1", 0.0, -0.5, 0.5, "mismatch along phase a", linear=True),
        Parameter("g_s", "1", 0.0, -0.5, 0.5, "mismatch at 45 degrees electrical", linear=True),
    ),
    term=term,
    electrical_order=2,  # of the mismatch; the common scale has none
    common_scale=("g",),
    example={"g": 0.0, "g_c": 0.02, "g_s": 0.01},
    needs="slow turns at clearly different torques",
    look_alikes={
        "torque_ripple": "with order 2 they make the same torque",
        "detent_force": "at constant force, with half the period of a pair of poles of a linear motor",
        "psi_f": "the common scale is a wrong torque constant unless voltages are logged",
        "K_t": "the common scale is a wrong torque constant",
    },
)
