"""Several records of one axis: weighed by their noise, and their positions counted from one zero."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.angle_zero import turned_by, with_common_zero, with_zero_of, zero_of_known
from pmsm_ctrl.regression.balances import STANDSTILL, Record, make_record
from pmsm_ctrl.regression.base_fit import base_fit
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.position_waves import Source
from pmsm_ctrl.regression.prediction import predict
from pmsm_ctrl.regression.spread import with_noise_of_records

__all__ = ["of_one_axis", "other_record", "sampled_alike", "zero_of_design"]

POINTS = 16  # of a wave

Zeros = tuple[tuple[float, float], ...]


def of_one_axis(design: Design, record: Record, zeros: Zeros | None = None) -> Record:
    """Weigh several records by their noise, and bring their positions to one zero.

    Of a design that has waves of its own, the zero of the record that they suit best.

    Parameters
    ----------
    design : Design
    record : Record
    zeros : tuple of (float, float), optional
        What has to be added to the position of each, and its standard error, rad (m), where that is known.

    Returns
    -------
    Record
    """
    fit = base_fit(design, record)
    weighed = with_noise_of_records(record, record.target - fit.weighted.predicted())
    if zeros:
        return turned_by(weighed, zeros)
    bare = _without_waves(design)
    if weighed is not record or bare is not design:
        fit = base_fit(bare, weighed)
    found = with_common_zero(Source.of(weighed, fit))
    if bare is design or not found.shifts:
        return found
    of_each = [turned_by(weighed, _from_zero_of(found.shifts, k)) for k in range(len(found.shifts))]
    return min(of_each, key=lambda one: predict(design, one).torque_error[0])


def other_record(design: Design, log: Log, record: Record, zeros: Zeros | None = None) -> Record:
    """Condition a held-out log as a record was, its position counted from the zero of the record.

    Nothing else is fitted to it, and it is one whatever it was joined from.

    Parameters
    ----------
    design : Design
    log : Log
    record : Record
    zeros : tuple of (float, float), optional
        As in `of_one_axis`.

    Returns
    -------
    Record
    """
    same = Processing(standstill=STANDSTILL, cutoff=min(record.cutoff, log.rate / 8.0))
    other = replace(sampled_alike(design, log, same, record), records=(), weighing=None)
    if zeros is not None:
        return turned_by(other, zeros) if zeros else other
    bare = _without_waves(record.design)
    return with_zero_of(*(Source.of(one, base_fit(bare, one)) for one in (other, record)))


def sampled_alike(design: Design, log: Log, processing: Processing, like: Record) -> Record:
    """Condition a log as one that was sampled in the same way as that of a record.

    Parameters
    ----------
    design : Design
    log : Log
        Another one; or the same one, in another band or for another design.
    processing : Processing
    like : Record
    """
    record = make_record(design, log, processing, like.age_elsewhere, like.timing)
    return replace(record, commanded=like.commanded, in_step=like.in_step, driven=like.driven)


def zero_of_design(design: Design, record: Record) -> tuple[float, float] | None:
    """Return what has to be added to the position for the waves of the design to be those of the record.

    Nothing of the kind is assumed of a record by itself: its waves may as well be others than the design's.

    Parameters
    ----------
    design : Design
    record : Record

    Returns
    -------
    (float, float) or None
        With its standard error, rad (m); None where nothing has to be added, or the design has no waves.
    """
    known = _waves_of(design)
    if not known or "theta" not in record.signals:
        return None
    return zero_of_known(Source.of(record, base_fit(_without_waves(record.design), record)), known)


def _waves_of(design: Design) -> dict[float, tuple[float, float]]:
    """Return cosine and sine part of the torque's waves that depend on the position alone, N m (N).

    By their number, radians in a radian of the axis (a metre).
    """
    effects, p = catalogue_of(design), float(design.motor.p or 1)
    out: dict[float, tuple[float, float]] = {}
    for entry in design.effects:
        effect = effects.get(entry.id)
        if effect is None or effect.signals != ("theta",) or effect.enters != "torque":
            continue
        values = effect.values(entry)
        number = effect.waves(values, p)
        phase = 2.0 * np.pi * np.arange(POINTS) / POINTS
        course = np.array([effect.standing(values, theta=angle / number) for angle in phase.tolist()])
        parts = np.array([np.cos(phase), np.sin(phase)]) @ course * (2.0 / POINTS)
        known = out.get(number, (0.0, 0.0))
        out[number] = (known[0] + float(parts[0]), known[1] + float(parts[1]))
    return out


def _without_waves(design: Design) -> Design:
    """Return the design without what reads the position: fitted to all records alike, it hides their zeros."""
    effects = catalogue_of(design)
    kept = tuple(e for e in design.effects if e.id not in effects or "theta" not in effects[e.id].signals)
    return design if len(kept) == len(design.effects) else design.replace_effects(kept)


def _from_zero_of(shifts: Zeros, number: int) -> Zeros:
    """Return the same shifts counted from the zero of one record."""
    zero, error = shifts[number]
    moved = [(shift - zero, hypot(stderr, error)) for shift, stderr in shifts]
    moved[number] = (0.0, 0.0)
    return tuple(moved)
