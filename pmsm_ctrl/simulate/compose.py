"""Compose the drive kernel for a set of effects: the template plus the lines each effect brings.

A generated source file per combination is compiled once and cached on disk. It is plain Python that can be
read (`source`), and run without numba (`load(..., compiled=False)`): the readable twin of the kernel.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
import sys
import threading
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from types import ModuleType

from pmsm_ctrl.effects import Effect
from pmsm_ctrl.files import write_text
from pmsm_ctrl.kernels import cache_folder
from pmsm_ctrl.simulate.feedforward import compensation_lines

__all__ = ["BARE_STATES", "MEMORY", "load", "memory", "module_of", "source"]

_LOADING = threading.Lock()  # a module loaded twice would be compiled twice
_MARK = re.compile(r"#\s<([a-z_ ]+)>\s*$")
# Numbers the kernel carries from one call to the next, and what each structure adds to them.
BARE_STATES = 15
MEMORY = {"transmission": 2, "bristle": 1, "delay": 512}
_TEMPLATE = Path(__file__).resolve().parent.parent / "kernels" / "drive_template.py"


def source(effects: Sequence[Effect], compensated: Sequence[Effect] = ()) -> str:
    """Return the drive kernel's source for these effects, in this order, and those its controller compensates."""
    lines = _lines(effects) | {"compensation": compensation_lines(compensated)}
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


@lru_cache(maxsize=256)
def _source(effects: tuple[Effect, ...], compensated: tuple[Effect, ...]) -> str:
    return source(effects, compensated)


def load(effects: Sequence[Effect], compensated: Sequence[Effect] = (), *, compiled: bool = True) -> ModuleType:
    """Return the module with `run` for these effects; `compiled=False` gives the readable twin in plain Python.

    `compensated` are the effects that the controller feeds forward; their values come with the references.
    """
    plant, drive = tuple(effects), tuple(compensated)
    text = _source(plant, drive)
    return module_of(text, plant, drive) if compiled else _plain(text, plant, drive)


def module_of(text: str, effects: tuple[Effect, ...], compensated: tuple[Effect, ...]) -> ModuleType:
    """Return the module of a generated text, with the terms it calls; threads that ask for the same get the same."""
    with _LOADING:
        return _compiled(text, effects, compensated)


def memory(effects: Sequence[Effect]) -> dict[str, int]:
    """Return how many numbers each structure keeps beside the bare drive's states, in the order they are stored."""
    present = {effect.structure for effect in effects}
    return {name: size for name, size in MEMORY.items() if name in present}


def _lines(effects: Sequence[Effect]) -> dict[str, list[str]]:
    """Return the lines for every mark of the template."""
    numbered = list(enumerate(effects))
    names = [f"e{k}_{p.symbol}" for k, effect in numbered for p in effect.parameters]
    lines: dict[str, list[str]] = {}
    if names:
        lines["parameters"] = [", ".join(names) + ("," if len(names) == 1 else "") + " = effects"]
    terms = [(k, effect) for k, effect in numbered if effect.structure == "term"]
    lines["torque"] = [f"opposing += {_call(k, effect)}" for k, effect in terms if effect.enters == "torque"]
    lines |= _voltage([(k, effect) for k, effect in terms if effect.enters == "voltage"])
    lines |= _measurement([(k, effect) for k, effect in terms if effect.enters == "measurement"])
    offset = BARE_STATES
    offsets = {}
    for name, size in memory(effects).items():
        offsets[name] = offset
        offset += size
    if any(effect.dry for effect in effects):
        lines["hold"] = ["if direction == 0.0:", "    domega = 0.0"]
        lines["step"] = ["y = step_dry(y, t + m * h, h, held, machine, effects)"]
    load, store = [], []
    dry = [(k, effect) for k, effect in terms if effect.dry]
    wiring: dict[str, Callable[..., dict[str, list[str]]]] = {
        "transmission": _transmission,
        "bristle": partial(_bristle, dry=dry),
        "delay": _delay,
    }
    for structure, wire in wiring.items():
        wired = [(k, effect) for k, effect in numbered if effect.structure == structure]
        if not wired or (structure == "bristle" and not dry):
            continue
        new = wire(wired, offsets[structure])
        load += new.pop("load memory", [])
        store += new.pop("store memory", [])
        if structure == "bristle":
            lines.pop("hold", None)  # a bristle gives way: nothing is ever locked
        lines |= new
    return lines | {"load memory": load, "store memory": store}


