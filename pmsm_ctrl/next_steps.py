"""The command that usually follows a command: its last line."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.files import unused_name

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.design_parts import Compensation

__all__ = ["completed_beside", "exported_design", "next_step"]


def completed_beside(page: Path) -> Path:
    """Return where ``study`` writes the completed design: beside its page.

    Parameters
    ----------
    page : Path
        The HTML file of the study.
    """
    return page.with_suffix(".design.toml")


def exported_design(folder: Path) -> Path:
    """Return where ``export`` writes the design whose compensation its options state: into the folder.

    Parameters
    ----------
    folder : Path
    """
    return folder / f"{folder.name}.design.toml"


def next_step(
    verb: str,
    given: Mapping[str, Any],
    verdict: str = "",
    typed: Sequence[str] = (),
    recommended: Design | None = None,
) -> str:
    """Return the command that usually follows, fit to be pasted into a shell; empty where there is none.

    Parameters
    ----------
    verb : str
    given : dict of str to value
        The arguments and options of the command.
    verdict : str
        That of a comparison, a diagnosis or a compensation.
    typed : sequence of str
        The verb with its arguments and options, without what it writes: to run it again.
    recommended : Design or None
        The design with what a study of its compensation recommends.
    """
    design = (_written(given) if verb in WRITING else None) or given.get("design")
    logs = given.get("log") or ["LOG"]
    logs = [logs] if isinstance(logs, str | Path) else logs
    evaluated = (*logs, "--design", design, *_mapped(given))
    words: Sequence[Any] = ()
    match verb:
        case "track" | "frf" if verb == "track" or verdict == "doubted":  # no design, or none to be trusted
            words = ("identify", *evaluated, "--output", _new())
        case "frf" if verdict == "not_linear":
            words = ("simulate", given["design"], "--scenario", "multisine", "--output", "multisine.csv")
        case "tune" | "sweep" | "frf" if not _written(given) and not given.get("keep") and not given.get("paper"):
            words = (*typed, "--output", _new())  # what was found is in no file yet
        case "diagnose" if verdict in ("effects_missing", "consistent") and not _written(given):
            words = (*typed, "--output", _new())
        case "identify" | "compare" | "diagnose" if verdict == "implausible":
            words = ("import", logs[0], "--design", given.get("design"), *_mapped(given))
        case "simulate":
            words = (_reader(given), given["output"], "--design", design, "--output", _new())
        case "tune":
            words = ("study", design)
        case "sweep" | "quadrants":
            words = ("compensate", design)
        case "import":
            words = _after_import(given, verdict)
        case "compare" | "diagnose" if verdict == "consistent":
            words = ("track", *evaluated) if _simulated(design) is False else ("compensate", design)
        case "identify" | "compare":
            words = ("diagnose", *evaluated, *_holdout(given), "--output", _new())
        case "add" | "diagnose" if verb == "add" or verdict == "effects_missing":
            words = _after_model(given, logs, design)
        case "diagnose":  # the log decides nothing: another motion may
            words = ("effects",)
        case "frf":
            words = ("tune", design, "--output", _new())
        case "fleet":
            words = _after_fleet(given, verdict)
        case "compensate":
            words = _after_compensation(given, verdict, recommended)
        case "export":
            words = ("verify", "BEFORE", "AFTER", "--design", _exported(given))
        case "verify":
            words = _after_verification(given, verdict, design)
        case "study":
            words = _after_study(given)
        case "effects" if not given.get("identifier"):
            words = ("effects", "stribeck", "--design", "DESIGN")
        case "effects":
            words = ("add", given["identifier"], "--design", design or "DESIGN", "--log", "LOG", "--output", _new())
    own = given.get("effects") or given.get("own")
    if own and words and words[0] not in WITHOUT_EFFECTS and "--effects" not in words:
        words = (*words, "--effects", getattr(own, "path", own))  # that of a fleet is the file alone
    return " ".join(["pmsm-ctrl", *(_shown(str(word)) for word in words)]) if words else ""


def _after_verification(given: Mapping[str, Any], verdict: str, design: Any) -> tuple[Any, ...]:
    """Return how to follow a compensator that acts, and how to look again after the drive was changed."""
    if verdict == "limit_cycle":
        return "compensate", design
    if verdict in ("applied", "inconclusive"):
        return "track", given["after"], "--design", design, *_mapped(given)
    return "verify", given["before"], "AFTER", "--design", design, *_mapped(given)


def _after_fleet(given: Mapping[str, Any], verdict: str) -> tuple[Any, ...]:
    """Return the words that evaluate what was set aside or written, report it, or look at one axis of the page."""
    if verdict == "set_aside":
        return _again(given)
    if given["words"][:1] == ["example"] and not given.get("report"):
        return ("fleet", Path(given["words"][1]) / "run.toml")
    if "report" not in given["words"][:1] and not given.get("report"):
        return ("fleet", "report", _results(given), "--output", unused_name(Path("fleet.html")))
    # an axis of the page that lacks an effect, or changes
    log, design = given.get("odd") or ("", "")
    design = design or given.get("design") or "DESIGN"
    return ("diagnose", log or "LOG", "--design", design, *_mapped(given), "--output", _new())


def _after_compensation(given: Mapping[str, Any], verdict: str, recommended: Design | None) -> tuple[Any, ...]:
    """Return the words that export what is recommended: by options where it stands in no file."""
    design, step = given["design"], given.get("step", FINE_STEP)
    if recommended is None:
        if verdict == "not_resolved":  # neither another gain nor other loops make a finer encoder
            return ()
        finer = ("compensate", design, "--step", f"{FINE_STEP:g}")
        return finer if verdict == "finer_step" and step > FINE_STEP else ("tune", design, "--output", _new())
    own = recommended.compensation
    stated: tuple[str, ...] = ("--source", own.source, "--gain", f"{own.share:.6g}")
    if own.source != "observer":  # which needs no model of the friction
        stated = (*stated, "--feed", ",".join(own.effects))
    if _written(given) or _states(design, own):
        design, stated = _written(given) or design, ()
    folder = unused_name(Path(Path(str(given["design"])).name.split(".")[0] or "axis"))
    return ("export", design, *stated, "--language", "st", "--output", folder)


def _states(path: Path, wanted: Compensation) -> bool:
    """Whether a design states this compensation; one that cannot be read does not."""
    from pmsm_ctrl.design import Design

    try:
        return Design.read(path).compensation == wanted
    except DesignError:
        return False


def _exported(given: Mapping[str, Any]) -> Any:
    """Return the design that was exported."""
    options = (given.get(name) is not None for name in ("source", "gain", "feed"))
    if any(options) and given.get("output") and not Path(given["output"]).suffix:
        return exported_design(Path(given["output"]))
    return given["design"]


def _written(given: Mapping[str, Any]) -> Any:
    """Return the file that holds the design that was found: the design itself, or the JSON of the result."""
    told = given.get("json_file")
    return given.get("output") or (told if told is not None and Path(told).suffix == ".json" else None)


def _simulated(design: Any) -> bool | None:
    """Return whether a design can be simulated with its loops; None where it cannot be read."""
    from pmsm_ctrl.design import Design

    try:
        found = Design.read(design)
    except (DesignError, TypeError):
        return None
    return found.motor.electrical and found.loops is not None


def _after_model(given: Mapping[str, Any], logs: Sequence[Any], design: Any) -> tuple[Any, ...]:
    """Return the words after a fit whose errors are known: its compensation, or where it fails if it has no drive."""
    if _simulated(design):
        return ("compensate", design)
    return ("compare", (given.get("holdout") or logs)[0], "--design", design, *_mapped(given))


def _reader(given: Mapping[str, Any]) -> str:
    return "frf" if given.get("scenario") in EXCITED else "identify"


def _mapped(given: Mapping[str, Any]) -> list[str]:
    """Return the words that state the mapping of the logs again."""
    return [word for pair in given.get("mapping") or () for word in ("--map", pair)]


def _after_import(given: Mapping[str, Any], doubted: str) -> tuple[Any, ...]:
    """Return the words that compare the log as it was imported: as it was written, or by the same mapping.

    `doubted` is a channel whose unit or sign has to be confirmed first: no other command reads the log before. Or it is
    how the written log has to be read, one mapping a line.
    """
    if doubted and "=" not in doubted:
        design = ("--design", given["design"]) if given.get("design") else ()
        return ("import", given["file"], *design, *_mapped(given), "--map", f"{doubted}=COLUMN [UNIT]")
    if not given.get("design"):
        return ("init", "axis")
    again = {"mapping": doubted.splitlines()}
    log, mapped = (given["output"], _mapped(again)) if given.get("output") else (given["file"], _mapped(given))
    return ("compare", log, "--design", given["design"], *mapped)


def _again(given: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the words of a fleet's command that tries again what was set aside."""
    values = {name: value for name in ("design", "output", "scheduler") if (value := given.get(name))}
    values |= {"effects": given["effects"]} if given.get("effects") else {}
    stated = [word for name, value in values.items() for word in (f"--{name}", value)]
    return ("fleet", *given["words"], *stated, *_mapped(given), *(["--joint"] if given.get("joint") else []), "--retry")


