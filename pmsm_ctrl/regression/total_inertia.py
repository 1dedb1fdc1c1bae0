"""The inertia that a fit has found, in a design that may state a load behind a gear."""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import SMALL
from pmsm_ctrl.design_text import rounded

__all__ = ["with_total_inertia"]


def with_total_inertia(design: Design, J: float, stderr: float) -> Design:
    """Return the design with another inertia at the motor shaft; unchanged where that leaves the rotor none.

    A fit that holds the inertia at its bound, which is that of the load, or whose inertia is zero to the digits of its
    standard error, has found no inertia of the rotor.

    Parameters
    ----------
    design : Design
    J, stderr : float
        kg m^2 (kg), load included.
    """
    if rounded(J - design.load.J / design.load.gear**2, stderr) < SMALL:
        return design
    return design.with_parameters(J=J, stderr={"J": stderr})
