"""What a complete study adds: compensation, tracking, and the files for the PLC and the drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pmsm_ctrl.compensate import compensate, sweep_gains
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.export import export_files
from pmsm_ctrl.files import write_text
from pmsm_ctrl.log import Log
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
    """

    name: str
    folder: Path
    lines: dict[str, int]

    @property
    def notices(self) -> tuple[Notice, ...]:
        """None: an export that is not safe is left out."""
        return ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return {"folder": str(self.folder), "files": sorted(self.lines)}


@present.register
def _(result: ExportedFiles) -> Section:
    rows = tuple((f"{result.folder.name}/{name}", str(lines)) for name, lines in sorted(result.lines.items()))
    links = {path: quote(path) for path, _ in rows}
    said = f"C and Structured Text of {result.name} stand in the folder {result.folder.name} beside this page."
    return Section(f"Export of {result.name}", (said, Table(("file", "lines"), rows, "Exported files", links=links)))


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
    parts: dict[str, tuple[str, Callable[[], Result]]] = {
        "compensate": (
            "the compensation",
            lambda: compensate(design, gains=sweep_gains(STEP), seed=seed, progress=lambda s: advance(0.9 * s)),
        ),
        "track": ("the tracking", lambda: track(design, record)),
        "export": ("the export", lambda: _exported(design, page.with_suffix(""))),
    }
    results: dict[str, Result] = {}
    left_out = []
    for verb, (what, part) in parts.items():
        try:
            results[verb] = part()
        except PmsmCtrlError as error:
            left_out.append(LEFT_OUT(what=what, why=str(error).splitlines()[0]))
    advance(1.0)
    return results, left_out


def _exported(design: Design, folder: Path) -> ExportedFiles:
    files = {**export_files(design, "c"), **export_files(design, "st")}
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        write_text(folder / name, text)
    return ExportedFiles(design.name, folder, {name: len(text.splitlines()) for name, text in files.items()})
