"""study: the whole chain on one axis, from its design to one page to hand round."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import sha256, write_text
from pmsm_ctrl.identify import Identification, identify
from pmsm_ctrl.log import Log
from pmsm_ctrl.report.page import Headline, render
from pmsm_ctrl.result import Result, Section, jsonable
from pmsm_ctrl.simulate import simulate

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
    output: str | os.PathLike[str] | None = None,
    seed: int = 0,
    own: Iterable[Effect] = (),
    command: str = "",
    progress: Callable[[float], None] | None = None,
) -> Study:
    """Run the chain that the design and the log allow, and write one HTML report.

    Parameters
    ----------
    design : Design
    log : Log, optional
        A measured log of this axis. Without one the design's own drive is simulated.
    output : path, optional
        The report; ``reports/NAME.html`` if left out, and the folder is made.
    seed : int
        Seed of the simulated noise.
    own : iterable of Effect
        A user's own effects that the design names.
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
    own = tuple(own)
    path = _target(design, output)
    simulated = log is None
    record = simulate(design, "identification", seed=seed, own=own, progress=progress) if log is None else log
    identification = identify(design, record, own=own)
    results: dict[str, Result] = {"identify": identification}
    headline = _headline(design, record, identification, simulated)
    outcome = Study(identification.design, path, headline, results)
    text = render(
        f"Study of {design.name}",
        [result.section() for result in results.values()],
        headline=headline,
        warnings=outcome.skipped,
        facts=_facts(design, record, seed if simulated else None),
        design_toml=design.to_toml(),
        command=command,
    )
    write_text(path, text)
    return outcome


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


def _headline(design: Design, log: Log, found: Identification, simulated: bool) -> Headline:
    share = f"{100 * found.relative_error:.2f} %"
    drive = "force" if design.motion == "linear" else "torque"
    if simulated:
        done = f"The drive {design.name} was simulated and its parameters identified from the log."
        missed = [
            name
            for name, (low, high) in found.intervals.items()
            if not low <= (found.estimates[name].nominal or 0) <= high
        ]
        verdict = (
            f"the identification misses what was put in: {', '.join(missed)} outside the 95 % interval."
            if missed
            else "every parameter that was put in lies inside the 95 % interval of what came back."
        )
        good: bool | None = not missed
    else:
        done = (
            f"The axis {design.name} was identified from {log.provenance.file or 'a given log'}, {log.duration:.3g} s."
        )
        verdict = f"the model leaves {share} of the measured {drive} unexplained."
        good = None
    friction = [name for name in found.estimates if name in ("F_c", "F_v")]
    numbers = [
        (
            f"{found.estimates[n].value:.4g} {found.estimates[n].unit}",
            f"{n}, standard error {found.estimates[n].stderr:.1g}",
        )
        for n in friction
    ]
    return Headline(done, verdict, good, (*numbers, (share, f"of the {drive} is left unexplained")))


def _facts(design: Design, log: Log, seed: int | None) -> dict[str, str]:
    facts = {"design": design.source or design.name}
    if design.source:
        facts["design, SHA-256"] = sha256(design.source)
    if log.provenance.file:
        facts["log"] = log.provenance.file
        facts["log, SHA-256"] = log.provenance.sha256
    if seed is not None:
        facts["seed"] = str(seed)
    return facts
