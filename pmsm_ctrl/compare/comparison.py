"""compare: where a design fails against a log, channel by channel."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compare.closed_loop import closed_loop
from pmsm_ctrl.compare.free_run import free_run, whole_run
from pmsm_ctrl.compare.notices import CHANGES, HOLDOUT_IS_LOG, LEFT_OUT, NOT_PREDICTED, STRUCTURE
from pmsm_ctrl.compare.other_zero import other_zero
from pmsm_ctrl.compare.stretches import Stretch, worst_stretches
from pmsm_ctrl.compare.verdict import judged
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.log import Log, Logs, Span, as_logs, names_of
from pmsm_ctrl.plausibility import doubts_about, of_holdout, with_inertia
from pmsm_ctrl.regression.angle_zero import from_one_zero, turned_by
from pmsm_ctrl.regression.balances import Record as Balances
from pmsm_ctrl.regression.conditioning import Prepared, Processing, prepare
from pmsm_ctrl.regression.drive_timing import UNDELAYED, DriveTiming, in_time
from pmsm_ctrl.regression.evaluated import record_as_evaluated
from pmsm_ctrl.regression.fast_orders import orders_beyond
from pmsm_ctrl.regression.joining import parts_of
from pmsm_ctrl.regression.one_axis import other_record, sampled_alike
from pmsm_ctrl.regression.prediction import Prediction, predict
from pmsm_ctrl.regression.record_result import RecordResult, record_notices, zero_of
from pmsm_ctrl.regression.timing import uniform
from pmsm_ctrl.residuals.dependence import ResidualStructure, Trace
from pmsm_ctrl.residuals.predicted import structures, traces_of
from pmsm_ctrl.residuals.single_wave import single_wave
from pmsm_ctrl.result import Result, Verdict, jsonable
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import drives

__all__ = ["ChannelError", "Comparison", "Record", "Simulated", "compare"]

Array = NDArray[np.float64]
PREDICTED = 0.4  # share of a record's work that is done before it is simulated


@dataclass(frozen=True)
class ChannelError:
    """Error of one channel over the moving samples.

    Attributes
    ----------
    rms, worst, mean : float
        Of measured - predicted, in `unit`.
    relative : float
        norm(measured - predicted) / norm(measured); of a position, of the distance travelled in a window.
    unit : str
    floor : float
        What the noise alone would make of the rms, and no more than that; NaN where it is not known.
    """

    rms: float
    worst: float
    mean: float
    relative: float
    unit: str
    floor: float = float("nan")

    @classmethod
    def of(cls, measured: Array, predicted: Array, unit: str, floor: float = float("nan")) -> ChannelError:
        """Return the error of measured and predicted samples.

        Parameters
        ----------
        measured, predicted : array, shape (n,)
        unit : str
        floor : float
            Rms that noise alone makes.
        """
        residual = measured - predicted
        size, rms = float(np.linalg.norm(measured)), float(np.sqrt(np.mean(residual**2)))
        return cls(
            rms=rms,
            worst=float(np.max(np.abs(residual))),
            mean=float(np.mean(residual)),
            relative=float(np.linalg.norm(residual)) / size if size > 0 else float("nan"),
            unit=unit,
            floor=float(np.minimum(floor, rms)),
        )


@dataclass(frozen=True)
class Simulated:
    """Errors of a simulation.

    Attributes
    ----------
    method : str
        ``free run in windows``, ``closed loop`` or ``free run``.
    meaning : str
        What the simulation is given, in words.
    errors : dict of channel to ChannelError
        ``omega``, ``theta`` and in closed loop ``i_q``. Over a whole record the relative error is that to the standard
        deviation of the channel, 1 - fit.
    fit : float
        Of the position over a whole record; NaN otherwise.
    record : str
        Which of several; empty where there is one.
    """

    method: str
    meaning: str
    errors: Mapping[str, ChannelError]
    fit: float = float("nan")
    record: str = ""


@dataclass(frozen=True, eq=False)
class Record:
    """The predictions on one log.

    Attributes
    ----------
    name : str
        Of the log.
    errors : dict of channel to ChannelError
        ``torque`` by inverse dynamics; ``u_d`` and ``u_q`` by the voltage equations where the log has them.
    traces : dict of channel to Trace
    structure : dict of channel to ResidualStructure
        What the residual depends on.
    stretches : tuple of Stretch
        The worst stretches of time of the torque, worst first.
    simulated : tuple of Simulated
        Speed and position by simulation, one entry a method.
    omega : array, shape (m,)
        Speed on the traces' grid, rad/s (m/s).
    notices : tuple of Notice
    rows : tuple of RecordResult
        The errors of each of its records: as predicted, and with the level of its friction refitted.
    timing : DriveTiming
        How the drive signal was sampled beside the position.
    timing_stderr : float
        Standard error of its delay, s.
    """

    name: str
    errors: Mapping[str, ChannelError]
    traces: Mapping[str, Trace]
    structure: Mapping[str, ResidualStructure]
    stretches: tuple[Stretch, ...]
    simulated: tuple[Simulated, ...]
    omega: Array
    notices: tuple[Notice, ...] = ()
    rows: tuple[RecordResult, ...] = ()
    timing: DriveTiming = UNDELAYED
    timing_stderr: float = 0.0

    @property
    def ratios(self) -> dict[str, float]:
        """Residual over its noise floor by channel, where it was searched for structure."""
        out = {}
        for name, found in self.structure.items():
            rms = float(np.sqrt(np.mean(self.traces[name].residual[found.mask] ** 2)))
            out[name] = rms / found.floor if found.floor > 0.0 else float("nan")
        return out


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """Errors of a design's predictions on a log and, where given, on a holdout log, and where they come from.

    Attributes
    ----------
    design : Design
    log : Record
    holdout : Record or None
        The other log, with the same parameters; the first of several.
    holdouts : tuple of Record
        All of them.
    notices : tuple of Notice
    verdict : Verdict
        ``consistent``, ``unexplained``, ``inconclusive`` or ``implausible``; nothing is fitted, so none is named.
    reasons : tuple of Notice
        What the verdict rests on, the likeliest first; empty for ``consistent``.
    """

    design: Design
    log: Record
    holdout: Record | None = None
    notices: tuple[Notice, ...] = ()
    verdict: Verdict = Verdict.CONSISTENT
    reasons: tuple[Notice, ...] = ()
    holdouts: tuple[Record, ...] = ()

    @property
    def records(self) -> tuple[RecordResult, ...]:
        """A row for every record, those that were held out last."""
        held_out = (replace(row, held_out=True) for other in self.holdouts for row in other.rows)
        return (*self.log.rows, *held_out)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        log = self.log
        stretches = [
            {"start": s.start, "stop": s.stop, "rms": s.rms, "unit": log.errors["torque"].unit}
            | {"motion": {**vars(s.motion), "kind": s.motion.kind.value}}
            for s in log.stretches
        ]
        plain: dict[str, Any] = jsonable({
            "schema": "pmsm-ctrl/comparison/1",
            "verdict": self.verdict.value,
            "reasons": [reason.text for reason in self.reasons],
            "reason_codes": [reason.code for reason in self.reasons],
            **self.doubts(),
            "log": log.name,
            "errors": _plain(log.errors),
            "simulation": [_plain_run(s) for s in log.simulated],
            "where": {name: found.to_dict() for name, found in log.structure.items()},
            "worst_stretches": stretches,
            "records": [row.to_dict() for row in self.records],
            "timing": {
                "late": log.timing.late, "filter": log.timing.lag, "stderr": log.timing_stderr, "unit": "s",
            },
            "holdouts": [
                {"log": one.name, "errors": _plain(one.errors), "simulation": [_plain_run(s) for s in one.simulated]}
                for one in self.holdouts
            ],
        })  # fmt: skip
        return plain


def _plain(errors: Mapping[str, ChannelError]) -> dict[str, Any]:
    return {name: vars(error) for name, error in errors.items()}


def _plain_run(run: Simulated) -> dict[str, Any]:
    return {
        "record": run.record,
        "method": run.method,
        "meaning": run.meaning,
        "errors": _plain(run.errors),
        "fit": run.fit,
    }


def compare(
    design: Design,
    log: Logs,
    *,
    holdout: Logs | None = None,
    processing: Processing | None = None,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Compare what a design predicts with what was measured; nothing of the design is fitted.

    Torque by inverse dynamics, ``J alpha + effects`` against the drive torque less the load torque, and the dq voltages
    by the voltage equations, both sides through the same zero-phase filter, standstill left out. How the log was
    sampled is fitted beside it, as in every fit, so that the errors are those of `diagnose`. Speed and position by
    simulation: driven by the measured torque in windows restarted from the measured state and over the whole record,
    and in closed loop where the log holds the reference and the design the loops.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log
        With ``theta`` or ``omega``, and ``torque`` or ``i_q``; ``i_d, i_q, u_d, u_q`` for the voltages. Of several
        records each has its own row, and is simulated by itself.
    holdout : Log or sequence of Log, optional
        Other records, predicted with the same parameters.
    processing : Processing, optional
        Filter, derivative and mask; the band of `diagnose` when left out.
    progress : function, optional
        Called with the share done, 0 to 1; an exception that it raises ends the comparison.

    Returns
    -------
    Comparison

    Raises
    ------
    LogError
        When a channel is missing or the axis hardly moves.
    DesignError
        When the design names an unknown effect.
    """
    logs, holdouts = as_logs(log), () if holdout is None else as_logs(holdout, "holdout")
    for record in (*logs, *holdouts):
        record.check_evaluable(100)
    design = with_inertia(design, logs)
    believed = doubts_about(design, log)
    advance = progress or (lambda share: None)
    part = 1.0 / (1 + len(holdouts))
    advance(0.1 * part)
    balances = _conditioned(design, believed.log, processing)
    prediction = predict(design, balances)
    zero = other_zero(design, balances, prediction)
    advance(PREDICTED * part)
    here = _record(design, believed.log, prediction, partial(_advanced, advance, part, 0))
    here = replace(here, name=names_of(logs, "the given log"))
    wave = single_wave(prediction.record, prediction.residual[0])
    verdict, reasons = judged(
        here.errors["torque"].relative, here.structure, here.ratios, believed, zero, wave.notice if wave else None
    )
    # structure has its own place in a result
    stated = (reason for reason in reasons if reason.code != STRUCTURE.code)
    doubted = tuple(dict.fromkeys((*stated, *believed.notices, *here.notices)))
    others, notices = [], list(doubted)
    for number, one in enumerate(holdouts, start=1):
        held_out = doubts_about(design, one)
        predicted = predict(design, other_record(design, held_out.log, balances), prediction)
        held = _record(design, held_out.log, predicted, partial(_advanced, advance, part, number))
        others.append(replace(held, name=one.provenance.file or "the holdout"))
        of_other = (*map(of_holdout, held_out.notices), *held.notices)
        notices += [notice for notice in of_other if notice not in (*here.notices, *notices)]
    known = {one.fingerprint for one in logs} if holdouts else set()
    if any(one.fingerprint in known for one in holdouts):
        notices.append(HOLDOUT_IS_LOG())
    return Comparison(
        design, here, others[0] if others else None, tuple(notices), verdict, reasons, tuple(others)
    )  # fmt: skip


