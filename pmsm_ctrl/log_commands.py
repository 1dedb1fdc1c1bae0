"""The commands that evaluate logs: identify, compare, diagnose, add, track, frf, verify and quadrants."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from pmsm_ctrl.console import NEGATIVE, finish, progress_bar
from pmsm_ctrl.errors import NotExcitedError, RequestError
from pmsm_ctrl.files import printable
from pmsm_ctrl.gates import (
    ComparedOption,
    FailOnOption,
    MaxErrorLeftOption,
    MaxErrorOption,
    OutcomeOption,
    require_accepted,
    require_applied,
)
from pmsm_ctrl.options import (
    DesignOption,
    EffectsOption,
    EstimateOption,
    ForceOption,
    HoldoutOption,
    JsonOption,
    LiveOption,
    LogArgument,
    MapOption,
    MethodOption,
    NewDesignOption,
    PolishOption,
    ReportOption,
    SeedOption,
    TrackedArgument,
    effect_ids,
    estimated_names,
    load_logs,
    logs_if_given,
    measured_bode,
    output_option,
    read_design,
)

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.identify import Method
    from pmsm_ctrl.log import Log

__all__ = ["LOG_COMMANDS"]


def identify(
    log: LogArgument,
    design: DesignOption,
    method: MethodOption = "regression",
    cutoff: Annotated[
        float | None,
        typer.Option("--cutoff", metavar="HZ", min=0.1, help="low-pass of both sides; found from the log if left out"),
    ] = None,
    output: NewDesignOption = None,
    mapping: MapOption = None,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Identify inertia and friction from a log. Status 1, and no design, when the given one is better."""
    with progress_bar("identify") as progress:
        from pmsm_ctrl.identify import identify as run_identification
        from pmsm_ctrl.regression.conditioning import Processing

        axis = read_design(design, effects)
        records = load_logs(log, axis, mapping)
        processing = None if cutoff is None else Processing(cutoff=cutoff)
        chosen = cast("Method", method)
        result = run_identification(
            axis, records, method=chosen, processing=processing, check_cutoff=True, check_method=True, progress=progress
        )
    found = result.design if result.improved else None
    finish("identify", result, json_file=json_file, report=report, design=found, output=output)
    if not result.improved:
        raise typer.Exit(NEGATIVE)


