"""A torque that was sampled in step with a held reference, or commanded: the inertia and the winding that it shows."""

from __future__ import annotations

import math

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.measures import machine_of
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.regression.conditioning import default_cutoff
from pmsm_ctrl.regression.timed_record import FRICTION

__all__ = ["inertia_doubted", "negative_friction", "shows_in_inertia"]

SHORTEST_MECHANICAL = 0.5e-3  # s: mechanical time constant of a servo motor without a load
USUAL_LOOP = 2.0 * math.pi * 500.0  # rad/s: bandwidth of a current loop that the design does not state


def inertia_doubted(fit: Fitted, off: float, tolerance: float, policy: Policy) -> str:
    """Return why an inertia beyond its tolerance may be none of the axis; empty where it is.

    A reference that is held for T steps by alpha T. A speed loop of angular frequency w answers with a jump of the
    torque by J w alpha T, which fades to its mean until the next step. Where every sample stands at the same place of
    such a step, as where the log's period is T or a multiple of it, half of that is taken for inertia. The loop is
    taken to be as fast as the usual band.

    A command is no torque. A current loop that does not compensate the back-emf lets the current fall behind by what
    its integrator needs to follow the ramp of it: by K_t alpha / (1.5 K_i), where K_i is the integral gain of the
    current controller, V/(A s). So the command shows K_t^2 / (1.5 K_i) of inertia that is none.

    Parameters
    ----------
    fit : Fitted
    off : float
        The inertia's difference from the design's, as a share of that.
    tolerance : float
        As a share.
    policy : Policy
    """
    record = fit.record
    if doubt := negative_friction(fit, policy):
        return doubt
    if record.in_step:
        return f"outside its tolerance, but the {record.drive} was sampled in step with a held reference: not sure"
    in_step = math.pi * default_cutoff(record.prepared.rate) * record.period
    if not record.sampling_stated and abs(off) - tolerance <= in_step:
        return f"outside its tolerance, but a {record.drive} sampled in step with a held reference shows the same"
    commanded = _behind(record.design) / record.design.J
    if not record.sampling_stated and 0.0 < off - tolerance <= commanded:
        return (
            f"outside its tolerance, but a {record.drive} command shows the same where the current loop does not "
            "compensate the back-emf"
        )
    return ""


def _behind(design: Design) -> float:
    """Return the inertia, kg m^2 (kg), by which the command of a current loop without a term of the back-emf is off.

    A loop that the design does not state cancels the pole of the winding. Of a winding that it does not state either
    the mechanical time constant is taken to be as short as that of a motor without a load can be: 1.5 R J / K_t^2.
    """
    if design.loops is not None:
        integral = design.loops.current.K_p / design.loops.current.T_n
    elif design.motor.R is not None:
        integral = design.motor.R * USUAL_LOOP
    else:
        return design.J / (SHORTEST_MECHANICAL * USUAL_LOOP)
    return design.K_t_assumed**2 / (1.5 * integral)


def negative_friction(fit: Fitted, policy: Policy) -> str:
    """Return that a friction of the axis would surely be negative: what was logged is not its torque alone.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    negative = [
        fit.model.names[k]
        for k, bound in fit.estimate.held.items()
        if fit.model.names[k] in FRICTION.values()
        and bound - float(fit.plain.values[k]) > policy.sure_errors * float(fit.plain.stderr[k])
    ]
    said = f"outside its tolerance, but not sure: {' and '.join(negative)} would be negative as well"
    return said if negative else ""


def shows_in_inertia(fit: Fitted, policy: Policy) -> bool:
    """Whether the inertia is surely off its tolerance, and a torque in step with a held reference explains that.

    The current that such a log holds is too large or too small by a share of the acceleration, and so is what the
    voltages hold of it: what they show in proportion to the current's sign or size is no effect of its own. Nor is
    what the torque itself shows so, where the reference was held for certain.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    found = machine_of(fit.record.design, fit, policy.tolerance).get("J")
    if found is None:
        return False
    value, stderr, nominal, tolerance = found
    outside = abs(value - nominal) - tolerance * nominal > policy.sure_errors * stderr
    return outside and bool(inertia_doubted(fit, value / nominal - 1.0, tolerance, policy))
