"""Shared by all commands: outputs, progress on stderr, errors as one line and an exit status."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO

from pmsm_ctrl.errors import CacheWarning, NextCommand, PmsmCtrlError, RequestError
from pmsm_ctrl.files import printable, require_writable, write_text

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.report import Headline
    from pmsm_ctrl.result import Result
    from pmsm_ctrl.section import Notice, Section

__all__ = [
    "BAD_INPUT",
    "DONE",
    "NEGATIVE",
    "STDOUT",
    "finish",
    "json_to_stdout",
    "keep_mapping",
    "parse_map",
    "parse_values",
    "progress_bar",
    "run",
    "say",
    "say_next",
    "writable",
    "write_json",
    "write_report",
]

DONE, NEGATIVE, BAD_INPUT = 0, 1, 2
INTERNAL = 70  # EX_SOFTWARE of sysexits.h: a fault of the program, not of its input
INTERRUPTED = 128 + signal.SIGINT
TERMINATED = 128 + signal.SIGTERM
BROKEN_PIPE = 128 + getattr(signal, "SIGPIPE", 13)
STDOUT = Path("-")  # of --json
ANYWHERE = ("--debug", "--verbose")  # global options that may stand anywhere
_shown: dict[str, Any] = {
    "brief": True,
    "verdict": "",
    "mapping": {},
    "recommended": None,
    "page": None,
    "odd": ("", ""),
}  # of the command that runs
_answers: list[TextIO] = []  # the standard output that `json_to_stdout` keeps
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)  # files that are written name themselves
ISSUES = "the project's issue tracker"


def run(command: Callable[..., Any], arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status; an error is one line on stderr.

    ``--debug`` anywhere on the line also shows the traceback and Python's warnings.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    _shown.update(brief="--verbose" not in words, verdict="", mapping={}, recommended=None, page=None, odd=("", ""))
    if not debug:
        # Warnings for users are notices of a result; warnings of libraries are for developers.
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", CacheWarning)
        warnings.showwarning = _show_warning
    # `kill` unwinds the stack, so that temporary files are removed.
    with contextlib.suppress(ValueError):  # only the main thread may set a handler
        signal.signal(signal.SIGTERM, _terminate)
    os.environ["MPLBACKEND"] = "agg"  # no command opens a window, and an unknown name would end one
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller (`>&-`); what is printed to None goes to stdout
            setattr(sys, name, io.TextIOWrapper(open(os.devnull, "wb"), encoding="utf-8"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):  # a Greek letter must not raise on a pipe without UTF-8
        sys.stdout.reconfigure(errors="replace")
    try:
        verb_words = [word for word in words if word not in ANYWHERE] or ["--help"]
        outcome = command(args=verb_words, prog_name="pmsm-ctrl", standalone_mode=False)
        if outcome == INTERRUPTED:  # typer turns an interrupt into this status, without a word
            raise KeyboardInterrupt
        sys.stdout.flush()
    except BaseException as error:
        # The reader of the pipe has exited (`pmsm-ctrl effects | head`). typer turns this into exit status 1,
        # which here means a negative answer.
        if isinstance(error, BrokenPipeError) or isinstance(error.__context__, BrokenPipeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return BROKEN_PIPE
        status, message = _explain(error)
        if isinstance(error, OSError) and error.filename is None and error.errno in FULL:
            status, message = BAD_INPUT, f"standard output: cannot be written ({error.strerror})"
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the rest fails at the end
        message += _following(error, words)
        if debug:
            import traceback

            traceback.print_exception(error, file=sys.stderr)
        if message:
            # control characters from a file must not reach the terminal
            shown = "".join(c if c.isprintable() else " " for c in message)
            with contextlib.suppress(OSError):  # a full disk behind it; the status says that it failed
                print(f"pmsm-ctrl: {' '.join(shown.split())}", file=sys.stderr, flush=True)
        return status
    return outcome if isinstance(outcome, int) else DONE


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    print(f"pmsm-ctrl: {message}", file=sys.stderr)


def _terminate(signum: int, frame: Any) -> NoReturn:
    sys.exit(TERMINATED)


def _following(error: BaseException, words: Sequence[str]) -> str:
    """Return the command that follows an error; none where it is the one that has just failed."""
    if not isinstance(error, PmsmCtrlError) or error.next_command is None:
        return ""
    importing = next((word for word in words if word not in ANYWHERE), "") == "import"
    if importing and error.next_command in (NextCommand.IMPORT, NextCommand.PROPOSE):
        return ""
    return f"; next: {error.next_command.value}"


def _explain(error: BaseException) -> tuple[int, str]:
    """Return the exit status and the one line for an exception."""
    if isinstance(error, PmsmCtrlError):
        return BAD_INPUT, str(error)
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else INTERNAL, ""
    if isinstance(error, KeyboardInterrupt) or type(error).__name__ == "Abort":
        return INTERRUPTED, "interrupted; no incomplete file was written"
    # Newer typer bundles click, older ones import it: the class differs, the method does not.
    if hasattr(error, "format_message"):
        context = getattr(error, "ctx", None)
        hint = f" (see {context.command_path} --help)" if context is not None else ""
        said = error.format_message().replace("Value error, ", "")  # as newer typer begins what an option refuses
        return BAD_INPUT, f"{said.rstrip('.')}{hint}"
    if isinstance(error, OSError) and error.filename is not None:
        return BAD_INPUT, f"{error.filename}: {error.strerror or error}"
    if isinstance(error, FileNotFoundError):  # of no file: of the current folder
        return BAD_INPUT, "the current folder does not exist any more; change to another one"
    if isinstance(error, MemoryError):
        return BAD_INPUT, "not enough memory for this input; use a shorter log"
    place = f"{type(error).__name__}: {error}"
    return INTERNAL, f"unexpected {place}. Please report it in {ISSUES} with the output of --debug"


def parse_map(entries: Sequence[str] | None) -> dict[str, str]:
    """Turn ``omega=speed [rpm]`` entries of ``--map`` into a mapping from channel to column.

    Raises
    ------
    RequestError
        For an entry without ``=`` or a channel that is named twice.
    """
    mapping: dict[str, str] = {}
    for entry in entries or ():
        channel, equals, column = (part.strip() for part in entry.partition("="))
        if not equals or not channel or not column:
            raise RequestError(f"--map '{entry}': CHANNEL='COLUMN [UNIT]' was expected, such as omega='speed [rpm]'")
        if channel in mapping:
            raise RequestError(f"--map: channel '{channel}' is given twice")
        mapping[channel] = column
    return mapping


@contextlib.contextmanager
def progress_bar(label: str) -> Iterator[Callable[[float], None]]:
    """Show a bar on stderr, where stderr is a terminal; yields a function that takes the share done, 0 to 1."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(printable(label), total=None)  # it moves until the share is known
        yield lambda share: progress.update(task, completed=share, total=1.0)


