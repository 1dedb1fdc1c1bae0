"""compare: where a design fails against a log, channel by channel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.voltages import predicted_voltages
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.identify.problem import build_problem, nominal_torque
from pmsm_ctrl.identify.signals import Processing, prepare
from pmsm_ctrl.log import CHANNELS, Log
from pmsm_ctrl.result import Result, Section, jsonable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["ChannelError", "Comparison", "Trace", "compare"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChannelError:
    """Error of one channel over the moving samples.

    Attributes
    ----------
    rms, worst, mean : float
        Of measured - predicted, in `unit`.
    relative : float
        norm(measured - predicted) / norm(measured).
    """

    rms: float
    worst: float
    mean: float
    relative: float
    unit: str


@dataclass(frozen=True, eq=False)
class Trace:
    """Measured and predicted channel on the thinned grid, shape (m,); `mask` marks the samples that count."""

    t: Array
    measured: Array
    predicted: Array
    mask: NDArray[np.bool_]
    unit: str

    def error(self) -> ChannelError:
        """Return the error over the samples that count."""
        measured = self.measured[self.mask]
        residual = measured - self.predicted[self.mask]
        size = float(np.linalg.norm(measured))
        return ChannelError(
            rms=float(np.sqrt(np.mean(residual**2))),
            worst=float(np.max(np.abs(residual))),
            mean=float(np.mean(residual)),
            relative=float(np.linalg.norm(residual)) / size if size > 0 else float("nan"),
            unit=self.unit,
        )


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """Errors of a design's predictions on a log and, where given, on a holdout log.

    Attributes
    ----------
    channels : dict of channel to ChannelError
        ``torque`` by inverse dynamics; ``u_d`` and ``u_q`` by the voltage equations where the log has them.
    holdout : dict of channel to ChannelError, or None
        The same on the other log, with the same parameters.
    traces, holdout_traces : dict of channel to Trace
    """

    design: Design
    channels: Mapping[str, ChannelError]
    traces: Mapping[str, Trace]
    log_name: str
    holdout: Mapping[str, ChannelError] | None = None
    holdout_traces: Mapping[str, Trace] | None = None
    holdout_name: str = ""
    reasons: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers."""
        return self.reasons

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for label, errors in ((self.log_name, self.channels), (self.holdout_name, self.holdout or {})):
            for name, e in errors.items():
                figures = (f"{e.rms:.4g}", f"{e.worst:.4g}", f"{e.mean:+.3g}", e.unit, f"{100 * e.relative:.2f} %")
                rows.append((label, name, *figures))
        return rows

    def summary(self) -> str:
        """Return the result as text, trust first."""
        lines = [f"comparison of {self.design.name} with {self.log_name}"]
        lines += [f"  warning: {text}" for text in self.warnings] or ["  no reason to doubt the numbers was found"]
        lines += [
            f"  {name:<8} rms {rms:>9} {unit:<4} relative {relative:>8}   worst {worst:>9}   mean {mean:>9}   ({label})"
            for label, name, rms, worst, mean, unit, relative in self._rows()
        ]
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw measured, predicted and residual of every channel on the log."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8.0, 3.4 * len(self.traces)), layout="constrained")
        _draw(figure, self.traces, self.log_name)
        return figure

    def plot_holdout(self) -> Figure:
        """Draw the same on the holdout; an empty figure where there is none."""
        from matplotlib.figure import Figure

        traces = self.holdout_traces or {}
        figure = Figure(figsize=(8.0, 3.4 * max(1, len(traces))), layout="constrained")
        _draw(figure, traces, self.holdout_name)
        return figure

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        errors = {name: vars(error) for name, error in self.channels.items()}
        other = None if self.holdout is None else {name: vars(error) for name, error in self.holdout.items()}
        return jsonable({
            "schema": "pmsm-ctrl/comparison/1",
            "warnings": self.warnings,
            "log": self.log_name,
            "errors": errors,
            "holdout_log": self.holdout_name or None,
            "holdout_errors": other,
        })  # fmt: skip

    def section(self) -> Section:
        """Return the section of the report."""
        hint = "Where prediction and measurement part, and where the residual has a shape, an effect is missing."
        figures = [(self.plot(), hint)]
        if self.holdout_traces:
            figures.append((self.plot_holdout(), "The same parameters on the record that was held out."))
        return Section(
            title="Model against measurement",
            paragraphs=tuple(f"Warning: {text}" for text in self.warnings),
            tables=((("log", "channel", "rms", "worst", "mean", "unit", "relative"), tuple(self._rows())),),
            figures=tuple(figures),
        )


