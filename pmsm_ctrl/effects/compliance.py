"""Compliance: motor and load are two masses with a spring and a damper between them; the load may rub.

``J_load domega_load/dt = T_s - F_load sgn(omega_load) - T_load``, set-valued at rest: the load stays where it is while
the spring pulls by less than its friction. The motor has the rest of `F_c`.
"""

from __future__ import annotations

from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import Spring
from pmsm_ctrl.kernels import kernel


@kernel
def term(twist: float, twist_rate: float, k: float, d: float) -> float:
    """Torque that the motor passes on: k (theta - theta_load) + d (omega - omega_load)."""
    return k * twist + d * twist_rate


effect = Effect(
    id="compliance",
    title="Two masses with a spring",
    equation=(
        r"T_s = k\,(\theta - \theta_l) + d\,(\omega - \omega_l),\quad "
        r"J_l\,\dot\omega_l = T_s - F_l\,\mathrm{sgn}(\omega_l)"
    ),
    source="W. Leonhard, Control of Electrical Drives, 3rd ed. (2001), ch. 2",
    enters="torque",
    structure=Spring(load="J_load", stiffness="k", damping="d", dry="F_load"),
    amplitudes=("J_load",),
    parameters=(
        Parameter("J_load", "kg m^2", 0.0, 0.0, inf, "inertia behind the spring, taken out of the total"),
        Parameter("k", "N m/rad", 100.0, 1e-9, inf, "stiffness"),
        Parameter("d", "N m s/rad", 0.0, 0.0, inf, "damping"),
        Parameter("F_load", "N m", 0.0, 0.0, inf, "Coulomb friction of the load, taken out of F_c"),
    ),
    term=term,
    example={"J_load": 4e-05, "k": 15.0, "d": 0.002, "F_load": 0.0},
    needs="motion with content around the resonance: chirp, multisine, or reversals of a load that rubs",
    look_alikes={
        "delay": "below the resonance both shift torque against acceleration",
        "backlash": "under a load that keeps the gap closed only the spring shows",
        "presliding": "a load that rubs, and swings faster than the log shows, is held and let go like a bristle",
    },
)
