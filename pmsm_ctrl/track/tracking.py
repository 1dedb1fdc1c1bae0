"""track: the history of F_c and F_v over a whole log, by the compiled twin of filterpy's extended filter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError, NextCommand, RequestError
from pmsm_ctrl.log import Log
from pmsm_ctrl.result import Estimate, Result, Section, jsonable
from pmsm_ctrl.track import model
from pmsm_ctrl.track.inputs import KnownTorque, drive_torque
from pmsm_ctrl.track.settings import Kind, Settings, check_kind, covariance, memory, numbers, start
from pmsm_ctrl.units import axis_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Samples", "Tracking", "filter_samples", "samples_of", "track"]

Array = NDArray[np.float64]

UNITS = {"F_c": "N m", "F_v": "N m s/rad", "T_load": "N m", "J": "kg m^2"}
WIDE = 1.5  # mean normalised innovation squared above which the torque noise is raised
TABLE_ROWS = 12


@dataclass(frozen=True, eq=False)
class Samples:
    """What the filter reads of a log, each of shape (n,): time, angle or speed, drive torque, known torque."""

    t: Array
    z: Array
    torque: Array
    known: Array
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Tracking(Result):
    """The history of friction over a log.

    Attributes
    ----------
    t : array, shape (n,)
    history : dict of name to array, shape (n,)
        ``F_c`` and ``F_v``, and ``T_load``, ``J`` where asked for.
    stderr : dict of name to array, shape (n,)
        Standard error the filter states at each sample.
    correlation : array, shape (n,)
        Correlation of the errors of F_c and F_v; near -1 only their sum is known.
    nis : array, shape (n,)
        Normalised innovation squared where a measurement was judged, NaN elsewhere.
    normalised : array, shape (n,)
        The innovation over its standard deviation, NaN elsewhere.
    events : int array, shape (n,)
        Positions in `pmsm_ctrl.track.model.EVENTS`.
    omega : array, shape (n,)
    torque_noise : float
        Noise of the drive torque per sample that the filter ended up with, N m rms.
    kind : {"extended", "unscented"}
        Which filter it was.
    """

    design: Design
    settings: Settings
    t: Array
    omega: Array
    history: Mapping[str, Array]
    stderr: Mapping[str, Array]
    correlation: Array
    nis: Array
    normalised: Array
    events: NDArray[np.int8]
    torque_noise: float
    log_name: str
    reasons: tuple[str, ...] = ()
    kind: Kind = "extended"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers."""
        return self.reasons

    @property
    def estimates(self) -> dict[str, Estimate]:
        """Estimates at the end of the log."""
        nominal = dict(zip(model.STATES, start(self.design).tolist(), strict=True))
        return {
            name: Estimate(
                float(values[-1]),
                axis_unit(UNITS[name], self.design.motion),
                float(self.stderr[name][-1]),
                nominal[name],
            )
            for name, values in self.history.items()
        }

    @property
    def counts(self) -> dict[str, int]:
        """Samples by what became of them."""
        found = np.bincount(self.events, minlength=len(model.EVENTS))
        return {name: int(n) for name, n in zip(model.EVENTS, found, strict=True) if n}

    def design_at(self, t: float) -> Design:
        """Return the design with the friction as it was at time `t` (s), with its standard errors."""
        k = min(max(int(np.searchsorted(self.t, t, side="right")) - 1, 0), self.t.size - 1)
        design = self.design
        for effect, name in (("coulomb", "F_c"), ("viscous", "F_v")):
            value = max(float(self.history[name][k]), 0.0)
            design = design.with_effect(effect, {name: value}, {name: float(self.stderr[name][k])})
        return design

    def summary(self) -> str:
        """Return the result as text, trust first."""
        lines = [
            f"tracking of {self.design.name} over {self.log_name}, {self.t[-1] - self.t[0]:.4g} s, {self.kind} filter"
        ]
        lines += [f"  warning: {text}" for text in self.warnings] or ["  no reason to doubt the numbers was found"]
        for name, e in self.estimates.items():
            values = self.history[name]
            lines.append(
                f"  {name:<7} {e.value:>11.5g} +- {e.stderr:<8.2g} {e.unit:<10} at the end; "
                f"from {values.min():.5g} to {values.max():.5g}; design {e.nominal:.5g}"
            )
        shares = ", ".join(f"{name} {n}" for name, n in self.counts.items())
        lines.append(f"  samples: {shares}")
        mean = _mean(self.nis)
        if mean is not None:
            lines.append(f"  mean normalised innovation squared {mean:.3f} (1 is consistent)")
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw the estimates with bands, the innovations and what was gated."""
        from pmsm_ctrl.track.figures import draw

        return draw(self)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON: the history thinned to at most 2000 samples."""
        step = max(1, self.t.size // 2000)
        return jsonable({
            "schema": "pmsm-ctrl/tracking/1",
            "filter": self.kind,
            "log": self.log_name,
            "warnings": self.warnings,
            "estimates": self.estimates,
            "correlation_F_c_F_v": float(self.correlation[-1]),
            "mean_nis": _mean(self.nis),
            "torque_noise": self.torque_noise,
            "samples": self.counts,
            "t": self.t[::step],
            "history": {name: values[::step] for name, values in self.history.items()},
            "stderr": {name: values[::step] for name, values in self.stderr.items()},
        })  # fmt: skip

    def section(self) -> Section:
        """Return the section of the report."""
        names = tuple(self.history)
        rows = []
        for k in np.unique(np.linspace(0, self.t.size - 1, TABLE_ROWS).astype(np.int64)):
            cells = (f"{self.history[n][k]:.5g} ± {self.stderr[n][k]:.2g}" for n in names)
            rows.append((f"{self.t[k]:.4g}", *cells))
        header = ("t [s]", *(f"{n} [{self.estimates[n].unit}]" for n in names))
        return Section(
            title=f"Friction tracked over {Path(self.log_name).name}",
            paragraphs=(
                *(f"Warning: {text}" for text in self.warnings),
                "A Kalman filter follows the friction while the axis runs. Where the axis stands it learns nothing; "
                "where the speed does not vary only the sum F_c + F_v omega is seen, and their ratio is kept.",
            ),
            tables=((header, tuple(rows)),),
            figures=((self.plot(), "The bands narrow where the motion tells F_c and F_v apart."),),
        )


def track(
    design: Design,
    log: Log,
    settings: Settings | None = None,
    *,
    kind: Kind = "extended",
    adapt: bool = True,
) -> Tracking:
    """Track F_c and F_v over a log.

    Parameters
    ----------
    design : Design
        Start values, noise, and further effects whose torque is taken as known.
    log : Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``.
    settings : Settings, optional
        By default the angle is used where the log has one.
    kind : {"extended", "unscented"}
        Which of the two filters; the twins of both run over whole logs.
    adapt : bool
        Raise the torque noise where the innovations are much larger than it explains (unmodelled torque), and
        say so; otherwise leave it.

    Raises
    ------
    LogError
        When a channel is missing or the log is too short.
    RequestError
        For another kind of filter, or when the design has no friction to start from.
    """
    check_kind(kind)
    if len(log) < 3:
        raise LogError(f"{_where(log)}{len(log)} samples; tracking needs at least 3")
    log.check_evaluable()
    settings = settings or Settings(measure="theta" if "theta" in log else "omega")
    samples = samples_of(design, log, settings.measure)
    settings = _noise_from_log(design, settings, samples, log)
    reasons = [*samples.notes]
    s = numbers(design, settings, log.period)
    first = s[model.TORQUE_DENSITY]
    out = _filtered(design, settings, s, samples, kind, adapt)
    raised = math.sqrt(s[model.TORQUE_DENSITY] / first) if first else 1.0
    if raised > 1.0:
        reasons.append(
            f"the axis is {raised:.2g} times noisier than its sensors: torque that the design does not model; "
            "the bands allow for its size, but not for its shape"
        )
    reasons += _doubts(settings, s, out)
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
        torque_noise=math.sqrt(s[model.TORQUE_DENSITY] / log.period),
        log_name=log.provenance.file or "the given log",
        reasons=tuple(reasons),
        kind=kind,
    )


