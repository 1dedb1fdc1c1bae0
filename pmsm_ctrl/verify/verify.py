"""The verb: was the compensator's feedforward applied, with which gain and delay, and what did it gain."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, NextCommand, require_kind
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.timing import uniform, unwrapped
from pmsm_ctrl.rendering.numbers import with_error
from pmsm_ctrl.result import Estimate
from pmsm_ctrl.section import Notice
from pmsm_ctrl.simulate.fed_forward import fed_currents, read_speed
from pmsm_ctrl.simulate.feedforward import ramp_length, smoothing_width
from pmsm_ctrl.verify import notices as words
from pmsm_ctrl.verify import policy
from pmsm_ctrl.verify.advice import advice_of
from pmsm_ctrl.verify.errors import Tracking, changes, promised, same_motion, tracking
from pmsm_ctrl.verify.law import Law, fit_law
from pmsm_ctrl.verify.record import Record, Unsigned, averaged, cropped, rounding_of
from pmsm_ctrl.verify.result import Outcome, Verification

__all__ = ["verify"]

Array = NDArray[np.float64]

NO_SIGN = 1e12  # rad/s (m/s), a dead zone that no speed leaves


def verify(
    design: Design, before: Log, after: Log, *, seed: int = 0, progress: Callable[[float], None] = lambda share: None
) -> Verification:
    """Find out from two logs what a downloaded compensator does.

    The controller's law is fitted to both logs: gains of position error, its integral, speed error and references
    fed forward. What the second log holds beside it is compared with the feedforward of the design's compensator,
    computed from the logged reference by the lines that the simulated drive runs. Neither inertia nor friction of the
    axis is needed for that.

    Parameters
    ----------
    design : Design
        With the compensation that was downloaded.
    before, after : Log
        The same motion before and after the download, with a reference of position or speed, what follows it, and
        ``i_q_ref``, ``i_q`` or ``torque``.
    seed : int
        Of the noise in the simulation that tells what was promised.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    Verification

    Raises
    ------
    LogError
        When a log lacks a channel.
    RequestError
        When the design compensates nothing, or by a disturbance observer; when the first argument is no design or the
        others are no logs.
    """
    require_kind(design, Design, "design")
    for number, log in enumerate((before, after), start=1):
        require_kind(log, Log, f"log {number}")
    found = [_completed(log) for log in (before, after)]
    channel = _channel(found)
    records = _records(design, found, channel)
    expected = design.compensation.gain or 1.0
    law = _law(records, channel, expected, progress)
    notes: list[Notice] = []
    if (
        channel == "i_q_ref"
        and abs(law.gain.value[1]) < policy.NOTHING * expected
        and all("i_q" in one for one in found)
    ):
        # some drives log what the speed controller asks for, and add the feedforward behind it
        measured = _law(_records(design, found, "i_q"), "i_q", expected, progress)
        if _half(measured) < policy.VAGUE * expected and abs(measured.gain.value[1]) > policy.VAGUE * expected:
            channel, law = "i_q", measured
            notes.append(words.OTHER_CHANNEL())
    errors = [tracking(log, design.encoder_step) for log in found]
    return _judged(design, found, (law, channel, expected), errors, promised(design, found[0], expected, seed), notes)


def _completed(log: Log) -> Log:
    """Return a log on one grid with the speeds that its positions tell."""
    log.check_evaluable(100)
    t, raw, _, _ = uniform(log)
    if "theta" in raw:
        raw["theta"] = unwrapped(raw["theta"])
    if "theta_ref" in raw:
        raw["theta_ref"] = unwrapped(raw["theta_ref"])
        if "theta" in raw:
            turns = np.median(raw["theta_ref"] - raw["theta"])
            raw["theta_ref"] = raw["theta_ref"] - 2.0 * math.pi * np.round(turns / (2.0 * math.pi))
    label = f"{log.provenance.file}: " if log.provenance.file else ""
    for name in ("omega", "omega_ref"):
        position = name.replace("omega", "theta")
        if name not in raw and position in raw:
            raw[name] = np.gradient(raw[position], t)
        if name not in raw:
            raise LogError(
                f"{label}neither {name} nor {position}: the reference and what follows it are needed to know the "
                f"controller's law (present: {', '.join(log)})",
                next_command=NextCommand.MAP,
            )  # fmt: skip
    return Log({"t": t - t[0], **raw}, log.motion, provenance=log.provenance)


def _channel(logs: list[Log]) -> str:
    for name in ("i_q_ref", "i_q", "torque"):
        if all(name in log for log in logs):
            return name
    raise LogError(
        "i_q_ref, i_q or torque is needed, the same channel in both logs (present: "
        f"{'; '.join(', '.join(log) for log in logs)})",
        next_command=NextCommand.MAP,
    )


def _records(design: Design, logs: list[Log], channel: str) -> list[Record]:
    placed = all("theta" in log and "theta_ref" in log for log in logs)
    return [_record(design, log, channel, placed) for log in logs]


def _record(design: Design, log: Log, channel: str, placed: bool) -> Record:
    """Return what the controller reads, the current that it asks for, and the compensator's own currents."""
    channels, period = dict(log.channels), log.period
    current = channels[channel] / (design.K_t_assumed if channel == "torque" else 1.0)
    speed, reference = channels["omega"], channels["omega_ref"]
    if placed:
        error = channels["theta_ref"] - channels["theta"]
        read = [error, reference - speed]
        whole = np.cumsum(error) * period
    else:
        error = reference - speed
        read = [error]
        # the sum of the speeds that the controller read is the angle turned, whatever the rate of the log
        turned = channels.get("theta", np.cumsum(speed) * period)
        whole = np.cumsum(reference) * period - turned
    acceleration = channels.get("alpha_ref", np.gradient(reference, log.t))
    # a current loop is late by tau di/dt, as much as a whole Coulomb friction where the acceleration steps
    lag = [] if channel == "i_q_ref" else [np.gradient(current, log.t)]
    columns = np.column_stack([*read, whole, reference, acceleration, *lag])
    limit = design.drive.i_max
    used = np.abs(current) < policy.LIMIT * limit if math.isfinite(limit) else np.ones(len(current), dtype=bool)
    if not used.sum() > 100:
        raise LogError(f"the current is at its limit of {limit:g} A in the whole log; a slower motion is needed")
    fed = fed_currents(design, channels, read_speed(design, channels), period)
    return Record(log.t, current, columns, len(read), fed, used, _unsigned(design, channels, period),
                  rounding=rounding_of(whole, period), measured=channel != "i_q_ref",
                  slower=period > policy.SLOWER * design.drive.speed_period)  # fmt: skip