def _advanced(advance: Callable[[float], None], part: float, done: int, share: float) -> None:
    advance(part * (done + PREDICTED + (1.0 - PREDICTED) * share))


def _conditioned(design: Design, log: Log, processing: Processing | None) -> Balances:
    """Return the balances of a log as every fit sees them; in a band that is asked for, sampled as in the usual one."""
    usual = record_as_evaluated(design, log)
    if processing is None:
        return usual
    alike = sampled_alike(design, log, processing, usual)
    return turned_by(alike, usual.shifts) if usual.shifts else alike


def _record(design: Design, log: Log, prediction: Prediction, progress: Callable[[float], None]) -> Record:
    """Simulate and search one log."""
    balances = prediction.record
    balances.kept.clear()  # the columns of a fit that is done
    prepared = balances.prepared
    traces, structure = traces_of(prediction), structures(prediction, log, design.J)
    torque = traces["torque"]
    # a simulation is driven by what was sampled with the motion
    timed = from_one_zero(prediction.timing.undone(in_time(design, log)), balances)
    processing = Processing(cutoff=prepared.cutoff)
    alike = prepare(design, timed, processing)
    simulated, said = _simulated(design, timed, processing, (alike, structure["torque"]), progress)
    beyond = orders_beyond(design, log, prepared.cutoff)
    rows = tuple(_rows(log, balances, traces))
    return Record(
        name=log.provenance.file or "the given log",
        errors={
            name: ChannelError.of(t.measured[t.mask], t.predicted[t.mask], t.unit, structure[name].floor)
            for name, t in traces.items()
        },
        traces=traces,
        structure=structure,
        stretches=worst_stretches(torque.t, torque.residual, torque.mask, balances.shaped(balances.signals["omega"])),
        simulated=simulated,
        omega=balances.shaped(balances.signals["omega"]),
        notices=(
            *balances.notes,
            *record_notices(rows),
            *_not_predicted(prediction),
            *beyond,
            *said,
        ),
        rows=rows,
        timing=prediction.timing,
        timing_stderr=prediction.timing_stderr,
    )