def _filtered(design: Design, settings: Settings, s: Array, samples: Samples, kind: Kind, adapt: bool) -> Filtered:
    """Filter; raise the torque noise in `s` and filter again while the innovations are much larger than it explains."""
    for _ in range(12):
        out = filter_samples(design, settings, s, samples, kind)
        mean = _mean(out.nis)
        if not adapt or mean is None or mean < WIDE:
            break
        s[model.TORQUE_DENSITY] *= mean
    return out


def _mean(nis: Array) -> float | None:
    """Return the mean over the samples that were judged; None where none was."""
    judged = np.isfinite(nis)
    return float(nis[judged].mean()) if judged.any() else None


def _correlation(covariance: Array, scale: Array) -> Array:
    """Return the correlation; where a spread is too small for a double to hold its square, none."""
    known = scale > 1e-300
    return np.where(known, covariance / np.where(known, scale, 1.0), 0.0)


@dataclass(frozen=True, eq=False)
class Filtered:
    """What the twin returns: see `pmsm_ctrl.track.twin.run`."""

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


def filter_samples(design: Design, settings: Settings, s: Array, samples: Samples, kind: Kind = "extended") -> Filtered:
    """Run the compiled twin of a filter over samples from the design's start values."""
    if kind == "unscented":
        from pmsm_ctrl.track.unscented import run_unscented as run
    else:
        from pmsm_ctrl.track.twin import run

    n = samples.t.size
    x, P, m = start(design), covariance(s, settings), memory()
    slow = 1 + max(k for k in settings.active if k != model.THETA)
    out = Filtered(
        x, P, np.empty((n, slow)), np.empty((n, slow)), np.empty(n), np.empty((n, 2)), np.empty(n, dtype=np.int8)
    )
    run(
        samples.t, samples.z, samples.torque, samples.known, s, x, P, m, out.estimates, out.variances,
        out.covariance, out.innovations, out.events,
    )  # fmt: skip
    return out


