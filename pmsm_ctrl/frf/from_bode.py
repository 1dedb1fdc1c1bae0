"""A measured Bode diagram beside a design: which loop it is of, in which unit, and the axis in it.

An open or closed speed loop holds the axis and everything around it: controllers, filters, delays, and the EMF, through
which the axis acts back on its current. With one number of each for every frequency, the reciprocal of the loop is
linear in the reciprocal of the axis: 1/L = a/P + b. The design's sampled cascade around two rigid axes gives a and b.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.frf.bode import BodeFile, BodeSet
from pmsm_ctrl.frf.result import Response
from pmsm_ctrl.sampling import smoothing
from pmsm_ctrl.tune.linearise import default_speed, friction_slope, mobility, rigid, second_mass
from pmsm_ctrl.tune.margins import response as response_of
from pmsm_ctrl.tune.sampled import Cascade
from pmsm_ctrl.tune.speed import open_loop

__all__ = ["KINDS", "MeasuredBode", "interpret", "unit_names"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

KINDS = ("plant", "open", "closed")
RPM = math.pi / 30.0
HEAVIER = 3.0  # inertia of the second rigid axis around which the cascade is evaluated
LEAST = 1e-3  # relative error of a point: a printed figure has three or four digits
NEIGHBOURS = 15  # points over which the scatter is taken


@dataclass(frozen=True, eq=False)
class MeasuredBode:
    """A measured Bode diagram, read and interpreted beside a design; `pmsm_ctrl.frf` takes it in place of a log.

    Attributes
    ----------
    file : str
    kind : {"plant", "open", "closed"}
        From current or torque to speed, or the open or closed speed loop.
    unit : str
        Of the plant.
    measured : Response
        As in the file.
    plant : Response
        The axis, (rad/s)/(N m).
    speed : float
        At which the design's surroundings of the axis were linearised, rad/s.
    columns : tuple of str
        Which column is what.
    doubts : tuple of str
        What was found from the numbers and not stated: to be confirmed.
    """

    file: str
    kind: str
    unit: str
    measured: Response
    plant: Response
    speed: float
    columns: tuple[str, ...]
    doubts: tuple[str, ...]


def unit_names(design: Design) -> dict[str, float]:
    """Return the units that a plant may have, and their factors to (rad/s)/(N m) or (m/s)/N.

    Parameters
    ----------
    design : Design
        Its torque constant turns currents into torque.
    """
    K_t = design.K_t_assumed
    peak, rms = 1.0 / K_t, 1.0 / (K_t * math.sqrt(2.0))
    if design.motion == "linear":
        return {"(m/s)/N": 1.0, "(m/s)/A": peak, "(m/s)/A rms": rms, "(mm/s)/N": 1e-3, "(mm/s)/A": 1e-3 * peak}
    return {
        "(rad/s)/(N m)": 1.0, "(rad/s)/A": peak, "(rad/s)/A rms": rms, "rpm/(N m)": RPM, "rpm/A": RPM * peak,
        "rpm/A rms": RPM * rms,
    }  # fmt: skip


def interpret(design: Design, read: BodeFile, *, kind: str | None = None, unit: str | None = None) -> MeasuredBode:
    """Return the axis that a measured Bode diagram holds.

    Parameters
    ----------
    design : Design
    read : BodeFile
    kind : {"plant", "open", "closed"}, optional
        What the file holds; found from its header, or from the shape.
    unit : str, optional
        Of a plant, a name of `unit_names`; else the one that makes the inertia closest to the design's.

    Returns
    -------
    MeasuredBode

    Raises
    ------
    RequestError
        For an unknown kind or unit, or a loop that the design cannot have.
    DesignError
        When the design's inertia is unknown.
    """
    known = unit_names(design)
    if kind is not None and kind not in KINDS:
        raise RequestError(f"response: found '{kind}'; accepted: {', '.join(KINDS)}")
    if unit is not None and unit not in known:
        raise RequestError(f"unit: found '{unit}'; accepted: {', '.join(known)}")
    one, doubts = _chosen(read, kind), list(read.doubts)
    models = _models(design, one.frequency)
    if kind is None and not one.kind:
        kind = min(models, key=lambda name: _distance(one.value, models[name], scaled=name == "plant"))
        doubts.append(f"the response is taken as {_WORDS[kind]}, whose shape is the closest")
    kind = kind or one.kind
    if kind not in models:
        raise RequestError(f"{read.file}: {_WORDS[kind]} needs the loops and the motor data of the design")
    errors = _errors(one)
    measured = _response("speed" if kind != "plant" else "plant", one, one.value, errors)
    if kind == "plant":
        if unit is None:
            stated = {name: factor for name, factor in known.items() if _means(one.unit, name)}
            unit, ratio = _unit(design, one, stated or known)
            if len(stated) != 1:  # none, or a current that may be peak or rms
                doubts.append(f"the unit is taken as {unit}, with which the inertia is {ratio:.3g} times the design's")
        value, share = one.value * known[unit], np.ones(len(one.value))
    else:
        loop, share = one.value, np.ones(len(one.value))
        if kind == "closed":
            passed = one.value / _reference(design, one.frequency)
            loop, share = passed / (1.0 - passed), 1.0 / np.abs(1.0 - passed)
            tau = design.require_loops().speed.reference_filter
            if tau > 0.0:
                doubts.append(f"the design's filter of the reference, {1e3 * tau:.3g} ms, is taken as a part of it")
        value = _axis_of(design, one.frequency, loop)
    plant = _response("plant", one, value, np.abs(value) * share * errors / np.abs(one.value))
    return MeasuredBode(
        read.file, kind, unit or "", measured, plant, _speed(design), read.columns, tuple(doubts)
    )  # fmt: skip


_WORDS = {
    "plant": "the axis, from current or torque to speed", "open": "the open speed loop",
    "closed": "the closed speed loop",
}  # fmt: skip


def _chosen(read: BodeFile, kind: str | None) -> BodeSet:
    """Return the set of the kind that is asked for, or the one closest to the axis."""
    wanted = [kind] if kind is not None else list(KINDS)
    for name in wanted:
        for one in read.sets:
            if one.kind == name:
                return one
    return read.sets[0]


def _speed(design: Design) -> float:
    return default_speed(design) if design.motor.electrical else 1.0


def _models(design: Design, frequency: Array) -> Mapping[str, Complex]:
    """Return the design's own responses at frequencies (Hz)."""
    speed = _speed(design)
    s = np.asarray(2j * math.pi * frequency, dtype=np.complex128)
    found = {"plant": mobility(s, design.J, friction_slope(design, speed), second_mass(design))}
    if design.loops is None:
        return found
    try:
        cascade = Cascade.of(design, design.loops.current, at=speed)
    except (DesignError, RequestError):
        return found
    open_ = response_of(open_loop(cascade, design.loops.speed), s.imag)
    return {**found, "open": open_, "closed": _reference(design, frequency) * open_ / (1.0 + open_)}