def _not_predicted(prediction: Prediction) -> Iterator[Notice]:
    for start, stop in prediction.record.left_out:
        yield LEFT_OUT(start=start, stop=stop)
    for at in prediction.record.changes:
        yield CHANGES(at=at)
    for note in prediction.notes:
        yield NOT_PREDICTED(why=note)


def _rows(log: Log, balances: Balances, traces: Mapping[str, Trace]) -> Iterator[RecordResult]:
    """Yield the errors of each record, as predicted and with the level of its friction refitted."""
    spans = log.records or (
        Span(log.provenance.file or "the given log", float(log.t[0]), float(log.t[-1]), 0.0, log.rate),
    )
    prepared = balances.prepared
    signals = (prepared.signals["direction"], prepared.signals["omega"], np.ones(len(prepared.t)))
    level = np.array([prepared.column(values) for values in signals]).T
    for number, span in enumerate(spans):
        as_predicted, refitted = {}, {}
        for name, trace in traces.items():
            used = trace.mask & (trace.t >= span.start) & (trace.t <= span.stop)
            if not used.any():
                continue
            measured, left = trace.measured[used], trace.residual[used]
            as_predicted[name] = vars(ChannelError.of(measured, measured - left, trace.unit))
            if name == "torque":
                left = left - level[used] @ factored(level[used]).solve(left)
            refitted[name] = vars(ChannelError.of(measured, measured - left, trace.unit))
        zero = zero_of(balances, number)
        yield RecordResult(
            span.name, False, span.duration, span.rate, as_predicted, {}, angle=zero, level_before=refitted
        )


