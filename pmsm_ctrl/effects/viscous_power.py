"""Drag that is not proportional to speed: bearing drag with omega^(2/3), windage with omega^2."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

from pmsm_ctrl.effects.base import Effect, Parameter
from pmsm_ctrl.effects.structures import LogView
from pmsm_ctrl.kernels import kernel


@kernel
def term(omega: float, direction: float, k: float, n: float) -> float:
    """k abs(omega)^n sgn(omega)."""
    return k * abs(omega) ** n * direction  # type: ignore[no-any-return]


def search(log: LogView) -> Iterator[dict[str, float]]:
    """Yield exponents below and above 1, which is viscous friction."""
    for n in (0.33, 0.5, 2.0 / 3.0, 0.8, 1.3, 1.6, 2.0, 2.5, 3.0):
        yield {"n": n}


effect = Effect(
    id="viscous_power",
    title="Sub- or super-linear drag",
    equation=r"k\,|\omega|^{n}\,\mathrm{sgn}(\omega)",
    source="A. Palmgren, Ball and Roller Bearing Engineering, 3rd ed. (1959): drag with speed^(2/3)",
    enters="torque",
    parameters=(
        Parameter("k", "N m (s/rad)^n", 0.0, 0.0, inf, "drag at 1 rad/s", linear=True),
        Parameter("n", "1", 2.0 / 3.0, 0.3, 3.0, "exponent", avoid=(0.85, 1.18)),
    ),
    term=term,
    search=search,
    example={"k": 0.001, "n": 0.667},
    needs="steady motion at five or more well spread speeds",
    look_alikes={
        "viscous": "with n = 1 they are the same",
        "quadratic_drag": "with n = 2 they are the same",
        "stribeck": "a sub-linear drag rises as steeply at low speed",
        "thermal_drift": "if the speed was raised step by step, drag that falls with time looks sub-linear",
    },
)
