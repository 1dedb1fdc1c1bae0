"""The verb: measured frequency responses, the axis fitted to them, and where the design's own response differs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, NotExcitedError, RequestError, require_kind
from pmsm_ctrl.frf import notices as words
from pmsm_ctrl.frf import policy
from pmsm_ctrl.frf.fit import Axis, fit_axis
from pmsm_ctrl.frf.from_bode import MeasuredBode
from pmsm_ctrl.frf.measured import LOOPS, closed_loop, counted, guessed_inertia, measured_axis
from pmsm_ctrl.frf.point_margins import point_margins
from pmsm_ctrl.frf.result import Band, Curves, FrequencyResponse, Response
from pmsm_ctrl.frf.stretches import mean_speed, stretches, without_steps
from pmsm_ctrl.frf.window import largest, widths, window_bias
from pmsm_ctrl.log import Logs, as_logs, names_of
from pmsm_ctrl.plausibility.policy import POLICY as PLAUSIBLE
from pmsm_ctrl.regression.measurement_correction import left_in
from pmsm_ctrl.rendering.numbers import with_error
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice
from pmsm_ctrl.tune.linearise import friction_slope, mobility, second_mass, with_second_mass
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.margins import response as loop_response
from pmsm_ctrl.tune.resonance import resonance_frequencies
from pmsm_ctrl.tune.sampled import Cascade
from pmsm_ctrl.tune.speed import open_loop
from pmsm_ctrl.units import axis_unit

__all__ = ["frf"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

UNITS = {
    "J": "kg m^2", "friction_slope": "N m s/rad", "delay": "s", "antiresonance": "Hz", "resonance": "Hz",
    "damping_ratio": "", "load_inertia": "kg m^2", "stiffness": "N m/rad", "damping": "N m s/rad",
}  # fmt: skip
# References of a motion: an excitation is added to the current, or swings about a speed.
MOTIONS = ("theta_ref", "omega_ref")
CLOSE = 3000  # frequencies at which a loop around the points is evaluated
DRAWN = 800  # frequencies of a curve between the measured points
MARGINS = {
    "phase_margin": "deg", "phase_margin_crossover": "Hz", "gain_margin_db": "dB", "crossover": "Hz",
    "sensitivity_peak": "",
}  # fmt: skip


def frf(design: Design, logs: Logs | MeasuredBode) -> FrequencyResponse:
    """Measure the frequency response of an axis from logs with excitation, and compare it with the design's.

    The response from drive torque to speed is taken by the local polynomial method, with the outermost reference that
    follows the excitation as instrument, from the longest stretch of each record in which the axis keeps its direction.
    A rigid axis or two masses are fitted to it by maximum likelihood.

    Parameters
    ----------
    design : Design
        Its torque constant turns currents into torque.
    logs : Log or sequence of Log, or MeasuredBode
        A measured Bode diagram from `read_response`, or logs: with ``theta`` or ``omega``, and ``torque`` or ``i_q``;
        excited by a multisine, a chirp, noise or the like.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    LogError
        When a channel is missing, nothing is excited, or the response does not determine the inertia.
    DesignError
        When a measured speed loop is given to a design without loops or motor data.
    RequestError
        When the first argument is no design.
    """
    require_kind(design, Design, "design")
    if isinstance(logs, MeasuredBode):
        shown = {} if logs.kind == "plant" else {"speed": _closed(logs)}
        J = guessed_inertia(logs.plant) if design.motor.J is None else design.J
        axis = fit_axis(logs.plant, J, design.drive.speed_period)
        compared = _compared(design, logs.file, logs.speed, {"plant": logs.plant, **shown}, axis, [])
        return replace(compared, notices=(*compared.notices, *words.taken(logs)))  # what was found comes first
    given = as_logs(logs)
    records = stretches(design, given)
    response, axis, found = measured_axis(design, records)
    if response.held:  # without the steps
        records = tuple(without_steps(design, one, axis.J, axis.mass) for one in records)
    loops = {name: one for name in LOOPS if (one := closed_loop(name, records)) is not None}
    bias = window_bias(records, response, axis)
    name, errors = largest(bias, axis)
    coarse = words.COARSE(resolution=response.resolution, parameter=name, bias=100.0 * bias[name], errors=errors)
    compared = _compared(
        design, names_of(given, "log"), mean_speed(records), {"plant": response, **loops}, axis,
        [*found, *left_in(design, given), *([coarse] if errors > 1.0 else [])],
    )  # fmt: skip
    return replace(compared, window_bias=bias, widths=() if axis.mass is None else widths(axis))


def _closed(given: MeasuredBode) -> Response:
    """Return the closed speed loop of a measured one."""
    one = given.measured
    if given.kind == "closed":
        return one
    closed = np.asarray(one.value / (1.0 + one.value))
    return replace(one, value=closed, stderr=one.stderr / np.abs(1.0 + one.value) ** 2)


def _compared(
    design: Design, name: str, speed: float, responses: dict[str, Response], axis: Axis, found: list[Notice]
) -> FrequencyResponse:
    """Compare the axis that was fitted to the response of the plant with the design's."""
    response = responses["plant"]
    unknown = design.motor.J is None
    if not axis.covariance[0, 0] < policy.UNDETERMINED**2:
        raise NotExcitedError(
            f"{name}: the response at {counted(len(response))} does not determine the inertia: its standard error "
            f"is more than {policy.UNDETERMINED:.0%} of it; excite more strongly, or over a wider range, and log the "
            "reference that is excited"
        )
    believed = design.with_parameters(J=axis.J) if unknown else design  # with the inertia found nothing else is hidden
    own = _own_response(believed, speed, response.frequency)
    between = np.geomspace(response.frequency[0], response.frequency[-1], DRAWN)
    curves = Curves(between, _own_response(believed, speed, between), axis.response(between))
    estimates = _estimates(believed, axis, speed)
    measured = _measured_design(believed, axis)
    judged = _judged(believed, axis, estimates)
    if (doubt := _unexcited(found, axis, response.instrument) or _nonlinear(design, found, axis)) is not None:
        # what differs from the design are values that are not to be taken
        found, judged, measured = [doubt, *found], [n for n in judged if n.code == words.MISFIT.code], design
    if unknown:
        estimates["J"] = replace(estimates["J"], nominal=None)
    return FrequencyResponse(
        design, measured, name, speed, responses, own,
        axis.response(response.frequency), curves, estimates, _bands(response, own, axis),
        _margins(believed, measured, axis, speed), axis.misfit, (*found, *judged),
        _point_margins(measured, axis, speed, response),
    )  # fmt: skip


