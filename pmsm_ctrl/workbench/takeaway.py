"""What a session gives away: design, report, result, a script that repeats every step, and the compensator."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.workbench import own, tasks

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.result import Result

__all__ = ["KINDS", "made", "script", "stem"]

# kind -> (end of the file's name, media type)
KINDS: dict[str, tuple[str, str]] = {
    "design": (".toml", "application/toml; charset=utf-8"),
    "report": (".html", "text/html; charset=utf-8"),
    "json": (".json", "application/json"),
    "script": ("_steps.py", "text/x-python; charset=utf-8"),
    "st": ("_compensator.st", "text/plain; charset=utf-8"),
    "c": ("_compensator.c", "text/plain; charset=utf-8"),
}


def stem(name: str) -> str:
    """Return the name of a design as the name of a file.

    Parameters
    ----------
    name : str

    Returns
    -------
    str
    """
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name).strip("._")[:60] or "axis"


def made(kind: str, request: Mapping[str, Any]) -> str:
    """Return the text of a file; runs in the process of the session.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    request : dict
        As for `tasks.solve`.

    Returns
    -------
    str
    """
    if kind == "script":
        return script(request)
    model, diagnosis = tasks.fitted(request, request["steps"])
    if kind == "design":
        return model.design.to_toml()
    if kind in ("st", "c"):
        from pmsm_ctrl.export import export

        return export(model.design, kind)
    if kind == "json":
        content = {"schema": "pmsm-ctrl/workbench/2", **model.to_dict()}
        if diagnosis is not None:
            content["diagnosis"] = diagnosis.to_dict()
        from pmsm_ctrl.result import jsonable

        return json.dumps(jsonable(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    return _report(request, model.design)


def _report(request: Mapping[str, Any], design: Design) -> str:
    """Return the page of the search, or of the model as it was built by hand."""
    from pmsm_ctrl.report import headline_of, render

    model, diagnosis = tasks.fitted(request, request["steps"])
    result: Result = model if diagnosis is None else diagnosis
    section, headline = result.section(), headline_of(result)
    notices = result.notices if headline is not None else ()
    facts = {f"log {k}": f"{entry['name']} ({entry['role']})" for k, entry in enumerate(request["logs"], start=1)}
    return render(
        section.title, [section.without(notices)], headline=headline, notices=notices, facts=facts,
        design_toml=design.to_toml(), command="pmsm-ctrl workbench",
    )  # fmt: skip


def script(request: Mapping[str, Any]) -> str:
    """Return a Python script that repeats every step from the files.

    Parameters
    ----------
    request : dict
        As for `tasks.solve`.

    Returns
    -------
    str
    """
    lines = [
        '"""Repeats the steps of a session of the workbench. Put the logs beside this file, under their names."""',
        "",
        *_own_effects(request),
        "from pmsm_ctrl import Design, read_log",
        "from pmsm_ctrl.diagnose import stepwise",
        "",
        "DESIGN = (",
        *(f"    {line!r}" for line in request["design"].splitlines(keepends=True)),
        ")",
        "",
        f"design = Design.from_toml(DESIGN){'.with_own_effects(*OWN)' if request.get('code') else ''}",
    ]
    for role, name in (("fit", "fitted"), ("holdout", "held_out")):
        lines.append(f"{name} = [")
        for entry in request["logs"]:
            if entry["role"] == role:
                mapping = f", mapping={entry['mapping']!r}" if entry["mapping"] else ""
                window = ".between({!r}, {!r})".format(*entry["window"]) if entry["window"] else ""
                lines.append(f"    read_log({Path(entry['name']).name!r}, design{mapping}){window},")
        lines.append("]")
    lines += ["", "model = stepwise(design, fitted, holdout=held_out or None)"]
    for step in request["steps"]:
        kind, name = next(iter(step.items()))
        lines.append("model, diagnosis = model.find()" if kind == "find" else f"model = model.{kind}({name!r})")
    lines += [
        "print(model)",
        f'print(model.design.write("{stem(tasks.design_of(request["design"]).name)}_found.toml"))',
    ]
    return "\n".join(lines) + "\n"


def _own_effects(request: Mapping[str, Any]) -> list[str]:
    """Return the code of the page's own effects, and what gathers them."""
    if not request.get("code"):
        return []
    names = [one["id"] for one in own.described(request["design"], request)]
    return [
        *request["code"].splitlines(),
        "",
        f"OWN = [one for one in list(globals().values()) if getattr(one, 'id', None) in {names!r}]",
        "",
    ]