def _call(k: int, effect: Effect, /, **renamed: str) -> str:
    """Return the call of effect `k`'s term with its own parameters; signals are locals of the template."""
    own = {p.symbol for p in effect.parameters}
    arguments = (renamed.get(name, f"e{k}_{name}" if name in own else name) for name in effect.arguments)
    return f"e{k}_term({', '.join(arguments)})"


def _voltage(effects: list[tuple[int, Effect]]) -> dict[str, list[str]]:
    """Voltage lost; what depends on di_q/dt stands beside L_q as incremental inductance."""
    lines = []
    slopes = []
    for k, effect in effects:
        lines += [f"e_d, e_q = {_call(k, effect)}", "u_d -= e_d", "u_q -= e_q"]
        if "di_q" in effect.signals:
            slopes.append(f"{_call(k, effect, di_q='1.0')}[1] - {_call(k, effect)}[1]")
    if not slopes:
        return {"voltage": lines}
    lines.append(f"L_q_incremental = L_q + {' + '.join(slopes)}")
    current = "di_q = (u_q - voltage_q(R, L_d, L_q, p, psi_f, i_d, i_q, 0.0, omega)) / L_q_incremental"
    return {"voltage": lines, "incremental inductance": [current]}


def _measurement(effects: list[tuple[int, Effect]]) -> dict[str, list[str]]:
    angle = [_call(k, effect) for k, effect in effects if effect.channels == ("theta",)]
    lines: dict[str, list[str]] = {"measure current": []}
    if angle:
        lines["encoder"] = [f"theta_m = quantise(theta + {' + '.join(angle)}, counts)"]
    for k, effect in effects:
        if effect.channels == ("i_d", "i_q"):
            lines["measure current"] += [f"e_d, e_q = {_call(k, effect)}", "i_d_m += e_d", "i_q_m += e_q"]
    return lines


def _transmission(effects: list[tuple[int, Effect]], offset: int) -> dict[str, list[str]]:
    """Two masses. A spring and a gap together are one spring with a gap: the spring's constants, the gap's width."""
    by_id = {effect.id: (k, effect) for k, effect in effects}
    spring, gap = by_id.get("compliance"), by_id.get("backlash")
    k, effect = gap or spring or effects[0]
    constants = spring[0] if spring else k
    shared = {name: f"e{constants}_{name}" for name in ("k", "d")} if spring and gap else {}
    torque = _call(k, effect, twist="theta - theta_l", twist_rate="omega - omega_l", **shared)
    J_load = f"e{constants}_J_load"
    return {
        "states": ["omega_l, theta_l = y[4], y[5]"],
        "coupling": [f"opposing = {torque}"],
        "acceleration": [f"domega = shaft_torque(y, t, direction, held, machine, effects) / (J - {J_load})"],
        "load": [f"domega_l = ({torque} - held[3]) / {J_load}"],
        "rates": ["return di_d, di_q, domega, omega, domega_l, omega_l"],
        "advance": ["return " + ", ".join(f"y[{n}] + h * k[{n}]" for n in range(6))],
        "landed": ["new = (new[0], new[1], 0.0, new[3], new[4], new[5])"],
        "load states": [
            f"y = (states[0], states[1], states[2], states[3], states[{offset}], states[{offset + 1}])",
        ],
        "store states": [
            "states[0], states[1], states[2], states[3] = y[0], y[1], y[2], y[3]",
            f"states[{offset}], states[{offset + 1}] = y[4], y[5]",
        ],
        "log": ["out[row, 14] = y[5]"],
    }


def _bristle(effects: list[tuple[int, Effect]], offset: int, dry: list[tuple[int, Effect]]) -> dict[str, list[str]]:
    """The bristle's deflection stands for the direction in every dry friction; it moves with the shaft's travel."""
    k, effect = effects[0]

    def level(speed: str) -> str:
        return " + ".join(_call(n, friction, omega=speed, direction="1.0") for n, friction in dry)

    return {
        "bristle": [
            f"level, rest = {level('omega')}, {level('0.0')}",
            f"direction = {_call(k, effect, zeta='held[4]', travel='theta - held[5]', limit='level / rest')}[1]",
            "direction *= rest / level",
        ],
        "step": [
            "start = (held[0], held[1], held[2], held[3], zeta, y[3])",
            "y = runge_kutta(y, t + m * h, h, 1.0, start, machine, effects)",
            "i_d, i_q, omega, theta = y[0], y[1], y[2], y[3]",
            "torque = torque_em(p, machine[4], machine[1], machine[2], i_d, i_q)",
            f"level, rest = {level('omega')}, {level('0.0')}",
            f"zeta = {_call(k, effect, travel='theta - start[5]', limit='level / rest')}[0]",
        ],
        "load memory": [f"zeta = states[{offset}]"],
        "store memory": [f"states[{offset}] = zeta"],
    }


