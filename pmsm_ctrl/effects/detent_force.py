"""Detent force: the magnets of a linear motor pull on slots and ends; the drag of a screw repeats with its lead."""

from __future__ import annotations

from math import cos, inf, pi, sin

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView, Search
from pmsm_ctrl.kernels import kernel

TRIED = 4  # periods that are tried
OF_POLES = (1, 2, 6)  # periods of the force in a pair of poles: of offsets, of the pitch of the magnets, of slots
BESIDE = 0.05  # of a wave over the whole travel: how much longer and shorter each is tried as well


@kernel
def term(theta: float, a_s: float, a_c: float, period: float) -> float:
    """a_s sin(2 pi theta / period) + a_c cos(2 pi theta / period)."""
    return a_s * sin(2.0 * pi * theta / period) + a_c * cos(2.0 * pi * theta / period)


def search(log: LogView) -> Search:
    """Return the periods that stand out most; on a rotary axis everything repeats with the turn, and has an order."""
    if not log.balances.linear:
        return Search((), 1, "on a rotary axis what repeats has an order of a turn")
    periods, possible = log.periods(TRIED)
    travel, p = log.travel, log.balances.design.motor.p
    poles = [] if p is None else [one for share in OF_POLES if 4.0 * (one := 2.0 * pi / (share * p)) <= travel]
    if not len(periods) and not poles:
        return Search((), 1, "no four periods lie within the travel, or none is passed slowly enough")
    beside = [travel / (travel / one + shift) for one in periods.tolist() for shift in (0.0, BESIDE, -BESIDE)]
    return Search(tuple({"period": one} for one in (*beside, *poles)), max(possible, 1) + len(poles))


effect = Effect(
    id="detent_force",
    title="Detent force of a linear axis",
    equation=r"A\,\sin(2\pi\,\theta/\lambda + \varphi)",
    source="N. Bianchi, S. Bolognani, A. D. F. Cappello, IEE Proc. Electr. Power Appl. 152 (2005) 703",
    enters="torque",
    parameters=(
        Parameter("a_s", "N m", 0.0, -inf, inf, "sine part, A cos(phi)", linear=True),
        Parameter("a_c", "N m", 0.0, -inf, inf, "cosine part, A sin(phi)", linear=True),
        Parameter("period", "rad", 0.03, 1e-5, 100.0, "period: pitch of the magnets or slots, or lead of the screw"),
    ),
    term=term,
    search=search,
    period="period",
    repeated=True,
    example={"a_s": 0.005, "a_c": 0.002, "period": 0.25},
    needs="a linear axis that passes four periods or more, slowly",
    look_alikes={
        "torque_ripple": "at constant current a force that repeats with the magnets is the same",
        "current_offset": "an error of the current sensors repeats with the poles of a linear motor",
        "current_gain": "an error of the current sensors repeats with the poles of a linear motor, twice",
    },
)
