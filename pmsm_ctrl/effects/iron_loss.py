"""Iron loss: hysteresis and eddy currents brake the rotor, even without current."""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.kernels import kernel


@kernel
def term(omega: float, direction: float, p: float, T_h: float, k_e: float) -> float:
    """T_h sgn(omega) + k_e p omega: a hysteresis part constant in speed, an eddy-current part proportional to it."""
    return T_h * direction + k_e * p * omega


effect = Effect(
    id="iron_loss",
    title="Iron loss torque",
    equation=r"T_h\,\mathrm{sgn}(\omega) + k_e\,p\,\omega",
    source="G. Bertotti, IEEE Trans. Magn. 24 (1988) 621, at constant flux amplitude",
    enters="torque",
    parameters=(
        Parameter("T_h", "N m", 0.0, 0.0, inf, "hysteresis torque", linear=True),
        Parameter("k_e", "N m s/rad", 0.0, 0.0, inf, "eddy-current torque per electrical speed", linear=True),
    ),
    term=term,
    same_as={"T_h": "coulomb", "k_e": "viscous"},
    example={"T_h": 0.003, "k_e": 8e-06},
    needs="a comparison with the magnets' flux changed or the rotor removed: never visible in one axis' log alone",
    look_alikes={
        "viscous": "the eddy-current part is proportional to speed",
        "coulomb": "the hysteresis part is constant in speed",
    },
)
