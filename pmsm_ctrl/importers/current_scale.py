"""Whether a current is in A peak or in A rms: drives write either as ``A``, and the torque differs by 1.41."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.importers.mapping import FACTOR, Assignment
from pmsm_ctrl.importers.names import says_rms, split_header, unit_spelling
from pmsm_ctrl.importers.notices import PEAK_OR_RMS
from pmsm_ctrl.importers.plausibility import CERTAIN, INTERVAL, MIN_SAMPLES, torque_factor
from pmsm_ctrl.importers.relations import axis_balance
from pmsm_ctrl.importers.table import Table
from pmsm_ctrl.log import CHANNELS, Log
from pmsm_ctrl.section import Notice

__all__ = ["peak_or_rms"]

NEAR = 0.2  # of an inertia, half of what lies between peak and rms
# What says it, in a name or beside a unit; `names.says_rms` is the contrary.
_PEAK = re.compile(r"peak|pk\b|spitze|scheitel|ampl|cr[eê]te|picco", re.IGNORECASE)


def peak_or_rms(
    log: Log, table: Table, assignment: Assignment, design: Design | None, mapping: Mapping[str, str] | None
) -> tuple[Notice, ...]:
    """Return the doubt whether the current is in A peak, where neither file, mapping nor design tells.

    A torque in the same log tells by the torque constant, which is checked elsewhere; so does the design's inertia.

    Parameters
    ----------
    log : Log
    table : Table
    assignment : Assignment
    design : Design, optional
    mapping : mapping of str to str, optional
        Channel to column.

    Returns
    -------
    tuple of Notice
        One, or none.
    """
    source = assignment.source("i_q")
    if source is None or source.assumed_unit or source.factor_unknown or bool(np.all(log["i_q"] == log["i_q"][0])):
        return ()  # an assumed unit is a doubt of its own
    column = table.columns[source.column]
    spec = (mapping or {}).get("i_q") or (design.log.channels.get("i_q", "") if design is not None else "")
    scaled = design is not None and "i_q" in design.log.scale
    stated = scaled or bool(split_header(spec)[1]) or FACTOR.fullmatch(spec.strip()) is not None
    said = f"{column.label} {column.unit}"  # not every format writes the unit into the name
    if column.name in CHANNELS or stated or _PEAK.search(said) or "rms" in unit_spelling(column.unit):
        return ()
    if says_rms(column.name):
        if "rms" in unit_spelling(source.unit):  # and it is read so
            return ()
        return (PEAK_OR_RMS(column=column.label, name=column.name, hint="; the name says rms"),)
    with np.errstate(all="ignore"):  # numbers of any size
        _, correlation = torque_factor(log, design)
        factor, error = _inertia(log, design)
    if abs(correlation) > 0.7 or abs(factor - 1.0) + error < NEAR:
        return ()
    rms = math.sqrt(2.0)
    hint = "; in A rms the inertia would be that of the design" if abs(rms * factor - 1.0) + error < NEAR else ""
    return (PEAK_OR_RMS(column=column.label, name=column.name, hint=hint),)


def _inertia(log: Log, design: Design | None) -> tuple[float, float]:
    """Return the inertia that current and acceleration give, over that of the design, and its uncertainty."""
    if design is None or design.motor.J is None or len(log) < MIN_SAMPLES:
        return math.nan, math.nan
    torque, linear = design.K_t_assumed * log["i_q"], log.motion == "linear"
    found = axis_balance(log.t, torque, speed=log.get("omega"), position=log.get("theta"), linear=linear)
    if not math.isfinite(found.inertia) or found.certain < CERTAIN:
        return math.nan, math.nan
    return found.inertia / design.J, INTERVAL * found.stderr / design.J
