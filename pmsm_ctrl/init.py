"""The command init: asks for datasheet values and writes a design."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pmsm_ctrl.files import printable
from pmsm_ctrl.options import ForceOption, output_option

if TYPE_CHECKING:
    from pmsm_ctrl.datasheet import Question

__all__ = ["init"]

Text = str | None
ANSWER = 16  # columns that an answer takes


def _option(example: str) -> Any:
    return typer.Option(metavar="VALUE", help=f"such as {example}", show_default=False)


def init(
    name: Annotated[
        Text, typer.Argument(metavar="NAME", help="name of the axis; default: axis, or that of the example")
    ] = None,
    output: Annotated[Path | None, output_option("DESIGN", "the design to write; default: NAME.toml")] = None,
    force: ForceOption = False,
    machine: Annotated[
        Text,
        typer.Option(
            metavar="KIND",
            help="motor: its windings are known; plain: only a torque constant is; linear: a "
            "moving mass and a force constant are, and with --pole-pitch its windings",
            show_default=False,
        ),
    ] = None,
    pole_pairs: Annotated[Text, _option("4")] = None,
    pole_pitch: Annotated[Text, _option("'16 mm', of a linear motor whose windings are known")] = None,
    torque_constant: Annotated[Text, _option("'0.84 N m/A rms'; linear: '35 N/A peak'")] = None,
    emf_constant: Annotated[Text, _option("'51 V rms line/krpm'; linear: '69 V rms line/(m/s)'")] = None,
    resistance: Annotated[Text, _option("'1.1 Ohm line'")] = None,
    inductance: Annotated[Text, _option("'7.6 mH line'")] = None,
    inductance_q: Annotated[Text, _option("'9 mH line'")] = None,
    inertia: Annotated[Text, _option("'1.6 kg cm2' or unknown; linear: '95 kg'")] = None,
    load_inertia: Annotated[Text, _option("'200 kg cm2', at the load's own shaft")] = None,
    gear: Annotated[Text, _option("10, motor turns per load turn")] = None,
    current_limit: Annotated[Text, _option("'9 A rms'")] = None,
    supply: Annotated[Text, _option("'230 V ac' or '325 V dc'")] = None,
    pwm: Annotated[Text, _option("'16 kHz'")] = None,
    speed_loop: Annotated[Text, _option("'4 kHz'")] = None,
    encoder: Annotated[Text, _option("'20 bit', '2500 lines' or '10000 counts'; linear: '1 um'")] = None,
    friction: Annotated[Text, _option("'0.08 N m'; linear: '20 N'")] = None,
    viscous: Annotated[Text, _option("'0.02 N m/krpm'; linear: '200 N s/m'")] = None,
    example: Annotated[
        Text, typer.Option(metavar="DESIGN", help="write a shipped design, such as seed_motor; asks nothing")
    ] = None,
    json_file: Annotated[Path | None, output_option("FILE", "write the design as JSON", "--json")] = None,
) -> None:
    """Ask for the datasheet values and write a design. Values given as options are not asked for."""
    given = {
        "pole_pairs": pole_pairs, "pole_pitch": pole_pitch, "torque_constant": torque_constant,
        "emf_constant": emf_constant, "resistance": resistance, "inductance": inductance,
        "inductance_q": inductance_q, "inertia": inertia,
        "load_inertia": load_inertia, "gear": gear, "current_limit": current_limit, "supply": supply, "pwm": pwm,
        "speed_loop": speed_loop, "encoder": encoder, "friction": friction, "viscous": viscous,
    }  # fmt: skip
    _require_name(name)
    if example is not None:
        _refuse_beside_example({"machine": machine, **given})
        target = output or Path(f"{example if name is None else name}.toml")
        _write_example(example, name, target, force=force, json_file=json_file)
        return
    name = "axis" if name is None else name
    _write(name, output or Path(f"{name}.toml"), machine, given, force=force, json_file=json_file)


def _require_name(name: Text) -> None:
    from pmsm_ctrl.errors import RequestError

    if name is not None and (os.sep in name or not name.strip()):
        raise RequestError(f"init '{name}': a name without {os.sep} was expected; --output names the file")


def _refuse_beside_example(given: dict[str, Text]) -> None:
    """Refuse values of a datasheet beside a design that has its own."""
    from pmsm_ctrl.errors import RequestError

    options = [f"--{key.replace('_', '-')}" for key, text in given.items() if text is not None]
    if options:
        raise RequestError(f"init --example: excludes {', '.join(options)}; change the values in the file it writes")


def _write_example(example: str, name: Text, target: Path, *, force: bool, json_file: Path | None) -> None:
    """Write one of the designs of the package, under another name where one is given."""
    from pmsm_ctrl.console import write_json
    from pmsm_ctrl.datasheet import quoted
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.files import example_design, require_new, write_text

    design = Design.example(example)
    require_new(() if force else [target])
    text = example_design(example).read_text(encoding="utf-8")
    if name is not None:
        text = text.replace(f'name = "{design.name}"', f"name = {quoted(name)}", 1)
        design = Design.from_toml(text, source=str(target))
    write_text(target, text)
    if json_file is not None:
        write_json(json_file, "init", {"design": design.to_dict(), "path": str(target)})
    print(printable(f"design: {target}"))
    print(_recording())
    _print_next(target, simulated=design.motor.electrical and design.motor.J is not None)


def _write(
    name: str, target: Path, machine: Text, given: dict[str, Text], *, force: bool, json_file: Path | None
) -> None:
    import tomllib

    from pmsm_ctrl.console import write_json
    from pmsm_ctrl.datasheet import answers_from, design_toml, machine_of, plausibility
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.files import require_new, write_text

    require_new(() if force else [target])
    ask = _asking(input) if sys.stdin is not None and sys.stdin.isatty() else None
    if machine is None:
        machine = machine_of(given) or ("motor" if ask is None else _machine(input))
    answers = answers_from(given, ask, machine)
    text = design_toml(name, answers, machine)
    design = Design.from_dict(tomllib.loads(text), source=str(target))
    facts, doubts = plausibility(design, answers)
    write_text(target, text)
    for doubt in doubts:
        print(f"pmsm-ctrl: {printable(target)}: warning: {doubt.text} [{doubt.code}]", file=sys.stderr)
    print("\n".join(facts))
    if json_file is not None:
        said = {"warnings": [d.text for d in doubts], "warning_codes": [d.code for d in doubts]}
        write_json(json_file, "init", {"design": design.to_dict(), "path": str(target), **said})
    print(printable(f"design: {target}"))
    print(_recording())
    _print_next(target, simulated=design.motor.electrical and design.motor.J is not None)


def _recording() -> str:
    """Return what to record, for all commands that follow, in lines of the terminal."""
    import shutil
    import textwrap

    from pmsm_ctrl.importers.recording import RECORD

    return textwrap.fill(f"record: {RECORD}", min(shutil.get_terminal_size().columns, 100), subsequent_indent="  ")


def _print_next(target: Path, *, simulated: bool) -> None:
    import shlex

    typed = shlex.quote(str(target))
    following = {f"study {typed}": "tunes and simulates"} if simulated else {}
    following |= {
        "import LOG": "checks a log",
        f"study {typed} --log LOG": "missing effects",
    }
    width = max(map(len, following))
    for number, (command, answers_what) in enumerate(following.items()):
        print(f"{'' if number else 'next:':<6}pmsm-ctrl {printable(command):<{width}}   {answers_what}")


def _machine(read: Callable[[str], str]) -> str:
    """Ask which kind of machine it is until the answer is one."""
    from pmsm_ctrl.datasheet import questions_of
    from pmsm_ctrl.errors import RequestError

    while True:
        try:
            kind = read("machine: motor (windings known), plain (torque constant) or linear [motor]: ").strip()
            questions_of(kind or "motor")
        except EOFError:
            raise RequestError("init: the input ended before the last answer; nothing was written") from None
        except RequestError as error:
            print(f"  {error}", file=sys.stderr)
        else:
            return kind or "motor"


def _asking(read: Callable[[str], str]) -> Callable[[Question], str]:
    """Return a function that asks one question until its answer can be read."""
    from pmsm_ctrl.datasheet import read_answer
    from pmsm_ctrl.errors import RequestError

    def ask(question: Question) -> str:
        units = list(question.units)
        hint = f" [{question.default or 'Enter: none'}]" if question.default is not None else ""
        while True:
            try:
                units_told = f", in {question.accepted}" if units else ""
                text = read(_fitted(f"{question.text}{units_told}{hint}: ")).strip()
                if not text and question.default is not None:
                    return ""
                if units and _bare(text):
                    text = f"{text} {_choose(units, read)}"
                read_answer(question, text)
            except EOFError:
                raise RequestError("init: the input ended before the last answer; nothing was written") from None
            except RequestError as error:
                print(f"  {str(error).removeprefix(question.option).lstrip()}", file=sys.stderr)
            else:
                return text

    return ask


def _fitted(prompt: str) -> str:
    """Return a prompt in lines of the terminal, the last of which leaves room for an answer."""
    import re
    import shutil
    import textwrap

    width = shutil.get_terminal_size().columns
    if len(prompt) <= max(40, width - ANSWER):
        return prompt
    # a unit stays whole: a line ends behind a comma or a semicolon
    pieces = re.sub(r"(?<![,;])\s(?!\[)", "\0", prompt.rstrip())
    lines = textwrap.wrap(pieces, max(40, width - ANSWER) - 1, subsequent_indent="    ", break_on_hyphens=False)
    return "\n".join(lines).replace("\0", " ") + " "


def _bare(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _choose(units: list[str], read: Callable[[str], str]) -> str:
    """Let the user pick the unit by number, because long units are easily mistyped."""
    if len(units) == 1:
        return units[0]
    menu = ", ".join(f"{k} {unit}" for k, unit in enumerate(units, start=1))
    chosen = read(_fitted(f"  which unit? {menu}: ")).strip()
    if chosen.isdecimal() and 1 <= int(chosen) <= len(units):
        return units[int(chosen) - 1]
    return chosen
