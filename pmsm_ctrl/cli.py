"""The command line: one command per function, each of a few lines: load, call, print, write.

Heavy modules are imported when a command runs, so that ``--help`` is fast.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.main import get_command
from typer.models import CommandFunctionType

from pmsm_ctrl.console import (
    NEGATIVE,
    command_line,
    finish,
    keep_verdict,
    kept_mapping,
    parse_map,
    parse_values,
    progress_bar,
    run,
    say,
    write_json,
    write_report,
)
from pmsm_ctrl.drive_commands import DRIVE_COMMANDS
from pmsm_ctrl.files import printable
from pmsm_ctrl.fleet_command import FLEET_COMMANDS
from pmsm_ctrl.init import init
from pmsm_ctrl.log_commands import LOG_COMMANDS
from pmsm_ctrl.options import (
    DesignArgument,
    EffectsOption,
    ForceGainsOption,
    ForceOption,
    HoldoutOption,
    JsonOption,
    LogsOption,
    MapOption,
    NewDesignOption,
    ReportOption,
    SeedOption,
    TruthOption,
    Verb,
    above_zero,
    confirmed_import,
    design_if_given,
    effect_ids,
    known_rate,
    logs_if_given,
    output_option,
    read_design,
    scenario_names,
)
from pmsm_ctrl.workbench_command import WORKBENCH_COMMANDS

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.log import Log

__all__ = ["app", "main"]


class _Commands(typer.Typer):
    """Built from the annotations once in a process, not at every call, which costs 60 ms."""

    @cached_property
    def _built(self) -> Callable[..., Any]:
        return get_command(self)

    def __call__(self, *words: Any, **settings: Any) -> Any:
        return self._built(*words, **settings)

    def command(self, name: str | None = None, **settings: Any) -> Callable[[CommandFunctionType], CommandFunctionType]:
        return super().command(name, cls=Verb, **settings)


app = _Commands(
    name="pmsm-ctrl",
    help="Control design, friction identification and model diagnosis for permanent-magnet servo drives.",
    epilog="Exit status: 0 done, 1 the answer is negative, 2 bad input.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

# A literal, because the module of the scenarios takes half a second to import; a test compares them.
MOTIONS = (
    "the motion: sweep, triangle, creep, multisine, chirp, noise, prbs, breakaway, hold, positioning, trapezoid, "
    "s_curve, warm_up, reversal or identification"
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from pmsm_ctrl import __version__

        print(f"pmsm-ctrl {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="show the version and exit", is_eager=True, callback=_show_version)
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="show tracebacks and warnings; may stand anywhere")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="print all of a result; may stand anywhere")] = False,
) -> None:
    """All act before a command runs: `--version` exits, `--debug` and `--verbose` are read by `console.run`."""


app.command()(init)


@app.command()
def simulate(
    design: DesignArgument,
    output: Annotated[Path, output_option("LOG", "the log to write, canonical CSV")],
    scenario: Annotated[
        str, typer.Option("--scenario", "-s", metavar="NAME", help=MOTIONS, autocompletion=scenario_names)
    ] = "sweep",
    truth: TruthOption = None,
    parameters: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="a parameter of the motion: speed_max=100")
    ] = None,
    seed: SeedOption = 0,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    force: ForceOption = False,
) -> None:
    """Simulate the sampled drive and write its log."""
    import textwrap

    from pmsm_ctrl.simulate import scenario as named_scenario
    from pmsm_ctrl.simulate import simulate as run_simulation
    from pmsm_ctrl.simulate.limited import doubts_of_simulation

    axis = read_design(design, effects)
    motion = named_scenario(scenario, axis, **parse_values(parameters))
    with progress_bar(f"simulate {scenario}") as progress:
        log = run_simulation(axis, motion, truth=design_if_given(truth, effects), seed=seed, progress=progress)
    log.write_csv(output)
    doubts = doubts_of_simulation(axis, log)
    for doubt in doubts:
        print(f"pmsm-ctrl: {printable(output)}: warning: {doubt.text} [{doubt.code}]", file=sys.stderr)
    print(f"{printable(output)}: {len(log)} samples, {log.duration:.4g} s at {log.rate:.5g} Hz")
    print(textwrap.fill(", ".join(log), initial_indent="  ", subsequent_indent="  "))
    if json_file is not None:
        run: dict[str, Any] = {"scenario": scenario, "seed": seed, "output": str(output)}
        run |= {"warnings": [one.text for one in doubts], "warning_codes": [one.code for one in doubts]}
        held = {"samples": len(log), "duration": log.duration, "rate": log.rate}
        write_json(json_file, "simulate", run | held | {"channels": {name: log.unit(name) for name in log}})


@app.command()
def tune(
    design: DesignArgument,
    output: Annotated[Path | None, output_option("NEW_DESIGN", "write the design with its loops set")] = None,
    current: Annotated[
        str, typer.Option("--current", metavar="METHOD", help="modulus_optimum, pole_cancellation or bandwidth")
    ] = "modulus_optimum",
    speed: Annotated[
        str, typer.Option("--speed", metavar="METHOD", help="symmetrical_optimum, pole_placement or bandwidth")
    ] = "symmetrical_optimum",
    current_bandwidth: Annotated[
        float | None, above_zero("--current-bandwidth", "HZ", "crossover of the current loop")
    ] = None,
    speed_bandwidth: Annotated[
        float | None, above_zero("--speed-bandwidth", "HZ", "crossover of the speed loop")
    ] = None,
    phase_margin: Annotated[
        float, above_zero("--phase-margin", "DEG", "for the methods bandwidth and pole_placement")
    ] = 60.0,
    keep: Annotated[bool, typer.Option("--keep", help="check the gains of the design instead of tuning them")] = False,
    robust: Annotated[bool, typer.Option("--robust", help="keep the margins at all corners of the tolerances")] = False,
    filters: Annotated[
        bool,
        typer.Option(
            "--filters/--no-filters",
            help="use a filter against a resonance where it helps, which is the default, or never",
            show_default=False,
        ),
    ] = True,
    prove: Annotated[bool, typer.Option("--prove/--no-prove", help="check the loops on the simulated drive")] = True,
    seed: SeedOption = 0,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceGainsOption = False,
) -> None:
    """Tune the loops from the datasheet. Status 1, and no design, when a margin is too small or a check fails."""
    from pmsm_ctrl.errors import RequestError
    from pmsm_ctrl.tune import Specification, UnstableLoopError, assess
    from pmsm_ctrl.tune import tune as run_tuning

    wanted = Specification(
        current=current, speed=speed, current_bandwidth=current_bandwidth, speed_bandwidth=speed_bandwidth,
        phase_margin=phase_margin, robust=robust, filters=filters,
    )  # fmt: skip
    if keep and wanted != Specification():
        raise RequestError("--keep: excludes every option of a method, because the gains of the design are kept")
    axis = read_design(design, effects)
    try:
        with progress_bar(f"tune {axis.name}") as progress:
            if keep:
                result = assess(axis, prove=prove, seed=seed)
            else:
                result = run_tuning(axis, wanted, prove=prove, seed=seed, progress=progress)
    except UnstableLoopError as error:
        if report is not None:  # the Nyquist plot of the loop shows more than the line on stderr
            write_report(report, error.section())
        raise
    found = result.design if result.defended or force else None
    finish("tune", result, json_file=json_file, report=report, design=found, output=output)
    if not result.defended:
        _leave_undefended(result.against[0].text, output if found is None else None)


def _leave_undefended(why: str, output: Path | None) -> None:
    """Leave with status 1, and say of a design that it was not written."""
    if output is not None:
        print(f"pmsm-ctrl: {printable(output)}: not written: {why}; --force writes it", file=sys.stderr)
    raise typer.Exit(NEGATIVE)


@app.command()
def sweep(
    design: DesignArgument,
    truth: TruthOption = None,
    repeats: Annotated[int, typer.Option("--repeats", metavar="N", min=1, max=1000, help="records to average")] = 3,
    paper: Annotated[bool, typer.Option("--paper", help="compare with the table of the reference paper")] = False,
    output: NewDesignOption = None,
    seed: SeedOption = 0,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Run the reference experiment: friction from a speed staircase."""
    from pmsm_ctrl.errors import RequestError
    from pmsm_ctrl.identify import paper_table
    from pmsm_ctrl.identify import sweep as run_sweep

    axis = read_design(design, effects)
    if paper:
        if truth is not None or output is not None:
            raise RequestError("--paper: excludes --truth and --output, because the table has its own two plants")
        finish("paper", paper_table(axis, repeats=repeats, seed=seed), json_file=json_file, report=report)
        return
    plant = design_if_given(truth, effects)
    with progress_bar(f"sweep {axis.name}") as progress:
        result = run_sweep(axis, truth=plant, repeats=repeats, seed=seed, progress=progress)
    finish("sweep", result, json_file=json_file, report=report, design=result.design, output=output)


