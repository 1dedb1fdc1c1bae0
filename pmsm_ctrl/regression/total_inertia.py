"""The inertia that a fit has found, in a design that may state a load behind a gear."""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.design_parts import SMALL
from pmsm_ctrl.units import rounded

__all__ = ["with_total_inertia"]


def with_total_inertia(design: Design, J: float, stderr: float) -> Design:
    """Return the design with another inertia at the motor shaft, unless that leaves the rotor or the load none.

    The larger one of the two takes the change. A fit that holds the inertia at its bound, which is that of the other
    one, or whose inertia is zero to the digits of its standard error, has found none.

    Parameters
    ----------
    design : Design
    J, stderr : float
        kg m^2 (kg), load included.
    """
    if rounded(J - design.load.kept(design.motor.J), stderr) < SMALL:
        return design
    return design.with_parameters(J=J, stderr={"J": stderr})
