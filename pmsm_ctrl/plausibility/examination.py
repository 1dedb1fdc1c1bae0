"""examine: do a log and a design belong together?

What the recorder did to single channels comes first (`recorder`), exchanged and foreign channels next (`foreign`), and
last one cause for all coefficients that are off (`causes`). All of them use the same few regressions (`relations`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility.bins import binned
from pmsm_ctrl.plausibility.causes import likeliest, strange
from pmsm_ctrl.plausibility.foreign import foreign_current, foreign_voltage, late_channel, magnitudes, sensor_offset
from pmsm_ctrl.plausibility.in_step import voltages_in_step
from pmsm_ctrl.plausibility.recorder import recorded
from pmsm_ctrl.plausibility.relations import Evidence, evidence_of
from pmsm_ctrl.plausibility.result import Plausibility
from pmsm_ctrl.plausibility.wording import odd_parameters, worded
from pmsm_ctrl.regression.drive_timing import drive_sampling, stated_timing
from pmsm_ctrl.section import Notice

__all__ = ["examine"]

FEWEST = 200  # samples; less than a fifth of a second of a usual log says nothing of a motion


def examine(design: Design, log: Log) -> Plausibility:
    """Compare a log with the physics of its design: signs, factors, swapped, foreign and damaged channels.

    Parameters
    ----------
    design : Design
    log : Log

    Returns
    -------
    Plausibility
        Empty for a sound log; a relation whose channels are absent is not examined.

    Raises
    ------
    LogError
        When the current or the torque is constant, or a number is beyond reason.
    """
    log.check_evaluable()
    if len(log) < FEWEST:
        return Plausibility(log)
    with np.errstate(all="ignore"):
        found = recorded(design, log)
        stated = stated_timing(drive_sampling(design, found.log), found.log.period)  # that is no fault of the channels
        evidence = evidence_of(design, binned(stated.undone(found.log)))
        kept, in_step = voltages_in_step(evidence, found.log)
        if in_step:
            evidence = replace(evidence, voltages={})
        contradictions = found.contradictions or _contradictions(evidence, kept)
        changed, late, lag = (kept, (), 0.0) if contradictions else late_channel(evidence, kept)
    doubts, logged = (*found.doubts, *in_step, *late), None if changed is kept else kept
    return Plausibility(changed, contradictions, doubts, found.excluded, found.repairs, lag, logged)


def _contradictions(evidence: Evidence, log: Log) -> tuple[Notice, ...]:
    """Return magnitudes for signed values, or exchanged or foreign channels, or the cause of all that is off."""
    for look in (magnitudes, foreign_current, foreign_voltage, sensor_offset):
        if found := look(evidence, log):
            return found
    readings = likeliest(evidence.design, evidence.ratios, evidence.from_current)
    if readings:
        return worded(evidence, readings)
    return odd_parameters(evidence, strange(evidence.ratios))
