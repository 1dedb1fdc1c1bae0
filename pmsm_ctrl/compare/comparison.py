"""compare: where a design fails against a log, channel by channel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.closed_loop import closed_loop
from pmsm_ctrl.compare.dependence import Where, where
from pmsm_ctrl.compare.free_run import free_run
from pmsm_ctrl.compare.stretches import Stretch, worst_stretches
from pmsm_ctrl.compare.voltages import predicted_voltages
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import CHANNELS, Log
from pmsm_ctrl.regression.bandwidth import signal_band
from pmsm_ctrl.regression.conditioning import Prepared, Processing, prepare
from pmsm_ctrl.regression.inverse_dynamics import build_problem
from pmsm_ctrl.regression.timing import punctual
from pmsm_ctrl.result import Result, Section, jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ChannelError", "Comparison", "Simulated", "Trace", "compare"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChannelError:
    """Error of one channel over the moving samples.

    Attributes
    ----------
    rms, worst, mean : float
        Of measured - predicted, in `unit`.
    relative : float
        norm(measured - predicted) / norm(measured); of a position, of the distance travelled in a window.
    floor : float
        What the noise alone would make of the rms; NaN where it is not known.
    """

    rms: float
    worst: float
    mean: float
    relative: float
    unit: str
    floor: float = float("nan")

    @classmethod
    def of(cls, measured: Array, predicted: Array, unit: str, floor: float = float("nan")) -> ChannelError:
        """Return the error of samples of shape (n,)."""
        residual = measured - predicted
        size = float(np.linalg.norm(measured))
        return cls(
            rms=float(np.sqrt(np.mean(residual**2))),
            worst=float(np.max(np.abs(residual))),
            mean=float(np.mean(residual)),
            relative=float(np.linalg.norm(residual)) / size if size > 0 else float("nan"),
            unit=unit,
            floor=floor,
        )


@dataclass(frozen=True, eq=False)
class Trace:
    """Measured and predicted channel on the thinned grid, shape (m,); `mask` marks the samples that count."""

    t: Array
    measured: Array
    predicted: Array
    mask: NDArray[np.bool_]
    unit: str

    def error(self, floor: float = float("nan")) -> ChannelError:
        """Return the error over the samples that count."""
        return ChannelError.of(self.measured[self.mask], self.predicted[self.mask], self.unit, floor)


@dataclass(frozen=True)
class Simulated:
    """Errors of a simulation.

    Attributes
    ----------
    method : str
        How it was simulated: free run in restarted windows, or closed loop.
    errors : dict of channel to ChannelError
        ``omega``, ``theta`` and in closed loop ``i_q``.
    """

    method: str
    errors: Mapping[str, ChannelError]


@dataclass(frozen=True, eq=False)
class _Record:
    """Everything about one log."""

    traces: Mapping[str, Trace]
    errors: Mapping[str, ChannelError]
    where: Mapping[str, Where]
    stretches: tuple[Stretch, ...]
    simulated: tuple[Simulated, ...]
    omega: Array
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """Errors of a design's predictions on a log and, where given, on a holdout log, and where they come from.

    Attributes
    ----------
    channels : dict of channel to ChannelError
        ``torque`` by inverse dynamics; ``u_d`` and ``u_q`` by the voltage equations where the log has them.
    where : dict of channel to Where
        What the residual depends on.
    stretches : tuple of Stretch
        The worst stretches of time of the torque, worst first.
    simulated : tuple of Simulated
        Speed and position by simulation, one entry a method.
    holdout, holdout_simulated : the same on the other log, with the same parameters; None without one
    traces, holdout_traces : dict of channel to Trace
    """

    design: Design
    channels: Mapping[str, ChannelError]
    traces: Mapping[str, Trace]
    where: Mapping[str, Where]
    stretches: tuple[Stretch, ...]
    simulated: tuple[Simulated, ...]
    omega: Array
    log_name: str
    holdout: Mapping[str, ChannelError] | None = None
    holdout_traces: Mapping[str, Trace] | None = None
    holdout_simulated: tuple[Simulated, ...] | None = None
    holdout_name: str = ""
    reasons: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers."""
        return self.reasons

    def summary(self) -> str:
        """Return the result as text, trust first."""
        from pmsm_ctrl.compare.text import summary_text

        return summary_text(self)

    def plot(self) -> Figure:
        """Draw measured, predicted and residual of every channel on the log."""
        from pmsm_ctrl.compare.figures import traces_figure

        return traces_figure(self.traces, self.log_name, self.stretches)

    def plot_holdout(self) -> Figure:
        """Draw the same on the holdout; an empty figure where there is none."""
        from pmsm_ctrl.compare.figures import traces_figure

        return traces_figure(self.holdout_traces or {}, self.holdout_name)

    def plot_where(self, channel: str = "torque") -> Figure:
        """Draw the residual over every coordinate with its curve, and the spectrum over the angle."""
        from pmsm_ctrl.compare.figures import where_figure

        return where_figure(self, channel)

    def plot_stretches(self) -> Figure:
        """Draw measured against predicted in the worst stretches."""
        from pmsm_ctrl.compare.figures import stretches_figure

        return stretches_figure(self)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        other = None if self.holdout is None else {name: vars(error) for name, error in self.holdout.items()}
        return jsonable({
            "schema": "pmsm-ctrl/comparison/1",
            "warnings": self.warnings,
            "log": self.log_name,
            "errors": {name: vars(error) for name, error in self.channels.items()},
            "simulation": _plain(self.simulated),
            "where": {name: found.to_dict() for name, found in self.where.items()},
            "worst_stretches": [vars(s) for s in self.stretches],
            "holdout_log": self.holdout_name or None,
            "holdout_errors": other,
            "holdout_simulation": None if self.holdout_simulated is None else _plain(self.holdout_simulated),
        })  # fmt: skip

    def section(self) -> Section:
        """Return the section of the report."""
        from pmsm_ctrl.compare.text import report_section

        return report_section(self)


