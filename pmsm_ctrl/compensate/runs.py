"""Drives without friction compensation and with a chosen one, and one run of a trial with them."""

from __future__ import annotations

from collections.abc import Iterable

from pmsm_ctrl.compensate.adaptive import simulate_adaptive
from pmsm_ctrl.compensate.metrics import Metrics, measure, measure_contour
from pmsm_ctrl.compensate.motions import Trial
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.simulate.parameters import matched_filter

__all__ = ["baseline", "compensated", "judge", "off_by", "run_trial", "scaled"]


def baseline(design: Design) -> Design:
    """Return a design without friction compensation, inertia and delay fed forward.

    The measured speed lags the true one; a reference that is not delayed alike makes an error of lag times
    acceleration, which must not be attributed to friction.

    Parameters
    ----------
    design : Design
        With its loops set.

    Returns
    -------
    Design
    """
    loops, place = design.require_loops(), design.require_loops().position
    own = loops.reference_filter(in_position=True)
    matched = own if own > 0.0 or place.velocity_filter is not None else matched_filter(design)
    forward = {"acceleration_feedforward": place.acceleration_feedforward or 1.0, "velocity_filter": matched}
    loops = loops.model_copy(update={"position": place.model_copy(update=forward)})
    off = design.compensation.model_copy(update={"gain": 0.0})
    return design.model_copy(update={"loops": loops, "compensation": off})


def compensated(
    design: Design, effects: Iterable[str], *, gain: float = 1.0, source: str = "reference", factor: float = 1.0
) -> Design:
    """Return a design with effects compensated, their linear parameters off by a factor.

    Parameters
    ----------
    design : Design
    effects : iterable of str
        Their ids; a disturbance observer needs none.
    gain : float
        Share of the modelled torque that is fed forward.
    source : {"reference", "commanded", "measured", "adaptive", "observer"}
        Speed from which it is computed; or the disturbance observer, whose bandwidth the design states.
    factor : float
        Of an observer's inertia.

    Returns
    -------
    Design
    """
    chosen = tuple(effects)
    changed = design.compensation.model_copy(update={"gain": gain, "source": source, "effects": chosen})
    return off_by(design.model_copy(update={"compensation": changed}), factor)


def off_by(design: Design, factor: float) -> Design:
    """Return a design whose compensation assumes wrong parameters: those of its effects, or an observer's inertia.

    Parameters
    ----------
    design : Design
    factor : float
        On the linear parameters.

    Returns
    -------
    Design
    """
    chosen = design.compensation
    if chosen.source != "observer":
        return design if factor == 1.0 else scaled(design, chosen.effects, factor)
    inertia = factor * (chosen.inertia or design.assumed.J or design.J)
    return design.model_copy(update={"compensation": chosen.model_copy(update={"inertia": inertia})})


def scaled(design: Design, effects: tuple[str, ...], factor: float) -> Design:
    """Return a design with the linear parameters of these effects multiplied by a factor."""
    entries = []
    for entry, (effect, values) in zip(design.effects, bound_effects(design), strict=True):
        if effect.id in effects:
            values = values | {p.symbol: values[p.symbol] * factor for p in effect.linear}
        entries.append(entry.model_copy(update={"parameters": values}))
    return design.replace_effects(tuple(entries))


def run_trial(believed: Design, trial: Trial, *, truth: Design | None = None, seed: int = 0) -> tuple[Log, ...]:
    """Simulate a trial as the design says, its tracker in the loop where the source is "adaptive".

    Parameters
    ----------
    believed : Design
        What the controller assumes.
    trial : Trial
    truth : Design, optional
        The plant, before the trial changes it; `believed` when left out.
    seed : int
        Of the first axis' noise; the next has the next.

    Returns
    -------
    tuple of Log
        One an axis, with the truth.
    """
    plant = trial.plant(truth if truth is not None else believed)
    adaptive = believed.compensation.source == "adaptive" and believed.compensation.share > 0.0
    if adaptive:
        return tuple(
            simulate_adaptive(believed, motion, truth=plant, seed=seed + axis).log
            for axis, motion in enumerate(trial.motions)
        )
    return tuple(
        simulate(believed, motion, truth=plant, seed=seed + axis, keep_truth=True)
        for axis, motion in enumerate(trial.motions)
    )


def judge(trial: Trial, logs: tuple[Log, ...], dither: float = 0.0) -> Metrics:
    """Return the metrics of a trial.

    Parameters
    ----------
    trial : Trial
    logs : tuple of Log
        Of its axes.
    dither : float
        Amplitude below which the motion at rest is no limit cycle, rad (m): one count of the encoder, which the loops
        cannot resolve; at least `metrics.FINEST`.

    Returns
    -------
    Metrics
    """
    if trial.radius > 0.0:
        return measure_contour(logs[0], logs[1], trial.radius, dither=dither)
    return measure(logs[0], dither=dither)
