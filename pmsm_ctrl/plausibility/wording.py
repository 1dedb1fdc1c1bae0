"""A cause and its factor as a notice: what such a factor usually is, and what to map."""

from __future__ import annotations

import math
from collections.abc import Iterable

from pmsm_ctrl.design import Design
from pmsm_ctrl.plausibility import notices as say
from pmsm_ctrl.plausibility.causes import Cause, Finding
from pmsm_ctrl.plausibility.relations import Evidence
from pmsm_ctrl.section import Notice

__all__ = ["odd_parameters", "worded"]

RPM = 30.0 / math.pi
ONE = 1.1  # logarithm of a factor (about 3) below which a wrong sign alone is reported
NEAR = 0.08  # of a known factor: the measured factor contains the tolerances of the datasheet


def worded(evidence: Evidence, readings: Iterable[Finding]) -> tuple[Notice, ...]:
    """Return one notice per reading, likeliest first; of several only those that would be mapped differently.

    Parameters
    ----------
    evidence : Evidence
    readings : iterable of Finding
    """
    found = [notice for reading in readings if (notice := _worded(evidence, reading)) is not None]
    unique = {notice.code: notice for notice in reversed(found)}
    return tuple(notice for notice in found if unique[notice.code] is notice)


def _worded(evidence: Evidence, reading: Finding) -> Notice | None:
    design, factor = evidence.design, reading.factor
    cause = reading.cause
    where = evidence.channel if cause is not Cause.MOTION else _motion(evidence)
    if cause is Cause.POLE_PAIRS and design.motor.p is not None:
        return say.POLE_PAIRS(found=round(design.motor.p * factor), p=design.motor.p)
    if cause in (Cause.FLUX, Cause.RESISTANCE, Cause.CROSS):
        name = {Cause.CROSS: "L_q"}.get(cause, cause.value)
        return say.PARAMETER_FACTOR(parameter=name, factor=factor)
    if cause is Cause.INERTIA:
        return say.INERTIA_FACTOR(factor=factor, cause=_known(factor, _every(design)))
    if factor < 0.0 and abs(math.log(-factor)) < ONE:
        if cause is Cause.VOLTAGE:
            return say.VOLTAGE_SIGN()
        if cause is Cause.MOTION:
            return say.MOTION_SIGN(channel=where)
        other = "" if evidence.voltages else f", or map {_motion(evidence)} with it"
        return say.CURRENT_SIGN(channel=where, other=other)
    template, known = {
        Cause.VOLTAGE: (say.VOLTAGE_FACTOR, _voltages(design)),
        Cause.MOTION: (say.MOTION_FACTOR, _motions(design)),
        Cause.TIME: (say.TIME_FACTOR, _times()),
    }.get(cause, (say.CURRENT_FACTOR, _currents(design)))
    return template(channel=where, factor=factor, inverse=1.0 / factor, cause=_known(factor, known))


def odd_parameters(evidence: Evidence, names: Iterable[str]) -> tuple[Notice, ...]:
    """Return a notice for every coefficient that is strange for no common reason."""
    shown = {"X": "L_q"}
    return tuple(
        say.PARAMETER_FACTOR(parameter=shown.get(name, name), factor=evidence.ratios[name].value) for name in names
    )


def _motion(evidence: Evidence) -> str:
    return "theta" if "theta" in evidence.bins.channels else "omega"


def _known(factor: float, known: Iterable[tuple[float, str]]) -> str:
    size = abs(factor)
    near = min(known, key=lambda row: abs(math.log(size / row[0])), default=None)
    if near is None or abs(math.log(size / near[0])) > NEAR:
        return ""
    return f": {near[1]}"


def _voltages(design: Design) -> list[tuple[float, str]]:
    bus = design.drive.u_dc
    return [
        (math.sqrt(3.0), "sqrt(3), line-to-line for phase"),
        (1.0 / math.sqrt(3.0), "1/sqrt(3), phase for line-to-line"),
        (math.sqrt(2.0), "sqrt(2), peak for rms"),
        (1.0 / math.sqrt(2.0), "1/sqrt(2), rms for peak"),
        (math.sqrt(1.5), "sqrt(3/2), power-invariant dq"),
        (1.0 / bus, "per unit of the dc-link voltage"),
        (2.0 / bus, "per unit of half the dc-link voltage"),
        (math.sqrt(3.0) / bus, "per unit of the dc-link voltage over sqrt(3)"),
        (100.0 / bus, "per cent of the dc-link voltage"),
        (1000.0, "mV for V"),
        (0.001, "kV for V"),
    ]


def _currents(design: Design) -> list[tuple[float, str]]:
    limit = design.drive.i_max
    out = [
        (math.sqrt(2.0), "sqrt(2), peak for rms"),
        (1.0 / math.sqrt(2.0), "1/sqrt(2), rms for peak"),
        (math.sqrt(1.5), "sqrt(3/2), power-invariant dq"),
        (1000.0, "mA for A, or a lost prefix milli"),
        (0.001, "a lost prefix kilo"),
        (1.0 / design.K_t_assumed, "a current for a torque, or the other way round"),
        (design.K_t_assumed, "a torque for a current, or the other way round"),
    ]
    if math.isfinite(limit):
        out += [(100.0 / limit, "per cent of i_max"), (1.0 / limit, "per unit of i_max")]
        out += [(100.0 / limit / design.K_t_assumed, "per cent of the rated torque")]
    return out


def _motions(design: Design) -> list[tuple[float, str]]:
    out = [
        (180.0 / math.pi, "degrees for radians"),
        (math.pi / 180.0, "radians for degrees"),
        (1.0 / (2.0 * math.pi), "turns for radians"),
        (2.0 * math.pi, "radians for turns"),
        (RPM, "rpm for rad/s"),
        (1.0 / RPM, "rad/s for rpm"),
        (1000.0, "a lost prefix milli"),
        (0.001, "a lost prefix kilo"),
    ]
    if design.motor.p is not None and design.motor.p > 1:
        out.append((float(design.motor.p), f"the electrical angle, {design.motor.p:g} pole pairs"))
    if design.load.gear != 1.0:
        out.append((1.0 / design.load.gear, "the load's side of the gear"))
    out += [(1.0 / ratio, f"the load's side of a gear of {ratio}") for ratio in (3, 4, 5, 7, 10, 20, 50, 100)]
    return out


def _times() -> list[tuple[float, str]]:
    return [(1000.0, "ms for s"), (0.001, "s for ms"), (1e6, "us for s"), (2.0, "every sample counted twice, or every "
            "second one missing"), (0.5, "half the sampling period"), (10.0, "ten times the sampling period"),
            (0.1, "a tenth of the sampling period")]  # fmt: skip


def _every(design: Design) -> list[tuple[float, str]]:
    """Return all known factors by their effect on the inertia: any channel may be wrong."""
    out = [(f, f"{text} in the current or torque") for f, text in _currents(design)]
    out += [(1.0 / f, f"{text} in the motion") for f, text in _motions(design)]
    return out + [(f**2, f"{text} in the time") for f, text in _times()]
