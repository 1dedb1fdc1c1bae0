"""The command fleet: logs of many axes to a table of results, and the table to a page."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pmsm_ctrl.console import NEGATIVE, command_line, finish, keep_odd, progress_bar
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import printable, require_new, require_writable, write_text
from pmsm_ctrl.options import ForceOption, JsonOption, MapOption, ReportOption

if TYPE_CHECKING:
    from pmsm_ctrl.fleet import Engine, FleetReport, FleetResult, Manifest

__all__ = ["FLEET_COMMANDS"]

AXIS_PAGES = 100  # axes up to which each gets a page without being asked for: some 0.3 s each

MemoryOption = Annotated[
    str, typer.Option("--memory", metavar="SIZE", help="limit of a worker, such as 2GB; auto shares the machine's")
]


def fleet(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="WHAT...",
            help="a manifest RUN.toml or, with --design, a FOLDER of logs; `watch` before either follows new logs; "
            "`report RESULTS` makes a page; `example FOLDER` simulates a fleet",
        ),
    ],
    design: Annotated[
        Path | None, typer.Option("--design", "-d", metavar="DESIGN", help="design of every axis of a folder")
    ] = None,
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="PATH", help="folder of results, or page of the report")
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", metavar="N", min=0, max=999, help="worker processes; 0: one a core; 1: none")
    ] = 0,
    scheduler: Annotated[
        str, typer.Option("--scheduler", metavar="ADDRESS", help="a running dask scheduler: tcp://HOST:8786")
    ] = "",
    memory: MemoryOption = "auto",
    retry: Annotated[bool, typer.Option("--retry", help="try logs again that were set aside")] = False,
    effects: Annotated[
        Path | None,
        typer.Option("--effects", metavar="FILE.py", help="file with own effects; RUNS this file as Python code"),
    ] = None,
    every: Annotated[
        float, typer.Option("--every", metavar="SECONDS", min=0.0, help="of watch: time between two scans")
    ] = 60.0,
    axis_pages: Annotated[
        bool | None,
        typer.Option(
            "--axis-pages/--no-axis-pages", help="of report and watch: a page for each axis; usually up to 100 axes"
        ),
    ] = None,
    joint: Annotated[bool, typer.Option("--joint", help="evaluate the records of an axis together")] = False,
    mapping: MapOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Evaluate the logs of many axes into one table. Logs that are in the table already are not evaluated again."""
    _require_no_page(words[0], report)
    if words[0] == "report":
        _report(words[1:], None if output is None else Path(output), json_file, axis_pages, force)
        return
    if words[0] == "example":
        _example(words[1:], design)
        if report is None:
            return
        words, design = [f"{words[1]}/run.toml"], None
    from pmsm_ctrl.fleet import Engine

    engine = Engine(jobs, scheduler, memory)
    if words[0] == "watch":
        _watch(_manifest(words[1:], design, output, joint, mapping, effects), engine, every, retry, axis_pages)
        return
    manifest = _manifest(words, design, output, joint, mapping, effects)
    _run(manifest, words[0], engine, retry, json_file, None if report is None else (report, axis_pages, force))


def _require_no_page(word: str, report: Path | None) -> None:
    if report is not None and word in ("report", "watch"):
        raise RequestError(f"--report: not with {word}, which writes a page itself")


def _run(
    manifest: Manifest, name: str, engine: Engine, retry: bool, json_file: Path | None,
    page: tuple[Path, bool | None, bool] | None,
) -> None:  # fmt: skip
    """Evaluate the logs of a manifest, say what came of it, and write the page of all results where one is wanted."""
    from pmsm_ctrl.fleet import fleet as run_fleet
    from pmsm_ctrl.fleet import fleet_report
    from pmsm_ctrl.rendering.numbers import counted

    with progress_bar(f"fleet {name}") as progress:
        result = run_fleet(manifest, engine=engine, retry=retry, progress=progress)
    finish("fleet", result, json_file=json_file)
    if page is not None:
        found = fleet_report(result.results)
        _write_page(found, *page)
        keep_odd(found.odd_log, found.odd_design)
    if result.failed:
        said = f"fleet: none of {counted(result.logs, 'log')} could be evaluated; the first: {result.lost[0].reason}"
        print(printable(f"pmsm-ctrl: {said}"), file=sys.stderr)
        raise typer.Exit(NEGATIVE)


def _watch(manifest: Manifest, engine: Engine, every: float, retry: bool, axis_pages: bool | None) -> None:
    """Follow a folder: table and pages are renewed as logs arrive, until Ctrl-C."""
    from pmsm_ctrl.fleet import fleet_report
    from pmsm_ctrl.fleet.folders import folder_at
    from pmsm_ctrl.fleet.remote import is_remote, plain
    from pmsm_ctrl.fleet.watch import watch

    if retry:
        raise RequestError("--retry: not with watch; run fleet once with it")
    where = plain(manifest.results)
    if is_remote(where):
        axis_pages = False  # the page is one object
    page = Path(where) / "fleet.html"

    def told(done: FleetResult) -> None:
        found = fleet_report(where)
        text = _page(found, _axis_pages(found, page, axis_pages, force=True))
        folder_at(where).write(page.name, text.encode())
        print(printable(f"{done.evaluated} logs evaluated, {done.logs} in all: {where}/{page.name}"), flush=True)

    watch(manifest, told, every=every, engine=engine)


