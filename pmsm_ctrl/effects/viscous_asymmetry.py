"""Viscous friction that differs by direction: a fatigued screw, a preloaded guide."""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(omega: float, dF_v: float) -> float:
    """dF_v abs(omega): F_v + dF_v forward, F_v - dF_v backward."""
    return dF_v * abs(omega)


effect = Effect(
    id="viscous_asymmetry",
    title="Direction-dependent viscous friction",
    equation=r"\Delta F_v\,|\omega|",
    source="A. Janot, M. Gautier, M. Brunot, nonlinear system identification benchmark EMPS (2019)",
    enters="torque",
    parameters=(
        Parameter("dF_v", "N m s/rad", 0.0, -inf, inf, "half the difference of F_v between directions", linear=True),
    ),
    term=term,
    both_ways=True,
    example={"dF_v": 4e-05},
    needs="at least two speeds in each direction",
    look_alikes={"constant_load": "at one speed per direction both are an offset between the directions"},
    validated="simulated logs, EMPS",
)
