"""Gravity on an arm behind a gear, or an unbalance there: a wave that repeats after several turns of the motor."""

from __future__ import annotations

from math import inf, pi

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.detent_force import term
from pmsm_ctrl.effects.structures import LogView, Search

TRIED = 4  # periods that stand out, and are tried
STRONGEST = 24  # of all waves, those within a turn among them, out of which they are taken
PARTS = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5)  # of a wave that the whole travel may be; four and more stand out
LONGEST = 4.0  # times the whole travel: a longer wave is a constant load and a slope
SHORTEST = 1.25 * 2.0 * pi  # rad; one turn is `unbalance`


def search(log: LogView) -> Search:
    """Return the period of a stated gear, those of more than a turn that stand out, and parts of the travel."""
    if log.balances.linear:
        return Search((), 1, "a linear axis has no turn that a gear could make slower")
    travel = log.travel
    stated = 2.0 * pi * log.balances.design.load.gear
    few = [one for one in (stated, *(travel / part for part in PARTS)) if SHORTEST <= one <= travel / PARTS[0]]
    if not few:
        return Search((), 1, "the axis turns by less than half of the shortest period behind a gear")
    standing = [one for one in log.periods(STRONGEST)[0].tolist() if one >= SHORTEST][:TRIED]
    ends = (SHORTEST, LONGEST * travel)
    possible = len(few) + int(travel / SHORTEST)
    return Search(tuple({"period": one} for one in dict.fromkeys((*few, *standing, *ends))), possible)


effect = Effect(
    id="load_gravity",
    title="Gravity or unbalance behind a gear",
    equation=r"A\,\sin(2\pi\,\theta/\lambda + \varphi)",
    source="B. Siciliano, L. Sciavicco, L. Villani, G. Oriolo, Robotics, Springer 2009, section 7.3",
    enters="torque",
    parameters=(
        Parameter("a_s", "N m", 0.0, -inf, inf, "sine part, A cos(phi), at the motor", linear=True),
        Parameter("a_c", "N m", 0.0, -inf, inf, "cosine part, A sin(phi), at the motor", linear=True),
        Parameter(
            "period", "rad", 125.7, 6.3, 1e5, "turn of the load at the motor: 2 pi times the gear", within_grid=True
        ),
    ),
    term=term,
    search=search,
    period="period",
    example={"a_s": 0.01, "a_c": 0.004, "period": 62.8},
    needs="half a turn of the load or more, in both directions",
    look_alikes={
        "constant_load": "over a small part of a turn of the load gravity hardly changes",
        "position_dependent_friction": "in one direction of motion both are waves over the position",
        "unbalance": "on the motor's shaft it repeats with every turn",
    },
)