def _unsigned(design: Design, channels: Mapping[str, Array], period: float) -> Unsigned | None:
    """Return the compensator's currents before a sign of the speed is put in."""
    if ramp_length(design) > 0.0:
        return None
    speed = read_speed(design, channels)
    hard, none = (
        fed_currents(design.replace(compensation={"smoothing": 0.0, "dead_zone": zone}), channels, speed, period)
        for zone in (design.compensation.dead_zone, NO_SIGN)
    )
    sign = np.where(speed > 0.0, 1.0, -1.0)  # of the compensator's own lines
    return Unsigned(speed, none, {name: (one - none[name]) * sign for name, one in hard.items()})


def _law(records: list[Record], channel: str, expected: float, progress: Callable[[float], None]) -> Law:
    """Return the law of two records, with what its sampling leaves in error."""
    kept = [cropped(one) for one in records]
    systematic = policy.SAMPLED
    if channel != "i_q_ref":
        width = max(1, round(policy.AVERAGED / kept[1].period))
        kept, systematic = [averaged(one, width) for one in kept], policy.MEASURED
    law = fit_law(kept[0], kept[1], progress)
    own = (math.hypot(systematic, policy.SHAPED if law.shaped else 0.0) * expected) ** 2
    # noise that the axis follows is in the measured current and in the controller's error alike: what the integrator
    # thereby lacks is found as a feedforward of both logs, and the change by as much too small
    own += 0.0 if channel == "i_q_ref" else float(law.gain.value[0]) ** 2
    gain, parts = (replace(one, covariance=one.covariance + own * np.eye(len(one.names)))
                   for one in (law.gain, law.parts))  # fmt: skip
    return replace(law, gain=gain, parts=parts)


def _half(law: Law) -> float:
    return float(_quantile() * law.gain.stderr[1])


def _quantile() -> float:
    """Return the quantile of an interval whose errors come from the differences of blocks."""
    return float(student.ppf(0.5 + 0.5 * policy.COVERAGE, policy.BLOCKS - 2))


@dataclass(frozen=True)
class _Part:
    """What is known of the gain of one part."""

    separable: bool
    missing: bool
    there: bool
    odd: bool


def _parts(law: Law, expected: float) -> dict[str, _Part]:
    out = {}
    whole = float(law.gain.value[1])
    for name, value, stderr in zip(law.parts.names, law.parts.value, law.parts.stderr, strict=True):
        separable = bool(stderr < policy.SEPARABLE_WITHIN * expected)
        missing = separable and abs(value) < policy.MISSING * expected
        odd = bool(abs(value - whole) > max(policy.ODD_ERRORS * stderr, policy.ODD * expected))
        out[name] = _Part(separable, bool(missing), bool(separable and value > policy.THERE * expected), odd)
    return out


