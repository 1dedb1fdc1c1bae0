"""The three methods of `identify`, and the design with what they find."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import filterfalse
from typing import Literal

from pmsm_ctrl.design import Design, EffectEntry
from pmsm_ctrl.identify import notices as words
from pmsm_ctrl.identify.instrumental import BiasTest, instrumental
from pmsm_ctrl.identify.open_loop_fit import by_open_loop
from pmsm_ctrl.identify.output_error import output_error
from pmsm_ctrl.identify.replay import Replay, build_replay, replayable
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.bandwidth import regression_problem, widest_band
from pmsm_ctrl.regression.conditioning import Processing, prepare
from pmsm_ctrl.regression.drive_timing import SYNCHRONOUS
from pmsm_ctrl.regression.inverse_dynamics import Problem, build_problem
from pmsm_ctrl.regression.least_squares import Fit, solve
from pmsm_ctrl.regression.total_inertia import with_total_inertia
from pmsm_ctrl.section import Notice

__all__ = ["Method", "Solution", "identified", "solved"]

Method = Literal["regression", "iv", "output_error"]


@dataclass(frozen=True, eq=False)
class Solution:
    """What a method found.

    Attributes
    ----------
    problem, fit : Problem, Fit
    bias : BiasTest or None
    notices, remarks : tuple of Notice
    """

    problem: Problem
    fit: Fit
    bias: BiasTest | None = None
    notices: tuple[Notice, ...] = ()
    remarks: tuple[Notice, ...] = ()


def solved(method: Method, design: Design, log: Log, processing: Processing, each: Callable[[], None]) -> Solution:
    """Return what a method finds.

    Parameters
    ----------
    method : {"regression", "iv", "output_error"}
    design : Design
    log : Log
    processing : Processing
    each : function
        Called in every round of a fit by simulation.
    """
    if method == "regression":
        problem = regression_problem(design, log, processing)
        return Solution(problem, solve(problem))
    if method == "output_error" and not replayable(design, log):
        plain = regression_problem(design, log, processing)
        fit = solve(plain)
        begin = design, identified(design, plain, fit)[0]
        simulated = by_open_loop(begin, log, fit, processing.sampling or SYNCHRONOUS, each)
        return Solution(simulated[0], simulated[1], notices=simulated[2], remarks=(words.OPEN_LOOP(),))
    replay = build_replay(design, log)
    solution = _by_simulation(method, design, log, replay, processing, each)
    if lost := solution.fit.unidentifiable.get("J"):
        # an inertia that the log does not show would take the others' errors with it
        solution = _by_simulation(method, design, log, replay, processing, each, inertia=False)
        held = {"J": replace(lost, held=True), **solution.fit.unidentifiable}
        solution = replace(solution, fit=replace(solution.fit, unidentifiable=held))
    return replace(solution, remarks=replay.notes)


def _by_simulation(
    method: Method, design: Design, log: Log, replay: Replay, processing: Processing, each: Callable[[], None],
    inertia: bool = True,
) -> Solution:  # fmt: skip
    wide = processing
    if processing.cutoff is None:
        wide = replace(processing, cutoff=widest_band(design, log))
    if method == "iv":
        plain = regression_problem(design, log, processing)
        usual = replace(processing, cutoff=plain.cutoff, inertia_cutoff=plain.inertia_cutoff)
        return Solution(*instrumental(design, log, replay, (wide, usual), inertia))
    wide = replace(wide, through_reversals=True)
    prepared = prepare(design, log, wide, as_logged=True)
    problem, fit, notices = output_error(design, build_problem(design, log, wide, inertia), prepared, replay, each)
    return Solution(problem, fit, notices=notices)


def identified(design: Design, problem: Problem, fit: Fit) -> tuple[Design, tuple[Notice, ...], tuple[Notice, ...]]:
    """Return the design with the identified values, and which are at their bounds: beyond their error, or within it.

    Parameters
    ----------
    design : Design
    problem : Problem
    fit : Fit
    """
    changed: dict[int, EffectEntry] = {}
    for column in problem.columns:
        if column.name not in fit.values:
            continue
        value = fit.values[column.name]
        if column.entry < 0:
            design = with_total_inertia(design, value, fit.stderr.get(column.name, float("nan")))
            continue
        entry = changed.get(column.entry, design.effects[column.entry])
        stderr = {s: e for s, e in entry.stderr.items() if s != column.symbol}
        if column.name not in fit.at_bound:  # at a bound it is no estimate
            stderr[column.symbol] = fit.stderr[column.name]
        changed[column.entry] = EffectEntry(
            id=entry.id, parameters={**entry.parameters, column.symbol: value}, stderr=stderr
        )
    effects = tuple(changed.get(k, entry) for k, entry in enumerate(design.effects))
    units = {column.name: column.unit for column in problem.columns}
    notices = tuple(
        words.BOUND(name=name, value=held.free, stderr=held.stderr, unit=units[name], bound=held.bound)
        for name, held in fit.at_bound.items()
    )
    far, near = filter(words.beyond_error, notices), filterfalse(words.beyond_error, notices)
    return design.replace_effects(effects), tuple(far), tuple(near)
