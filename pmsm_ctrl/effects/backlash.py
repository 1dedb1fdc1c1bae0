"""Backlash: motor and load are two masses with a gap between the flanks; the load may rub.

``J_load domega_load/dt = T_s - F_load sgn(omega_load) - T_load``, set-valued at rest: in the gap nothing but its
friction acts on the load. The motor has the rest of `F_c`.
"""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import Gap
from pmsm_ctrl.kernels import kernel


@kernel
def term(twist: float, twist_rate: float, gap: float, k: float, d: float) -> float:
    """Contact torque: nothing inside the gap, spring and damper on either flank, and a flank never pulls."""
    half = 0.5 * gap
    if twist > half:
        return max(k * (twist - half) + d * twist_rate, 0.0)
    if twist < -half:
        return min(k * (twist + half) + d * twist_rate, 0.0)
    return 0.0


effect = Effect(
    id="backlash",
    title="Backlash",
    equation=(
        r"T_s = k\,\mathrm{dz}_{g/2}(\theta - \theta_l) + d\,(\omega - \omega_l),\quad "
        r"J_l\,\dot\omega_l = T_s - F_l\,\mathrm{sgn}(\omega_l)"
    ),
    source="M. Nordin, P.-O. Gutman, Automatica 38 (2002) 1633",
    enters="torque",
    structure=Gap(load="J_load", stiffness="k", damping="d", gap="gap", dry="F_load"),
    amplitudes=("gap",),
    parameters=(
        Parameter("gap", "rad", 0.0, 0.0, 1.0, "total gap at the motor shaft"),
        Parameter("J_load", "kg m^2", 1e-5, 1e-12, inf, "inertia behind the gap, taken out of the total"),
        Parameter("k", "N m/rad", 100.0, 1e-9, inf, "contact stiffness; that of `compliance` if both are there"),
        Parameter("d", "N m s/rad", 0.01, 0.0, inf, "contact damping; that of `compliance` if both are there"),
        Parameter("F_load", "N m", 0.0, 0.0, inf, "Coulomb friction of the load, taken out of F_c; as above"),
    ),
    term=term,
    example={"gap": 0.01, "J_load": 4e-05, "k": 100.0, "d": 0.02, "F_load": 0.0},
    needs="reversals of the torque between motor and load: quick back and forth moves",
    look_alikes={
        "compliance": "under a load that keeps the gap closed only the spring shows",
        "presliding": "a load that rubs, and hardly weighs, is left behind and taken along like a bristle",
    },
)
