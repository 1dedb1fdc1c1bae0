"""study: the whole chain on one axis, from its design to one page to hand round."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.compare import compare
from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import Diagnosis, diagnose
from pmsm_ctrl.errors import DesignError, NextCommand, RequestError
from pmsm_ctrl.files import sha256, write_text
from pmsm_ctrl.identify import Identification, SweepResult, identify, paper_table, sweep
from pmsm_ctrl.identify.paper import PAPER_CASES
from pmsm_ctrl.log import Log
from pmsm_ctrl.report.history import Entry, extended, history_section, history_text, read_history
from pmsm_ctrl.report.page import Headline, render, versions
from pmsm_ctrl.result import Result, Section, jsonable
from pmsm_ctrl.simulate import simulate
from pmsm_ctrl.tune import Tuning, tune
from pmsm_ctrl.units import drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Study", "study"]


@dataclass(frozen=True, eq=False)
class Study(Result):
    """What `study` did.

    Attributes
    ----------
    design : Design
        The given design with what was identified.
    path : Path
        The report.
    headline : Headline
        What the first screen says.
    results : dict of verb to Result
        In the order in which they ran.
    skipped : tuple of str
        What could not be done, and why.
    """

    design: Design
    path: Path
    headline: Headline
    results: Mapping[str, Result]
    skipped: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers, of every part, each once."""
        own = [f"{verb}: {text}" for verb, result in self.results.items() for text in result.warnings]
        return tuple(dict.fromkeys((*self.skipped, *own)))

    def summary(self) -> str:
        """Return every part's summary and, last, the path of the report."""
        parts = [f"left out: {text}" for text in self.skipped]
        parts += [result.summary() for result in self.results.values()]
        return "\n\n".join([*parts, f"{self.headline.verdict}\nreport: {self.path}"])

    def plot(self) -> Figure:
        """Return the last part's figure."""
        return list(self.results.values())[-1].plot()

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return {
            "verdict": self.headline.verdict,
            "numbers": {label: value for value, label in self.headline.numbers},
            "report": str(self.path),
            "warnings": list(self.warnings),
            **{verb: jsonable(result.to_dict()) for verb, result in self.results.items()},
        }

    def section(self) -> Section:
        """Return the first screen as a section, for use in another report."""
        return Section("Study", (self.headline.done, self.headline.verdict))


def study(
    design: Design,
    log: Log | None = None,
    *,
    holdout: Log | None = None,
    output: str | os.PathLike[str] | None = None,
    seed: int = 0,
    history: str | os.PathLike[str] | None = None,
    command: str = "",
    progress: Callable[[float], None] | None = None,
) -> Study:
    """Run the chain that the design and the log allow, and write one HTML report.

    Parameters
    ----------
    design : Design
    log : Log, optional
        A measured log of this axis. Without one the design's own drive is simulated.
    holdout : Log, optional
        Another record of the axis, predicted with what was identified from `log`.
    output : path, optional
        The report; ``reports/NAME.html`` if left out, and the folder is made.
    seed : int
        Seed of the simulated noise.
    history : path, optional
        A file with what earlier studies of this axis identified: this one is added to it, and all are shown.
    command : str
        Shown in the appendix as the command that makes the page again.
    progress : function, optional
        Called with the share done, 0 to 1.

    Raises
    ------
    DesignError, LogError
        When the design or the log cannot be used.
    RequestError
        When the report cannot be written.
    """
    path = _target(design, output)
    before = read_history(history) if history is not None else ()  # refused before the work, not after it
    advance = progress or (lambda share: None)
    results, skipped = _simulated_parts(design, log is None, seed, advance)
    tuned = results.get("tune")
    drive = tuned.design if design.loops is None and isinstance(tuned, Tuning) else design
    record = simulate(drive, "identification", seed=seed) if log is None else log
    identification = identify(drive, record)
    comparison = compare(identification.design, record, holdout=holdout)
    if log is None:
        identification = replace(identification, log_name="a simulated identification motion")
        comparison = replace(comparison, log_name="the simulated motion")
    results |= {"identify": identification, "compare": comparison}
    advance(0.8)
    swept = results.get("sweep")
    if log is None and isinstance(swept, SweepResult):
        headline = _simulated(design, swept, identification)
    else:
        found = diagnose(drive, record, holdout=holdout, progress=lambda s: advance(0.8 + 0.15 * s))
        results["diagnose"] = found
        headline = _measured(design, record, found)
    earlier = _history(before, design, record, identification) if history is not None else _Earlier()
    outcome = Study(identification.design, path, headline, results, tuple(skipped))
    logs = [record] if holdout is None else [record, holdout]
    text = render(
        f"Study of {design.name}",
        [*(_section(verb, results[verb]) for verb in _reading_order(results)), *earlier.sections],
        headline=headline,
        warnings=[*(f"Left out: {text}" for text in skipped), *_import_warnings(logs)],
        facts=_facts(design, logs, seed if design.motor.electrical else None),
        design_toml=design.to_toml(),
        command=command,
    )
    write_text(path, text)
    if history is not None:
        write_text(history, history_text(earlier.entries))
    advance(1.0)
    return outcome


@dataclass(frozen=True)
class _Earlier:
    """The history with this study in it, and its section."""

    entries: tuple[Entry, ...] = ()
    sections: tuple[Section, ...] = ()


def _history(before: tuple[Entry, ...], design: Design, record: Log, identification: Identification) -> _Earlier:
    name = Path(record.provenance.file).name or identification.log_name
    key = (record.provenance.sha256, hashlib.sha256(design.to_toml().encode()).hexdigest(), versions()["pmsm-ctrl"])
    entry = Entry(name, key, dict(identification.estimates), identification.relative_error)
    entries = extended(before, entry)
    return _Earlier(entries, (history_section(entries),))


