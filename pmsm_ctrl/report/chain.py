"""study: all analyses of one axis, from its design to one HTML report."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import diagnose
from pmsm_ctrl.errors import DesignError, NextCommand, RequestError, require_kind
from pmsm_ctrl.files import sha256, write_text
from pmsm_ctrl.identify import Identification, SweepResult, identify, paper_table, sweep
from pmsm_ctrl.identify.paper import PAPER_CASES
from pmsm_ctrl.likely import unlikely
from pmsm_ctrl.log import Log, Logs, as_logs
from pmsm_ctrl.plausibility import doubts_about, of_holdout, with_inertia
from pmsm_ctrl.report.drive_parts import drive_parts
from pmsm_ctrl.report.headline import of_diagnosis, of_simulation
from pmsm_ctrl.report.history import Entry, add_entry, extended, read_history
from pmsm_ctrl.report.notices import LEFT_OUT
from pmsm_ctrl.report.page import render, versions
from pmsm_ctrl.report.present import parts
from pmsm_ctrl.report.result import Study
from pmsm_ctrl.result import Result
from pmsm_ctrl.section import Notice
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.tune import Tuning, tune

__all__ = ["report_path", "study"]


def study(
    design: Design,
    log: Logs | None = None,
    *,
    holdout: Logs | None = None,
    output: str | os.PathLike[str] | None = None,
    seed: int = 0,
    history: str | os.PathLike[str] | None = None,
    complete: bool = False,
    command: str = "",
    progress: Callable[[float], None] | None = None,
) -> Study:
    """Run the chain that the design and the log allow, and write one HTML report.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log, optional
        Measured logs of this axis. Without one the design's own drive is simulated.
    holdout : Log or sequence of Log, optional
        Other records of the axis, predicted with what was identified from `log`.
    output : path, optional
        The report; ``reports/NAME.html`` if left out, and the folder is made.
    seed : int
        Seed of the simulated noise.
    history : path, optional
        A file with what earlier studies of this axis identified: this one is added to it, and all are shown.
    complete : bool
        Also compensate, track and export the axis; the files go into a folder beside the page.
    command : str
        Shown in the appendix as the command that makes the page again.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    Study

    Raises
    ------
    DesignError, LogError
        When the design or the log cannot be used.
    RequestError
        When the report cannot be written.
    """
    path = report_path(design, output)
    before = read_history(history) if history is not None else ()  # refused before the computation
    advance = progress or (lambda share: None)
    design = design if log is None else with_inertia(design, log)
    results, left_out = _simulated_parts(design, log is None, seed, advance)
    tuned = results.get("tune")
    drive = tuned.design if design.loops is None and isinstance(tuned, Tuning) else design
    records = (simulate(drive, "identification", seed=seed),) if log is None else as_logs(log)
    holdouts = () if holdout is None else as_logs(holdout, "holdout")
    identification = identify(drive, records)
    comparison = compare(identification.design, records, holdout=holdouts or None)
    if log is None:
        identification = replace(identification, log_name="a simulated identification motion")
        comparison = replace(comparison, log=replace(comparison.log, name="the simulated motion"))
    results |= {"identify": identification, "compare": comparison}
    advance(0.8)
    swept = results.get("sweep")
    if log is None and isinstance(swept, SweepResult):
        headline = of_simulation(design, swept, records[0].duration)
    else:
        found = diagnose(drive, records, holdout=holdouts or None, progress=lambda s: advance(0.8 + 0.15 * s))
        results["diagnose"] = found
        headline = of_diagnosis(found, comparison)
    now = _entry(design, records, identification)
    entries = () if history is None else extended(before, now)
    outcome = Study(identification.design, path, headline, results, (), entries, complete)
    if complete:
        more, missing = drive_parts(
            outcome.completed, records[0], path, seed=seed, progress=lambda s: advance(0.95 + 0.05 * s)
        )
        outcome = replace(outcome, results=results | more)
        left_out += missing
    outcome = replace(outcome, doubts_of_input=(doubts := (*left_out, *_of_input(design, records, holdouts))))
    raised = (*doubts, *results["diagnose"].notices) if "diagnose" in results else doubts  # before the numbers
    text = render(
        f"Study of {design.name}",
        [section.without(raised) for section in parts(outcome)],
        headline=headline,
        notices=raised,
        facts=_facts(design, (records, holdouts), seed if design.motor.electrical else None),
        design_toml=design.to_toml(),
        command=command,
    )
    write_text(path, text)
    if history is not None:
        add_entry(history, now)
    advance(1.0)
    return outcome


def _entry(design: Design, records: Sequence[Log], identification: Identification) -> Entry:
    name = ", ".join(Path(one.provenance.file).name for one in records if one.provenance.file)
    name = name or identification.log_name
    hashes = [one.provenance.sha256 for one in records]
    joint = hashes[0] if len(hashes) == 1 else hashlib.sha256("".join(hashes).encode()).hexdigest()
    key = (joint, hashlib.sha256(design.to_toml().encode()).hexdigest(), versions()["pmsm-ctrl"])
    return Entry(name, key, dict(identification.estimates), identification.relative_error)


def _of_input(design: Design, records: Sequence[Log], holdouts: Sequence[Log]) -> tuple[Notice, ...]:
    """What is doubtful in the design and the logs, in the words of every verb."""
    other = (of_holdout(notice) for holdout in holdouts for notice in doubts_about(design, holdout).notices)
    return tuple(dict.fromkeys((*unlikely(design), *doubts_about(design, records).notices, *other)))


def _simulated_parts(
    design: Design, needed: bool, seed: int, advance: Callable[[float], None]
) -> tuple[dict[str, Result], list[Notice]]:
    """Return the results that need no log, by verb, and a notice for those that are not possible.

    The speed sweep is simulated when it is `needed`, without a log.

    Raises
    ------
    DesignError
        When there is nothing else to show, and the design cannot be simulated.
    """
    if not design.motor.electrical:
        lacking = "the design lacks the motor's electrical data"
        if needed:
            where = design.source or design.name
            message = f"{where}: {lacking}, so it cannot be simulated; give a log with --log"
            raise DesignError(message, next_command=NextCommand.ELECTRICAL_DATA)
        return {}, [LEFT_OUT(what="the tuning", why=lacking)]
    results: dict[str, Result] = {}
    tuned = tune(design, seed=seed, progress=lambda share: advance(0.3 * share))
    results["tune"] = tuned
    drive = design if design.loops is not None else tuned.design
    if needed:  # below a log, a sweep of the simulated design would be an answer to another question
        results["sweep"] = sweep(drive, seed=seed, progress=lambda share: advance(0.3 + 0.3 * share))
        if is_reference(design):
            results["paper"] = paper_table(drive, seed=seed)
    advance(0.7)
    return results, []


def is_reference(design: Design) -> bool:
    """Whether this is the reference paper's motor with the friction that the paper put in."""
    case = PAPER_CASES[0]
    friction = {**design.parameters("coulomb"), **design.parameters("viscous")}
    return (
        len(design.effects) == 2
        and friction == {"F_c": case.F_c, "F_v": case.F_v}
        and design.motor.psi_f == 0.172
        and math.isclose(design.J, 9e-5)
    )


