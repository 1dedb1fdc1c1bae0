"""Compose the drive kernel for a set of effects: the template plus the lines each effect brings.

A generated source file per combination is compiled once and cached on disk. It is plain Python that can be
read (`source`), and run without numba (`load(..., compiled=False)`): the readable twin of the kernel.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import re
import sys
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from types import ModuleType

from pmsm_ctrl.effects import Effect
from pmsm_ctrl.files import write_text
from pmsm_ctrl.kernels import cache_folder

__all__ = ["load", "source"]

_MARK = re.compile(r"#\s<([a-z ]+)>\s*$")
_TEMPLATE = Path(__file__).resolve().parent.parent / "kernels" / "drive_template.py"


def source(effects: Sequence[Effect]) -> str:
    """Return the drive kernel's source for these effects, in this order."""
    lines = _lines(effects)
    out = []
    for line in _TEMPLATE.read_text(encoding="utf-8").splitlines():
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


def load(effects: Sequence[Effect], *, compiled: bool = True) -> ModuleType:
    """Return the module with `run` for these effects; `compiled=False` gives the readable twin in plain Python."""
    text = source(effects)
    return _compiled(text, tuple(effects)) if compiled else _plain(text, tuple(effects))


def _lines(effects: Sequence[Effect]) -> dict[str, list[str]]:
    """Return the lines for every mark of the template."""
    names = [f"e{k}_{p.symbol}" for k, effect in enumerate(effects) for p in effect.parameters]
    lines: dict[str, list[str]] = {}
    if names:
        lines["parameters"] = [", ".join(names) + ("," if len(names) == 1 else "") + " = effects"]
    torque = [f"opposing += {_call(k, effect)}" for k, effect in enumerate(effects) if effect.enters == "torque"]
    if torque:
        lines["torque"] = torque
    if any(effect.dry for effect in effects):
        lines["hold"] = ["if direction == 0.0:", "    domega = 0.0"]
        lines["step"] = ["y = step_dry(y, t + m * h, h, held, machine, effects)"]
    return lines


def _call(k: int, effect: Effect) -> str:
    """Return the call of effect `k`'s term with its own parameters."""
    own = {p.symbol for p in effect.parameters}
    arguments = (f"e{k}_{name}" if name in own else name for name in effect.arguments)
    return f"e{k}_term({', '.join(arguments)})  # {effect.id}"


@lru_cache(maxsize=256)
def _compiled(text: str, effects: tuple[Effect, ...]) -> ModuleType:
    digest = hashlib.sha256(text.encode())
    for effect in effects:
        digest.update(inspect.getsource(effect.py_term).encode())
    name = f"drive_{digest.hexdigest()[:16]}"
    folder = cache_folder() / "generated"
    path = folder / f"{name}.py"
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    spec = importlib.util.spec_from_file_location(f"pmsm_ctrl_generated_{name}", path)
    assert spec is not None  # the file was just written
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    module.__dict__.update({f"e{k}_term": effect.term for k, effect in enumerate(effects)})
    spec.loader.exec_module(module)
    return module


@lru_cache(maxsize=16)
def _plain(text: str, effects: tuple[Effect, ...]) -> ModuleType:
    from pmsm_ctrl.kernels import balance, rotation

    module = ModuleType("drive_twin")
    # The same text with `kernel` doing nothing; it is the package's own, not a user's.
    text = text.replace("from pmsm_ctrl.kernels import kernel\n", "kernel = lambda function: function\n")
    exec(compile(text, "drive_twin", "exec"), module.__dict__)
    for library in (balance, rotation):
        module.__dict__.update({name: getattr(library, name).py_func for name in library.__all__})
    module.__dict__.update({f"e{k}_term": effect.py_term for k, effect in enumerate(effects)})
    return module
