"""A log conditioned with what the base model shows of its sampling: the filter of the drive signal, and the band."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design, EffectEntry
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import ALWAYS, STANDSTILL, USABLE, Record
from pmsm_ctrl.regression.bandwidth import signal_band
from pmsm_ctrl.regression.base_fit import Estimated, base_fit, error_left, settled_model
from pmsm_ctrl.regression.conditioning import Processing, default_cutoff
from pmsm_ctrl.regression.drive_timing import (
    AGE,
    EMF,
    EMF_FILTERED,
    EMF_LATE,
    FASTEST_LOOP,
    LATENESS,
    LONGEST_FILTER,
    SPEED_SPREAD,
    SPREAD,
    SURE,
    UNDELAYED,
    DriveTiming,
    Sampling,
    drive_sampling,
    emf_winding,
    filter_behind,
    in_time,
    late_for,
    possible_sampling,
    stated_timing,
    stated_within,
)
from pmsm_ctrl.regression.edge_share import FEWEST, edge_share, falsified, has_edges
from pmsm_ctrl.regression.edges import WRONG_TORQUE, steep
from pmsm_ctrl.regression.encoder_lines import RESOLVER, shown_lines
from pmsm_ctrl.regression.filter_profile import LOWERED, by_profile
from pmsm_ctrl.regression.instruments import by_reference
from pmsm_ctrl.regression.late_reversals import in_time_at_reversals
from pmsm_ctrl.regression.made import Made
from pmsm_ctrl.regression.model import FIXED, MOST_NOISE, noise_share
from pmsm_ctrl.regression.notices import (
    DRIVE_COMMANDED,
    ENCODER_LINES,
    RESOLVER_ERROR,
    SHOWN_MS,
    TORQUE_EDGES,
    timing_notice,
)
from pmsm_ctrl.regression.one_axis import of_one_axis
from pmsm_ctrl.regression.sampling_terms import FILTERED
from pmsm_ctrl.regression.saturated import rough_weights
from pmsm_ctrl.regression.stepped_reversals import stepped_at_reversals

__all__ = ["FRICTION", "SPEED_FILTERS", "as_possible_command", "sampling_of", "timed_record", "with_friction"]

Array = NDArray[np.float64]

FRICTION = {"coulomb": "F_c", "viscous": "F_v"}  # of every axis
ROUNDS = 2  # in which the time of sampling is found: what is left then is met to first order
# Angle, rad, up to which two moments describe a filtered signal: the third is 0.1 % of it then.
EXPANDED = 0.2
# Angle at the end of the band, rad, beyond which a filter of a log period is no matter of two moments: 600 Hz and less.
REACHES = 2.0 * EXPANDED
SPEED_FILTERS = (0.004, 0.008, 0.016, 0.032)  # s: each is within a factor of 1.5 of any between them
ROUNDS_OF_SPEED = 4  # the filter of a speed is often several periods long
HALVINGS = 2  # of the default band: 10 Hz still hold the friction of an axis
BLUE = 0.66  # what half the band leaves of a noise that grows with the frequency; of white noise it leaves 0.7
WIDER = 1.25  # times the default band: less is not worth a second pass
# Share of the torque below which no effect is worth a name, and no error worth a weight; of the weights' usual level
# what is worth a second pass.
CLOSEST, CLOSER = 0.004, 0.7
NOISIER = 3.0  # times the noise floor: white noise grows with the root of the band, by no more than this
# Noise of the torque, as its share, that no wider band may reach: beside it a friction of 2 % lowers no error
# noticeably.
LOUD = 0.1


def with_friction(design: Design) -> Design:
    """Return the design whose parameters a base model fits: with Coulomb and viscous friction, if it states neither.

    Every axis has them. A design from a datasheet states none, and whatever is fitted in their place would be wrong.

    Parameters
    ----------
    design : Design
    """
    if any(entry.id in FRICTION for entry in design.effects):
        return design
    added = (EffectEntry(id=name, parameters={symbol: 0.0}) for name, symbol in FRICTION.items())
    return design.replace_effects((*added, *design.effects))


def timed_record(design: Design, log: Log, made: Made | None = None, band: float | None = None) -> Record:
    """Condition a log, after the base model has shown how it was sampled.

    Where the log has a speed alone the lag of that is corrected, else the filter of a drive signal that is later than
    sampling can make it, unless the design states how the log was sampled. A wider band than the default one is taken
    where the drive signal has one, the sampling can be described there, and the acceleration is no noise there, or
    already was in the default one; a narrower one where noise of the acceleration is what is left.

    Parameters
    ----------
    design : Design
    log : Log
    made : Made, optional
        What was made of the log before.
    band : float, optional
        The band, Hz, in place of the one that the log calls for; not above the default.

    Returns
    -------
    Record
    """
    design = with_friction(design)
    made = made or Made(log)
    timed, fit = _timed(design, made, band)
    record = timed if band else _widened(design, made, timed, fit)
    fit = fit if record is timed else base_fit(design, record)
    if band and made.commanded:  # that does not hang on the band in which it shows
        record, fit = _commanded(design, record) if made.commanded[0] and _may_be_command(record) else (record, fit)
    else:
        record, fit = _as_command(design, record, fit)
        made.commanded[:] = [record.commanded]
    record, fit = _weighed(design, record, fit)
    assert record.weighing is not None
    sure = steep(record.weighing.edges(record.wrong))
    record = replace(_with_edges_said(record), weighing=None)  # it holds the log
    if record.records:
        record = of_one_axis(design, record, tuple(made.zeros) or None)  # they do not hang on the band
        made.zeros[:] = record.shifts
        fit = base_fit(design, record)
    return _with_filter_said(_with_lines(record, fit, sure))


def sampling_of(design: Design, log: Log) -> tuple[Log, Sampling]:
    """Return a log with its filter undone, and what else is known of its sampling: for a regression of its own.

    A log that cannot be made ready is returned with what the design states of it.

    Parameters
    ----------
    design : Design
    log : Log
    """
    young = in_time(design, log)
    late, early = possible_sampling(design, log)
    known = stated_timing(drive_sampling(design, log), log.period)
    found = Sampling(known, sigma=((late + early) / math.sqrt(12.0), late**2 / 6.0))
    try:
        record, fit = _timed(design, Made(log))
    except LogError:
        return known.undone(young), found
    name = LATENESS if record.age is None else AGE
    value, stderr = fit.value(name)
    sigma, spread = found.sigma
    if record.age is not None:  # a speed that is old makes a torque early
        known_age = stated_within(design, log.period) if design.log.of("omega").stated else FILTERED
        value, sigma = -(record.age.delay + value), math.hypot(sigma, known_age)
        spread = max(spread, record.age.lag**2 / 2.0)
    spread = max(spread, record.timing.lag**2 / 6.0)
    stderr = stderr if stderr > FIXED * max(late, early) else 0.0  # what is held has none
    return record.timing.undone(young), Sampling(record.timing, value, stderr, (sigma, spread))


def _timed(design: Design, made: Made, band: float | None = None) -> tuple[Record, Estimated]:
    """Return a log in its default band, or a narrower one, with the filter of the drive signal undone."""
    if band is None:
        record, fit = _sharpened(design, made, made.record(design))
    else:
        record = made.record(design, Processing(standstill=STANDSTILL, cutoff=band))
        fit = base_fit(design, record)
    same = Processing(standstill=STANDSTILL, cutoff=record.cutoff)
    if made.ahead > 0.0:
        ahead = DriveTiming(-made.ahead, sure=False)
        return stepped_at_reversals(design, made, *_behind(design, made, same, ahead))
    if record.age is not None:
        record, fit = _behind_speed_filter(design, made, record, fit)
    for _ in range(ROUNDS_OF_SPEED if record.age is not None else 0):
        age = _age(design, *_plain(design, record, fit))
        if age == record.age:
            break
        record = made.record(design, same, age)
        fit = base_fit(design, record)
        if age is None:
            break
    for _ in range(ROUNDS if record.age is None and not record.sampling_stated else 0):
        timing = _filter(design, *_plain(design, record, fit))  # edges tell it as well
        if timing == record.timing:
            break
        record, fit = _behind(design, made, same, timing)
    if record.age is None and not record.sampling_stated and _is_slow(record):
        record, fit = _by_profile(design, made, record, fit)
    return stepped_at_reversals(design, made, *in_time_at_reversals(design, made, record, fit))


def _behind_speed_filter(design: Design, made: Made, record: Record, fit: Estimated) -> tuple[Record, Estimated]:
    """Return the record and its fit with a filter of the speed undone that is too slow for two moments, if it has one.

    From there on its moments are found as usual.
    """

    def behind(lag: float) -> tuple[Record, Estimated]:
        other = made.record(design, Processing(standstill=STANDSTILL, cutoff=record.cutoff), DriveTiming(0.0, lag))
        return other, base_fit(design, other)

    left = error_left(*_plain(design, record, fit))
    if _noise(fit) > LOWERED * left:
        return record, fit  # that is noise already
    found = [behind(lag) for lag in SPEED_FILTERS]
    errors = [error_left(*_plain(design, *one)) for one in found]
    best = int(np.argmin(errors))
    return found[best] if errors[best] < LOWERED * left else (record, fit)


def _age(design: Design, record: Record, fit: Estimated) -> DriveTiming | None:
    """How a speed was sampled; None where the drive signal is the later one, by more than sampling can make it.

    No filter makes a speed too early. How late the drive signal is, and behind which filter, is then found as in a log
    with a position. A speed has passed a filter where its variance is surely larger than that of a mean over a period.
    """
    age = record.age
    assert age is not None
    free = base_fit(design, record, settled=False)
    value, stderr = free.value(AGE)
    delay = age.delay + value
    if -delay - record.sampling > SURE * stderr:
        return None
    if SPEED_SPREAD not in free.model.names:
        return DriveTiming(delay)
    value, stderr = free.value(SPEED_SPREAD)
    spread = age.spread + value
    if spread - record.period**2 / 24.0 <= SURE * stderr:
        return DriveTiming(delay)
    early = stated_within(design, record.period) if record.sampling_stated else record.sampling
    lag = min(math.sqrt(2.0 * spread), max(delay + early, 0.0))
    return DriveTiming(delay - lag, lag)


def _is_slow(record: Record) -> bool:
    """Whether a filter of one period of the log reaches into its usual band, so that two moments do not describe it."""
    return 2.0 * math.pi * default_cutoff(record.prepared.rate) * record.period > REACHES


def _by_profile(design: Design, made: Made, record: Record, fit: Estimated) -> tuple[Record, Estimated]:
    """Return the record and its fit behind the filter with which its error is least, where it is noticeably less.

    Edges count like everything else, behind every filter alike: they tell it.
    """
    same = Processing(standstill=STANDSTILL, cutoff=record.cutoff)

    def error(timing: DriveTiming) -> float:
        try:
            behind = _with_edges(design, _behind(design, made, same, timing)[0])
        except LogError:
            return math.inf
        if timing.late > record.sampling:  # a delay leaves less than half of the variance of a filter
            free = base_fit(design, behind[0], settled=False)
            late = timing.late + free.level(LATENESS)
            return error_left(behind[0], free) if abs(free.level(SPREAD)) < 0.25 * late**2 else math.inf
        other = abs(behind[1].level(SPREAD)) > timing.spread + record.period**2 / 24.0
        return math.inf if other and timing != record.timing else error_left(*behind)

    if _noise(fit) > LOWERED * error_left(*_with_edges(design, record)):
        return record, fit  # that is noise already
    timing = by_profile(record.timing, record.period, error)
    return (record, fit) if timing == record.timing else _behind(design, made, same, timing)


def _behind(design: Design, made: Made, same: Processing, timing: DriveTiming) -> tuple[Record, Estimated]:
    record = made.record(design, same, None, timing)
    return record, base_fit(design, record)


def _as_command(design: Design, record: Record, fit: Estimated) -> tuple[Record, Estimated]:
    """Return the record as that of a command where it shows itself as one, and its fit.

    A command exceeds the current where the compensation of the back-emf is late, by no more than a speed filter, and by
    one that the terms can describe. Where the axis hardly ever turns back, an early torque cannot be told from a late
    compensation: what exceeds a usual current loop is that to the filter. Either that lowers the error by as much as
    any filter has to, or the signal is early as well, by a current loop. Of what is measured neither holds: there the
    terms of a command would stand in for springs, gaps and delays.
    """
    if not _may_be_command(record):
        return record, fit
    tried, found = _commanded(design, record)
    value, stderr = found.value(LATENESS)
    early = -record.timing.delay - value
    filtered, error = found.value(EMF_FILTERED)
    late = found.level(EMF) + filtered
    longest = LONGEST_FILTER * (late + late_for(design, early, found.level("J")))
    if not (0.0 < late < EMF_LATE and filtered > -SURE * error and EMF_LATE * filtered < longest):
        return record, fit
    shown = early > max(FASTEST_LOOP, SURE * stderr) or error_left(tried, found) < LOWERED * error_left(record, fit)
    return (tried, found) if shown else (record, fit)


def _commanded(design: Design, record: Record) -> tuple[Record, Estimated]:
    said = (*record.notes, DRIVE_COMMANDED(quantity=record.drive))
    tried = _otherwise(record, commanded=True, notes=said)
    return tried, base_fit(design, tried)


def as_possible_command(record: Record) -> Record:
    """Return the record with the terms of a command unless the design states another sampling.

    In a diagnosis they would stand in for effects. The standard errors of an identification hold what a command that
    does not show itself may shift the parameters by.

    Parameters
    ----------
    record : Record
    """
    return _otherwise(record, commanded=True) if _may_be_command(record) else record


def _may_be_command(record: Record) -> bool:
    """Whether a drive signal of which nothing is stated may hold what the terms of a command describe."""
    told = record.age is not None or record.sampling_stated or record.commanded
    return not told and emf_winding(record.design) is not None


def _weighed(design: Design, record: Record, fit: Estimated) -> tuple[Record, Estimated]:
    """Weigh edges by how far they are off in this log, and reversals by the noise floor, where the model reaches it.

    The error of the moment of a reversal is small beside a usual noise level, and large beside a low one.
    """
    share = edge_share(*_plain(design, record, fit)) if has_edges(record) else 1.0
    close = max(_noise(fit), CLOSEST)
    wrong = close if close <= CLOSER * WRONG_TORQUE else record.wrong
    if share == record.edges and wrong == record.wrong:
        return record, fit
    again = _reweighed(record, wrong, share)
    return again, base_fit(design, again)


def _plain(design: Design, record: Record, fit: Estimated) -> tuple[Record, Estimated]:
    """Return the record and its fit with edges that count like everything else."""
    return _with_edges(design, record) if has_edges(record) else (record, fit)


def _with_edges(design: Design, record: Record) -> tuple[Record, Estimated]:
    plain = _reweighed(record, record.wrong, 0.0)
    return plain, base_fit(design, plain)


def _reweighed(record: Record, wrong: float, share: float) -> Record:
    assert record.weighing is not None
    weight, mask = record.weighing.weights(wrong, share)
    return _otherwise(record, weight=weight, mask=mask, wrong=wrong, edges=share)


def _otherwise(record: Record, **changes: Any) -> Record:
    """Return the record with changes that the columns of its fits hang on."""
    kept = {key: value for key, value in record.kept.items() if key[0] in ALWAYS}
    return replace(record, memo={}, kept=kept, **changes)


def _with_edges_said(record: Record) -> Record:
    """Return the record with a notice of the edges that its samples do not resolve, where these are not few."""
    false = falsified(record, record.edges)
    if false < FEWEST:
        return record
    return replace(record, notes=(*record.notes, TORQUE_EDGES(quantity=record.drive, percent=100.0 * false)))


def _with_lines(record: Record, fit: Estimated, sure: Array) -> Record:
    """Return the record with the errors of the encoder's lines that it shows, which every fit then holds.

    They show everywhere. Where an edge may be late, as that of dry friction in a reversal, they are not looked for.
    """
    left = record.target[0] - fit.inside.predicted()[0]
    found = shown_lines(record, left, fit.model.matrix[0], float(fit.weights.sigma[0]), sure)
    if not found:
        return record
    said = (
        RESOLVER_ERROR(order=lines, amplitude=amplitude)
        if lines in RESOLVER
        else ENCODER_LINES(lines=lines, amplitude=amplitude)
        for lines, amplitude in found.items()
    )
    return replace(record, lines=tuple(found), notes=(*record.notes, *said), kept={})


def _with_filter_said(record: Record) -> Record:
    """Return the record with a notice of the filter that was found and undone; one that is stated needs none."""
    if record.sampling_stated or 1e3 * max(record.timing.lag, -record.timing.delay) < SHOWN_MS:
        return record
    return replace(record, notes=(*record.notes, timing_notice(record.timing, record.drive)))


def _filter(design: Design, record: Record, fit: Estimated) -> DriveTiming:
    """Return the filter of the drive signal that explains what sampling cannot do; none where none does.

    A delay that exceeds it by less than its uncertainty is not taken for a filter: friction that the design lacks looks
    like one. A variance exceeds it where it is larger than that of a mean over a period: two moments do not describe a
    filter that reaches into the band.
    """
    settled = fit.level(LATENESS) <= record.sampling and not _spread_out(record, fit)
    if record.timing == UNDELAYED and settled:
        return UNDELAYED
    free = base_fit(design, record, settled=False)
    delay, stderr = record.timing.delay + free.level(LATENESS), free.value(LATENESS)[1]
    value, error = record.timing.spread + free.value(SPREAD)[0], free.value(SPREAD)[1]
    if delay - record.sampling > SURE * stderr:
        # noise that the controller responds to makes it too large by least squares
        estimates = by_reference(free.record, free.model, float(free.weights.sigma[0]))
        if estimates is not None and record.timing.spread + estimates.spread[0] < value:
            value, error = record.timing.spread + estimates.spread[0], estimates.spread[1]
        return filter_behind(delay, (value, error), record.sampling) or UNDELAYED
    if delay <= SURE * stderr or not _spread_out(record, free):
        return UNDELAYED
    lag = min(math.sqrt(2.0 * value), delay)
    return DriveTiming(delay - lag, lag)


def _spread_out(record: Record, fit: Estimated) -> bool:
    """Whether the impulse response of the drive signal has a larger variance than a mean over a period.

    By the reference as well, where there is one: noise that the controller responds to makes it too large by least
    squares.
    """
    least = record.sampling**2 / 24.0 - record.timing.spread
    if fit.level(SPREAD) <= least:  # whatever its standard error
        return False
    value, stderr = fit.value(SPREAD)
    if value - least <= SURE * stderr:
        return False
    estimates = by_reference(fit.record, fit.model, float(fit.weights.sigma[0]))
    return estimates is None or estimates.spread[0] - least > SURE * estimates.spread[1]


def _sharpened(design: Design, made: Made, record: Record) -> tuple[Record, Estimated]:
    """Narrow the band of a log as long as noise of the acceleration, mostly of a coarse encoder, is dominant.

    Noise in the motion is noise in every column, and the drive responds to it, so that no column can be judged against
    it. It grows with the square of the frequency: the noise floor falls faster with the band than that of white noise.
    """
    fit = base_fit(design, record)
    for _ in range(HALVINGS):
        size, floor = _size(record), _noise(fit)
        if design.J * record.shaft_noise() < floor * size:
            break
        try:
            narrow = made.record(design, Processing(standstill=STANDSTILL, cutoff=0.5 * record.cutoff))
        except LogError:
            break
        if narrow.shaft_noise() > BLUE * record.shaft_noise():  # what lies above the band is the motion itself
            break
        if narrow.usable < USABLE or _noise_floor(design, narrow) > BLUE * floor:
            break
        record, fit = narrow, base_fit(design, narrow)
    return record, fit


def _widened(design: Design, made: Made, record: Record, fit: Estimated) -> Record:
    wanted = min(signal_band(made.log), record.prepared.rate / 8.0)  # a fast log was thinned to a lower rate
    if record.age is None:
        # of a lateness alone the slope is taken over all of it, which is exact
        spread, stderr = fit.value(SPREAD)
        lag = max(math.sqrt(2.0 * max(abs(spread) - stderr, 0.0)), record.timing.lag)
        wanted = min(wanted, EXPANDED / (2.0 * math.pi * max(lag, 1e-9)))
    if wanted < WIDER * record.cutoff or record.cutoff < default_cutoff(record.prepared.rate):
        return record
    processing = Processing(standstill=STANDSTILL, cutoff=wanted)
    wide = made.record(design, processing, record.age, record.timing)
    usual, share = (noise_share(one, one.acceleration()) for one in (record, wide))
    if share >= max(MOST_NOISE, usual):
        return record
    floor = _noise_floor(design, wide)
    return record if floor > min(NOISIER * _noise(fit), LOUD) else wide


def _noise(fit: Estimated) -> float:
    """Noise floor of the torque balance, as a share of the torque."""
    return float(fit.weights.sigma[0]) / max(_size(fit.record), 1e-300)


def _noise_floor(design: Design, record: Record) -> float:
    """Do the same for a record that is not fitted yet, without an estimate."""
    found = settled_model(design, record)
    return float(rough_weights(found.record, found.left).sigma[0]) / max(_size(record), 1e-300)


def _size(record: Record) -> float:
    return float(np.sqrt(np.mean(record.target[0][record.mask] ** 2)))