def _unexcited(found: list[Notice], axis: Axis, instrument: str) -> Notice | None:
    """Return why the fitted axis is not to be taken: without excitation friction and noise look like an axis."""
    codes = {notice.code for notice in found}
    if instrument in MOTIONS and words.REVERSES.code in codes:
        why = f"what {instrument} shows is a motion in which the axis reverses, where friction is not linear"
        return words.NO_EXCITATION(why=why)
    if words.NO_REFERENCE.code not in codes:
        return None
    unseen = "the log holds no excitation that a reference shows, and"
    if words.REVERSES.code in codes:
        return words.NO_EXCITATION(why=f"{unseen} the axis reverses, where friction is not linear")
    if axis.misfit > policy.MISFIT:
        return words.NO_EXCITATION(why=f"{unseen} the residual of the fitted axis is {axis.misfit:.2g} times the noise")
    return None


def _nonlinear(design: Design, found: list[Notice], axis: Axis) -> Notice | None:
    """Return why the response is not that of a linear axis, or None.

    Standard errors grow with the residual as they do with noise. What a friction that is not linear leaves is no noise:
    it moves the inertia by many of them, and where friction holds the axis the response is another one altogether.
    """
    if axis.misfit <= policy.MISFIT:
        return None
    if words.REVERSES.code in {notice.code for notice in found}:
        return words.NOT_LINEAR(misfit=axis.misfit, why="the axis reverses while it is excited")
    factor = 1.0 if design.motor.J is None else axis.J / design.J
    if max(factor, 1.0 / factor) > PLAUSIBLE.limit["J"]:
        return words.NOT_LINEAR(misfit=axis.misfit, why=f"the inertia is {factor:.3g} times the design's")
    return None


def _own_response(design: Design, speed: float, frequency: Array) -> Complex:
    s = np.asarray(2j * math.pi * frequency, dtype=np.complex128)
    return mobility(s, design.J, friction_slope(design, speed), second_mass(design))


def _estimates(design: Design, axis: Axis, speed: float) -> dict[str, Estimate]:
    mass, frequencies = second_mass(design), resonance_frequencies(design)
    nominal: dict[str, float] = {"J": design.J, "friction_slope": friction_slope(design, speed), "delay": 0.0}
    if mass is not None and frequencies is not None:
        nominal |= {"antiresonance": frequencies[0], "resonance": frequencies[1], "damping_ratio": mass.damping_ratio}
        nominal |= {"load_inertia": mass.J_load, "stiffness": mass.k, "damping": mass.d}
    return {
        name: Estimate(value, axis_unit(UNITS[name], design.motion), stderr, nominal.get(name))
        for name, (value, stderr) in axis.errors().items()
    }


def _measured_design(design: Design, axis: Axis) -> Design:
    """Return the design with the inertia and the spring that were found."""
    found = design.with_parameters(J=axis.J)
    return found if axis.mass is None else with_second_mass(found, axis.mass)


def _size(band: Band) -> float:
    """Return the modulus of a deviation's logarithm."""
    return math.hypot(math.log(band.ratio), math.radians(band.phase))