def parse_values(entries: Sequence[str] | None) -> dict[str, float]:
    """Turn ``speed_max=100`` entries of ``--set`` into numbers by name.

    Raises
    ------
    RequestError
        For an entry that is not NAME=NUMBER.
    """
    values: dict[str, float] = {}
    for entry in entries or ():
        name, _, text = (part.strip() for part in entry.partition("="))
        try:
            values[name] = float(text)
        except ValueError:
            raise RequestError(f"--set '{entry}': NAME=NUMBER was expected, such as speed_max=100") from None
    return values


def writable(path: Path | None) -> Path | None:
    """Callback of an option that names an output: what cannot be written is refused before the work begins."""
    if path is not None and path != STDOUT:
        require_writable(path)
    return path


def write_json(path: Path, verb: str, data: Mapping[str, Any]) -> None:
    """Write a result as JSON, atomically; a result that does not name its schema gets the verb's."""
    from pmsm_ctrl.result import jsonable

    content = {"schema": f"pmsm-ctrl/{verb}/1", **jsonable(data)}
    # a terminal or pipe of another encoding would get question marks
    plain = path == STDOUT and (_answers[-1].encoding or "ascii").lower().replace("-", "") != "utf8"
    text = json.dumps(content, indent=2, ensure_ascii=plain, allow_nan=False) + "\n"
    if path == STDOUT:
        print(text, end="", file=_answers[-1])
    else:
        write_text(path, text)


