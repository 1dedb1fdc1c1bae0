"""Voltages of a slow log that were sampled in step with a held reference: their instants are not their means."""

from __future__ import annotations

import math
from dataclasses import replace

from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import notices as say
from pmsm_ctrl.plausibility.policy import POLICY
from pmsm_ctrl.plausibility.relations import Evidence
from pmsm_ctrl.section import Notice

__all__ = ["voltages_in_step"]

VOLTAGES = ("u_d", "u_q")


def voltages_in_step(evidence: Evidence, log: Log) -> tuple[Log, tuple[Notice, ...]]:
    """Return the log without voltages that say nothing of the winding, and that they do not.

    A position reference that is held steps in proportion to the speed, and current and voltage answer each step with a
    jump that fades until the next one. Where every sample stands at the same place of a step, the current is off by
    b omega, which is taken for viscous friction: K_t b is all of it, or its difference from the design's. A current
    loop of angular frequency w makes the voltage L_q w b omega of that, which is taken for back-emf.

    Parameters
    ----------
    evidence : Evidence
    log : Log
    """
    design, torque, psi_f = evidence.design, evidence.narrow, evidence.ratios.get("psi_f")
    motor, stated = design.motor, design.log.of("u_q").stated or design.log.of("i_q").stated
    if psi_f is None or torque is None or stated or log.period < POLICY.held_reference:
        return log, ()
    emf = design.K_t_assumed * (motor.p or 0) * (motor.psi_f or 0.0)
    if not emf or not motor.L_q:
        return log, ()
    F_v = torque.value("F_v")
    taken = max(abs(F_v), abs(F_v - design.parameters("viscous").get("F_v", 0.0)))
    in_step = motor.L_q * 2.0 * math.pi * POLICY.fastest_loop * taken / emf
    off = abs(psi_f.value - 1.0) - motor.tolerance_of("psi_f", POLICY.spread["psi_f"])
    if not 0.0 < off <= in_step:
        return log, ()
    kept = {name: values for name, values in log.channels.items() if name not in VOLTAGES}
    notice = say.VOLTAGES_IN_STEP(period=1e3 * log.period, percent=100.0 * (psi_f.value - 1.0))
    return replace(log, channels=kept), (notice,)
