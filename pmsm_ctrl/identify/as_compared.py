"""The error of an identified design on its own log: the numbers that `compare` prints of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.evaluated import record_as_evaluated
from pmsm_ctrl.regression.prediction import predict
from pmsm_ctrl.regression.record_result import RecordResult

__all__ = ["as_compared", "sizes"]

Array = NDArray[np.float64]


def sizes(residual: Array, torque: Array) -> dict[str, float]:
    """Return the torque error, residual by torque, and the rms of the residual.

    Parameters
    ----------
    residual, torque : array, shape (n,)
    """
    error = float(np.linalg.norm(residual) / np.linalg.norm(torque))
    return {"relative_error": error, "rms": float(np.sqrt(np.mean(residual**2)))}


def as_compared(
    found: Design, log: Log, rows: tuple[RecordResult, ...]
) -> tuple[dict[str, float], tuple[RecordResult, ...]]:  # fmt: skip
    """Return the torque error of a design on a log, and the rows of several records with theirs.

    The log is conditioned again: how it was sampled and what weighs little in it follows from a design, and the terms
    of a command, which widen the standard errors of a fit, would make its error smaller.

    Parameters
    ----------
    found : Design
    log : Log
        All records.
    rows : tuple of RecordResult
        In the order of the records; none for a log that is one record.
    """
    prediction = predict(found, record_as_evaluated(found, log))
    record, left = prediction.record, prediction.residual[0]
    out = []
    for row, span in zip(rows, record.records, strict=False):
        used = record.mask & (record.t >= span.start) & (record.t <= span.stop)
        if not used.any():  # it stands still
            out.append(row)
            continue
        of_row = sizes(left[used], record.target[0][used])
        torque: dict[str, Any] = {"rms": of_row["rms"], "relative": of_row["relative_error"]}
        out.append(replace(row, after={**row.after, "torque": {**row.after.get("torque", {}), **torque}}))
    return sizes(left[record.mask], record.target[0][record.mask]), tuple(out)