def samples_of(design: Design, log: Log, measure: str) -> Samples:
    """Return what the filter reads of a log.

    Raises
    ------
    LogError
        When a channel is missing.
    """
    if measure not in log:
        message = f"{_where(log)}no channel '{measure}' to track from (present: {', '.join(log)})"
        raise LogError(message, next_command=NextCommand.MAP)
    if "torque" not in log and "i_q" not in log:
        raise LogError(
            f"{_where(log)}neither torque nor i_q (present: {', '.join(log)})", next_command=NextCommand.IMPORT
        )
    z = _unwrap(log["theta"]) if measure == "theta" else np.array(log["omega"])
    zero = np.zeros(len(log))
    i_d, i_q = (log.channels.get(name, zero) for name in ("i_d", "i_q"))
    drive = np.asarray(log["torque"] if "torque" in log else drive_torque(design, i_d, i_q), dtype=np.float64)
    known, torque = KnownTorque(design), drive
    if "T_load" in log:
        torque = drive - log["T_load"]
    extra = zero
    if known:
        speed = _speed(log.t, z, drive) if measure == "theta" else z
        theta = z if measure == "theta" else log.channels.get("theta")
        signals = {"t": log.t, "omega": speed, "direction": np.sign(speed), "i_d": i_d, "i_q": i_q, "torque": drive}
        extra = known.over(signals if theta is None else {**signals, "theta": theta})
    return Samples(np.array(log.t), z, np.array(torque), np.array(extra), known.notes)