for command in (*LOG_COMMANDS, *FLEET_COMMANDS, *WORKBENCH_COMMANDS, *DRIVE_COMMANDS):
    app.command()(command)


@app.command()
def study(
    design: DesignArgument,
    log: LogsOption = None,
    holdout: HoldoutOption = None,
    output: Annotated[Path | None, output_option("FILE", "the report; default: reports/NAME.html, or NAME-2")] = None,
    history: Annotated[
        Path | None,
        typer.Option("--history", metavar="FILE", help="parameters of earlier studies; this study is added"),
    ] = None,
    complete: Annotated[
        bool, typer.Option("--complete", help="also compensate, track and export; some minutes")
    ] = False,
    mapping: MapOption = None,
    seed: SeedOption = 0,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    force: ForceOption = False,
) -> None:
    """Run the whole chain and write one HTML report.

    tune, sweep, identify and compare, and with --log diagnose, as far as design and log allow; with --complete also
    compensate, track and export.
    """
    from pmsm_ctrl.errors import RequestError
    from pmsm_ctrl.files import require_distinct, require_new, unused_name
    from pmsm_ctrl.next_steps import completed_beside
    from pmsm_ctrl.report import report_path
    from pmsm_ctrl.report import study as run_study

    axis = read_design(design, effects)
    if holdout is not None and log is None:
        raise RequestError("--holdout: needs --log, from which the model is identified")
    page = report_path(axis, output)
    if not force:
        page = page if output is not None else unused_name(page)
        require_new([page] if output is None else ())  # another study may run
    beside = completed_beside(page) if log is not None else None
    if beside is not None:
        require_distinct([beside], [design])
        require_new(() if force else [beside])
    if complete and not force and page.with_suffix("").exists():
        raise RequestError(f"{page.with_suffix('')}: exists; --force writes the exported files into it")
    measured = logs_if_given(log, axis, mapping)
    other = logs_if_given(holdout, axis, mapping)
    with progress_bar(f"study {axis.name}") as progress:
        result = run_study(
            axis, measured, holdout=other, output=page, seed=seed, history=history, complete=complete,
            command=command_line(), progress=progress,
        )  # fmt: skip
    if beside is not None:
        result.completed.write(beside)
    if json_file is not None:
        write_json(json_file, "study", result.to_dict())
    say(result)
    if beside is not None:
        print(printable(f"design: {beside}"))