def compare(
    design: Design,
    log: Log,
    *,
    holdout: Log | None = None,
    own: Iterable[Effect] = (),
    processing: Processing | None = None,
) -> Comparison:
    """Compare what a design predicts with what was measured; nothing is fitted.

    Torque by inverse dynamics, ``J alpha + effects + T_load`` against the drive torque, and the dq voltages by
    the voltage equations, both sides through the same zero-phase filter, standstill left out.

    Parameters
    ----------
    design : Design
    log : Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``; ``i_d, i_q, u_d, u_q`` for the voltages.
    holdout : Log, optional
        Another record, predicted with the same parameters.
    own : iterable of Effect
        A user's own effects that the design names.
    processing : Processing, optional
        Filter, derivative and mask.

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    """
    own = tuple(own)
    traces, notes = _traces(design, log, own, processing)
    other: dict[str, Trace] | None = None
    if holdout is not None:
        other, more = _traces(design, holdout, own, processing)
        notes += tuple(text for text in more if text not in notes)
        if log.provenance.sha256 and log.provenance.sha256 == holdout.provenance.sha256:
            notes += ("the holdout is the log itself: its error proves nothing",)
    return Comparison(
        design=design,
        channels={name: trace.error() for name, trace in traces.items()},
        traces=traces,
        log_name=log.provenance.file or "the given log",
        holdout=None if other is None else {name: trace.error() for name, trace in other.items()},
        holdout_traces=other,
        holdout_name="" if holdout is None else holdout.provenance.file or "the holdout",
        reasons=notes,
    )


def _traces(
    design: Design, log: Log, own: tuple[Effect, ...], processing: Processing | None
) -> tuple[dict[str, Trace], tuple[str, ...]]:
    prepared = prepare(design, log, processing)
    problem = build_problem(design, prepared, own=own)
    # what the problem moved to its left side (load torque, terms without linear parameters) belongs to the model
    predicted = nominal_torque(problem) + (problem.torque - problem.target)
    traces = {"torque": Trace(problem.t, problem.torque, predicted, problem.mask, problem.unit)}
    voltages, notes = predicted_voltages(design, prepared, own)
    for name, values in voltages.items():
        measured = prepared.column(prepared.signals[name])
        traces[name] = Trace(problem.t, measured, prepared.column(values), problem.mask, CHANNELS[name][0])
    return traces, (*problem.notes, *notes)


def _draw(figure: Figure, traces: Mapping[str, Trace], label: str) -> None:
    from pmsm_ctrl.identify.figures import BLACK, BLUE, VERMILION

    if not traces:
        return
    axes = np.atleast_1d(figure.subplots(2 * len(traces), 1, sharex=True, height_ratios=[2, 1] * len(traces)))
    for k, (name, trace) in enumerate(traces.items()):
        upper, lower = axes[2 * k], axes[2 * k + 1]
        shown = np.where(trace.mask, 1.0, np.nan)
        upper.plot(trace.t, trace.measured * shown, color=BLACK, linewidth=1.0, label="measured")
        upper.plot(trace.t, trace.predicted * shown, color=BLUE, linewidth=1.0, linestyle="--", label="predicted")
        upper.set_ylabel(f"{name} [{trace.unit}]")
        lower.plot(trace.t, (trace.measured - trace.predicted) * shown, color=VERMILION, linewidth=0.8)
        lower.axhline(0.0, color=BLACK, linewidth=0.5)
        lower.set_ylabel(f"residual [{trace.unit}]")
        for each in (upper, lower):
            each.grid(alpha=0.3)
    axes[0].legend(loc="upper right", fontsize="small")
    # a path can be wider than the figure
    axes[0].set_title(f"Measured against predicted, {Path(label).name}; filtered, standstill left out")
    axes[-1].set_xlabel("time [s]")