# What a reader must know about a part before its section, where the section cannot know it.
INTRODUCTIONS = {"compare": "The model is the design with the identified inertia and friction; no more was fitted."}


# The page answers before it explains: what the headline speaks of comes first, the loops last.
MEASURED_ORDER = ("compare", "diagnose", "identify", "tune", "sweep", "paper")
SIMULATED_ORDER = ("sweep", "paper", "identify", "compare", "tune")


def _reading_order(results: Mapping[str, Result]) -> list[str]:
    order = MEASURED_ORDER if "diagnose" in results else SIMULATED_ORDER
    return [*(verb for verb in order if verb in results), *(verb for verb in results if verb not in order)]


def _section(verb: str, result: Result) -> Section:
    section = result.section()
    introduction = (INTRODUCTIONS[verb],) if verb in INTRODUCTIONS else ()
    return replace(section, paragraphs=(*introduction, *section.paragraphs))


def _import_warnings(logs: Iterable[Log]) -> list[str]:
    return [f"{log.provenance.file}: {text}" for log in logs for text in log.provenance.warnings]


def _simulated_parts(
    design: Design, needed: bool, seed: int, advance: Callable[[float], None]
) -> tuple[dict[str, Result], list[str]]:
    """Return what the design alone can show, by verb, and what it cannot.

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
        return {}, [f"the tuning and the simulated speed sweep, because {lacking}"]
    results: dict[str, Result] = {}
    tuned = tune(design, seed=seed, progress=lambda share: advance(0.3 * share))
    results["tune"] = tuned
    drive = design if design.loops is not None else tuned.design
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


def _target(design: Design, output: str | os.PathLike[str] | None) -> Path:
    """Return where the report goes. A name from a file must not lead out of reports/."""
    if output is not None:
        return Path(output)
    stem = re.sub(r"[^\w.-]+", "_", design.name).strip("._") or "axis"
    folder = Path("reports")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise RequestError(f"{folder}: cannot be made ({error.strerror}); name the report with --output") from None
    return folder / f"{stem}.html"


ACCEPTED_PERCENT = 1.0  # the reference experiment's own bound, with noise and quantisation


def _simulated(design: Design, swept: SweepResult, found: Identification) -> Headline:
    """Say how much of what was put in came back."""
    put_in = {**design.parameters("coulomb"), **design.parameters("viscous")}
    numbers, deviations = [], []
    for symbol, estimate in swept.estimates.items():
        remark = f"{symbol} from the sweep"
        if put_in.get(symbol):
            deviations.append(100.0 * (estimate.value / put_in[symbol] - 1.0))
            remark += f", {deviations[-1]:+.2f} % from what was put in"
        numbers.append((f"{estimate.value:.4g} {estimate.unit}", remark))
    numbers.append((f"{swept.rms_percent:.2f} %", "rms error between the friction line and the averaged torque"))
    done = (
        f"The drive {design.name} was simulated as it samples: a speed sweep of {len(swept.levels)} levels gives its "
        f"friction, and a motion of {found.problem.t[-1]:.3g} s its inertia and friction by regression."
    )
    worst = max(map(abs, deviations), default=0.0)
    verdict = f"the sweep returns the friction that was put in within {worst:.2f} % (accepted: {ACCEPTED_PERCENT:g} %)."
    if not deviations:
        verdict = "the design has no Coulomb or viscous friction to compare the sweep with."
    return Headline(done, verdict, worst <= ACCEPTED_PERCENT if deviations else None, tuple(numbers))


def _measured(design: Design, log: Log, found: Diagnosis) -> Headline:
    """Say which effects the measured log calls for, and what the error falls to."""
    name = log.provenance.file or "a given log"
    done = f"The axis {design.name} was diagnosed from {name}, {log.duration:.3g} s at {log.rate:.4g} Hz."
    before, after = (100.0 * found.errors[rung]["torque"]["relative"] for rung in ("nominal", "final"))
    drive = drives(design.motion)
    named = ", ".join(step.effect for step in found.steps)
    verdicts = {
        "consistent": f"the design explains the log: no effect is missing, {after:.2f} % of the {drive} is left.",
        "effects_missing": f"{named} missing: the error falls from {before:.2f} to {after:.2f} % of the {drive}.",
        "unexplained": f"something is left that no effect of the catalogue explains: {found.unexplained}.",
        "not_excited": f"this log cannot tell: it leaves {after:.2f} % of the {drive}, and excites too little.",
    }
    numbers = (
        (f"{before:.2f} %", f"of the {drive} left unexplained by the design as given"),
        (f"{after:.2f} %", "left with the effects that were found"),
        (str(len(found.steps)), "effects missing from the design"),
    )
    return Headline(done, verdicts[found.verdict], found.verdict == "consistent" or None, numbers)


def _facts(design: Design, logs: Iterable[Log], seed: int | None) -> dict[str, str]:
    facts = {"design": design.source or design.name}
    if design.source:
        facts["design, SHA-256"] = sha256(design.source)
    for number, log in enumerate(logs):
        name = "holdout" if number else "log"
        if log.provenance.file:
            facts[name] = log.provenance.file
            facts[f"{name}, SHA-256"] = log.provenance.sha256
        for k, note in enumerate(log.provenance.notes, start=1):
            facts[f"{name}, note {k}"] = note
    if seed is not None:
        facts["seed"] = str(seed)
    return facts