def _axis_of(design: Design, frequency: Array, loop: Complex) -> Complex:
    """Return the axis in an open speed loop, (rad/s)/(N m)."""
    speed, loops = _speed(design), design.require_loops()
    s = np.asarray(2j * math.pi * frequency, dtype=np.complex128)
    stiff = rigid(design)
    known, seen = [], []
    for factor in (1.0, HEAVIER):
        truth = stiff.with_parameters(J=factor * design.J)
        cascade = Cascade.of(design, loops.current, truth=truth, at=speed)
        seen.append(1.0 / response_of(open_loop(cascade, loops.speed), s.imag))
        known.append(truth.J * s + friction_slope(truth, speed))
    a = (seen[1] - seen[0]) / (known[1] - known[0])
    b = seen[0] - a * known[0]
    return np.asarray(a / (1.0 / loop - b))


def _reference(design: Design, frequency: Array) -> Complex:
    """Return the sampled filter of the reference speed at frequencies (Hz)."""
    period = design.drive.speed_period
    a = smoothing(period, design.require_loops().speed.reference_filter)
    z = np.exp(2j * math.pi * frequency * period)
    return np.asarray(a * z / (z - 1.0 + a))


def _distance(value: Complex, model: Complex, *, scaled: bool) -> float:
    """Return how far a shape is from another, nepers and radians; the delay of a drive's tool does not count much."""
    away = np.log(value / model)
    level = away.real - (np.median(away.real) if scaled else 0.0)
    return float(np.median(np.abs(level)) + np.median(np.abs(away.imag)))


def _means(stated: str, name: str) -> bool:
    """Whether a unit in a header may be a known one; A alone may be peak or rms."""
    text, known = _plain(stated), _plain(name)
    return bool(text) and (text == known or (text.endswith("/a") and text + "rms" == known))


def _plain(unit: str) -> str:
    """Return a unit without brackets, blanks and signs of a product: rad/s/nm."""
    text = re.sub(r"(u|r|1|rev)/min|min\^?-1", "rpm", unit.lower())
    return re.sub(r"[\s()\[\]*·._]", "", text).replace("eff", "rms").replace("apeak", "a").replace("apk", "a")


def _unit(design: Design, one: BodeSet, known: Mapping[str, float]) -> tuple[str, float]:
    """Return the unit with which the inertia at the lower third of the frequencies is closest to the design's."""
    low = one.frequency <= np.quantile(one.frequency, 1.0 / 3.0)
    inertia = float(np.median(1.0 / (2.0 * math.pi * one.frequency[low] * np.abs(one.value[low]))))
    ratios = {name: inertia / factor / design.J for name, factor in known.items()}
    best = min(ratios, key=lambda name: abs(math.log(ratios[name])))
    return best, ratios[best]


def _errors(one: BodeSet) -> Array:
    """Return the errors of the points from their scatter about their neighbours, smooth over frequency."""
    from scipy.ndimage import median_filter

    f, logarithm = np.log(one.frequency), np.log(np.abs(one.value)) + 1j * np.unwrap(np.angle(one.value))
    share = (f[1:-1] - f[:-2]) / (f[2:] - f[:-2])
    left = logarithm[1:-1] - (1.0 - share) * logarithm[:-2] - share * logarithm[2:]
    sizes = np.abs(left) / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
    # the median of the modulus of complex noise is 0.83 of its standard deviation
    level = median_filter(np.pad(sizes, 1, mode="edge"), NEIGHBOURS, mode="nearest") / math.sqrt(math.log(2.0))
    return np.asarray(np.abs(one.value) * np.maximum(level, LEAST))


def _response(name: str, one: BodeSet, value: Complex, errors: Array) -> Response:
    spacing = float(np.median(np.diff(one.frequency)))
    return Response(name, one.frequency, np.asarray(value), errors, one.coherence, "that of the drive's tool", spacing)
