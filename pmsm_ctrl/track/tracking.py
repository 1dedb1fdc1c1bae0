"""track: the history of F_c and F_v over a whole log, by the compiled twin of filterpy's extended Kalman filter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log, Logs, as_logs, names_of
from pmsm_ctrl.plausibility import doubts_about, with_inertia
from pmsm_ctrl.regression.measurement_correction import corrected_log
from pmsm_ctrl.section import Notice
from pmsm_ctrl.track import model, notices
from pmsm_ctrl.track.inputs import Samples, located, noise_from_samples, samples_of, scatter
from pmsm_ctrl.track.result import Tracking, mean_of_judged
from pmsm_ctrl.track.settings import Settings, covariance, memory, numbers, start
from pmsm_ctrl.units import axis_unit, drives

__all__ = ["Filtered", "filter_samples", "track"]

Array = NDArray[np.float64]

SLOW, EITHER = 0.05, 0.1  # share of the top speed that counts as motion; of the motion, in either direction
SPAN, SURGE = 0.02, 0.5  # s between two speeds; accelerating torque, as a share of F_c, that shows the inertia
LOUD = 3.0  # times the sensors' noise: the torque itself scatters between two samples


def track(
    design: Design,
    log: Logs,
    settings: Settings | None = None,
    *,
    adapt: bool = True,
) -> Tracking:
    """Track F_c and F_v over a log.

    Parameters
    ----------
    design : Design
        Start values, noise, and further effects whose torque is taken as known.
    log : Log or sequence of Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``. Several records are tracked in their order: friction is
        carried over from one to the next, the motion starts again.
    settings : Settings, optional
        By default the angle is used where the log has one; T_load is estimated as well where the axis turns in both
        directions, and J where it also accelerates: taken as known, their errors are mistaken for friction.
    adapt : bool
        False leaves the torque noise as the settings say, whatever the innovations are; see `Settings.adapt`.

    Returns
    -------
    Tracking

    Raises
    ------
    LogError
        When a channel is missing or the log is too short.
    RequestError
        When the design has no friction to start from, or the drive torque is zero throughout.
    """
    logs = as_logs(log)
    for one in logs:
        if len(one) < 3:
            raise LogError(f"{located(one)}{len(one)} samples; tracking needs at least 3")
        one.check_evaluable()
    design = with_inertia(design, logs)
    believed = doubts_about(design, log)
    log, left_in = corrected_log(design, believed.log)
    settings = settings or _default_settings(design, log)
    samples = samples_of(design, log, settings.measure)
    settings = noise_from_samples(design, settings, samples, located(log))
    doubts = [*believed.notices, *left_in, *samples.notices, *_undersampled(design, log, samples)]
    settings = settings if adapt else replace(settings, adapt=False)
    s = numbers(design, settings, log.period)
    out = filter_samples(design, settings, s, samples)
    raised = math.sqrt(out.noise)
    if out.noise > model.EXCESS_LIMIT:
        missing = ",".join(name for name in ("T_load", "J") if name not in settings.estimate)
        remedy = f"; a load or an inertia that the design does not know: --estimate {missing}" if missing else ""
        doubts.append(notices.UNMODELLED_TORQUE(drive=drives(log.motion), factor=raised, remedy=remedy))
    doubts += _doubts(settings, s, out)
    active = [model.STATES[k] for k in settings.active if k not in (model.OMEGA, model.THETA)]
    history = {name: out.estimates[:, model.STATES.index(name)] for name in active}
    stderr = {name: np.sqrt(out.variances[:, model.STATES.index(name)]) for name in active}
    return Tracking(
        design=design,
        settings=settings,
        t=log.t,
        omega=out.estimates[:, model.OMEGA],
        history=history,
        stderr=stderr,
        correlation=_correlation(out.covariance, stderr["F_c"] * stderr["F_v"]),
        nis=out.nis,
        normalised=out.innovations[:, 0] / np.sqrt(out.innovations[:, 1]),
        events=out.events,
        torque_noise=raised * math.sqrt(s[model.TORQUE_DENSITY] / log.period),
        log_name=names_of(logs, "the given log"),
        records=log.records,
        notices=tuple(doubts),
    )


def _default_settings(design: Design, log: Log) -> Settings:
    """Return what is measured and estimated where nothing is stated.

    With one direction alone a load torque is not separable from F_c, and without acceleration an inertia only gathers
    the errors of both: each is estimated where the motion shows it.
    """
    measure: Literal["theta", "omega"] = "theta" if "theta" in log else "omega"
    span = max(1, round(SPAN / log.period))
    angle = log["theta"] if measure == "theta" else np.cumsum(log["omega"]) * log.period
    speed = (angle[span:] - angle[:-span]) / (span * log.period)
    turning = np.abs(speed) > SLOW * np.abs(speed).max(initial=0.0)
    forwards = float(np.mean(speed[turning] > 0.0)) if turning.any() else 0.0
    if not EITHER < forwards < 1.0 - EITHER:
        return Settings(measure=measure, estimate=())
    surge = design.J * float(np.std(speed[span:] - speed[:-span])) / (span * log.period)
    excited = surge > SURGE * design.parameters("coulomb").get("F_c", 0.0)
    return Settings(measure=measure, estimate=("T_load", "J") if excited else ("T_load",))


def _undersampled(design: Design, log: Log, samples: Samples) -> list[Notice]:
    """Return a notice where the torque between two samples of a slow log swings by more than F_c."""
    noise, friction = design.K_t_assumed * design.sensor.current_noise, design.parameters("coulomb").get("F_c", 0.0)
    found = scatter(samples)
    slow = design.motor.electrical and log.period > 1.5 * design.drive.speed_period
    if not (slow and 0.0 < friction < found and found > LOUD * noise > 0.0):
        return []
    names = {"drive": drives(log.motion), "unit": axis_unit("N m", log.motion), "rate": 1.0 / design.drive.speed_period}
    return [notices.UNDERSAMPLED(scatter=found, times=found / friction, louder=found / noise, **names)]


def _correlation(covariance: Array, scale: Array) -> Array:
    """Return the correlation; where a spread is too small for a double to hold its square, none."""
    known = scale > 1e-300
    return np.where(known, covariance / np.where(known, scale, 1.0), 0.0)


@dataclass(frozen=True, eq=False)
class Filtered:
    """The arrays that `pmsm_ctrl.track.twin.run` fills.

    Attributes
    ----------
    x, P : array
        Estimates and covariance at the end, shapes (6,) and (6, 6).
    estimates, variances, covariance, innovations, events : array
        Histories over n samples.
    """

    x: Array
    P: Array
    estimates: Array
    variances: Array
    covariance: Array
    innovations: Array
    events: NDArray[np.int8]

    @property
    def nis(self) -> Array:
        """Normalised innovation squared where a measurement was judged, NaN elsewhere, shape (n,)."""
        return self.innovations[:, 0] ** 2 / self.innovations[:, 1]

    @property
    def noise(self) -> float:
        """Mean factor on the variance of the torque noise over the judged measurements, 1 without one."""
        mean = mean_of_judged(self.innovations[:, 2])
        return 1.0 if mean is None else mean


def filter_samples(design: Design, settings: Settings, s: Array, samples: Samples) -> Filtered:
    """Run the compiled twin over samples, from the design's start values.

    Parameters
    ----------
    design : Design
        Start values.
    settings : Settings
        Which states are estimated.
    s : array
        The run's fixed numbers, from `pmsm_ctrl.track.settings.numbers`.
    samples : Samples
        n samples.

    Returns
    -------
    Filtered
        The history, arrays of length n.
    """
    from pmsm_ctrl.track.twin import run

    n = samples.t.size
    x, P, m = start(design), covariance(s, settings), memory()
    slow = 1 + max(k for k in settings.active if k != model.THETA)
    out = Filtered(
        x, P, np.empty((n, slow)), np.empty((n, slow)), np.empty(n), np.empty((n, 3)), np.empty(n, dtype=np.int8)
    )
    # a column of a table is not contiguous, and would have the whole filter compiled once more
    t, z, torque, known = map(np.ascontiguousarray, (samples.t, samples.z, samples.torque, samples.known))
    run(t, z, torque, known, s, x, P, m, out.estimates, out.variances, out.covariance, out.innovations, out.events)
    return out


def _doubts(settings: Settings, s: Array, out: Filtered) -> list[Notice]:
    learnt = np.isin(out.events, (model.UPDATED, model.CONSTANT, model.CHANGE))
    if not learnt.any():
        return [notices.NOT_MOVED()]
    doubts, mean = [], mean_of_judged(out.nis)
    if mean is not None and not 0.6 <= mean <= 1.3:
        doubts.append(notices.INCONSISTENT(nis=mean, fault="narrow" if mean > 1.0 else "wide"))
    constant = int((out.events == model.CONSTANT).sum())
    if constant > 0.5 * learnt.sum():
        doubts.append(notices.CONSTANT_SPEED(percent=100 * constant / int(learnt.sum())))
    for k in settings.active:
        if k not in (model.OMEGA, model.THETA) and out.P[k, k] > 0.5 * s[model.PRIOR + k]:
            doubts.append(notices.NOT_EXCITED(state=model.STATES[k]))
    moving = learnt & (np.abs(out.estimates[:, 0]) > 0.0)
    if "T_load" in settings.estimate and abs(np.mean(np.sign(out.estimates[moving, 0]))) > 0.95:
        doubts.append(notices.ONE_DIRECTION())
    changes = int((out.events == model.CHANGE).sum())
    if changes:
        doubts.append(notices.CHANGED(count=changes))
    rejected = int((out.events == model.REJECTED).sum() + (out.events == model.IMPLAUSIBLE).sum())
    if rejected:
        doubts.append(notices.REJECTED(count=rejected))
    return doubts
