"""Several records identified together: what each has of its own is fitted first, and taken out as a known load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.least_squares import Fit
from pmsm_ctrl.regression.record_result import RecordResult, RecordSpread, own_rows, record_spreads
from pmsm_ctrl.regression.records import LEVELS
from pmsm_ctrl.regression.spread import levels_of
from pmsm_ctrl.regression.timed_record import timed_record

__all__ = ["Joint", "joint", "with_joint_errors"]


@dataclass(frozen=True, eq=False)
class Joint:
    """Records made ready to be identified as one log.

    Attributes
    ----------
    log : Log
        With what each record's friction and constant torque deviate in its ``T_load``.
    rows : tuple of RecordResult
    spreads : tuple of RecordSpread
    stderr : dict of name to float
        Of parameters, the deviations of the records estimated beside them.
    """

    log: Log
    rows: tuple[RecordResult, ...] = ()
    spreads: tuple[RecordSpread, ...] = ()
    stderr: Mapping[str, float] = field(default_factory=dict)


def joint(design: Design, log: Log) -> Joint:
    """Fit the base model to all records, each with its own friction and constant torque, and take these out.

    A log that is one record is returned as it is.

    Parameters
    ----------
    design : Design
    log : Log

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    """
    if len(log.records) < 2:
        return Joint(log)
    record = timed_record(design, log)
    fit = base_fit(design, record)
    levels = levels_of(fit.record, fit.estimate, fit.weights, fit.whitener)
    t = record.prepared.t
    load = np.zeros(len(log))
    for symbol, signal in LEVELS.items():
        shape = np.interp(log.t, t, record.signals[signal]) if signal else np.ones(len(log))
        for span, value in zip(log.records, levels.deviation[symbol].tolist(), strict=True):
            inside = (log.t >= span.start) & (log.t <= span.stop)
            load[inside] += value * shape[inside]
    load += log.channels.get("T_load", np.zeros(len(log)))
    model = fit.model
    nominal = np.where([name in ("J",) or model.group_of(k).entry >= 0 for k, name in enumerate(model.names)],
                       model.nominal, fit.plain.values)  # fmt: skip
    before = fit.record.target - model.matrix @ nominal
    after = fit.record.target - fit.estimate.predicted()
    rows = own_rows(fit.record, (before, after), (fit.estimate, fit.weights, fit.whitener), "")
    stderr = dict(zip(model.names, fit.plain.stderr.tolist(), strict=True))
    return Joint(log.with_channels(T_load=load), tuple(rows), record_spreads(fit.record, fit.estimate, rows), stderr)


def with_joint_errors(fit: Fit, stderr: Mapping[str, float]) -> Fit:
    """Return a fit whose standard errors allow for the deviations of the records, which were taken as known.

    Parameters
    ----------
    fit : Fit
    stderr : dict of name to float
    """
    known = {name: max(own, stderr.get(name, 0.0)) if np.isfinite(own) else own for name, own in fit.stderr.items()}
    return replace(fit, stderr=known)