def _judged(
    design: Design, logs: list[Log], found: tuple[Law, str, float], errors: list[Tracking],
    wanted: Mapping[str, float], notes: list[Notice],
) -> Verification:  # fmt: skip
    law, channel, expected = found
    value, half = float(law.gain.value[1]), _half(law)
    rms = {name: float(np.sqrt(np.mean(one**2))) for name, one in _fed(design, logs[1]).items()}
    whole = max(math.sqrt(sum(one**2 for one in rms.values())), 1e-300)
    weight = {name: one / whole for name, one in rms.items()}
    parts = _parts(law, expected)
    measured = changes(*errors) if same_motion(*logs) else {}
    verdict = _verdict(law, expected, parts, weight, errors, logs[1].period)
    if verdict is Outcome.NOT_APPLIED:  # nothing has no sign
        law = replace(law, sign=None)
    notes += [*_of_sign(design, logs[1], law), *_of_law(law, expected, parts, weight)]
    notes += _of_integrator(law, channel, expected, logs[1].rate)
    notes += _of_errors(errors, measured, wanted, judged=verdict in (Outcome.APPLIED, Outcome.LATE))
    notes += _of_samples(design, logs, channel)
    applied = abs(value) > max(half, policy.NOTHING * expected)
    delay = Estimate(law.delay, "s", (law.delay_high - law.delay_low) / 3.92) if applied else None
    estimates = {
        name: Estimate(float(v), "1", float(s), expected)
        for name, v, s in zip(law.parts.names, law.parts.value, law.parts.stderr, strict=True)
    }
    result = Verification(
        verdict=verdict,
        design=design,
        before_name=logs[0].provenance.file,
        after_name=logs[1].provenance.file,
        expected=expected,
        gain=Estimate(value, "1", float(law.gain.stderr[1]), expected),
        before_gain=Estimate(float(law.gain.value[0]), "1", float(law.gain.stderr[0])),
        interval=(value - half, value + half),
        delay=delay,
        delay_interval=(law.delay_low, law.delay_high) if applied else (math.nan, math.nan),
        smoothing=None
        if law.sign is None
        else Estimate(
            law.sign.width, _speed_unit(design), (law.width_high - law.width_low) / 3.92, smoothing_width(design)
        ),
        smoothing_interval=(math.nan, math.nan) if law.sign is None else (law.width_low, law.width_high),
        smoothing_shape="" if law.sign is None else law.sign.shape,
        parts=estimates,
        implausible=tuple(name for name, one in parts.items() if one.odd),
        weight=weight,
        channel=channel,
        before=errors[0],
        after=errors[1],
        measured=measured,
        promised=wanted,
        explained=law.explained,
        advice="",
        t=law.t,
        added=law.added,
        predicted=law.predicted,
        notices=tuple(notes),
    )
    return advice_of(result, [name for name, one in parts.items() if one.missing])


def _fed(design: Design, log: Log) -> dict[str, Array]:
    return fed_currents(design, dict(log.channels), read_speed(design, dict(log.channels)), log.period)


def _verdict(
    law: Law, expected: float, parts: Mapping[str, _Part], weight: Mapping[str, float],
    errors: list[Tracking], period: float,
) -> Outcome:  # fmt: skip
    value, half = float(law.gain.value[1]), _half(law)
    before, after = (0.0 if math.isnan(one.cycle_amplitude) else one.cycle_amplitude for one in errors)
    # a drive that adds nothing cycles for another reason
    if after > policy.CYCLE * before and value + half > policy.NOTHING * expected:
        return Outcome.LIMIT_CYCLE
    if law.unresolved or law.explained < policy.EXPLAINED or not half < policy.VAGUE * expected:
        return Outcome.INCONCLUSIVE
    missing = any(one.missing and weight[name] > policy.WORTH for name, one in parts.items())
    odd = any(one.odd for one in parts.values())
    if missing and any(one.there for one in parts.values()):
        return Outcome.INCONCLUSIVE if odd else Outcome.PARTLY_APPLIED
    if abs(value) < policy.NOTHING * expected:
        return Outcome.NOT_APPLIED
    if value + half < 0.0:
        return Outcome.WRONG_SIGN
    if value - half <= 0.0:
        return Outcome.INCONCLUSIVE
    if abs(value - expected) > max(policy.WRONG * expected, half):
        return Outcome.INCONCLUSIVE if odd else Outcome.WRONG_GAIN
    if law.delay_low > max(policy.LATE, policy.LATE_PERIODS * period):
        return Outcome.INCONCLUSIVE if law.rounded > policy.NOTHING * expected else Outcome.LATE
    return Outcome.APPLIED