def _plain(simulated: Iterable[Simulated]) -> list[dict[str, Any]]:
    return [{"method": s.method, "errors": {name: vars(e) for name, e in s.errors.items()}} for s in simulated]


def compare(
    design: Design,
    log: Log,
    *,
    holdout: Log | None = None,
    processing: Processing | None = None,
) -> Comparison:
    """Compare what a design predicts with what was measured; nothing is fitted.

    Torque by inverse dynamics, ``J alpha + effects + T_load`` against the drive torque, and the dq voltages by
    the voltage equations, both sides through the same zero-phase filter, standstill left out. Speed and position by
    simulation: driven by the measured torque in windows restarted from the measured state, and in closed loop where
    the log holds the reference and the design the loops.

    Parameters
    ----------
    design : Design
    log : Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``; ``i_d, i_q, u_d, u_q`` for the voltages.
    holdout : Log, optional
        Another record, predicted with the same parameters.
    processing : Processing, optional
        Filter, derivative and mask.

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    """
    for record in (log, *(() if holdout is None else (holdout,))):
        record.check_evaluable(100)
    processing = processing or Processing(cutoff=signal_band(log))
    here = _record(design, log, processing)
    notes = here.notes
    other: _Record | None = None
    if holdout is not None:
        same = replace(processing, cutoff=min(processing.cutoff or np.inf, holdout.rate / 8.0))
        other = _record(design, holdout, same if processing.cutoff else processing)
        notes += tuple(text for text in other.notes if text not in notes)
        if log.provenance.sha256 and log.provenance.sha256 == holdout.provenance.sha256:
            notes += ("the holdout is the log itself: its error proves nothing",)
    return Comparison(
        design=design,
        channels=here.errors,
        traces=here.traces,
        where=here.where,
        stretches=here.stretches,
        simulated=here.simulated,
        omega=here.omega,
        log_name=log.provenance.file or "the given log",
        holdout=None if other is None else other.errors,
        holdout_traces=None if other is None else other.traces,
        holdout_simulated=None if other is None else other.simulated,
        holdout_name="" if holdout is None else holdout.provenance.file or "the holdout",
        reasons=tuple(map(str, notes)),
    )


def _record(design: Design, log: Log, processing: Processing) -> _Record:
    """Predict, simulate and search one log."""
    prepared = prepare(design, log, processing)
    prepared = replace(prepared, moving=prepared.moving & punctual(log, prepared.t, prepared.cutoff))
    # terms that read the torque read the measured one: nothing is fitted here
    problem = build_problem(design, replace(prepared, acting=prepared.signals["torque"]))
    # what the problem moved to its left side (load torque, terms without linear parameters) belongs to the model
    predicted = problem.nominal + (problem.torque - problem.target)
    traces = {"torque": Trace(problem.t, problem.torque, predicted, problem.mask, problem.unit)}
    voltages, notes = predicted_voltages(design, prepared)
    for name, values in voltages.items():
        measured = prepared.column(prepared.signals[name])
        traces[name] = Trace(problem.t, measured, prepared.column(values), problem.mask, CHANNELS[name][0])
    per_ampere = design.K_t_assumed if "i_q" in prepared.signals else None
    found = {
        name: where(prepared, trace.measured, trace.predicted, trace.mask, trace.unit, predicted, design.J, per_ampere)
        for name, trace in traces.items()
    }
    torque = traces["torque"]
    stretches = worst_stretches(
        torque.t, torque.measured - torque.predicted, torque.mask, problem.omega, torque.unit, _unit("omega", log)
    )
    simulated, more = _simulations(design, log, prepared, processing, found["torque"])
    return _Record(
        traces=traces,
        errors={name: trace.error(found[name].floor) for name, trace in traces.items()},
        where=found,
        stretches=stretches,
        simulated=simulated,
        omega=problem.omega,
        notes=(*problem.notes, *notes, *more),
    )


def _unit(name: str, log: Log) -> str:
    return CHANNELS[name][1 if log.motion == "linear" else 0]


def _simulations(
    design: Design, log: Log, prepared: Prepared, processing: Processing, left: Where
) -> tuple[tuple[Simulated, ...], tuple[str, ...]]:
    """Speed and position by every method that the log and the design allow."""
    made: list[Simulated] = []
    notes: tuple[str, ...] = ()
    free = free_run(design, prepared)
    if free is not None:
        speed_floor, place_floor = free.floors(left.left, prepared.thinned_rate, design.J, left.mask)
        theta = ChannelError.of(free.travel.ravel(), (free.theta - free.theta_meas[:, :1]).ravel(), "", place_floor)
        errors = {
            "omega": ChannelError.of(free.omega_meas.ravel(), free.omega.ravel(), _unit("omega", log), speed_floor),
            "theta": replace(theta, unit=_unit("theta", log)),
        }
        made.append(Simulated(f"free run, restarted every {free.window:.3g} s", errors))
        notes += free.notes
    closed = closed_loop(design, log, processing)
    if closed is not None:
        notes += closed.notes
        if closed.mask.any():
            used = closed.mask
            floors = {"i_q": left.floor / design.K_t_assumed}
            errors = {
                name: ChannelError.of(
                    closed.measured[name][used], closed.simulated[name][used], _unit(name, log),
                    floors.get(name, float("nan")),
                )
                for name in closed.measured
            }  # fmt: skip
            fed = " and test signal" if closed.fed else ""
            made.append(Simulated(f"closed loop with the log's {closed.control} reference{fed}", errors))
    return tuple(made), notes
