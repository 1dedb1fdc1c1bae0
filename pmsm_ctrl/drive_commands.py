"""The commands that lead into the drive: compensate and export."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pmsm_ctrl.console import NEGATIVE, finish, progress_bar, write_json
from pmsm_ctrl.files import printable
from pmsm_ctrl.options import (
    DesignArgument,
    EffectsOption,
    ForceOption,
    JsonOption,
    LogsOption,
    MapOption,
    ReportOption,
    SeedOption,
    TruthOption,
    design_if_given,
    logs_if_given,
    output_option,
    read_design,
)

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.log import Log

__all__ = ["DRIVE_COMMANDS"]


def compensate(
    design: DesignArgument,
    truth: TruthOption = None,
    step: Annotated[
        float,
        typer.Option(
            "--step",
            metavar="PERCENT",
            min=1.0,
            max=150.0,
            help="step of the gain sweep to 150 %; finer below a first step that is not safe",
        ),
    ] = 10.0,
    output: Annotated[
        Path | None, output_option("NEW_DESIGN", "write the design with the recommended compensation")
    ] = None,
    seed: SeedOption = 0,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Compare friction compensations, find the safe gains, recommend one. Status 1 when the acceptance fails."""
    with progress_bar(f"compensate {design.stem}") as progress:
        from pmsm_ctrl.compensate import compensate as run_compensation
        from pmsm_ctrl.compensate import sweep_gains

        axis = read_design(design, effects)
        plant, gains = design_if_given(truth, effects), sweep_gains(0.01 * step)
        result = run_compensation(axis, truth=plant, gains=gains, seed=seed, progress=progress)
    finish("compensate", result, json_file=json_file, report=report, design=result.recommended, output=output)
    if result.recommended is None and output is not None:
        from pmsm_ctrl.compensate.notices import why_none

        print(f"pmsm-ctrl: {printable(output)}: not written: {why_none(result.verdict)}", file=sys.stderr)
    if not result.accepted or (result.recommended is None and output is not None):
        raise typer.Exit(NEGATIVE)


def export(
    design: DesignArgument,
    language: Annotated[str, typer.Option("--language", "-l", metavar="st|c", help="Structured Text or C99")],
    flavour: Annotated[
        str, typer.Option("--flavour", metavar="iec|br|beckhoff", help="dialect of Structured Text")
    ] = "iec",
    part: Annotated[
        str, typer.Option("--part", metavar="compensation|filter|tracker", help="part to write into a single file")
    ] = "compensation",
    precision: Annotated[
        str, typer.Option("--precision", metavar="double|single", help="of the numbers in the program")
    ] = "double",
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="PATH", help="a file, or without suffix a folder for all parts"),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option("--source", metavar="NAME", help="speed in place of the design's: reference, commanded, ..."),
    ] = None,
    gain: Annotated[
        float | None, typer.Option("--gain", metavar="SHARE", min=0.0, help="in place of the design's; 1 for 100 %")
    ] = None,
    feed: Annotated[
        str | None, typer.Option("--feed", metavar="EFFECT,...", help="effects fed forward, in place of the design's")
    ] = None,
    log: LogsOption = None,
    mapping: MapOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="overwrite existing files, and export a gain that is not safe")
    ] = False,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
) -> None:
    """Write gains, compensator, filters and tracker as source code. A folder also gets the tables of the drives.

    With --log the tables say what simulators miss on it; a log with theta_load gives the backlash. Where --source,
    --gain or --feed change the compensation, the folder also gets the design with it, for verify.
    """
    from pmsm_ctrl.errors import UnsafeGainError
    from pmsm_ctrl.next_steps import exported_design

    axis = _with_compensation(read_design(design, effects), source=source, gain=gain, feed=feed)
    folder = _folder_of(output, needed=log is not None)
    name = None if folder is not None else output.name if output else ""
    measured = logs_if_given(log, axis, mapping) or []
    try:
        files = _sources(axis, language, flavour, part, name, precision, measured)
    except UnsafeGainError as error:
        if not force:
            raise
        print(f"pmsm-ctrl: warning: {error}", file=sys.stderr)
        files = _sources(axis, language, flavour, part, name, precision, measured, unsafe=True)
    if part == "compensation":
        _say_left_out(axis)
    changed = any(one is not None for one in (source, gain, feed))
    beside = exported_design(folder) if folder is not None and changed else None
    _write_sources(files, output, beside, axis, force=force)
    if json_file is not None:
        whole = {"source": files[""]} if "" in files else {"files": files}
        write_json(json_file, "export", {"language": language, "flavour": flavour} | whole)


def _folder_of(output: Path | None, *, needed: bool) -> Path | None:
    """Return the folder that an output without a suffix is; one that the tables of a log need has to be given."""
    from pmsm_ctrl.errors import RequestError

    folder = output if output is not None and not output.suffix else None
    if needed and folder is None:
        raise RequestError("--log: the tables need a folder; --output with a name without suffix was expected")
    return folder


def _write_sources(
    files: dict[str, str], output: Path | None, beside: Path | None, design: Design, *, force: bool
) -> None:
    """Print the sources, or write them into a file or a folder; no file is written where one of them exists.

    All are written before the first is named, with the design `beside` them.
    """
    from pmsm_ctrl.files import require_new, write_text

    if output is not None and not output.suffix:
        require_new(() if force else (*(output / name for name in files), *([beside] if beside else [])))
        output.mkdir(parents=True, exist_ok=True)
    if output is None:
        print("".join(files.values()), end="")
        return
    paths = {output if output.suffix else output / name: text for name, text in files.items()}
    for path, text in paths.items():
        write_text(path, text)
    if beside is not None:
        design.write(beside)
    for path, text in paths.items():
        print(f"{printable(path)}: {len(text.splitlines())} lines")
    if beside is not None:
        print(printable(f"design: {beside}"))


def _with_compensation(design: Design, *, source: str | None, gain: float | None, feed: str | None) -> Design:
    """Return the design with what the options say of its compensation."""
    stated: dict[str, object] = {"source": source, "gain": gain}
    stated["effects"] = None if feed is None else tuple(name.strip() for name in feed.split(","))
    changed = {name: value for name, value in stated.items() if value is not None}
    stating = design.replace(compensation=changed) if changed else design
    if source != "observer" or stating.compensation.bandwidth is not None:
        return stating
    from pmsm_ctrl.compensate import baseline
    from pmsm_ctrl.compensate.study import with_bandwidth
    from pmsm_ctrl.tune.observer import design_observer

    return with_bandwidth(stating, design_observer(baseline(stating)))


def _say_left_out(design: Design) -> None:
    from pmsm_ctrl.export.compensator import left_out

    if others := left_out(design):
        every = ", ".join(f'"{one}"' for one in (*design.compensation.effects, *others))
        said = f"not fed forward: {', '.join(others)}; effects = [{every}] in [compensation] exports them too"
        print(f"pmsm-ctrl: warning: {design.source or design.name}: {said}", file=sys.stderr)


def _sources(
    design: Design,
    language: str,
    flavour: str,
    part: str,
    name: str | None,
    precision: str,
    logs: list[Log],
    *,
    unsafe: bool = False,
) -> dict[str, str]:
    """Return the texts to export by file name: of one part under this name, or of all."""
    from pmsm_ctrl.export import export as export_part
    from pmsm_ctrl.export import export_files

    if name is None:
        return export_files(design, language, flavour=flavour, force=unsafe, precision=precision, logs=logs)
    return {name: export_part(design, language, part=part, flavour=flavour, force=unsafe, precision=precision)}


DRIVE_COMMANDS = (compensate, export)