@contextlib.contextmanager
def json_to_stdout() -> Iterator[None]:
    """Keep standard output for the JSON of ``--json -``; what is printed besides goes to standard error."""
    _answers.append(sys.stdout)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        _answers.pop()


def say(result: Result, *, whole: bool = False) -> None:
    """Print a result: the verdict and its most important numbers, or all of it with ``--verbose``."""
    print(result.summary(brief=_shown["brief"] and not whole))
    _shown["verdict"] = str(getattr(result, "verdict", ""))
    _shown["recommended"] = getattr(result, "recommended", None)
    _shown["page"] = getattr(result, "path", None)


def keep_mapping(mapping: Mapping[str, str]) -> None:
    """Keep the mapping by which a log was read, for the command that follows."""
    _shown["mapping"] = dict(mapping)


def kept_mapping() -> dict[str, str]:
    """Return the mapping that was kept; empty where the one of the command line holds."""
    return dict(_shown["mapping"])


def keep_odd(log: str, design: str) -> None:
    """Keep the log of a fleet that the command which follows looks at, and its design; empty where not known."""
    _shown["odd"] = (log, design)


def keep_verdict(verdict: str) -> None:
    """Keep what the command that follows depends on, where the result does not say it."""
    _shown["verdict"] = verdict


def say_next(verb: str, given: Mapping[str, Any], typed: Sequence[str] = ()) -> None:
    """Print the command that usually follows, where another one is known; `typed` runs this one again."""
    from pmsm_ctrl.next_steps import next_step

    if _shown["mapping"]:  # confirmed while the command ran
        given = {**given, "mapping": [f"{channel}={column}" for channel, column in _shown["mapping"].items()]}
    if verb == "fleet":
        given = {**given, "odd": _shown["odd"]}  # which the fleet's report names
    if verb == "study" and _shown["page"] is not None:
        given = {**given, "output": _shown["page"]}
    line = next_step(verb, given, _shown["verdict"], typed, _shown["recommended"])
    if line:  # source code on standard output stays as it is
        print(
            printable(f"next: {line}"),
            file=sys.stderr if verb == "export" and given.get("output") is None else sys.stdout,
        )


def finish(
    verb: str,
    result: Result,
    *,
    json_file: Path | None = None,
    report: Path | None = None,
    whole: bool = False,
    design: Design | None = None,
    output: Path | None = None,
) -> None:
    """Write the design that was found, the JSON of a result with it and its report, and then print the summary.

    What reads the output may end after its first lines: no file is lost by that.
    """
    written = []
    if design is not None and output is not None:
        design.write(output)
        written.append(f"design: {output}")
    if json_file is not None:
        found = {} if design is None else {"design": design.to_dict()}
        write_json(json_file, verb, {**result.to_dict(), **found})
    if report is not None:
        from pmsm_ctrl.report import headline_of

        headline = headline_of(result)
        _write_page(report, result.section(), headline, result.notices if headline is not None else ())
        written.insert(0, f"report: {report}")
    say(result, whole=whole)
    for line in written:
        print(printable(line))


def write_report(
    path: Path, section: Section, headline: Headline | None = None, notices: Sequence[Notice] = ()
) -> None:
    """Write one section as an HTML page of its own and print where it is; `notices` stand on its first screen."""
    _write_page(path, section, headline, notices)
    print(printable(f"report: {path}"))


def _write_page(path: Path, section: Section, headline: Headline | None, notices: Sequence[Notice]) -> None:
    from pmsm_ctrl.report import render

    text = render(section.title, [section.without(notices)], headline=headline, notices=notices, command=command_line())
    write_text(path, text)


def command_line() -> str:
    """Return the command as it was typed, fit to be pasted into a shell."""
    import shlex

    return shlex.join(["pmsm-ctrl", *sys.argv[1:]])
