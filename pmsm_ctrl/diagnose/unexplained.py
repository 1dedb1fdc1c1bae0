"""Structure that no effect of the catalogue explains: does the residual depend on a coordinate, by cross-validation?

Or else, does a refused effect explain far more of it than noise would? Or is little left only because the winding took
it up, with a value that no motor of that datasheet has?
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.notices import coordinate_words, largest_words
from pmsm_ctrl.diagnose import notices
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.measures import judged_gain
from pmsm_ctrl.diagnose.notices import Doubt
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Reason
from pmsm_ctrl.diagnose.result import Structure
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.diagnose.selection import Selection, name_of
from pmsm_ctrl.effects.structures.paths import drive_path, observed_path, voltage_path
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.bounds import bounded
from pmsm_ctrl.regression.columns import Group
from pmsm_ctrl.regression.model import solve_model
from pmsm_ctrl.rendering.numbers import with_prefix
from pmsm_ctrl.residuals.coordinates import TIME, Drive, accelerations
from pmsm_ctrl.residuals.dependence import Dependence, Relevance, Trace, residual_structure
from pmsm_ctrl.residuals.single_wave import single_wave
from pmsm_ctrl.units import axis_unit

__all__ = ["beside_path", "dependence", "impossible_winding", "resemblance", "slow_torque", "unexplained", "wave_left"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RESEMBLING = (Reason.NOT_CONFIRMED, Reason.MINOR)  # refusals of an effect that something missing can resemble
# Refusals of an effect that a log does not tell from something else.
AS_WELL = frozenset({Reason.LIKE_RIPPLE, Reason.ONE_WAY, Reason.ONE_SPEED, Reason.IN_PASSING})
FEWEST_SAMPLES = 100  # of a balance that is judged
FEWEST = 4  # samples whose mean is drawn, and reversals that can repeat each other
HALF = 0.5  # of the samples around a reversal have to take part
# What a missing voltage looks like where a parameter of the winding takes it up, and the parameter's unit.
LIKENESS = {"R": ("a resistance", "Ohm"), "L_d": ("an inductance", "H"), "L_q": ("an inductance", "H")}


def unexplained(selection: Selection, policy: Policy = POLICY) -> Structure | None:
    """Return the structure of the final residual that no effect explains; None where it is not significant.

    Parameters
    ----------
    selection : Selection
    policy : Policy
    """
    fit = selection.fit
    found = dependence(selection, policy)
    if found is not None and found.confirmed and found.coordinate == TIME:  # a load of the process is more than that
        return slow_torque(fit, policy) or found
    found = found or resemblance(selection, policy)
    return found or impossible_winding(fit, policy) or slow_torque(fit, policy) or wave_left(fit)


def dependence(selection: Selection, policy: Policy = POLICY) -> Structure | None:
    """Return the coordinate that the residual depends on most; None when it depends on none.

    An error of the drive signal at the edges of the torque is a curve over the acceleration, the current or the speed
    of a motion that repeats itself. A dependence that is gone `beside_path` is an open question, and so is one that a
    refused effect explains, which the log does not tell from something else.

    Parameters
    ----------
    selection : Selection
    policy : Policy
    """
    fit = selection.fit
    found = _strongest(fit, policy)
    if found is None:
        return None
    (one, name), record = found, fit.record
    doubt = _explained_by_refused(selection, policy)
    if doubt is None and _strongest(beside_path(fit), policy) is None:
        doubt = Doubt.DRIVE_PATH
    coordinate = coordinate_words(one)
    notice = notices.DEPENDENCE(
        percent=100.0 * one.added, balance=_balance(record, name), coordinate=coordinate,
        peak=with_prefix(one.peak, record.unit(name)), doubt=doubt, why=notices.why(doubt, policy),
        place="" if one.coordinate == "direction" else f" {largest_words(one)}",
    )  # fmt: skip
    curve = (one.x, one.forward, one.backward)
    return Structure(coordinate, one.unit, name, one.added, one.p_value, curve, notice, confirmed=doubt is None)


def _explained_by_refused(selection: Selection, policy: Policy) -> Doubt | None:
    """Return why an effect of the catalogue that is most of the residual was refused, where that says little of it."""
    refused = ((trial, selection.refused.get(name_of(trial))) for trial in selection.fit.trials)
    reasons = {
        refusal.reason
        for trial, refusal in refused
        if refusal is not None and _share(selection.fit, trial) > policy.left_inside
    }
    if reasons & AS_WELL:
        return Doubt.AS_WELL
    return Doubt.HELD_OUT if Reason.HOLDOUT_WORSE in reasons else None


def beside_path(fit: Fitted) -> Fitted:
    """Return a fit beside all that may lie between the logged drive signal and the torque.

    How a log was sampled is fitted as a delay and a variance. A current loop, a hold and a mean over many periods leave
    more than these two, which is as large as the edges of the torque are steep. Each effect with a mass of its own is
    judged beside these columns; so is what no effect explains.

    Parameters
    ----------
    fit : Fitted
    """
    record = fit.record
    parts = [*drive_path(record), *observed_path(record)]
    if len(record.channels) > 1:
        parts += voltage_path(record)
    symbols = tuple(f"path {k + 1}" for k in range(len(parts)))
    model = fit.model.plus(Group(None, symbols, record.stack_all(parts), {}), 1.0)
    plain = solve_model(record, model, fit.weights, fit.plain)
    return replace(fit, model=model, plain=plain, estimate=bounded(plain))


def _strongest(fit: Fitted, policy: Policy) -> tuple[Dependence, str] | None:
    """Return the dependence that explains most of the residual of any balance, and the balance; None without any."""
    record, plain = fit.record, fit.plain
    predicted = plain.predicted()
    J = float(plain.values[plain.model.names.index("J")])
    per_ampere = record.design.K_t_assumed if "i_q" in record.prepared.signals else None
    drive = Drive(predicted[0], J, per_ampere, accelerations(record.prepared, J))
    found: list[tuple[Dependence, str]] = []
    for row, name in enumerate(record.channels):
        sound = record.mask & (record.weight[row] > policy.sound_weight)
        if int(sound.sum()) < FEWEST_SAMPLES:
            continue
        level = float(np.sqrt(np.mean(record.target[row][sound] ** 2)))
        # a small voltage is known no better than the whole: a frame askew by 4 mrad mixes so much of it in
        whole = float(np.sqrt(np.mean(record.target[1:, sound] ** 2) * 2.0)) if name != "torque" else level
        least = max(policy.size * whole, record.coarse[row]) / max(level, 1e-300)
        trace = Trace(record.t, record.target[row], predicted[row], sound, record.unit(name))
        relevance = Relevance(policy.structure_share, least)
        structure = residual_structure(record.prepared, trace, drive, relevance, table=False)
        if structure.named:
            found.append((structure.named[0], name))
    return max(found, key=lambda f: f[0].added, default=None)


def resemblance(selection: Selection, policy: Policy = POLICY) -> Structure | None:
    """Return the structure that a refused effect explains far too much of for noise; None where there is none.

    The effect itself was refused for a reason: something like it is missing. Left-out data have to confirm that, either
    blocks by `first_block_errors`, or each reversal by the mean course of the others. Otherwise it is an open question;
    a minor effect is none, nor is one so flexible that a part of the residual is no evidence of it. An open question is
    also what sits around reversals as the edges of the torque do (`_doubt`).

    Parameters
    ----------
    selection : Selection
    policy : Policy
    """
    fit = selection.fit
    glaring = [
        (share, trial, refusal)
        for trial in fit.trials
        if (share := _share(fit, trial)) > policy.resembled_at_turns and trial.p_value < policy.significance
        and (refusal := selection.refused.get(name_of(trial))) and refusal.reason in RESEMBLING
        and not trial.candidate.effect.structure.never_minor(trial.group.shape)
    ]  # fmt: skip
    if not glaring:
        return None
    share, best, refusal = max(glaring, key=lambda one: one[0])
    name, record = name_of(best), fit.record
    row = _where_it_enters(fit, best.plain_direction)
    rest, whole = (values[row] * record.weight[row] * record.mask for values in (fit.residual, record.target))
    if float(rest @ rest) < policy.small_size**2 * float(whole @ whole):
        return None  # whatever it is, nobody needs to know
    ratio, curve = _around_reversals(record, fit.residual[row], row)
    minor, around = refusal.reason is Reason.MINOR, ratio > policy.around_reversals
    repeated = around and _repeated(fit, row) > policy.block_errors
    told = repeated if minor else around or share > policy.excess
    if not told:
        return None
    place, coordinate, unit = "", "time since the reversal", "s"
    if around:
        place = f" and {ratio:.2g} times as large around reversals as elsewhere"
    else:
        coordinate, unit = "acceleration", axis_unit("rad/s^2", record.prepared.motion)
        curve = _over(record.at_grid(record.signals["alpha"]), record, fit.residual[row])
    channel = record.channels[row]
    gained = not minor and refusal.detail["gain"] > policy.first_block_errors * refusal.detail["stderr"]
    doubt = _doubt(fit, row, policy) if repeated else None
    notice = notices.RESEMBLANCE(
        balance=_balance(record, channel), place=place, effect=name, percent=100.0 * share, refusal=refusal,
        doubt=doubt, why=notices.why(doubt, policy),
    )  # fmt: skip
    confirmed = (repeated and doubt is None) or (share > policy.excess and gained)
    return Structure(coordinate, unit, channel, share, best.p_value, curve, notice, name, confirmed)


def impossible_winding(fit: Fitted, policy: Policy = POLICY) -> Structure | None:
    """Return the voltage that a parameter of the winding takes up far beyond its datasheet; None where none does.

    A dead time that is no candidate is as well a resistance of four times the datasheet's: the residual is noise then,
    and yet no motor of that datasheet explains the log. At one amplitude of the current it is one in the model as well:
    the effects that the log does not tell from the parameter are said.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    plain, record = fit.plain, fit.record
    names = [name for name in LIKENESS if name in plain.model.names]
    places = np.array([plain.model.names.index(name) for name in names], dtype=np.intp)
    off = (plain.values - plain.model.nominal)[places]
    tolerance = np.maximum(plain.model.sigma, policy.tolerance * plain.model.nominal)[places]
    far = (off / tolerance) ** 2
    surely = np.abs(off) / plain.stderr[places]
    far[surely < policy.sure_errors] = 0.0
    if not np.any(far > policy.impossible):
        return None
    best = int(np.argmax(far))
    name, k = names[best], int(places[best])
    taken = plain.model.matrix[:, :, k] * off[best]
    row = max(range(1, len(record.channels)), key=lambda r: float(np.sum(taken[r][record.mask] ** 2)))
    with_it = fit.residual[row] + taken[row]
    share = 1.0 - float(np.mean(fit.residual[row][record.mask] ** 2) / np.mean(with_it[record.mask] ** 2))
    like, unit = LIKENESS[name]
    value, nominal = float(plain.values[k]), float(plain.model.nominal[k])
    same = [t.candidate.effect.id for t in fit.trials if t.singular and name in t.candidate.effect.look_alikes]
    explained = f"this log does not tell {' and '.join(same)} from it" if same else notices.why(None, policy)
    notice = notices.WINDING_IMPOSSIBLE(
        parameter=name, value=value, unit=unit, ratio=value / nominal, like=like, explained=explained
    )
    curve = _over(record.at_grid(record.signals["i_d" if name == "L_d" else "i_q"]), record, with_it)
    p = math.erfc(float(surely[best]) / math.sqrt(2.0))
    return Structure("current", "A", record.channels[row], max(share, 0.0), p, curve, notice, like)


