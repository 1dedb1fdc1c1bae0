"""Friction that grows with the transmitted torque: gears, screws, loaded guides."""

from __future__ import annotations

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(torque: float, direction: float, mu: float) -> float:
    """mu abs(T) sgn(omega) with T the electromagnetic torque that the transmission carries."""
    return mu * abs(torque) * direction


effect = Effect(
    id="load_dependent_friction",
    title="Load-dependent friction",
    equation=r"\mu\,|T|\,\mathrm{sgn}(\omega)",
    source="P. Hamon, M. Gautier, P. Garrec, IEEE/RSJ IROS (2010) 4885: dry friction with load",
    enters="torque",
    parameters=(Parameter("mu", "1", 0.0, 0.0, 0.9, "share of the transmitted torque lost in friction", linear=True),),
    term=term,
    example={"mu": 0.08},
    needs="the same speeds at clearly different torques: two accelerations, or two loads",
    look_alikes={
        "coulomb": "at constant torque it is a constant",
        "torque_saturation": "both take away a share of large torques; driving and braking tell them apart",
    },
)
