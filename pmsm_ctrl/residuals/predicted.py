"""What the residuals of a prediction depend on, balance by balance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.prediction import Prediction
from pmsm_ctrl.regression.timing import punctual
from pmsm_ctrl.residuals.coordinates import Drive
from pmsm_ctrl.residuals.dependence import ResidualStructure, Trace, residual_structure

__all__ = ["structures", "traces_of"]


def traces_of(prediction: Prediction) -> dict[str, Trace]:
    """Return measured and predicted side of every balance.

    Parameters
    ----------
    prediction : Prediction
    """
    balances = prediction.record
    return {
        name: Trace(balances.t, balances.target[row], prediction.predicted[row], balances.mask, balances.unit(name))
        for row, name in enumerate(balances.channels)
    }


def structures(
    prediction: Prediction, log: Log, J: float, channels: Sequence[str] | None = None, least: float = 0.0
) -> Mapping[str, ResidualStructure]:
    """Return what the residual of every balance depends on.

    Parameters
    ----------
    prediction : Prediction
    log : Log
        That was predicted.
    J : float
        Inertia of the design, kg m^2 (kg).
    channels : sequence of str, optional
        The balances; all that there are when left out.
    least : float
        Weight above which samples are judged.
    """
    balances, prepared = prediction.record, prediction.record.prepared
    load = balances.signals.get("T_load")
    predicted = prediction.predicted[0] + (0.0 if load is None else balances.shaped(load))
    drive = Drive(predicted, J, balances.design.K_t_assumed if "i_q" in prepared.signals else None)
    away = replace(prepared, moving=prepared.moving & punctual(log, prepared.t, prepared.cutoff)).mask
    return {
        name: residual_structure(prepared, replace(trace, mask=trace.mask & away & (weight >= least)), drive)
        for (name, trace), weight in zip(traces_of(prediction).items(), balances.weight, strict=True)
        if channels is None or name in channels
    }