@app.command("import")
def import_log(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="log file of a drive or a data logger")],
    design: Annotated[
        Path | None, typer.Option("--design", "-d", metavar="DESIGN", help="design whose [log] table is used")
    ] = None,
    output: Annotated[Path | None, output_option("LOG", "write it as canonical CSV")] = None,
    mapping: MapOption = None,
    rate: Annotated[
        float | None,
        typer.Option(
            "--rate",
            metavar="HZ",
            callback=known_rate,
            help="of a file without time; with --map t=COLUMN of a column that counts samples",
        ),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="accept a proposed mapping unasked")] = False,
    json_file: JsonOption = None,
    force: ForceOption = False,
) -> None:
    """Show how a log file is read, or propose how. Ends with the [log] table that reads it again."""
    from pmsm_ctrl.files import require_distinct, require_new, write_text

    beside = output.with_name(f"{output.stem}.log.toml") if output is not None else None
    if beside is not None:
        require_distinct([beside, *([json_file] if json_file else [])], [file, *([design] if design else [])])
        require_new(() if force else [beside])
    result = confirmed_import(file, design, mapping, yes=yes, json_file=json_file, rate=rate)
    if output is not None and beside is not None:
        result.log.write_csv(output)
        write_text(beside, result.table)
    finish("import", result, json_file=json_file, whole=True)
    keep_verdict(_still_doubted(result.log, design_if_given(design), mapping, written=output is not None))
    if output is not None and beside is not None:
        print(printable(f"log: {output}\nits [log] table, for a design: {beside}"))


