"""What the process of a session computes: it calls the verbs, and leaves curves in the session's folder.

A task gets plain values and returns plain values. Logs and fits are kept from one call to the next; a fresh process
makes them again from the same request.
"""

from __future__ import annotations

import hashlib
import json
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.errors import PmsmCtrlError, RequestError
from pmsm_ctrl.files import write_text
from pmsm_ctrl.workbench.curves import overview, write_curves
from pmsm_ctrl.workbench.memory import array_bytes
from pmsm_ctrl.workbench.own import bound

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.diagnose import Diagnosis, ModelErrors, Stepwise
    from pmsm_ctrl.importers import ImportReport
    from pmsm_ctrl.log import Log

__all__ = [
    "PROGRESS",
    "STOP",
    "StoppedError",
    "fitted",
    "forget",
    "logs_of",
    "prepare",
    "preview",
    "read",
    "solve",
]

PROGRESS, STOP = "progress.json", "stop"  # files of the session's folder by which a task and the server talk
KEPT = 24  # fits, undone ones among them
MOST_BYTES = 1 << 29  # of the arrays of all of them; what was forgotten is computed again
Request = Mapping[str, Any]

_designs: dict[str, Design] = {}
_logs: OrderedDict[Path, tuple[str, Log, ImportReport]] = OrderedDict()  # by file: how it was read, and what
_shown: OrderedDict[str, dict[str, Any]] = OrderedDict()
_fits: OrderedDict[str, tuple[Stepwise, Diagnosis | None]] = OrderedDict()


class StoppedError(RequestError):
    """The user has ended a search."""


def prepare() -> None:
    """Import the verbs, and leave Ctrl-C to the server."""
    import signal
    import warnings

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore")  # what users have to know is a notice of a result
    import pmsm_ctrl.diagnose
    import pmsm_ctrl.importers  # noqa: F401


