"""The dq voltages a design predicts from the measured currents and speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.notices import NOT_IN_VOLTAGES
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.evaluate import column
from pmsm_ctrl.kernels.balance import voltage_d, voltage_q
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.filters import derivative
from pmsm_ctrl.regression.signals import evaluable_terms, term_signals
from pmsm_ctrl.section import Notice

__all__ = ["predicted_voltages"]

Array = NDArray[np.float64]


def predicted_voltages(design: Design, prepared: Prepared) -> tuple[dict[str, Array], tuple[Notice, ...]]:
    """Predict u_d and u_q, shape (n,), V, by the dq voltage equations and the design's voltage effects.

    Empty when the design or the log lacks what is needed; the notices name effects that could not take part.
    """
    signals, motor = prepared.signals, design.motor
    if not motor.electrical or any(name not in signals for name in ("i_d", "i_q", "u_d", "u_q")):
        return {}, ()
    i_d, i_q, omega = signals["i_d"], signals["i_q"], signals["omega"]
    di_d, di_q = signals["di_d"], signals["di_q"]
    R, L_d, L_q, p, psi_f = motor.R, motor.L_d, motor.L_q, motor.p, motor.psi_f
    # the kernels' own Python source works on arrays
    u_d = voltage_d.py_func(R, L_d, L_q, p, i_d, i_q, di_d, omega)
    u_q = voltage_q.py_func(R, L_d, L_q, p, psi_f, i_d, i_q, di_q, omega)
    known = term_signals(design, signals)
    terms, left_out = evaluable_terms(design, "voltage", known)
    for effect, parameters in terms:
        added = column(effect, known, parameters)
        u_d, u_q = u_d + added[0], u_q + added[1]
    # the command logged now acts after the drive's delay and is held for one period: half a period later on average
    age = (design.drive.delay_periods + 0.5) / design.drive.f_control
    period = 1.0 / prepared.rate
    predicted = {"u_d": u_d + age * derivative(u_d, period), "u_q": u_q + age * derivative(u_q, period)}
    return predicted, tuple(NOT_IN_VOLTAGES(effect=name, why=why) for name, why in left_out.items())