def _speed(t: Array, theta: Array, drive: Array) -> Array:
    """Speed from each angle and the last one before it that was taken in, as on a live stream."""
    speed = np.zeros(t.size)
    later = np.append(True, t[1:] > np.maximum.accumulate(t)[:-1])
    taken = np.flatnonzero(np.isfinite(theta) & np.isfinite(drive) & later)
    speed[taken[1:]] = np.diff(theta[taken]) / np.diff(t[taken])
    return speed


def _where(log: Log) -> str:
    return f"{log.provenance.file}: " if log.provenance.file else ""


def _unwrap(theta: Array) -> Array:
    """Undo a wrap at one turn: jumps of nearly 2 pi within a range of one turn, and nothing else."""
    if np.ptp(theta) <= 2 * np.pi * (1 + 1e-6) and float(np.max(np.abs(np.diff(theta)))) > 1.5 * np.pi:
        return np.unwrap(theta)
    return np.array(theta)


def _noise_from_log(design: Design, settings: Settings, samples: Samples, log: Log) -> Settings:
    """Fill in the noise that neither the settings nor the design state, from the log itself."""
    if settings.torque_noise is None and design.sensor.current_noise == 0.0:
        # The second difference of a smooth signal is noise; the median passes over steps.
        second = np.diff(samples.torque, 2)
        noise = 1.4826 * float(np.median(np.abs(second))) / math.sqrt(6.0)
        floor = 1e-4 * float(np.quantile(np.abs(samples.torque), 0.95))
        if not max(noise, floor) > 0.0:
            raise RequestError(f"{_where(log)}the drive torque is zero throughout; tracking needs a drive that pushes")
        settings = replace(settings, torque_noise=max(noise, floor))
    if settings.angle_noise is None and design.sensor.encoder_counts == 0 and settings.measure == "theta":
        step = np.abs(np.diff(samples.z))
        step = step[step > 1e-12 * max(1.0, float(np.max(np.abs(samples.z))))]
        finest = float(step.min()) if step.size else 1e-6
        settings = replace(settings, angle_noise=max(finest / math.sqrt(12.0), 1e-9))
    return settings


def _doubts(settings: Settings, s: Array, out: Filtered) -> list[str]:
    doubts, mean = [], _mean(out.nis)
    learnt = np.isin(out.events, (model.UPDATED, model.CONSTANT, model.CHANGE))
    if not learnt.any():
        return ["the axis never moved long enough: the estimates are the design's values"]
    if mean is not None and not 0.6 <= mean <= 1.3:
        kind = "optimistic" if mean > 1.0 else "pessimistic"
        doubts.append(f"the innovations are {mean:.2g} times as large as stated (squared): the bands are {kind}")
    constant = int((out.events == model.CONSTANT).sum())
    if constant > 0.5 * learnt.sum():
        doubts.append(
            f"during {100 * constant / learnt.sum():.0f} % of the motion the speed did not vary: only the sum "
            "F_c + F_v abs(omega) is observable there, and their ratio was kept"
        )
    for k in settings.active:
        if k not in (model.OMEGA, model.THETA) and out.P[k, k] > 0.5 * s[model.PRIOR + k]:
            doubts.append(f"{model.STATES[k]} is hardly better known than before the log: the motion does not show it")
    moving = learnt & (np.abs(out.estimates[:, 0]) > 0.0)
    if "T_load" in settings.estimate and abs(np.mean(np.sign(out.estimates[moving, 0]))) > 0.95:
        doubts.append("the axis turns in one direction: T_load and F_c cannot be told apart")
    changes = int((out.events == model.CHANGE).sum())
    if changes:
        doubts.append(f"friction or load changed abruptly {changes} time{'s' if changes > 1 else ''}")
    rejected = int((out.events == model.REJECTED).sum() + (out.events == model.IMPLAUSIBLE).sum())
    if rejected:
        doubts.append(f"{rejected} measurement{'s were' if rejected > 1 else ' was'} rejected as outlying")
    return doubts
