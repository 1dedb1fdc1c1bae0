"""The pages that are printed from the package itself: `python docs/generate.py` writes docs/theory.md again.

Equations of the machine and of the controllers are read from the source of the functions that compute them, those of
the effects from the catalogue: nothing on the theory page is written twice. The site's build calls `build` for the
pages that need not be committed: the commands' options, the fields of a design and the codes of the warnings.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
GREEK = ("omega", "theta", "psi", "alpha", "beta", "delta", "zeta", "tau", "mu", "phi", "varphi")
# What a row or a tuple of the kernels holds, as symbols.
HOLDS = {
    ("i_ref", 0): r"i_{d,\mathrm{ref}}", ("i_ref", 1): r"i_{q,\mathrm{ref}}",
    ("i_m", 0): r"i_{d,\mathrm{meas}}", ("i_m", 1): r"i_{q,\mathrm{meas}}",
    ("reference", 0): r"\theta_\mathrm{ref}", ("reference", 1): r"\omega_\mathrm{ref}",
    ("reference", 2): r"\alpha_\mathrm{ref}", ("reference", 3): r"i_\mathrm{add}",
}  # fmt: skip
NAMES = {
    "di_d": r"\dot i_d", "di_q": r"\dot i_q", "omega_e": r"p\hat\omega", "I_d": "I_d", "I_q": "I_q", "I_s": r"I_\omega",
    "b_d": r"\frac{T}{T_{n,d}}", "b_q": r"\frac{T}{T_{n,q}}", "b_s": r"\frac{T_s}{T_{n,\omega}}",
    "K_d": "K_{p,d}", "K_q": "K_{p,q}", "K_s": r"K_{p,\omega}", "k_omega": r"k_v", "k_alpha": r"k_a\frac{J}{K_t}",
    "a_speed": r"a_\omega", "a_ref": r"a_\mathrm{ref}", "scale": "s", "wanted": r"i_\mathrm{wanted}",
    "theta_m": r"\theta_\mathrm{meas}", "theta_last": r"\theta_\mathrm{last}",
    "omega_filtered": r"\omega_\mathrm{filtered}", "i_q_ref": r"i_{q,\mathrm{ref}}",
    "omega_ref": r"\omega_\mathrm{ref}^*",
}  # fmt: skip


def symbol(name: str) -> str:
    """Return a name of the source as LaTeX: psi_f, L_d_hat, omega."""
    if name in NAMES:
        return NAMES[name]
    hat = name.endswith("_hat")
    head, _, index = name.removesuffix("_hat").partition("_")
    letter = "\\" + head if head in GREEK else head
    letter = rf"\hat{{{letter}}}" if hat else letter
    return f"{letter}_{{{index.replace('_', ',')}}}" if index else letter


def latex(node: ast.expr, inside: int = 0) -> str:
    """Return an expression of the source as LaTeX; `inside` is how tightly its surroundings bind."""
    match node:
        case ast.Name():
            return symbol(node.id)
        case ast.Constant():
            return f"{node.value:g}"
        case ast.Subscript(value=ast.Name(id=name), slice=ast.Constant(value=index)):
            return HOLDS[name, index]
        case ast.UnaryOp(op=ast.USub()):
            return f"-{latex(node.operand, 2)}"
        case ast.Call(func=ast.Name(id=name)):
            return rf"\{name}\left({', '.join(latex(a) for a in node.args)}\right)"
        case ast.BinOp(op=ast.Div()):
            return rf"\frac{{{latex(node.left)}}}{{{latex(node.right)}}}"
        case ast.BinOp(op=ast.Mult()):
            return rf"{latex(node.left, 2)}\,{latex(node.right, 2)}"
        case ast.BinOp(op=ast.Add() | ast.Sub()):
            sign = "+" if isinstance(node.op, ast.Add) else "-"
            text = f"{latex(node.left)} {sign} {latex(node.right, 1 if sign == '-' else 0)}"
            return rf"\left({text}\right)" if inside else text
    raise ValueError(f"{ast.dump(node)}: no LaTeX for this; extend docs/generate.py")


def equations(function: Any, names: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield what a kernel computes: its assignments to `names`, or what it returns."""
    source = textwrap.dedent(inspect.getsource(getattr(function, "py_func", function)))
    for node in sorted(ast.walk(ast.parse(source)), key=lambda n: getattr(n, "lineno", 0)):
        match node:
            case ast.Return(value=ast.expr() as value) if not names:
                yield latex(value)
            case ast.Assign(targets=[ast.Name(id=name)], value=value) if name in names:
                yield f"{symbol(name)} = {latex(value)}"
            case ast.AugAssign(target=ast.Name(id=name), value=value) if name in names:
                yield rf"{symbol(name)} \leftarrow {symbol(name)} + {latex(value)}"


