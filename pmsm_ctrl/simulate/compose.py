"""Compose the drive kernel for a set of effects: the template plus the lines of each effect.

Every combination is a generated source file, compiled once and cached on disk; what hangs on the plant alone, or on
the controller alone, is in files of its own, which combinations share. It is plain Python: `source` returns it whole,
and ``load(..., compiled=False)`` runs it without numba.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
import sys
import threading
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from pmsm_ctrl.effects import Effect
from pmsm_ctrl.effects.fingerprint import fingerprint
from pmsm_ctrl.effects.structures import STRUCTURES, Structure
from pmsm_ctrl.files import write_text
from pmsm_ctrl.kernels import cache_folder
from pmsm_ctrl.simulate.controller_lines import PLAIN, SpeedParts

__all__ = ["BARE_STATES", "completed", "lines_of", "load", "module_of", "source", "structures"]

_LOADING = threading.Lock()  # a module loaded twice would be compiled twice
_MARK = re.compile(r"#\s<([a-z_ ]+)>\s*$")
BARE_STATES = 15  # states of the kernel without effects; structures add theirs
_TEMPLATE = Path(__file__).resolve().parent.parent / "kernels" / "drive_template.py"
# Functions of the template that hang on the plant's effects alone, and on those of the controller.
_OF_THE_PLANT = (
    "drive_torque", "shaft_torque", "derivative", "advance", "runge_kutta", "impending", "step_dry", "step_smooth",
    "measure",
)  # fmt: skip
_OF_THE_CONTROLLER = ("speed_control",)


def source(
    effects: Sequence[Effect], compensated: Sequence[Effect] = (), parts: SpeedParts = PLAIN, *,
    driven: Mapping[str, list[str]] | None = None,
) -> str:  # fmt: skip
    """Return the drive kernel's source for these effects, in this order, and those its controller compensates.

    `parts` is what the speed controller has beside; `driven` holds the lines for further marks.
    """
    return completed(_TEMPLATE, {**lines_of(effects), **parts.lines(compensated), **(driven or {})})


def completed(template: Path, lines: Mapping[str, list[str]]) -> str:
    """Return the text of a template with the lines for its marks."""
    out = []
    for line in template.read_text(encoding="utf-8").splitlines():
        mark = _MARK.search(line)
        if mark is None:
            out.append(line)
            continue
        new = lines.get(mark.group(1), [])
        indent = line[: len(line) - len(line.lstrip())]
        code = line[: mark.start()].rstrip()
        if new:
            out.extend(indent + text for text in new)
        elif code:
            out.append(code)
    return "\n".join(out) + "\n"


@lru_cache(maxsize=256)
def _source(effects: tuple[Effect, ...], compensated: tuple[Effect, ...], parts: SpeedParts) -> str:
    return source(effects, compensated, parts)


def load(
    effects: Sequence[Effect], compensated: Sequence[Effect] = (), *, compiled: bool = True,
    parts: SpeedParts = PLAIN,
) -> ModuleType:  # fmt: skip
    """Return the module whose `run` simulates a drive with these effects.

    Parameters
    ----------
    effects : sequence of Effect
        The plant's effects, in the order of their parameters.
    compensated : sequence of Effect
        Effects of the controller's feedforward; their parameters are columns of the references.
    compiled : bool
        False returns the same text in plain Python, for reading and comparison.
    parts : SpeedParts
        What the speed controller has beside its PI: an observer, filters.

    Returns
    -------
    module
    """
    plant, drive = tuple(effects), tuple(compensated)
    text = _source(plant, drive, parts)
    return module_of(text, plant, drive, pieces=True) if compiled else _plain(text, plant, drive)


def module_of(
    text: str, effects: tuple[Effect, ...], compensated: tuple[Effect, ...], *, pieces: bool = False
) -> ModuleType:  # fmt: skip
    """Return the module of a generated text, with the terms it calls; the same one for all threads.

    With `pieces`, the plant's functions and the controller's come from modules that other combinations share.
    """
    with _LOADING:
        return _compiled(text, effects, compensated, pieces)


def structures(effects: Sequence[Effect]) -> list[tuple[type[Structure], int]]:
    """Return the structures of effects and the first state of each, in the order of the kernel's states."""
    found, offset = [], BARE_STATES
    for kind in STRUCTURES:
        if any(isinstance(effect.structure, kind) for effect in effects):
            found.append((kind, offset))
            offset += kind.memory
    return found


def lines_of(effects: Sequence[Effect]) -> dict[str, list[str]]:
    """Return the lines for every mark of the template."""
    numbered = list(enumerate(effects))
    names = [f"e{k}_{p.symbol}" for k, effect in numbered for p in effect.parameters]
    lines: dict[str, list[str]] = {}
    if names:
        lines["parameters"] = [", ".join(names) + ("," if len(names) == 1 else "") + " = effects"]
    if any(effect.dry for effect in effects):
        lines["hold"] = ["if direction == 0.0:", "    domega = 0.0"]
        lines["step"] = ["y = step_dry(y, t + m * h, h, held, machine, effects)"]
    dry = [(k, effect) for k, effect in numbered if effect.dry and not effect.has_state]
    for kind, offset in structures(effects):
        new = kind.lines([(k, effect) for k, effect in numbered if isinstance(effect.structure, kind)], offset, dry)
        for mark in ("load memory", "store memory"):
            new[mark] = [*lines.get(mark, []), *new.get(mark, [])]
        lines |= new
    if lines.get("encoder") or lines.get("measure current"):
        lines["sensed"] = ["sensed = effects"]
        lines["measurement parameters"] = [lines["parameters"][0].replace("effects", "sensed")]
    return lines


