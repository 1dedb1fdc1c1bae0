"""Arguments and options that the commands share, and reading and writing of their files."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
import typer.core

from pmsm_ctrl.console import STDOUT, json_to_stdout, keep_mapping, parse_map, say_next, writable, write_json
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import FOUND_FREE, printable, require_distinct, require_new

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.effects import Effect
    from pmsm_ctrl.frf import MeasuredBode
    from pmsm_ctrl.importers import ImportReport, Proposal
    from pmsm_ctrl.log import Log

__all__ = [
    "DesignArgument", "DesignOption", "EffectsOption", "EstimateOption", "ForceGainsOption", "ForceOption",
    "HoldoutOption", "JsonOption",
    "LiveOption", "LogArgument", "LogsOption", "MapOption", "MethodOption", "NewDesignOption", "PolishOption",
    "ReportOption", "SeedOption", "TrackedArgument", "TruthOption", "Verb", "above_zero", "confirmed_import",
    "design_if_given", "effect_ids", "estimated_names", "known_rate", "load_logs", "logs_if_given", "measured_bode",
    "output_option", "read_design", "scenario_names", "write_design",
]  # fmt: skip


def output_option(metavar: str, text: str, *names: str) -> Any:
    """Option that names a file to write; a path that cannot be written is refused before the computation."""
    return typer.Option(*(names or ("--output", "-o")), callback=writable, metavar=metavar, help=text)


class Verb(typer.core.TyperCommand):
    """A command that is not run where an output is also an input, or exists, unless ``--force`` is given."""

    def __init__(self, *given: Any, **settings: Any) -> None:
        super().__init__(*given, **settings)
        for one in self.params:
            if one.param_type_name == "argument":
                _plain_argument(one)

    OUTPUTS = ("output", "json_file", "report", "history")
    EXTENDED = ("history",)  # is added to

    def invoke(self, ctx: Any) -> Any:
        """Run the command after a look at its numbers and at the files that it names.

        Raises
        ------
        RequestError
            For a number that is not finite, and an output that is an input or exists.
        """
        for one in self.params:
            value = ctx.params.get(str(one.name))
            if isinstance(value, float) and not math.isfinite(value):  # nan passes every bound
                raise RequestError(f"{one.opts[0]} {value}: a finite number was expected")
        named = [path for name in self.OUTPUTS if (path := ctx.params.get(name)) is not None and path != STDOUT]
        outputs = [Path(path) for path in named if "://" not in str(path)]  # what is remote is no file
        inputs = [one for name, value in ctx.params.items() if name not in self.OUTPUTS for one in _paths(value)]
        if outputs:
            require_distinct(outputs, inputs)
        FOUND_FREE.clear()
        if not ctx.params.get("force"):
            require_new(path for path in outputs if path not in [ctx.params.get(name) for name in self.EXTENDED])
        given, typed = dict(ctx.params), self._typed(ctx)
        with json_to_stdout() if ctx.params.get("json_file") == STDOUT else nullcontext():
            done = super().invoke(ctx)
            say_next(str(self.name), given, typed)
        return done

    def _typed(self, ctx: Any) -> list[str]:
        """Return the words that run the command again: all that was typed but what it writes."""
        words = [str(self.name)]
        for one in self.params:
            value = ctx.params.get(str(one.name))
            source = ctx.get_parameter_source(one.name)
            if one.name in (*self.OUTPUTS, "force") or source is None or source.name != "COMMANDLINE":
                continue
            if isinstance(value, bool):
                words.append(one.opts[0] if value else one.secondary_opts[0])
                continue
            named = [] if one.param_type_name == "argument" else one.opts[:1]
            if isinstance(value, OwnEffects):
                value = value.path
            for each in value if isinstance(value, (list, tuple)) else [value]:
                words += [*named, str(each)]
        return words


def _plain_argument(argument: Any) -> None:
    """Show an argument as ``DESIGN``, ``[NAME]`` or ``LOG...``, without the braces and types of newer typer."""
    name = argument.metavar or str(argument.name).upper()
    shown = name if argument.required else f"[{name}]"
    argument._usage_display_name = lambda: shown
    argument.display_type_rich = lambda ctx=None: None


def _paths(value: Any) -> Iterator[Path]:
    """Yield the files that an argument stands for; patterns and folders are expanded."""
    if isinstance(value, OwnEffects):
        yield value.path
    elif isinstance(value, Path):
        yield value
    elif isinstance(value, (list, tuple)) and value and all(isinstance(one, Path) for one in value):
        from pmsm_ctrl.importers.folders import log_files

        yield from log_files(value)


class OwnEffects(tuple["Effect", ...]):
    """The effects of a file, and the file."""

    path: Path


def _own_effects(path: str) -> OwnEffects:
    """Run the file of ``--effects`` and return what it defines; an id in use is refused before the work."""
    from pmsm_ctrl.effects import catalogue_with
    from pmsm_ctrl.effects.loading import load_effects

    own = OwnEffects(load_effects(path))
    own.path = Path(path)
    catalogue_with(own)
    return own


DesignArgument = Annotated[Path, typer.Argument(metavar="DESIGN", help="design in TOML; pmsm-ctrl init writes one")]
DesignOption = Annotated[Path, typer.Option("--design", "-d", metavar="DESIGN", help="design in TOML")]
EffectsOption = Annotated[
    Any,
    typer.Option(
        "--effects", metavar="FILE.py", parser=_own_effects, help="file with own effects; RUNS this file as Python code"
    ),
]
SEVERAL = "files, a quoted pattern such as 'run_*.csv', or a folder"
LogArgument = Annotated[
    list[Path], typer.Argument(metavar="LOG...", help=f"measured or simulated logs of one axis: {SEVERAL}")
]
TrackedArgument = Annotated[
    list[Path] | None, typer.Argument(metavar="LOG...", help=f"measured or simulated logs of one axis: {SEVERAL}")
]
LiveOption = Annotated[
    str | None,
    typer.Option("--live", metavar="SOURCE", help="a growing file, - for standard input, or ads://NETID, until Ctrl-C"),
]
EstimateOption = Annotated[
    str | None,
    typer.Option(
        "--estimate",
        metavar="NAMES",
        help="what is estimated beside F_c and F_v: T_load, J, T_load,J or none; "
        "by default T_load where the axis reverses, and J where it accelerates; with --live both",
    ),
]
LogsOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--log", metavar="LOG", help="measured log of this axis, a quoted pattern or a folder; may be repeated"
    ),
]
MapOption = Annotated[
    list[str] | None,
    typer.Option("--map", "-m", metavar="CHANNEL=COLUMN", help="such as omega='speed [rpm]'; may be repeated"),
]
JsonOption = Annotated[Path | None, output_option("FILE", "write the result as JSON; - for stdout", "--json")]
ReportOption = Annotated[Path | None, output_option("FILE", "write the result as one HTML page", "--report")]
HoldoutOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--holdout", metavar="LOG2", help="another log, for validation; nothing is fitted to it; may be repeated"
    ),
]
# Of every command that writes a file; `Verb` reads it. Commands use it for files whose names they make themselves.
ForceOption = Annotated[bool, typer.Option("--force", help="overwrite existing files")]
ForceGainsOption = Annotated[
    bool, typer.Option("--force", help="overwrite files, and write gains whose margins or checks are not met")
]
NewDesignOption = Annotated[Path | None, output_option("NEW_DESIGN", "write the design with the result")]
MethodOption = Annotated[
    str, typer.Option("--method", metavar="METHOD", help="regression, iv (instrumental variables) or output_error")
]
PolishOption = Annotated[
    bool, typer.Option("--polish/--no-polish", help="refine the parameters by simulation if validation improves")
]
TruthOption = Annotated[Path | None, typer.Option("--truth", metavar="DESIGN", help="the true plant, if it differs")]
SeedOption = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="seed of the simulated noise")]


# Completion imports the catalogue (half a second): a hand-written list would become outdated.
def effect_ids(incomplete: str) -> list[str]:
    """Return the effects whose id begins so."""
    from pmsm_ctrl.effects import CATALOGUE

    return [name for name in CATALOGUE if name.startswith(incomplete)]


def scenario_names(incomplete: str) -> list[str]:
    """Return the scenarios whose name begins so."""
    from pmsm_ctrl.simulate.scenarios import SCENARIOS

    return [name for name in SCENARIOS if name.startswith(incomplete)]


def read_design(path: Path, own: Iterable[Effect] | None = None) -> Design:
    """Return the design in a file, carrying these own effects; the module of designs is imported here."""
    from pmsm_ctrl.design import Design

    return Design.read(path).with_own_effects(*(own or ()))


def design_if_given(path: Path | None, own: Iterable[Effect] | None = None) -> Design | None:
    """Return the design of an option that may be left out."""
    return None if path is None else read_design(path, own)


def confirmed_import(
    file: Path,
    design: Path | None,
    mapping: list[str] | None,
    *,
    yes: bool,
    json_file: Path | None,
    rate: float | None = None,
) -> ImportReport:
    """Return the import of a file; what names with units do not settle is proposed, and has to be confirmed.

    Raises
    ------
    RequestError
        With the command that takes the proposal, where nobody confirmed it.
    LogError
        When the file cannot be read, or a stated mapping does not fit it.
    """
    from pmsm_ctrl.errors import LogError
    from pmsm_ctrl.importers import describe, open_table, propose
    from pmsm_ctrl.importers.clock import timed_by

    axis, known = design_if_given(design), parse_map(mapping)
    if rate is not None:
        known["t"] = timed_by(rate, known.get("t", ""))
        keep_mapping(known)
    try:
        report = describe(file, axis, known)
        if not report.assumed:
            return report
        refused = None
    except LogError as error:
        if not error.proposable:
            raise
        refused = error
    proposal = propose(open_table(file, axis), axis, known)
    if refused is not None and not proposal.guesses:
        raise refused
    taken = yes and proposal.complete  # the report ends with the same [log] table
    said = proposal.summary()
    print(said.rstrip().removesuffix(proposal.table.rstrip()).rstrip() + "\n" if taken else said)
    if taken or (proposal.complete and _agreed()):
        keep_mapping(proposal.mapping)
        return replace(describe(file, axis, proposal.mapping), accepted=proposal.notices)
    if json_file is not None:
        write_json(json_file, "proposal", proposal.to_dict())
    raise RequestError(_to_confirm(file, design, proposal))


def known_rate(rate: float | None) -> float | None:
    """Callback of ``--rate``: what no recorder has is refused; a bound of the option would be printed in the help."""
    if rate is not None and not 1e-6 <= rate <= 1e9:
        raise typer.BadParameter(f"{rate:g}: samples a second, between 1e-6 and 1e9, were expected")
    return rate


def above_zero(name: str, metavar: str, text: str) -> Any:
    """Return an option that takes a number above zero; a bound of the option would be printed in the help."""
    return typer.Option(name, metavar=metavar, callback=_require_above_zero, help=text)


def _require_above_zero(value: float | None) -> float | None:
    if value is not None and not 0.0 < value < math.inf:
        raise typer.BadParameter(f"{value:g}: a positive, finite number was expected")
    return value


def _agreed() -> bool:
    """Return whether a proposal is taken, asked on a terminal; nobody can be asked elsewhere."""
    if sys.stdin is None or not sys.stdin.isatty():
        return False
    try:
        return input("Read the file like this? [y/N] ").strip().lower() in (
            "y",
            "yes",
            "j",
            "ja",
            "o",
            "oui",
            "s",
            "si",
        )
    except EOFError:
        return False


def measured_bode(
    paths: list[Path], design: Design, source: Path, *, kind: str | None, unit: str | None, yes: bool
) -> MeasuredBode | None:
    """Return the measured Bode diagram in a file, once its doubts are confirmed; None where the files are logs.

    Raises
    ------
    RequestError
        When doubts are not confirmed; the message holds the command that does.
    """
    import shlex

    from pmsm_ctrl.frf import is_bode_file, read_response

    stated = kind is not None or unit is not None
    if not stated and not (len(paths) == 1 and is_bode_file(paths[0])):
        return None
    if len(paths) != 1:
        raise RequestError(f"{len(paths)} files given; one measured Bode diagram was expected")
    file = paths[0]
    given = read_response(file, design, kind=kind, unit=unit)
    print(printable("\n".join([f"{file}: {', '.join(given.columns)}", *given.doubts])), file=sys.stderr)
    if given.doubts and not (yes or _agreed()):
        typed = ["pmsm-ctrl", "frf", str(file), "--design", str(source), "--response", given.kind]
        typed += ["--unit", given.unit] if given.unit else []
        doubts = "; ".join(given.doubts)
        raise RequestError(f"{file}: not read: {doubts}; --yes takes it so, or: {shlex.join([*typed, '--yes'])}")
    return given


def _to_confirm(file: Path, design: Path | None, proposal: Proposal) -> str:
    """Return the message with the command that takes a proposal."""
    import shlex

    from pmsm_ctrl.importers.guessing import RATE_IS_OPEN
    from pmsm_ctrl.importers.naming import AS_STATED
    from pmsm_ctrl.importers.notices import UNUSABLE

    typed = ["pmsm-ctrl", "import", str(file), *(["--design", str(design)] if design is not None else [])]
    if any(guess.open_question == RATE_IS_OPEN for guess in proposal.guesses):
        typed += ["--rate", "HZ"]  # the rest is proposed again once there is a time, a rated torque among it
        columns = {g.channel: g.mapping for g in proposal.guesses if AS_STATED in g.reasons}
    else:
        columns = dict(proposal.mapping)
    for channel, column in columns.items():
        typed += ["--map", f"{channel}={column}"]
    for group in proposal.missing:
        typed += ["--map", f"{group.split()[-1]}=COLUMN [UNIT]"]
    if proposal.complete:
        return f"{file}: not read: the mapping has not been confirmed; --yes takes it, or: {shlex.join(typed)}"
    gaps = [notice.text for notice in proposal.found if notice.code in UNUSABLE]
    if gaps:
        return f"{file}: not read: {'; '.join(gaps)}"
    lacking = [*proposal.missing, *(f"{g.open_question} of {g.channel}" for g in proposal.guesses if g.open_question)]
    return f"{file}: not read: to be filled in: {', '.join(lacking)}: {shlex.join(typed)}"


def write_design(design: Design, path: Path | None) -> None:
    """Write a design where one was asked for, and print where it is."""
    if path is not None:
        design.write(path)
        print(printable(f"design: {path}"))


def load_logs(paths: Iterable[Path], design: Design, mapping: list[str] | None) -> list[Log]:
    """Return the logs that are meant, and print their notices on stderr.

    A unit in doubt has to be confirmed by `mapping`.
    """
    from pmsm_ctrl.importers import log_files, read_log, require_confirmed

    logs = []
    for path in log_files(paths):
        log = read_log(path, design, parse_map(mapping))
        require_confirmed(log, design, parse_map(mapping))
        for notice in log.provenance.notices:
            print(printable(f"pmsm-ctrl: {path}: warning: {notice.text} [{notice.code}]"), file=sys.stderr)
        logs.append(log)
    return logs


def logs_if_given(paths: Iterable[Path] | None, design: Design, mapping: list[str] | None) -> list[Log] | None:
    """Return the logs of an option that may be left out."""
    return load_logs(paths, design, mapping) if paths else None


def estimated_names(text: str | None) -> tuple[str, ...] | None:
    """Return what a tracker estimates beside F_c and F_v; None where that is left to it.

    Parameters
    ----------
    text : str or None
        Of ``--estimate``.

    Returns
    -------
    tuple of str, or None

    Raises
    ------
    RequestError
        For a name that it cannot estimate.
    """
    if text is None:
        return None
    from pmsm_ctrl.track import Settings

    return Settings(estimate=() if text == "none" else tuple(name.strip() for name in text.split(","))).estimate
