"""The currents that terms read: what was meant to flow, and what is faster than the low-pass of the signals."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared
from pmsm_ctrl.regression.edges import MAD, UPPER
from pmsm_ctrl.regression.filters import derivative, low_pass
from pmsm_ctrl.regression.weights import on_grid, scatter

__all__ = ["add_slopes", "drive_as_logged", "intended_i_d"]

Array = NDArray[np.float64]

INTENDED = 0.25  # of the cutoff: a current that is meant to flow along d all the time changes no faster
SHOWN = 3.0  # times the noise, from which on a current is none


def intended_i_d(log: Log, prepared: Prepared, i_d: Array) -> Array:
    """Return the d-current without its noise: the reference where it is logged, else the slow part if there is any.

    What flows for moments only, as at the most torque per ampere of a salient motor, is faster, and no noise.

    Parameters
    ----------
    log : Log
    prepared : Prepared
    i_d : array, shape (n,)
        Measured and pre-filtered, A.
    """
    if "i_d_ref" in log:
        return on_grid(log, prepared, "i_d_ref")
    slow = low_pass(i_d, prepared.rate, INTENDED * prepared.cutoff)
    fast = i_d - slow
    noise = float(np.std(fast))
    if noise > SHOWN * MAD * float(np.median(np.abs(fast))):
        return i_d
    return slow if float(np.sqrt(np.mean(slow**2))) > SHOWN * noise else np.zeros_like(i_d)


def drive_as_logged(
    design: Design, log: Log, prepared: Prepared, signals: Mapping[str, Array]
) -> dict[str, Array]:  # fmt: skip
    """Return torque and q-current as they were logged, and the standard deviation of their noise, shape (n,) each.

    A term that bends over the current or the torque needs them as fast as they were: its mean over a fast current is
    not its value at the mean. The noise above a quarter of the rate is taken for that of all frequencies alike.

    Parameters
    ----------
    design : Design
    log : Log
        With one of them; the other one follows by the torque constant.
    prepared : Prepared
    signals : dict of name to array, shape (n,)
        With both, pre-filtered.
    """
    logged = {name: on_grid(log, prepared, name) for name in ("torque", "i_q") if name in log}
    noise = {name: scatter(one, prepared.rate) / math.sqrt(1.0 - 2.0 * UPPER) for name, one in logged.items()}
    K_t = design.K_t_assumed
    if "torque" not in logged:
        logged["torque"] = signals["torque"] + K_t * (logged["i_q"] - signals["i_q"])
        noise["torque"] = K_t * noise["i_q"]
    elif "i_q" not in logged:
        logged["i_q"], noise["i_q"] = logged["torque"] / K_t, noise["torque"] / K_t
    spread = {f"{name}_noise": np.broadcast_to(value, prepared.t.shape) for name, value in noise.items()}
    return {f"{name}_logged": one for name, one in logged.items()} | spread


def add_slopes(signals: dict[str, Array], prepared: Prepared, known: Mapping[str, Array]) -> None:
    """Add the slopes of the currents that are others than the known ones, whose slopes are there.

    Parameters
    ----------
    signals : dict of name to array, shape (n,)
        Changed in place.
    prepared : Prepared
    known : dict of name to array, shape (n,)
    """
    for name in ("i_d", "i_q", "i_q_wide"):
        if name == "i_q_wide" and signals.get(name) is signals["i_q"]:
            signals["di_q_wide"] = signals["di_q"]
        elif name in signals and signals[name] is not known.get(name):
            signals[f"d{name}"] = derivative(signals[name], 1.0 / prepared.rate)