def _still_doubted(log: Log, design: Design | None, mapping: list[str] | None, *, written: bool) -> str:
    """Return the channel that has to be confirmed before another command reads the log, or how what is written is."""
    from pmsm_ctrl.importers.confirmation import of_written, unconfirmed

    if written:
        wrong, stated = of_written(log, design, parse_map(mapping))
        return wrong or "\n".join(stated)
    doubts = unconfirmed(log, design, parse_map(mapping) | kept_mapping())
    return doubts[0][1] if doubts else ""


@app.command()
def effects(
    identifier: Annotated[
        str | None, typer.Argument(metavar="EFFECT", help="show this effect in full", autocompletion=effect_ids)
    ] = None,
    design: Annotated[
        Path | None, typer.Option("--design", "-d", metavar="DESIGN", help="simulate the effect's signature on it")
    ] = None,
    output: Annotated[Path | None, output_option("FILE", "draw the signature: .svg, .png or .pdf")] = None,
    own: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """List the effects of the catalogue. A named one is shown in full with its signature."""
    from pmsm_ctrl.effects import catalogue_with, lookup
    from pmsm_ctrl.errors import RequestError
    from pmsm_ctrl.rendering import to_text
    from pmsm_ctrl.report.catalogue import describe_effect, save_figure
    from pmsm_ctrl.report.present import catalogue_section

    known = catalogue_with(own or ())
    if identifier is None:
        if design is not None or output is not None or report is not None:
            raise RequestError("effects: --design, --output and --report need the name of one effect")
        print(to_text(catalogue_section(known.values())))
        if json_file is not None:
            write_json(json_file, "effects", {"effects": [describe_effect(e).to_dict() for e in known.values()]})
        return
    if output is not None and design is None:
        raise RequestError("--output: the signature is simulated, which needs --design")
    axis = design_if_given(design, own)
    if axis is not None and output is not None:
        axis.require_loops()  # the signature is simulated
    entry = describe_effect(lookup(identifier, known), axis)
    finish("effects", entry, json_file=json_file, report=report, whole=True)
    if output is not None:
        save_figure(entry.plot(), output)
        print(printable(f"signature: {output}"))


@app.command()
def schema(
    verb: Annotated[str | None, typer.Argument(metavar="VERB", help="a command with --json; all if left out")] = None,
) -> None:
    """Print the JSON Schema of what a command writes with --json."""
    import json

    from pmsm_ctrl.schemas import SCHEMAS, schema_of

    print(json.dumps(SCHEMAS if verb is None else schema_of(verb), indent=2, ensure_ascii=True))


# A verb's own help names what may stand behind every one.
for registered in app.registered_commands:
    if registered.name != "schema":
        registered.epilog = "Anywhere: --verbose prints all of a result, --debug a traceback."


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``pmsm-ctrl`` and exit with its status."""
    sys.exit(run(app, arguments))
