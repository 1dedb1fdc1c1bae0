"""An inertia that the design does not know, from the log: the value that the fits start from."""

from __future__ import annotations

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, require_kind
from pmsm_ctrl.importers.relations import NOTHING, Balance, axis_balance
from pmsm_ctrl.log import Log, Logs, as_logs

__all__ = ["with_inertia"]

CERTAIN = 5.0  # standard errors of an inertia that a fit can start from


def with_inertia(design: Design, log: Logs) -> Design:
    """Return the design with an inertia: its own, or where that is unknown the one by which the log's axis accelerates.

    The fits then have no prior of it. What is written of the design has the tolerance that the design states, or none.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log

    Returns
    -------
    Design

    Raises
    ------
    LogError
        When the log does not tell the inertia either.
    RequestError
        When `design` is none.
    """
    require_kind(design, Design, "design")
    if design.motor.J is not None:
        return design
    best = max((_balance(design, one) for one in as_logs(log)), key=lambda found: found.certain)
    if not best.inertia > 0.0 or best.certain < CERTAIN:
        raise LogError(
            f"{design.source or design.name}: motor.J is unknown and the log does not tell it: the axis hardly "
            "accelerates, or the sign of its torque is wrong; a log with fast reversals, or a number, was expected"
        )
    load = design.load.at_motor
    J = best.inertia - load if best.inertia > 1.01 * load else 0.01 * best.inertia
    return design.starting_from(J)


def _balance(design: Design, log: Log) -> Balance:
    torque = log["torque"] if "torque" in log else design.K_t_assumed * log["i_q"] if "i_q" in log else None
    if torque is None or not {"theta", "omega"} & set(log):
        return NOTHING
    if "T_load" in log:
        torque = torque - log["T_load"]
    found = axis_balance(
        log.t, torque, speed=log.get("omega"), position=log.get("theta"), linear=log.motion == "linear"
    )
    return found if found.inertia == found.inertia else NOTHING