def compare(
    log: LogArgument,
    design: DesignOption,
    holdout: HoldoutOption = None,
    fail_on: ComparedOption = None,
    max_error: MaxErrorOption = None,
    mapping: MapOption = None,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Compare the predictions of a design with a log. Errors are given by channel."""
    with progress_bar(f"compare {design.stem}") as progress:
        from pmsm_ctrl.compare import compare as run_comparison

        axis = read_design(design, effects)
        other = logs_if_given(holdout, axis, mapping)
        records = load_logs(log, axis, mapping)
        result = run_comparison(axis, records, holdout=other, progress=progress)
    finish("compare", result, json_file=json_file, report=report)
    require_accepted(result.verdict, result.records, fail_on, max_error)


def diagnose(
    log: LogArgument,
    design: DesignOption,
    holdout: HoldoutOption = None,
    output: NewDesignOption = None,
    calibrate: Annotated[
        int,
        typer.Option(
            "--calibrate",
            metavar="COUNT",
            min=0,
            max=10_000,
            help="simulations to estimate the false-alarm rate",
        ),
    ] = 0,
    fail_on: FailOnOption = None,
    max_error: MaxErrorLeftOption = None,
    polish: PolishOption = False,
    response: Annotated[
        Path | None,
        typer.Option("--frf", metavar="FRF.json", help="result of frf --json: its resonance is searched too"),
    ] = None,
    mapping: MapOption = None,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Find the physical effects that a design lacks. Status 1, and no design, when the given one is better."""
    with progress_bar(f"diagnose {log[0].name}{' and others' if len(log) > 1 else ''}") as progress:
        from pmsm_ctrl.diagnose import diagnose as run_diagnosis
        from pmsm_ctrl.diagnose.resonance import read_measured

        start = None if response is None else read_measured(response)
        axis = read_design(design, effects)
        other = logs_if_given(holdout, axis, mapping)
        measured = load_logs(log, axis, mapping)
        result = run_diagnosis(
            axis, measured, holdout=other, progress=progress, calibrate=calibrate, polish=polish, start=start
        )
    found = result.design if result.improved else None
    finish("diagnosis", result, json_file=json_file, report=report, design=found, output=output)
    if not result.improved:
        raise typer.Exit(NEGATIVE)
    require_accepted(result.verdict, result.records, fail_on, max_error)


def add(
    effect: Annotated[
        str,
        typer.Argument(metavar="EFFECT", help="such as stribeck; see pmsm-ctrl effects", autocompletion=effect_ids),
    ],
    design: DesignOption,
    log: Annotated[
        list[Path], typer.Option("--log", metavar="LOG", help="log its parameters are fitted to; may be repeated")
    ],
    output: Annotated[Path, output_option("NEW_DESIGN", "the design to write")],
    holdout: HoldoutOption = None,
    polish: PolishOption = False,
    mapping: MapOption = None,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: Annotated[
        bool,
        typer.Option("--force", help="overwrite files, and write an effect that the log does not support"),
    ] = False,
) -> None:
    """Add an effect to a design, fitted to a log. Status 1, and no design, when the log does not support it."""
    with progress_bar(f"add {effect}") as progress:
        from pmsm_ctrl.diagnose.adding import added

        axis = read_design(design, effects)
        other = logs_if_given(holdout, axis, mapping)
        measured = load_logs(log, axis, mapping)
        result = added(axis, measured, effect, holdout=other, polish=polish, progress=progress)
    found = result.design if result.improved and (result.supported or force) else None
    finish("add", result, json_file=json_file, report=report, design=found, output=output)
    if found is None:
        why = f"{result.against[0]}; --force writes it" if result.improved else result.warnings[0]
        print(f"pmsm-ctrl: {printable(output)}: not written: {why}", file=sys.stderr)
        raise typer.Exit(NEGATIVE)


def track(
    design: DesignOption,
    log: TrackedArgument = None,
    live: LiveOption = None,
    idle: Annotated[
        float | None,
        typer.Option("--idle", metavar="S", min=0.1, help="with --live: end when nothing came for this time"),
    ] = None,
    window: Annotated[
        float,
        typer.Option("--window", metavar="S", min=0.1, help="with --live: motion of a record; alarms compare records"),
    ] = 10.0,
    estimate: EstimateOption = None,
    mapping: MapOption = None,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Track F_c and F_v over a log or a live stream. An extended Kalman filter estimates them."""
    from pmsm_ctrl.live_command import watch_source
    from pmsm_ctrl.log import as_logs
    from pmsm_ctrl.track import Settings
    from pmsm_ctrl.track import track as run_tracking

    names = estimated_names(estimate)  # an unknown name is refused before the log is read
    axis = read_design(design, effects)
    if live is not None or not log:
        watched = watch_source(axis, live, log, mapping=mapping, estimate=names, idle=idle, window=window)
        finish("track", watched, json_file=json_file, report=report)
        return
    logs = load_logs(log, axis, mapping)
    measured = all("theta" in one for one in as_logs(logs))
    settings = None if names is None else Settings(measure="theta" if measured else "omega", estimate=names)
    result = run_tracking(axis, logs, settings)
    finish("track", result, json_file=json_file, report=report)


def frf(
    log: LogArgument,
    design: DesignOption,
    output: NewDesignOption = None,
    response: Annotated[
        str | None,
        typer.Option("--response", metavar="plant|open|closed", help="what a measured Bode diagram describes"),
    ] = None,
    unit: Annotated[
        str | None, typer.Option("--unit", metavar="UNIT", help="unit of a plant response, such as rpm/A")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="accept what was inferred from a Bode file")] = False,
    mapping: MapOption = None,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Measure the frequency response of the axis. From logs or a Bode file; compared with the design's.

    Status 1 where --output is given and the log holds no excitation: then no design is written.
    """
    from pmsm_ctrl.frf import frf as measure

    axis = read_design(design, effects)
    given = measured_bode(log, axis, design, kind=response, unit=unit, yes=yes)
    try:
        result = measure(axis, load_logs(log, axis, mapping) if given is None else given)
    except NotExcitedError as error:
        if output is None:
            raise
        print(f"pmsm-ctrl: {printable(output)}: not written: {printable(error)}", file=sys.stderr)
        raise typer.Exit(NEGATIVE) from error
    found = result.measured if result.trusted else None
    finish("frf", result, json_file=json_file, report=report, design=found, output=output)
    if not result.trusted and output is not None:
        print(f"pmsm-ctrl: {printable(output)}: not written: {result.notices[0].text}", file=sys.stderr)
        raise typer.Exit(NEGATIVE)


def verify(
    before: Annotated[Path, typer.Argument(metavar="BEFORE", help="log before the download of the compensator")],
    after: Annotated[Path, typer.Argument(metavar="AFTER", help="log of the same motion after it")],
    design: DesignOption,
    fail_on: OutcomeOption = None,
    mapping: MapOption = None,
    seed: SeedOption = 0,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Check whether a downloaded compensator acts. Its gain, its delay and the error before and after are found."""
    from pmsm_ctrl.verify import verify as run_verification

    axis = read_design(design, effects)
    logs = [_single(path, axis, mapping) for path in (before, after)]
    with progress_bar(f"verify {after.name}") as progress:
        result = run_verification(axis, logs[0], logs[1], seed=seed, progress=progress)
    finish("verify", result, json_file=json_file, report=report)
    require_applied(result.verdict.value, fail_on)


def quadrants(
    x: Annotated[Path, typer.Argument(metavar="X", help="log of the first axis of a circle")],
    y: Annotated[Path, typer.Argument(metavar="Y", help="log of the second axis, from the same trigger")],
    design: DesignOption,
    after: Annotated[
        list[Path] | None, typer.Option("--after", metavar="LOG", help="the same after a change: X, then Y")
    ] = None,
    mapping: MapOption = None,
    mapping_y: Annotated[
        list[str] | None,
        typer.Option("--map-y", metavar="CHANNEL=COLUMN", help="of the second axis, where it differs from --map"),
    ] = None,
    effects: EffectsOption = None,
    json_file: JsonOption = None,
    report: ReportOption = None,
    force: ForceOption = False,
) -> None:
    """Measure the quadrant errors of a circle. They can be compared before and after a change."""
    from pmsm_ctrl.verify import quadrants as measure

    axis = read_design(design, effects)
    maps = (mapping, mapping_y or mapping) * 2
    logs = [_single(path, axis, one) for path, one in zip((x, y, *_pair(after)), maps, strict=False)]
    result = measure(logs[0], logs[1], (logs[2], logs[3]) if after else None)
    finish("quadrants", result, json_file=json_file, report=report)


def _pair(after: list[Path] | None) -> list[Path]:
    if after and len(after) != 2:
        raise RequestError(f"--after: {len(after)} given; two were expected, the log of X and that of Y")
    return after or []


def _single(path: Path, axis: Design, mapping: list[str] | None) -> Log:
    logs = load_logs([path], axis, mapping)
    if len(logs) != 1:
        raise RequestError(f"{path}: {len(logs)} logs; one file was expected")
    return logs[0]


LOG_COMMANDS = (identify, compare, diagnose, add, track, frf, verify, quadrants)