def _block(*lines: str) -> str:
    return "\n".join(f"$$\n{line}\n$$\n" for line in lines)


def machine() -> str:
    """Return the section on the machine."""
    from pmsm_ctrl.kernels import balance

    voltage = [f"u_{axis} = {next(equations(f))}" for axis, f in (("d", balance.voltage_d), ("q", balance.voltage_q))]
    torque = f"T_{{em}} = {next(equations(balance.torque_em))}"
    source = re.search(r"source: (.*)", balance.__doc__ or "", re.DOTALL)
    assert source is not None
    return "\n".join([
        "## The machine", "",
        "Rotor coordinates, amplitude-invariant scaling (currents and voltages are peak values), friction positive for "
        "positive speed.", "", _block(*voltage, torque,
        r"J\,\dot\omega = T_{em} - \sum_k T_k - T_\mathrm{load}, \qquad \dot\theta = \omega"),
        "The $T_k$ are the torque effects of the design, below. Dry friction is set-valued: a shaft at rest stays "
        "there while what pushes it is less than what it takes to break away; a step in which the speed meets zero "
        "is split there.", "", f"Source: {' '.join(source[1].split())}", "",
    ])  # fmt: skip


def controllers() -> str:
    """Return the section on the loops as they run in the drive."""
    from pmsm_ctrl.kernels import control, drive_template, rotation

    speed = list(equations(drive_template.speed_control, (
        "omega_hat", "omega_filtered", "omega_ref", "e", "wanted", "I_s")))  # fmt: skip
    return "\n".join([
        "## The controllers, as the drive samples them", "",
        "Position and speed, every `speed_divider`-th control period $T_s$. An arrow gives a value of the last period "
        "its new one. The limit of the current is applied to $i_\\mathrm{wanted}$; what it takes away is fed back, so "
        "that the integrator never winds up. Without a position controller $K_v = 0$.", "", _block(*speed),
        "$a = 1 - e^{-T_s/\\tau}$ for the speed filter and the reference filter.", "",
        "Current, every control period $T$, with decoupling and EMF feedforward from what the controller believes:", "",
        _block(*equations(control.voltage_demand, ("u_d", "u_q")), *equations(control.integrate, ("I_d", "I_q"))),
        "$s \\le 1$ is the share of the voltage that fits into the hexagon of the inverter. "
        + " ".join((inspect.getdoc(rotation.hexagon_scale.py_func) or "").split("\n\n")[1].split()), "",
        "The voltage is applied one period later (`delay_periods`) and held for one; the encoder rounds the angle to "
        "its counts. The reasoning behind the gains is on the page on [tuning](tuning.md).", "",
    ])  # fmt: skip


def effects() -> str:
    """Return the catalogue: equation, parameters, required excitation, similar effects, source."""
    from pmsm_ctrl.effects import CATALOGUE

    where = {
        "torque": "opposes the torque", "voltage": "adds to the voltage drop", "measurement": "measured less true",
    }  # fmt: skip
    lines = ["## The effects", "", "What a design may name, and what a diagnosis offers.", ""]
    for effect in CATALOGUE.values():
        lines += [f"### {effect.title}", "", f"`{effect.id}`, {where[effect.enters]}.", "", _block(effect.equation)]
        lines += ["| parameter | unit | |", "|---|---|---|"]
        lines += [f"| `{p.symbol}` | {p.unit} | {_cell(p.description)} |" for p in effect.parameters]
        lines += ["", f"Required excitation: {effect.needs}."]
        for other, why in effect.look_alikes.items():
            lines.append(f"Can be confused with `{other}`: {why}.")
        lines += ["", f"Validated on: {effect.validated}. Source: {effect.source}.", ""]
    return "\n".join(lines)


def _cell(text: str) -> str:
    return text.replace("|", r"\|")


def theory() -> str:
    """Return the theory page."""
    head = (
        "<!-- Written by `python docs/generate.py`; change the source that it reads. -->\n\n# Theory\n\n"
        "Every equation that the package computes with, and where it comes from. This page is printed from the source: "
        "the machine and the\ncontrollers from the functions that run, the effects from the catalogue that the "
        "simulation, the regression, the diagnosis,\nthe compensator and the export read.\n"
    )
    return "\n".join([head, machine(), controllers(), effects()]).rstrip() + "\n"


def commands() -> str:
    """Return every command's help."""
    from typer.testing import CliRunner

    from pmsm_ctrl.cli import app

    runner = CliRunner(env={"COLUMNS": "110", "TERMINAL_WIDTH": "110", "NO_COLOR": "1"})
    lines = ["# Commands", "", "As `--help` prints them.", ""]
    for command in app.registered_commands:
        name = command.name or command.callback.__name__  # type: ignore[union-attr]
        shown = runner.invoke(app, [name, "--help"], prog_name="pmsm-ctrl")
        lines += [f"## pmsm-ctrl {name}", "", "```text", shown.output.strip(), "```", ""]
    return "\n".join(lines)


