"""Presliding: below breakaway the contact is a stiff spring, not a rigid lock (elasto-plastic bristle).

One internal number, the bristle's deflection zeta as a share of the breakaway deflection z_s, carries every dry
friction of the axis: F = F(0) zeta. It depends on the distance travelled, not on time, so a step over any distance
has a closed form: elastic up to the share z_b, then bending towards the dry friction at this speed. Nothing is
stiff in time, whatever the speed; a load that swings below the elastic share leaves no drift, which plain LuGre
does; and because the deflection follows the falling Stribeck curve over a distance, friction lags behind speed.
"""

from __future__ import annotations

from math import exp

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import Bristle
from pmsm_ctrl.kernels import kernel


@kernel
def term(
    zeta: float, travel: float, omega: float, limit: float, z_s: float, z_b: float, tau_z: float
) -> tuple[float, float]:
    """Deflection after a further `travel` from deflection `zeta`, and the friction it makes, as shares of F(0).

    Elastic while unloading or where abs(zeta) < z_b limit: dzeta = dtheta / z_s. Beyond, in the direction of
    loading, dzeta = dtheta / z_s (1 - (zeta - z_b limit) / (limit - z_b limit)), which tends to `limit`.
    The friction is zeta + tau_z dzeta/dt, the bristle's spring and damper.
    """
    sign = 1.0 if travel > 0.0 or (travel == 0.0 and omega >= 0.0) else -1.0
    start = sign * zeta
    now = start + abs(travel) / z_s
    stiffness = 1.0 / z_s
    elastic = z_b * limit
    if now > elastic:
        room = limit - elastic
        first = max(start, elastic)
        left = (limit - first) * exp(-(now - first) / room)
        now = limit - left
        if sign * omega > 0.0:
            stiffness *= left / room
    return sign * now, sign * now + tau_z * omega * stiffness


effect = Effect(
    id="presliding",
    title="Presliding (elasto-plastic bristle)",
    equation=r"\mathrm{sgn}(\omega) \to \zeta,\quad d\zeta = \frac{d\theta}{z_s}\,(1 - \alpha(\zeta))",
    source="P. Dupont, V. Hayward, B. Armstrong, F. Altpeter, IEEE Trans. Automat. Control 47 (2002) 787",
    enters="torque",
    structure=Bristle(deflection="z_s", damping="tau_z"),
    channels=("zeta", "direction"),
    amplitudes=("z_s",),
    parameters=(
        Parameter("z_s", "rad", 0.0, 0.0, 1.0, "breakaway deflection: the stiffness is (F_s + ...)/z_s"),
        Parameter("z_b", "1", 0.5, 0.0, 0.99, "share of the breakaway torque that is purely elastic", soft=True),
        Parameter("tau_z", "s", 1e-3, 0.0, 1.0, "damping of the bristle over its stiffness", soft=True),
    ),
    term=term,
    both_ways=True,
    example={"z_s": 0.002, "z_b": 0.5, "tau_z": 0.001},
    needs="small reversals and holds with an encoder finer than the breakaway deflection",
    look_alikes={
        "stribeck": "just around reversals both bend the friction curve",
        "compliance": "a stiff spring in front of a stuck load looks alike from the motor",
        "backlash": "a lost motion at reversal shows in both",
    },
)