def _simulated(
    design: Design, log: Log, processing: Processing, whole: tuple[Prepared, ResidualStructure],
    progress: Callable[[float], None],
) -> tuple[tuple[Simulated, ...], tuple[Notice, ...]]:  # fmt: skip
    """Simulate every record by itself: in restarted windows, in closed loop, and from its begin to its end."""
    prepared, left = whole
    found: list[Simulated] = []
    said: list[Notice] = []
    parts = parts_of(log)
    for number, part in enumerate(parts):
        try:
            of_part = prepared if part is log else prepare(design, part, replace(processing, cutoff=prepared.cutoff))
        except LogError:  # too short to be simulated; its row has its errors all the same
            continue
        free, free_notices = _free_run(design, part, of_part, left)
        closed, closed_notices = _closed_loop(design, part, processing, left.floor)
        name = "" if part is log else part.provenance.file
        tell = partial(_told, progress, len(parts), number)
        tell(0.0)
        runs = (*free, *closed, *_whole_run(design, part, of_part, tell))
        found += [replace(one, record=name) for one in runs]
        said += [notice for notice in (*free_notices, *closed_notices) if notice not in said]
    progress(1.0)
    return tuple(found), tuple(said)


def _told(progress: Callable[[float], None], count: int, done: int, share: float) -> None:
    """Tell how far the simulations are; of each record, those in windows and in closed loop come first."""
    progress((done + 0.3 + 0.7 * share) / count)


def _free_run(
    design: Design, log: Log, prepared: Prepared, left: ResidualStructure
) -> tuple[Iterable[Simulated], tuple[Notice, ...]]:
    free = free_run(design, prepared)
    if free is None:
        return (), ()
    speed, place = free.floors(left.left, prepared.thinned_rate, design.J, left.mask)
    # the distance travelled is what a position error is to be held against
    theta = ChannelError.of(
        free.travel.ravel(), (free.theta - free.theta_meas[:, :1]).ravel(), log.unit("theta"), place
    )
    errors = {
        "omega": ChannelError.of(free.omega_meas.ravel(), free.omega.ravel(), log.unit("omega"), speed),
        "theta": theta,
    }
    meaning = f"the measured {drives(log.motion)} alone, restarted from the measured state every {free.window:.3g} s"
    return (Simulated("free run in windows", meaning, errors),), free.notices


def _whole_run(design: Design, log: Log, prepared: Prepared, progress: Callable[[float], None]) -> Iterable[Simulated]:
    """Simulate the whole record from its torque alone; one with gaps has no torque there."""
    if not uniform(log)[2].all():
        return ()
    run = whole_run(design, prepared, progress)
    if run is None:
        return ()
    pairs = {"omega": (run.omega_meas, run.omega), "theta": (run.theta_meas, run.theta)}
    errors = {
        name: ChannelError.of(measured - measured.mean(), simulated - measured.mean(), log.unit(name))
        for name, (measured, simulated) in pairs.items()
    }
    return (
        Simulated(
            "free run", f"the measured {drives(log.motion)} alone, the state given at the start", errors, run.fit
        ),
    )


def _closed_loop(
    design: Design, log: Log, processing: Processing, floor: float
) -> tuple[Iterable[Simulated], tuple[Notice, ...]]:
    run = closed_loop(design, log, processing)
    if run is None or not run.mask.any():
        return (), () if run is None else run.notices
    floors = {"i_q": floor / design.K_t_assumed}
    errors = {
        name: ChannelError.of(
            measured[run.mask], run.simulated[name][run.mask], log.unit(name), floors.get(name, float("nan"))
        )
        for name, measured in run.measured.items()
    }
    fed = " and added current" if run.added_current else ""
    return (Simulated("closed loop", f"the log's {run.control} reference{fed}", errors),), run.notices