def _speed_unit(design: Design) -> str:
    return "m/s" if design.motion == "linear" else "rad/s"


def _of_sign(design: Design, log: Log, law: Law) -> list[Notice]:
    """Return what is to be known of a drive with another sign of the speed than the design's."""
    if law.sign is None:
        return []
    unit, width = _speed_unit(design), law.sign.width
    if law.unresolved:
        peak = float(np.abs(read_speed(design, dict(log.channels))).max())
        return [words.SMOOTHING_NOT_TOLD(width=width, unit=unit, peak=peak)]
    text = with_error(width, (law.width_high - law.width_low) / 3.92)
    shape = "hyperbolic tangent" if law.sign.curved else "straight line"
    shape = f"about as a {shape}" if law.shaped else shape
    return [words.SMOOTHED(width=text, unit=unit, shape=shape, stated=smoothing_width(design))]


def _of_law(law: Law, expected: float, parts: Mapping[str, _Part], weight: Mapping[str, float]) -> list[Notice]:
    """Return the doubts about the controller's law, and the parts that are missing or not separable."""
    out: list[Notice] = []
    if law.explained < policy.EXPLAINED:
        out.append(words.UNEXPLAINED(share=law.explained))
    if law.retuned:
        out.append(words.RETUNED())
    if abs(law.gain.value[0]) > max(_quantile() * law.gain.stderr[0], policy.NOTHING * expected):
        out.append(words.BEFORE(gain=float(law.gain.value[0])))
    some = any(one.there for one in parts.values())
    for name, value, stderr in zip(law.parts.names, law.parts.value, law.parts.stderr, strict=True):
        text = with_error(float(value), float(stderr)) if math.isfinite(stderr) else "unknown"
        if parts[name].odd:
            out.append(words.PART_IMPLAUSIBLE(effect=name, gain=text, total=float(law.gain.value[1])))
        elif not parts[name].separable:
            out.append(words.NOT_TOLD(effect=name, gain=text, share=weight[name]))
        elif parts[name].missing and some:
            out.append(words.PART_MISSING(effect=name, gain=text, share=weight[name]))
    return out


def _of_integrator(law: Law, channel: str, expected: float, rate: float) -> list[Notice]:
    """Return what the integrator's part may have in the gain."""
    out: list[Notice] = []
    if channel != "i_q_ref" and abs(law.gain.value[0]) > policy.NOTHING * expected:
        out.append(words.BEFORE_NOT_TOLD(gain=float(law.gain.value[0])))
    if not law.rounded < policy.NOTHING * expected:
        out.append(words.ROUNDED(rate=rate))
    return out


def _of_errors(
    errors: list[Tracking], measured: Mapping[str, float], wanted: Mapping[str, float], *, judged: bool
) -> list[Notice]:
    """Return what the tracking errors leave open; `judged` says whether they should have fallen as promised."""
    out: list[Notice] = []
    if not measured:
        out.append(words.OTHER_MOTION())
    if not wanted:
        out.append(words.NO_PROMISE())
    for name, what in (("rms", "rms"), ("reversal_peak", "reversal")) if judged and measured else ():
        if wanted.get(name, 0.0) < -policy.WRONG and measured[name] > policy.REACHED * wanted[name]:
            out.append(words.LESS_GAINED(what=what, measured=-measured[name], promised=-wanted[name]))
            break
    if math.isnan(errors[1].cycle_amplitude):
        out.append(words.NO_REST())
    elif errors[0].cycle_amplitude > 0.0:
        out.append(words.HUNTED_BEFORE(amplitude=errors[0].cycle_amplitude, unit=errors[0].unit,
                                       frequency=errors[0].cycle_frequency))  # fmt: skip
    return out


def _of_samples(design: Design, logs: list[Log], channel: str) -> list[Notice]:
    """Return what was left out of the logs."""
    out: list[Notice] = []
    if max(len(log) for log in logs) > policy.MOST:
        out.append(words.CROPPED(count=policy.MOST))
    scale = design.K_t_assumed if channel == "torque" else 1.0
    share = float(np.mean(np.abs(logs[1][channel]) / scale >= policy.LIMIT * design.drive.i_max))
    return [*out, words.CLIPPED(share=share)] if share > 0.0 else out
