"""Errors of the design that a diagnosis writes, evaluated as `compare` does, instead of those of its last fit."""

from __future__ import annotations

from dataclasses import replace

from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.outcome import errors_table
from pmsm_ctrl.diagnose.result import Diagnosis, DiagnosisStep, Errors
from pmsm_ctrl.regression.evaluated import as_compared, with_evaluation
from pmsm_ctrl.regression.prediction import errors as errors_of
from pmsm_ctrl.regression.prediction import predict
from pmsm_ctrl.regression.worse_than_given import torque_error, worse_by_error

__all__ = ["as_written"]


def as_written(case: Case, found: Diagnosis) -> Diagnosis:
    """Return the answer with the torque errors of the given design and of the one that is written.

    Where that is worse than the given one, the given one stays.

    Parameters
    ----------
    case : Case
    found : Diagnosis
    """
    if case.believed is None:
        return found
    record = found.record
    prediction = predict(case.as_given, record)
    nominal = errors_table(record, errors_of(prediction.record, prediction.residual))
    found = replace(found, errors={**found.errors, "nominal": nominal})
    if found.design is case.as_given:
        return found
    rms, relative = torque_error(found.design, as_compared(found.design, record, case.believed.log))
    own = {"rms": rms, "unit": record.unit("torque"), "relative": relative}
    final = {**found.errors["final"], "torque": own}
    found = replace(found, errors={**found.errors, "final": final}, steps=_ending_at(found, final))
    worse = worse_by_error(relative, nominal["torque"]["relative"])
    if worse is None:
        return replace(found, design=with_evaluation(found.design, record, case.believed.log))
    warned = dict.fromkeys((*found.reasons, worse, *found.notices))
    return replace(found, design=case.as_given, improved=False, notices=tuple(warned))


def _ending_at(found: Diagnosis, final: Errors) -> tuple[DiagnosisStep, ...]:
    """Return the steps, the last of which ends at the final error."""
    return (*found.steps[:-1], *(replace(step, error_after=final) for step in found.steps[-1:]))