def _delay(effects: list[tuple[int, Effect]], offset: int) -> dict[str, list[str]]:
    """The logged currents pass through a delay line of control periods, interpolated in between."""
    k, _ = effects[0]
    half = MEMORY["delay"] // 2
    return {
        "load memory": [f"line = states[{offset}:{offset + 2 * half}]"],
        "delay line": [
            f"line[2 * (k % {half})], line[2 * (k % {half}) + 1] = i_m",
            f"age = e{k}_tau / T",
            "part = age - int(age)",
            f"newer, older = 2 * ((k - int(age)) % {half}), 2 * ((k - int(age) - 1) % {half})",
            "i_d_late = (1.0 - part) * line[newer] + part * line[older]",
            "i_q_late = (1.0 - part) * line[newer + 1] + part * line[older + 1]",
        ],
        "log current": ["out[row, 3], out[row, 4] = i_d_late, i_q_late"],
    }


def _fingerprint(effect: Effect) -> bytes:
    """Return what changes when an effect's term does: its whole file, or its byte code if it has none."""
    code = effect.py_term.__code__
    file = Path(code.co_filename)
    return file.read_bytes() if file.is_file() else code.co_code + repr(code.co_consts).encode()


def _reuse(text: str) -> str:
    """Import the functions that no active effect has changed from the template, where they are compiled already.

    Only those whose arguments have the same types in every combination: the rest is compiled anew in any case.
    """
    bare = source(())
    unchanged = []
    for name in ("advance", "speed_control"):
        block = re.compile(rf"@inlined\ndef {name}\(.*?\n\n\n", flags=re.DOTALL)
        found, original = block.search(text), block.search(bare)
        if found and original and found.group() == original.group():
            text = text.replace(found.group(), "")
            unchanged.append(name)
    line = f"from pmsm_ctrl.kernels.drive_template import {', '.join(unchanged)}\n"
    return (
        text.replace("from pmsm_ctrl.kernels.rotation", f"{line}from pmsm_ctrl.kernels.rotation", 1)
        if unchanged
        else text
    )


@lru_cache(maxsize=256)
def _compiled(text: str, effects: tuple[Effect, ...], compensated: tuple[Effect, ...]) -> ModuleType:
    text = _reuse(text)
    digest = hashlib.sha256(text.encode())
    for effect in (*effects, *compensated):
        digest.update(_fingerprint(effect))
    name = f"drive_{digest.hexdigest()[:16]}"
    typed = [e for e in (*effects, *compensated) if not Path(e.py_term.__code__.co_filename).is_file()]
    if typed:
        # A term typed at a prompt cannot be found again by another process: nothing of it may reach the disk.
        module = ModuleType(name)
        module.__dict__.update({f"e{k}_term": effect.term for k, effect in enumerate(effects)})
        module.__dict__.update({f"f{k}_term": effect.term for k, effect in enumerate(compensated)})
        exec(compile(text, name, "exec"), module.__dict__)  # the package's own text
        return module
    folder = cache_folder() / "generated"
    path = folder / f"{name}.py"
    if not path.exists() or path.read_bytes() != text.encode():
        folder.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    spec = importlib.util.spec_from_file_location(f"pmsm_ctrl_generated_{name}", path)
    assert spec is not None  # the file was just written
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    module.__dict__.update({f"e{k}_term": effect.term for k, effect in enumerate(effects)})
    module.__dict__.update({f"f{k}_term": effect.term for k, effect in enumerate(compensated)})
    spec.loader.exec_module(module)
    return module


@lru_cache(maxsize=16)
def _plain(text: str, effects: tuple[Effect, ...], compensated: tuple[Effect, ...]) -> ModuleType:
    from pmsm_ctrl.kernels import balance, control, rotation

    module = ModuleType("drive_twin")
    # The same text with `kernel` doing nothing; it is the package's own, not a user's.
    text = text.replace(
        "from pmsm_ctrl.kernels import inlined, kernel\n", "inlined = kernel = lambda function: function\n"
    )
    exec(compile(text, "drive_twin", "exec"), module.__dict__)
    for library in (balance, control, rotation):
        module.__dict__.update({name: getattr(library, name).py_func for name in library.__all__})
    module.__dict__.update({f"e{k}_term": effect.py_term for k, effect in enumerate(effects)})
    module.__dict__.update({f"f{k}_term": effect.py_term for k, effect in enumerate(compensated)})
    return module