def _holdout(given: Mapping[str, Any]) -> list[Any]:
    """Return the words that state the held-out logs again."""
    return [word for log in given.get("holdout") or () for word in ("--holdout", log)]


def _after_study(given: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the words after a study: with the completed design where one was written, and to write one where not."""
    design, logs = given["design"], given.get("log")
    if not logs:
        return ("import", "LOG", "--design", design)
    beside = completed_beside(given["output"]) if given.get("output") else None
    if beside is not None and beside.exists():
        if _simulated(beside) is False:
            return ("track", *logs, "--design", beside, *_mapped(given))
        # a complete study has compensated and exported
        return ("verify", "BEFORE", "AFTER", "--design", beside) if given.get("complete") else ("compensate", beside)
    return ("diagnose", *logs, "--design", design, *_mapped(given), *_holdout(given), "--output", _new())


# Commands whose output is a design, with which one goes on.
EXCITED = ("multisine", "chirp", "noise", "prbs")  # motions whose logs hold a frequency response
WRITING = ("tune", "sweep", "identify", "diagnose", "add", "frf")
WITHOUT_EFFECTS = ("import", "init", "fleet")
FINE_STEP = 2.0  # of the gain, per cent


def _results(given: Mapping[str, Any]) -> Any:
    """Return the folder of the results of a fleet: as stated, or as the manifest says."""
    from pmsm_ctrl.fleet import read_manifest

    source = given["words"][-1]
    stated = read_manifest(source).results if str(source).endswith(".toml") else "results"
    return given.get("output") or stated


def _shown(word: str) -> str:
    return word if word.isidentifier() and word.isupper() else shlex.quote(word)


def _new() -> Path:
    """Return a name for a design that is not taken yet: no command overwrites one."""
    return unused_name(Path("new.toml"))