def fields() -> str:
    """Return the tables of a design with the fields' own descriptions."""
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.units import DATASHEET

    lines = ["# A design, field by field", "", "TOML; SI units unless the name says otherwise. What is left out takes",
             "its default; an unknown name is an error.", ""]  # fmt: skip
    lines += _fields(Design, "at the top")
    for name, field in Design.model_fields.items():
        for part in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if hasattr(part, "model_fields"):
                lines += _fields(part, f"[{name}]")
                for inner, deeper in part.model_fields.items():
                    if hasattr(deeper.annotation, "model_fields"):
                        lines += _fields(deeper.annotation, f"[{name}.{inner}]")
                    for key, listed in getattr(deeper.annotation, "model_fields", {}).items():
                        for item in getattr(listed.annotation, "__args__", ()):
                            if hasattr(item, "model_fields"):
                                lines += _fields(item, f"[[{name}.{inner}.{key}]]")
    lines += ["## Names of datasheets", "", "| name | unit | sets |", "|---|---|---|"]
    lines += [f"| `{key}` | {sheet.meaning} | `{sheet.field}` |" for key, sheet in DATASHEET.items()]
    return "\n".join(lines) + "\n"


def _fields(model: Any, title: str) -> list[str]:
    about = " ".join((inspect.getdoc(model) or "").split("\n\n")[0].split())
    rows = []
    for name, field in model.model_fields.items():
        if name == "source" or any(
            hasattr(part, "model_fields") for part in (field.annotation, *getattr(field.annotation, "__args__", ()))
        ):
            continue
        default = "required" if field.is_required() else _default(field)
        rows.append(f"| `{name}` | {default} | {_cell(field.description or '')} |")
    if not rows:
        return []
    return [f"## {title}", "", about, "", "| field | default | |", "|---|---|---|", *rows, ""]


def _default(field: Any) -> str:
    value = field.default_factory() if field.default_factory is not None else field.default
    return "none" if value in (None, (), {}) else f"`{value}`"


def notices() -> str:
    """Return the warnings of every room by their codes."""
    import pmsm_ctrl
    from pmsm_ctrl.section import Template

    lines = ["# Warning codes", "", "A result carries its warnings as notices: a code, a sentence and its values.",
             "JSON has the codes under `warning_codes`. Values stand in braces.", ""]  # fmt: skip
    package = Path(pmsm_ctrl.__file__).parent
    rooms = {path.parent.name: f"pmsm_ctrl.{path.parent.name}.notices" for path in package.glob("*/notices.py")}
    for name, module in sorted({**rooms, "datasheet": "pmsm_ctrl.datasheet", "likely": "pmsm_ctrl.likely"}.items()):
        room = importlib.import_module(module)
        lines += [f"## {name}", "", "| code | sentence |", "|---|---|"]
        found = (held for held in vars(room).values() if isinstance(held, Template))
        lines += [f"| `{template.code}` | {_cell(template.words)} |" for template in found]
        lines.append("")
    lines += ["## Why a diagnosis did not accept a candidate", "", "`why_not_code` of its ranking.", ""]
    reasons = importlib.import_module("pmsm_ctrl.diagnose.refusal").WORDS
    lines += [
        "| code | sentence |",
        "|---|---|",
        *(f"| `{code}` | {_cell(words)} |" for code, words in reasons.items()),
    ]
    return "\n".join([*lines, ""])


def schemas() -> str:
    """Return the keys of every result as a command writes it with ``--json``."""
    from pmsm_ctrl.schemas import SCHEMAS

    lines = [
        "# JSON of the results",
        "",
        "`--json FILE` writes the result of a command. `pmsm-ctrl schema VERB` prints its JSON Schema.",
        "Keys may be added without a new version; those of this page stay. A key in italics may be absent.",
        "",
    ]
    for verb, schema in SCHEMAS.items():
        keys = ", ".join(f"`{key}`" if key in schema["required"] else f"*{key}*" for key in schema["properties"])
        lines += [f"## {verb}", "", f"`{schema['title']}`: {keys}", ""]
    return "\n".join(lines)


PAGES: dict[str, Callable[[], str]] = {
    "commands.md": commands,
    "design.md": fields,
    "notices.md": notices,
    "schemas.md": schemas,
}


def build(folder: Path) -> None:
    """Write the pages that are made at every build of the site."""
    folder.mkdir(exist_ok=True)
    for name, page in PAGES.items():
        (folder / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    (HERE / "theory.md").write_text(theory(), encoding="utf-8")
    print(HERE / "theory.md")
