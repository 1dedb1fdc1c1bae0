"""What a complete study adds: compensation, tracking, and the files for the PLC and the drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pmsm_ctrl.compensate import CompensationStudy, compensate, sweep_gains
from pmsm_ctrl.compensate.notices import why_none
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.export import export_files
from pmsm_ctrl.export.compensator import exported_gain
from pmsm_ctrl.files import write_text
from pmsm_ctrl.log import Log
from pmsm_ctrl.rendering.numbers import percent
from pmsm_ctrl.report.notices import LEFT_OUT
from pmsm_ctrl.result import Result
from pmsm_ctrl.section import Notice, Section, Table, present
from pmsm_ctrl.track import track

__all__ = ["ExportedFiles", "drive_parts"]

STEP = 0.5  # of the gain in the study's sweep: a first look, as `compensate --step 50`


@dataclass(frozen=True, eq=False)
class ExportedFiles(Result):
    """The files that a study exported.

    Attributes
    ----------
    name : str
        Of the design.
    folder : Path
    lines : dict of str to int
        Lines of each file, by its name.
    source : str
        Of the compensation that is exported.
    gain : float
    why_not_recommended : str
        Why this is not what the study of the compensation recommends; empty where it is.
    """

    name: str
    folder: Path
    lines: dict[str, int]
    source: str = "reference"
    gain: float = 1.0
    why_not_recommended: str = ""

    @property
    def notices(self) -> tuple[Notice, ...]:
        """None: an export that is not safe is left out."""
        return ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return {
            "folder": str(self.folder), "files": sorted(self.lines), "source": self.source, "gain": self.gain,
            "why_not_recommended": self.why_not_recommended,
        }  # fmt: skip


@present.register
def _(result: ExportedFiles) -> Section:
    rows = tuple((f"{result.folder.name}/{name}", str(lines)) for name, lines in sorted(result.lines.items()))
    links = {path: quote(path) for path, _ in rows}
    said = f"C and Structured Text of {result.name} stand in the folder {result.folder.name} beside this page."
    by = "the disturbance observer" if result.source == "observer" else f"{result.source} speed"
    chosen = f"Exported compensation: {by}, gain {percent(result.gain, 0)}"
    why = f"not a recommended one: {result.why_not_recommended}" if result.why_not_recommended else "as recommended"
    table = Table(("file", "lines"), rows, "Exported files", links=links)
    return Section(f"Export of {result.name}", (said, f"{chosen}, {why}.", table))


def drive_parts(
    design: Design, record: Log, page: Path, *, seed: int = 0, progress: Callable[[float], None] | None = None
) -> tuple[dict[str, Result], list[Notice]]:
    """Compensate, track and export an axis; what is not possible is told.

    Parameters
    ----------
    design : Design
        With its loops and its friction.
    record : Log
        To track.
    page : Path
        The report; the exported files go into a folder of its name.
    seed : int
        Of the simulated noise.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    results : dict of str to Result
        By verb.
    left_out : list of Notice
    """
    advance = progress or (lambda share: None)
    results: dict[str, Result] = {}
    left_out: list[Notice] = []

    def run(verb: str, what: str, part: Callable[[], Result]) -> None:
        try:
            results[verb] = part()
        except PmsmCtrlError as error:
            left_out.append(LEFT_OUT(what=what, why=str(error).splitlines()[0]))

    gains = sweep_gains(STEP)
    run(
        "compensate",
        "the compensation",
        lambda: compensate(design, gains=gains, seed=seed, progress=lambda s: advance(0.9 * s)),
    )
    run("track", "the tracking", lambda: track(design, record))
    chosen, why = _chosen(design, results.get("compensate"))
    run("export", "the export", lambda: _exported(chosen, why, page.with_suffix("")))
    advance(1.0)
    return results, left_out


def _chosen(design: Design, found: Result | None) -> tuple[Design, str]:
    """Return the design with the compensation to export, and why it is not a recommended one.

    Where nothing is recommended and the design states no gain, nothing is fed forward: the gain is 0.
    """
    if not isinstance(found, CompensationStudy):
        return design, "no compensation was judged"
    if found.recommended is not None:
        return found.recommended, ""
    stated = design if design.compensation.gain is not None else design.replace(compensation={"gain": 0.0})
    return stated, why_none(found.verdict)


def _exported(design: Design, why: str, folder: Path) -> ExportedFiles:
    """Write the sources, and beside them the design with the exported compensation, which `verify` needs."""
    files = {**export_files(design, "c"), **export_files(design, "st")}
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        write_text(folder / name, text)
    lines = {name: len(text.splitlines()) for name, text in files.items()}
    design.write(folder / f"{folder.name}.design.toml")
    own = design.compensation
    return ExportedFiles(design.name, folder, lines, own.source, exported_gain(design), why)