def _report(
    words: list[str], output: Path | None, json_file: Path | None, axis_pages: bool | None, force: bool
) -> None:
    """Answer the questions of a fleet, on the terminal and as a page."""
    from pmsm_ctrl.fleet import fleet_report

    if len(words) != 1:
        raise RequestError("fleet report: one folder of results was expected: pmsm-ctrl fleet report RESULTS")
    if output is not None:
        require_writable(output)
    found = fleet_report(words[0])
    finish("fleet_report", found, json_file=json_file)
    keep_odd(found.odd_log, found.odd_design)
    if output is not None:
        _write_page(found, output, axis_pages, force)


def _write_page(found: FleetReport, page: Path, axis_pages: bool | None, force: bool) -> None:
    """Write the page of a fleet, and those of its axes."""
    write_text(page, _page(found, _axis_pages(found, page, axis_pages, force)))
    print(printable(f"report: {page}"))


def _example(words: list[str], design: Path | None) -> None:
    """Write the logs of a simulated fleet, with what is true of its axes."""
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.fleet.example import simulated_fleet

    if len(words) != 1 or Path(words[0]).exists():
        raise RequestError("fleet example: the name of one new folder was expected")
    axis = Design.read(design) if design is not None else Design.example("seed_motor")
    with progress_bar(f"fleet example {words[0]}"):
        drawn = simulated_fleet(words[0], axis)
    print(printable(f"{words[0]}: logs of {len(drawn)} axes, run.toml, and the truth in truth.json"))


def _axis_pages(found: FleetReport, page: Path, wanted: bool | None, force: bool) -> dict[str, str]:
    """Write a page for each axis into a folder beside the fleet's; return its address by axis.

    They are made from the stored results: the logs need not be within reach, and nothing is evaluated again.
    """
    from urllib.parse import quote

    from pmsm_ctrl.fleet.axis import axis_records, page_names
    from pmsm_ctrl.fleet.present import axis_sections, axis_verdict
    from pmsm_ctrl.report import Headline, render

    if wanted is False or (wanted is None and len(found.axes) > AXIS_PAGES):
        if wanted is None:
            print(f"no page for each of {len(found.axes)} axes; --axis-pages writes them")
        return {}
    folder = page.with_name(f"{page.stem}_axes")
    names = page_names(one.name for one in found.axes)
    if not force:
        require_new(folder / name for name in names.values())
    folder.mkdir(exist_ok=True)
    records = axis_records(found.results)
    for one in found.axes:
        headline = Headline(f"{one.records} logs were evaluated one by one.", axis_verdict(one), None, ())
        text = render(
            f"Axis {one.name}", axis_sections(found, one, records[one.name]), headline=headline,
            facts={"results": found.results, "type": one.type or "none stated"}, command=command_line(),
        )  # fmt: skip
        write_text(folder / names[one.name], text)
    return {axis: f"{quote(folder.name)}/{quote(name)}" for axis, name in names.items()}


def _page(found: FleetReport, links: Mapping[str, str] | None = None) -> str:
    from pmsm_ctrl.fleet.present import linked, sections, verdict_of
    from pmsm_ctrl.rendering.numbers import counted
    from pmsm_ctrl.report import Headline, render

    logs = sum(one.records for one in found.axes)
    numbers = (
        (f"{len(found.axes)}", f"{'axis' if len(found.axes) == 1 else 'axes'} with {counted(logs, 'log')}"),
        (f"{len(found.missing)}", "lack an effect"),
        (f"{len({one.axis for one in found.changes})}", "change over time"),
        (f"{len(found.worthless)}", "logs without an answer"),
    )  # fmt: skip
    evaluated = "was evaluated" if logs == 1 else "were evaluated one by one"
    headline = Headline(f"{counted(logs, 'log')} {evaluated}.", verdict_of(found), None, numbers)
    first, *rest = sections(found)
    shown = (replace(first, blocks=first.blocks[1:]).without(found.notices), *rest)
    return render(
        "Fleet", [linked(one, links or {}) for one in shown], headline=headline, notices=found.notices,
        facts={"results": found.results},
        command=command_line(),
    )  # fmt: skip


def _manifest(
    words: list[str], design: Path | None, output: str | None, joint: bool, mapping: list[str] | None,
    effects: Path | None,
) -> Manifest:  # fmt: skip
    """Return the manifest of a file, or of folders of logs."""
    from pmsm_ctrl.console import parse_map
    from pmsm_ctrl.fleet import Manifest, read_manifest

    if not words:
        raise RequestError("fleet watch: a manifest, or a folder with --design was expected")
    if len(words) == 1 and words[0].endswith(".toml"):
        if design is not None:
            raise RequestError("--design: excludes a manifest, which names its own designs")
        manifest = read_manifest(words[0])
    elif design is None:
        raise RequestError(f"fleet {words[0]}: a manifest that ends in .toml, or --design was expected")
    else:
        manifest = Manifest(logs=tuple(words), design=str(design))
    settings = manifest.settings
    settings = replace(settings, joint=joint or settings.joint, mapping={**settings.mapping, **parse_map(mapping)})
    own = "" if effects is None else str(effects.resolve())  # workers have working folders of their own
    results = output if output is not None else manifest.results
    return replace(manifest, settings=settings, results=results, effects=own)


FLEET_COMMANDS = (fleet,)