def _digest(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def design_of(text: str) -> Design:
    """Return the design of a TOML text; it is read once."""
    from pmsm_ctrl.design import Design

    if text not in _designs:
        _designs[text] = Design.from_toml(text)
    return _designs[text]


# -- logs ---------------------------------------------------------------------------------------------------------


def read(folder: str, entry: Request, design: str) -> dict[str, Any]:
    """Read an uploaded file: its channels, what was understood, and what is doubtful.

    Parameters
    ----------
    folder : str
        Of the session.
    entry : dict
        ``id``, ``file``, ``name`` and ``mapping``.
    design : str
        As TOML.

    Returns
    -------
    dict
        ``columns`` of the file always; ``error``, or all the rest.
    """
    from pmsm_ctrl.importers import open_table
    from pmsm_ctrl.importers.table import one_line
    from pmsm_ctrl.result import jsonable

    given = design_of(design)
    columns: list[dict[str, str]] = []
    try:
        table = open_table(Path(folder) / entry["file"], given, entry["name"])
        columns = [
            {"label": one_line(column.label)[:80], "unit": one_line(column.unit)[:20]}
            for column in table.columns[:MOST_COLUMNS]
        ]
        log, report = _described(folder, entry, design)
        facts = _facts(log, report, given, entry)
        curves = f"{entry['id']}.curves-{_digest([entry['mapping'], design])[:10]}"
        if not (Path(folder) / curves / "index.json").exists():
            write_curves(Path(folder) / curves, {"t": log.t} | {name: log[name] for name in log if name != "t"})
        return jsonable({"columns": columns, "error": "", "curves": curves, **facts})
    except PmsmCtrlError as error:
        return {"columns": columns, "error": _without_options(str(error)), "curves": ""}


MOST_COLUMNS = 400


def _without_options(message: str) -> str:
    """Leave out of a message what only a command line understands."""
    return message.partition(" (name them in [log.channels]")[0].partition("; --map ")[0]


def _described(folder: str, entry: Request, design: str) -> tuple[Log, ImportReport]:
    """Return the whole log and the report on its file."""
    from pmsm_ctrl.importers import describe

    path, read = Path(folder) / entry["file"], _digest([entry["mapping"], design])
    if path not in _logs or _logs[path][0] != read:
        _logs.pop(path, None)
        report = describe(path, design_of(design), entry["mapping"] or None, name=entry["name"])
        report.log.check_evaluable(3)
        for gone in [one for one in _logs if not one.exists()]:  # removed from their session
            del _logs[gone]
        _logs[path] = read, report.log, report
        while len(_logs) > 1 and sum(len(log) * len(log.channels) for _, log, _ in _logs.values()) > MOST_VALUES:
            _logs.popitem(last=False)
    _logs.move_to_end(path)
    return _logs[path][1:]


MOST_VALUES = 1.5e8  # of all logs that are kept, 1.2 GB


def _facts(log: Log, report: ImportReport, design: Design, entry: Request) -> dict[str, Any]:
    from pmsm_ctrl.importers import unconfirmed

    open_doubts = unconfirmed(log, design, entry["mapping"])
    blocked = {notice.text: channel for notice, channel in open_doubts}
    return {
        "format": report.log.provenance.importer,
        "motion": log.motion,
        "samples": len(log),
        "start": float(log.t[0]),
        "stop": float(log.t[-1]),
        "rate": log.rate,
        "channels": [
            {
                "channel": one.channel, "number": one.number, "label": one.column, "unit": one.unit,
                "stated": one.stated_unit, "gain": one.gain, "how": one.how, "assumed": one.assumed_unit,
                "low": one.minimum, "high": one.maximum,
                "picture": overview(log[one.channel]) if one.channel != "t" else [],
            }
            for one in report.channels
        ],
        "unused": list(report.unused[:40]),
        "notes": list(log.provenance.notes),
        "doubts": [
            {"code": notice.code, "text": notice.text, "channel": blocked.get(notice.text, "")}
            for notice in report.notices
        ],
    }  # fmt: skip


def logs_of(request: Request, role: str) -> list[Log]:
    """Return the logs of a request that have a role, cut to their windows.

    Parameters
    ----------
    request : dict
    role : {"fit", "holdout"}

    Returns
    -------
    list of Log

    Raises
    ------
    RequestError
        When a doubt about a unit or a sign is not settled.
    """
    from pmsm_ctrl.importers import unconfirmed

    out = []
    for entry in request["logs"]:
        if entry["role"] != role:
            continue
        log, _ = _described(request["folder"], entry, request["design"])
        for notice, channel in unconfirmed(log, design_of(request["design"]), entry["mapping"]):
            raise RequestError(f"{entry['name']}: {notice.text}; choose the unit of {channel} in step 2")
        window = entry.get("window")
        out.append(log.between(*window) if window else log)
    return out


# -- fits ---------------------------------------------------------------------------------------------------------


def fitted(request: Request, steps: Sequence[Mapping[str, Any]]) -> tuple[Stepwise, Diagnosis | None]:
    """Return the model after some steps, and the diagnosis where the last of them was a search.

    Parameters
    ----------
    request : dict
        ``folder``, ``design`` and ``logs``.
    steps : sequence of dict
        ``{"add": name}``, ``{"remove": name}`` or ``{"find": true}``, from the base model on.

    Returns
    -------
    (Stepwise, Diagnosis or None)

    Raises
    ------
    RequestError
        When no log is marked to be fitted, or a step is not possible.
    """
    from pmsm_ctrl.diagnose import stepwise

    key = _key(request, steps)
    if key in _fits:
        _fits.move_to_end(key)
        return _fits[key]
    made: tuple[Stepwise, Diagnosis | None]
    if not steps:
        fit, held = logs_of(request, "fit"), logs_of(request, "holdout")
        if not fit:
            raise RequestError("no log is marked 'fit'; mark at least one in step 2")
        made = stepwise(bound(design_of(request["design"]), request), fit, holdout=held or None), None
    else:
        before, last = fitted(request, steps[:-1])[0], steps[-1]
        if "add" in last:
            made = before.add(last["add"]), None
        elif "remove" in last:
            made = before.remove(last["remove"]), None
        else:
            talk = _Talk(Path(request["folder"]))
            made = before.find(progress=talk.progress, each=talk.accepted)
    _fits[key] = made
    forget(_fits)
    return made


def forget(fits: OrderedDict[str, Any]) -> None:
    """Drop the oldest fits beyond `KEPT` and beyond `MOST_BYTES`; the last one stays.

    Parameters
    ----------
    fits : ordered dict
        Changed in place.
    """
    while len(fits) > KEPT or (len(fits) > 1 and array_bytes(fits.values()) > MOST_BYTES):
        fits.popitem(last=False)


def _key(request: Request, steps: Sequence[Mapping[str, Any]]) -> str:
    """Name a model by all that it depends on."""
    logs = [{k: entry.get(k) for k in ("id", "mapping", "role", "window")} for entry in request["logs"]]
    return _digest([request["folder"], request["design"], request.get("code", ""), logs, list(steps)])


class _Talk:
    """Tells the server through files how far a search is, and hears that it shall stop."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.share = 0.0
        self.models: list[dict[str, Any]] = []

    def progress(self, share: float) -> None:
        if (self.folder / STOP).exists():
            raise StoppedError("the search was stopped; the effects that were added before are kept")
        self.share = max(share, self.share)
        self._write()

    def accepted(self, one: ModelErrors) -> None:
        self.models.append(_model_errors(one))
        self._write()

    def _write(self) -> None:
        write_text(self.folder / PROGRESS, json.dumps({"share": self.share, "models": self.models}))


def _model_errors(one: ModelErrors) -> dict[str, Any]:
    from pmsm_ctrl.result import jsonable

    return jsonable({"name": one.name, "errors": one.errors, "holdout": one.holdout})


def solve(request: Request) -> dict[str, Any]:
    """Fit the model as it stands, and return what a page shows of it.

    Parameters
    ----------
    request : dict
        ``folder``, ``design``, ``logs`` and ``steps``.

    Returns
    -------
    dict
    """
    from pmsm_ctrl.effects.catalogue import catalogue_of
    from pmsm_ctrl.rendering.numbers import with_error
    from pmsm_ctrl.result import jsonable
    from pmsm_ctrl.units import axis_unit, axis_words

    key = _key(request, request["steps"])
    model, diagnosis = fitted(request, request["steps"])
    if key in _shown:
        return _shown[key] | jsonable({"records": _records(request, model)})
    design, catalogue = model.design, catalogue_of(bound(design_of(request["design"]), request))
    given = len(design_of(request["design"]).effects)
    _shown[key] = jsonable({
        "models": [_model_errors(one) for one in model.models],
        "names": model.names,
        "cutoff": model.cutoff,
        "floor": {name: error["relative"] for name, error in model.noise_floor.items()},
        "titles": {name: effect.title_on(design.motion) for name, effect in catalogue.items()},
        "candidates": [_candidate(one, catalogue, design.motion) for one in model.rank()],
        "effects": [
            {
                "id": entry.id, "title": catalogue[entry.id].title_on(design.motion), "given": k < given,
                "parameters": [
                    f"{symbol} = "
                    + with_error(value, entry.stderr.get(symbol, 0.0),
                                 axis_unit(catalogue[entry.id].parameter(symbol).unit, design.motion))
                    for symbol, value in entry.parameters.items()
                ],
                "meanings": [
                    axis_words(catalogue[entry.id].parameter(symbol).description, design.motion)
                    for symbol in entry.parameters
                ],
            }
            for k, entry in enumerate(design.effects)
        ],
        "verdict": _verdict(diagnosis),
        "alike": _alike(diagnosis, catalogue),
    })  # fmt: skip
    while len(_shown) > KEPT:
        _shown.popitem(last=False)
    return _shown[key] | jsonable({"records": _records(request, model)})


def _candidate(one: Any, catalogue: Mapping[str, Any], motion: str) -> dict[str, Any]:
    identifier = one.effect.split(" ")[0]
    effect = catalogue.get(identifier)
    return {
        "name": one.effect, "id": identifier, "title": effect.title_on(motion) if effect else identifier,
        "explained": one.explained, "p": one.p_value, "why_not": one.why_not, "advised": one.refusal is None,
        "needs": effect.needs if effect else "", "look_alikes": list(effect.look_alikes) if effect else [],
        "possible": one.refusal is None or one.refusal.reason.value not in ("unavailable", "not_independent"),
    }  # fmt: skip


def _alike(diagnosis: Diagnosis | None, catalogue: Mapping[str, Any]) -> list[dict[str, list[str]]]:
    """Return for every effect that a search found what this log cannot tell from it, and which look-alikes it can."""
    if diagnosis is None:
        return []
    judged = {
        one.effect.split(" ")[0]
        for one in diagnosis.ranking
        if one.refusal is not None and one.refusal.reason.value not in NOT_JUDGED
    }
    return [
        {
            "same": list(step.equivalents),
            "apart": [one for one in catalogue[step.effect].look_alikes if one in judged - {*step.equivalents}],
        }
        for step in diagnosis.steps
    ]


NOT_JUDGED = ("unavailable", "not_independent", "not_excited")  # reasons for which a look-alike was not compared


def _verdict(diagnosis: Diagnosis | None) -> dict[str, Any] | None:
    from pmsm_ctrl.diagnose import verdict_text

    if diagnosis is None:
        return None
    text = verdict_text(diagnosis)
    reasons = [notice.text for notice in diagnosis.reasons[:1]]
    return {"text": f"{text[0].upper()}{text[1:]}", "code": diagnosis.verdict.value, "reasons": reasons}


def _records(request: Request, model: Stepwise) -> list[dict[str, Any]]:
    """Write the curves of the fitted records and of every held-out one, and return what can be drawn of them."""
    out = []
    key = _digest([request["design"], request.get("code", ""), request["logs"], request["steps"]])[:12]
    for number in (None, *range(len(model.held_out_names))):
        over = model.coordinates(number)
        columns: dict[str, Any] = {}
        balances = []
        every = (
            {channel: model.contributions(channel) for channel in model.balances}
            if number is None
            else model.held_out(number)
        )
        for channel, parts in every.items():
            columns = columns or {"t": parts.t, "used": parts.used}
            columns |= {f"{channel}:measured": parts.measured, f"{channel}:predicted": parts.predicted}
            columns[f"{channel}:residual"] = parts.residual()
            columns |= {f"{channel}:part:{name}": values for name, values in parts.effects.items()}
            balances.append({
                "name": channel, "unit": parts.unit, "parts": list(parts.effects), "products": parts.products,
                "size": parts.size, "count": int(parts.used.sum()),
            })  # fmt: skip
        columns |= {f"over:{label}": values for label, values in over.items()}
        curves = f"model-{key}-{'fit' if number is None else number}"
        write_curves(Path(request["folder"]) / curves, columns)
        names = [
            entry["name"] for entry in request["logs"] if entry["role"] == ("fit" if number is None else "holdout")
        ]
        out.append({
            "curves": curves, "held_out": number is not None, "balances": balances, "coordinates": list(over),
            "name": " + ".join(names) if number is None else names[number],
            "orders": model.orders(number), "start": float(columns["t"][0]),
            "stop": float(columns["t"][-1]), "samples": len(columns["t"]),
        })  # fmt: skip
    return out


def preview(request: Request, effect: str, balance: str, curves: str) -> str:
    """Write what a candidate would take from the residual, and return the name of its curves.

    Parameters
    ----------
    request : dict
    effect, balance : str
        As `Stepwise.preview`.
    curves : str
        Folder of the fitted records' curves, beside which it is written.

    Returns
    -------
    str
    """
    name = f"{curves}-preview-{_digest([effect, balance])[:12]}"
    if not (Path(request["folder"]) / name / "index.json").exists():
        model, _ = fitted(request, request["steps"])
        t = model.contributions(balance).t
        write_curves(Path(request["folder"]) / name, {"t": t, "preview": model.preview(effect, balance)})
    return name