def wave_left(fit: Fitted) -> Structure | None:
    """Return the single wave that most of what is left of the torque consists of; None where there is none.

    Parameters
    ----------
    fit : Fitted
    """
    found = single_wave(fit.record, fit.residual[0])
    if found is None:
        return None
    x, wave = found.curve
    return Structure(found.coordinate, found.unit, "torque", found.share, found.p_value, (x, wave, wave), found.notice)


def slow_torque(fit: Fitted, policy: Policy = POLICY) -> Structure | None:
    """Return the slow part of what is left of the torque where that is large; None where it is not.

    A load that changes with the time of the process depends on no coordinate of the axis, and a noise model of any
    order takes it for noise. But noise of a sensor has forgotten itself after a period of the band.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    record, used = fit.record, fit.record.mask
    left, whole = (values[0] * record.weight[0] for values in (fit.residual, record.target))
    lag = max(1, round(record.prepared.thinned_rate / record.cutoff))
    both = used[lag:] & used[:-lag]
    if int(both.sum()) < FEWEST_SAMPLES:
        return None
    alike = float(np.mean((left[lag:] * left[:-lag])[both]))
    share = alike / max(float(np.mean(whole[used] ** 2)), 1e-300)
    correlation = alike / max(float(np.mean(left[used] ** 2)), 1e-300)
    p = 0.5 * math.erfc(correlation * math.sqrt(0.5 * float(both.sum()) / lag))
    if share < policy.excess**2 or p > policy.significance:
        return None
    notice = notices.SLOW_TORQUE(
        balance=_balance(record, "torque"), percent=100.0 * math.sqrt(share), seconds=1.0 / record.cutoff
    )
    return Structure("time", "s", "torque", correlation, p, _over(record.t, record, fit.residual[0]), notice)


def _share(fit: Fitted, trial: Trial) -> float:
    """Return what a trial explains of the residual, by the weights that judged it."""
    solved, gain = judged_gain(fit, trial)
    return gain / solved.chi2


def _balance(record: Record, channel: str) -> str:
    return record.drive if channel == "torque" else channel


def _where_it_enters(fit: Fitted, direction: Array) -> int:
    """Return the balance in which an effect explains most, of its whitened `direction`."""
    power = direction[: fit.plain.rows] ** 2
    return int(np.argmax(np.bincount(fit.weights.channel, weights=power, minlength=len(fit.record.channels))))


def _doubt(fit: Fitted, row: int, policy: Policy) -> Doubt | None:
    """Return what else may have left a course that the residual takes around every reversal; None where nothing may.

    A motion that repeats itself repeats every error of the model. Friction is meant only where most of the common
    course is left beside what blurs edges of the torque, and where the residual at edges around reversals is larger
    than at those elsewhere; by as much as a contribution needs for a name, and in samples that count.
    """
    record, residual = fit.record, fit.residual[row]
    rest, whole = (values * record.weight[row] * record.mask for values in (residual, record.target[row]))
    if float(rest @ rest) < policy.size**2 * float(whole @ whole):
        return Doubt.SMALL
    since, weighed = _since_reversal(record)[0], (record.weight[row] * residual)[record.mask] ** 2
    near = _near(record, since)[record.mask]
    if float(np.mean(weighed[near])) < float(np.mean(weighed[~near])):
        return Doubt.LITTLE_WEIGHT
    common, left = (float(np.sum(_alike(one, row))) for one in (fit, beside_path(fit)))
    if left < policy.left_inside * common:
        return Doubt.DRIVE_PATH
    edges = _edges(record)
    at_edges, usual = (_around_reversals(record, values, row)[0] for values in (residual * edges, edges))
    return Doubt.EDGES if at_edges < policy.around_reversals * usual else None


def _edges(record: Record) -> Array:
    """Return how fast torque and acceleration change together, N m/s, shape (m,): not where friction changes its sign.

    An edge of the drive's torque is one of the acceleration. Where friction jumps, the torque jumps and the
    acceleration does not, or the acceleration jumps the other way.
    """
    s = record.signals
    both = record.rate_of(s["torque"]) * record.rate_of(record.design.J * s["alpha"])
    return record.at_grid(np.sqrt(np.maximum(both, 0.0)))


def _around_reversals(record: Record, residual: Array, row: int) -> tuple[float, tuple[Array, Array, Array]]:
    """Return the rms around reversals over that elsewhere, and the residual over the time since the reversal."""
    since, forward = _since_reversal(record)
    near = _near(record, since)
    weight = (record.weight[row] * record.mask) ** 2
    if not np.any(near) or int(np.sum((weight > 0.0) & ~near)) < FEWEST_SAMPLES:
        return 0.0, (np.zeros(0),) * 3  # there is no elsewhere
    square = residual**2
    powers = [float(np.sum(weight[s] * square[s]) / max(float(np.sum(weight[s])), 1e-300)) for s in (near, ~near)]
    reach = _reach(record)
    curve = _means(since, residual, forward, record.mask, np.linspace(-reach, 2.0 * reach, 31))
    return float(np.sqrt(powers[0] / max(powers[1], 1e-300))), curve


def _since_reversal(record: Record) -> tuple[Array, Mask]:
    """Return the time since the nearest reversal, s, and whether the axis moves forward after it; shape (m,) each."""
    omega, t, grid = record.signals["omega"], record.prepared.t, record.t
    turns = np.flatnonzero(np.diff(np.sign(omega)) != 0.0)
    if len(turns) == 0:
        return np.full(len(grid), np.inf), np.ones(len(grid), dtype=bool)
    after = np.clip(np.searchsorted(t[turns], grid), 1, len(turns)) - 1
    before = np.minimum(after + 1, len(turns) - 1)
    nearest = np.where(np.abs(grid - t[turns[after]]) < np.abs(grid - t[turns[before]]), after, before)
    return grid - t[turns[nearest]], np.sign(omega[turns[nearest] + 1]) > 0.0


def _near(record: Record, since: Array) -> Mask:
    return np.abs(since) < _reach(record)


def _reach(record: Record) -> float:
    """Return the memory of the filter on either side of a reversal, s."""
    return 2.0 / record.prepared.cutoff


def _repeated(fit: Fitted, row: int) -> float:
    """Return whether the residual takes the same course around every reversal: the mean over its standard error.

    Noise that is larger around reversals than elsewhere, as that of a coarse encoder, has another course each time. A
    few reversals tell their own scatter badly, by Student's distribution: what is returned are the standard errors of
    as many as one likes that are as unlikely.
    """
    from scipy.stats import norm
    from scipy.stats import t as student

    alike = _alike(fit, row)
    if len(alike) < FEWEST:
        return 0.0
    errors = np.mean(alike) / max(float(np.std(alike, ddof=1)) / math.sqrt(len(alike)), 1e-300)
    return float(norm.isf(student.sf(errors, len(alike) - 1)))


def _alike(fit: Fitted, row: int) -> Array:
    """Return what the course of the residual around each reversal has in common with those around all others.

    An axis that comes to rest may turn many times there: only reversals whose courses share no sample are looked at.
    """
    record = fit.record
    omega, t = record.signals["omega"], record.prepared.t
    reach = _reach(record)
    since = np.arange(-reach, 2.0 * reach, 1.0 / record.rate)
    residual = fit.residual[row] * record.weight[row] * record.mask
    turns = np.flatnonzero(np.diff(np.sign(omega)) != 0.0)
    seen = [np.interp(t[k] + since, record.t, record.mask).mean() > HALF for k in turns]
    turns = _apart(t, turns[np.array(seen, dtype=bool)], 3.0 * reach)
    course = np.array([np.sign(omega[k + 1]) * np.interp(t[k] + since, record.t, residual) for k in turns])
    return np.sum(course * (course.sum(axis=0) - course), axis=-1) if len(turns) else np.zeros(0)


def _apart(t: Array, places: NDArray[np.intp], least: float) -> NDArray[np.intp]:
    """Return the places, from the first on, that lie no closer together than `least`, s."""
    kept: list[int] = []
    for k in places.tolist():
        if not kept or t[k] - t[kept[-1]] >= least:
            kept.append(k)
    return np.array(kept, dtype=np.intp)


def _over(x: Array, record: Record, residual: Array) -> tuple[Array, Array, Array]:
    low, high = np.quantile(x[record.mask], [0.002, 0.998])
    edges = np.linspace(low, high, 26)
    forward = record.at_grid(record.signals["omega"]) > 0.0
    return _means(x, residual, forward, record.mask, edges)


def _means(x: Array, residual: Array, forward: Mask, used: Mask, edges: Array) -> tuple[Array, Array, Array]:
    """Return the middles of the bins between edges, and the mean residual in each, moving forward and backward."""
    sides = []
    for side in (forward, ~forward):
        here = used & side & (x >= edges[0]) & (x <= edges[-1])
        place = np.clip(np.searchsorted(edges, x[here], side="right") - 1, 0, len(edges) - 2)
        count = np.bincount(place, minlength=len(edges) - 1)
        total = np.bincount(place, weights=residual[here], minlength=len(edges) - 1)
        sides.append(np.divide(total, count, out=np.full(len(count), np.nan), where=count >= FEWEST))
    return 0.5 * (edges[1:] + edges[:-1]), sides[0], sides[1]