def _reuse(text: str) -> str:
    """Import the functions that no effect changes from the template, where they are compiled already.

    Only those whose arguments have the same types in every combination; the others are compiled anew in any case.
    """
    bare = source(())
    unchanged = []
    for name in ("advance", "measure", "speed_control"):
        found = _function(name, text)
        if found and found == _function(name, bare):
            text = text.replace(found, "")
            unchanged.append(name)
    line = f"from pmsm_ctrl.kernels.drive_template import {', '.join(unchanged)}\n"
    return (
        text.replace("from pmsm_ctrl.kernels.rotation", f"{line}from pmsm_ctrl.kernels.rotation", 1)
        if unchanged
        else text
    )


def _function(name: str, text: str) -> str:
    """Return the text of an inlined function, empty where there is none."""
    found = re.search(rf"@inlined\ndef {name}\(.*?\n\n\n", text, flags=re.DOTALL)
    return found.group() if found else ""


@lru_cache(maxsize=256)
def _compiled(
    text: str, effects: tuple[Effect, ...], compensated: tuple[Effect, ...], pieces: bool
) -> ModuleType:  # fmt: skip
    name = _name("drive", text, (*effects, *compensated))
    typed = [e for e in (*effects, *compensated) if not Path(e.py_term.__code__.co_filename).is_file()]
    if typed:
        # A term typed at a prompt has no file, so that another process could not compile it: keep it off the disk.
        module = ModuleType(name)
        module.__dict__.update(_terms(effects, compensated))
        exec(compile(_reuse(text), name, "exec"), module.__dict__)  # the package's own text
        return module
    if not pieces:
        return _filed(name, _reuse(text), _terms(effects, compensated))
    text, plant = _apart(text, "plant", _OF_THE_PLANT, effects, _terms(effects, ()))
    text, control = _apart(text, "control", _OF_THE_CONTROLLER, compensated, _terms((), compensated))
    return _filed(name, text, _terms(effects, compensated) | plant | control)


def _apart(
    text: str, kind: str, names: Sequence[str], effects: Sequence[Effect], terms: Mapping[str, Any]
) -> tuple[str, dict[str, Any]]:
    """Take functions out of a kernel's text: return what is left, and the functions of a module of their own.

    A plant is compiled once for all its controllers that way, and a controller once for all its plants.
    """
    found = {name: function for name in names if (function := _function(name, text))}
    part = _reuse(text.partition("@inlined\n")[0] + "".join(found.values()))
    for function in found.values():
        text = text.replace(function, "")
    module = _filed(_name(kind, part, effects), part, terms) if found else None
    return text, {name: getattr(module, name) for name in found}


def _name(kind: str, text: str, effects: Sequence[Effect]) -> str:
    """Return the name of a generated module: another one for another text, or another term that it calls."""
    digest = hashlib.sha256(text.encode())
    for effect in effects:
        digest.update(fingerprint(effect.term))
    return f"{kind}_{digest.hexdigest()[:16]}"


def _filed(name: str, text: str, functions: Mapping[str, Any]) -> ModuleType:
    """Return the module of a text in the cache's folder, where numba finds what another process has compiled."""
    folder = cache_folder() / "generated"
    path = folder / f"{name}.py"
    if not path.exists() or path.read_bytes() != text.encode():
        folder.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    known = sys.modules.get(f"pmsm_ctrl_generated_{name}")
    if known is not None and known.__file__ == str(path):
        return known
    spec = importlib.util.spec_from_file_location(f"pmsm_ctrl_generated_{name}", path)
    assert spec is not None  # the file was just written
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    module.__dict__.update(functions)
    spec.loader.exec_module(module)
    return module


@lru_cache(maxsize=16)
def _plain(text: str, effects: tuple[Effect, ...], compensated: tuple[Effect, ...]) -> ModuleType:
    from pmsm_ctrl.kernels import balance, control, rotation

    module = ModuleType("drive_twin")
    # The same text without compilation; it is generated by the package, not a user's.
    text = text.replace(
        "from pmsm_ctrl.kernels import inlined, kernel\n", "inlined = kernel = lambda function: function\n"
    )
    exec(compile(text, "drive_twin", "exec"), module.__dict__)
    for library in (balance, control, rotation):
        module.__dict__.update({name: getattr(library, name).py_func for name in library.__all__})
    module.__dict__.update(_terms(effects, compensated, "py_term"))
    return module


def _terms(effects: Sequence[Effect], compensated: Sequence[Effect], kind: str = "term") -> dict[str, Any]:
    """Return the functions that a generated text calls, by the names it has for them."""
    pairs = (("e", effects), ("f", compensated))
    return {f"{letter}{k}_term": getattr(effect, kind) for letter, group in pairs for k, effect in enumerate(group)}