def _bands(response: Response, own: Complex, axis: Axis) -> tuple[Band, ...]:
    """Return the third octaves in which the design's response differs, neighbouring ones joined; the delay is left out.

    The mean deviation of a third octave is tested, with the chance shared out over all of them. A band goes on where
    the deviation is significant and at least half of the smallest one that begins a band: a flat one is one band.
    """
    ratio = response.value / own * np.exp(2j * math.pi * response.frequency * float(axis.values[2]))
    octave = np.floor(3.0 * np.log2(response.frequency / response.frequency[0])).astype(int)
    weight = (np.abs(response.value) / response.stderr) ** 2
    limit = float(chi2.isf(policy.DEVIATION / len(np.unique(octave)), 2))
    groups: list[list[Band]] = []
    last = -2
    for number, k in enumerate(np.unique(octave)):
        inside = octave == k
        share, total = weight[inside] / weight[inside].sum(), float(weight[inside].sum())
        mean = complex(np.sum(share * np.log(ratio[inside])))
        if 2.0 * total * abs(mean) ** 2 < limit or abs(mean) < 0.5 * policy.SMALLEST_DEVIATION:
            continue
        f = response.frequency[inside]
        band = Band(float(f[0]), float(f[-1]), math.exp(mean.real), math.degrees(mean.imag))
        if groups and last == number - 1 and (groups[-1][-1].ratio > 1.0) == (band.ratio > 1.0):
            groups[-1].append(band)
        else:
            groups.append([band])
        last = number
    bands = [replace(max(one, key=_size), low=one[0].low, high=one[-1].high)
             for one in groups if max(map(_size, one)) >= policy.SMALLEST_DEVIATION]  # fmt: skip
    return tuple(bands)


def _open_loop(design: Design, speed: float) -> Any:
    """Return the open speed loop, or None where the design does not tell it."""
    if design.loops is None:
        return None
    try:
        cascade = Cascade.of(design, design.loops.current, at=speed)
    except (DesignError, RequestError):  # no winding data, or a speed that the drive cannot hold
        return None
    return open_loop(cascade, design.loops.speed)


def _speed_loop(design: Design, speed: float) -> Margins | None:
    loop = _open_loop(design, speed)
    return None if loop is None else margins(loop)


def _point_margins(measured: Design, axis: Axis, speed: float, response: Response) -> dict[str, Estimate]:
    """Return the margins of the speed loop around the measured points; the delay of the log is that of the axis."""
    loop = _open_loop(measured, speed)
    if loop is None:
        return {}
    # also where nothing was measured: whether a margin lies there the fitted axis tells
    frequency = np.geomspace(0.1 * response.frequency[0], 0.499 / measured.drive.speed_period, CLOSE)
    found = point_margins(
        response, axis.response(response.frequency), frequency, loop_response(loop, 2.0 * math.pi * frequency),
        math.sqrt(axis.covariance[2, 2]),
    )  # fmt: skip
    return {name: Estimate(value, MARGINS[name], stderr) for name, (value, stderr) in found.items()}


def _margins(design: Design, measured: Design, axis: Axis, speed: float) -> dict[str, tuple[Estimate, float]]:
    """Return the margins of the speed loop around the fitted axis, with errors, and around the design's."""
    before, after = _speed_loop(design, speed), _speed_loop(measured, speed)
    if before is None or after is None:
        return {}

    def of(one: Axis) -> Array:
        found = _speed_loop(_measured_design(design, one), speed)
        return np.array([getattr(found, name) if found is not None else math.nan for name in MARGINS])

    spread = axis.propagated(of)
    return {
        name: (Estimate(getattr(after, name), unit, float(stderr)), float(getattr(before, name)))
        for (name, unit), stderr in zip(MARGINS.items(), spread, strict=True)
    }


def _judged(design: Design, axis: Axis, estimates: dict[str, Estimate]) -> list[Notice]:
    """Return where the fitted axis is not the design's."""
    found: list[Notice] = []
    if axis.misfit > policy.MISFIT:
        found.append(words.MISFIT(misfit=axis.misfit))
    limit = float(norm.isf(0.5 * policy.DEVIATION / 3.0))

    def differs(name: str) -> bool:
        one = estimates[name]
        away = abs(one.value - (one.nominal or 0.0))
        return away > limit * one.stderr and away > policy.SMALLEST_DEVIATION * abs(one.nominal or 0.0)

    def text(name: str, scale: float = 1.0) -> str:
        return with_error(scale * estimates[name].value, scale * estimates[name].stderr)

    if differs("J"):
        share = estimates["J"].value / design.J - 1.0
        found.append(words.INERTIA(
            quantity="moving mass" if design.motion == "linear" else "inertia", found=text("J"),
            unit=axis_unit(UNITS["J"], design.motion), design=design.J, share=share,
        ))  # fmt: skip
    own = resonance_frequencies(design)
    if own is None and axis.mass is not None:
        found.append(words.NEW_RESONANCE(antiresonance=text("antiresonance"), resonance=text("resonance")))
    elif own is not None and axis.mass is None:
        found.append(words.NO_RESONANCE(design=own[1]))
    elif own is not None and differs("resonance"):
        found.append(words.OTHER_RESONANCE(found=text("resonance"), design=own[1]))
    delay = estimates["delay"]
    if delay.value > limit * delay.stderr and delay.value > 0.5 * math.sqrt(12.0 * axis.spread):
        found.append(words.LATE(found=text("delay", 1e3)))
    return found