def report_path(design: Design, output: str | os.PathLike[str] | None) -> Path:
    """Return where the report of a design goes. A name from a file must not lead out of reports/.

    Parameters
    ----------
    design : Design
    output : path, optional
        A name that was asked for.

    Returns
    -------
    Path
        `output`, or ``reports/NAME.html``; its folder is made.

    Raises
    ------
    RequestError
        When the folder cannot be made, or `design` is none.
    """
    require_kind(design, Design, "design")
    if output is not None:
        return Path(output)
    stem = re.sub(r"[^\w.-]+", "_", design.name).strip("._") or "axis"
    folder = Path("reports")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise RequestError(f"{folder}: cannot be made ({error.strerror}); name the report with --output") from None
    return folder / f"{stem}.html"


def _facts(design: Design, logs: tuple[Sequence[Log], Sequence[Log]], seed: int | None) -> dict[str, str]:
    facts = {"design": design.source or design.name}
    if design.source:
        facts["design, SHA-256"] = sha256(design.source)
    named = [
        (word if len(some) == 1 else f"{word} {k}", log)
        for word, some in zip(("log", "holdout"), logs, strict=True)
        for k, log in enumerate(some, start=1)
    ]
    for name, log in named:
        if log.provenance.file:
            facts[name] = log.provenance.file
            if log.provenance.sha256:  # none of a log that was simulated
                facts[f"{name}, SHA-256"] = log.provenance.sha256
        for k, note in enumerate(log.provenance.notes, start=1):
            facts[f"{name}, note {k}"] = note
    if seed is not None:
        facts["seed"] = str(seed)
    return facts
