"""From a datasheet to a design: the questions, in the units of datasheets, and the TOML that is written.

A unit is required where datasheets use more than one: a torque constant per A rms or per A peak, a resistance of a
phase or between two terminals. The design keeps the number of the sheet and names its unit.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace

from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import RequestError, nearest
from pmsm_ctrl.likely import FACTS, figures_of, unlikely
from pmsm_ctrl.section import Notice, Template
from pmsm_ctrl.sheet_questions import MACHINES, PITCH, QUESTIONS, Answer, Question, option_of
from pmsm_ctrl.units import DATASHEET, axis_unit

__all__ = [
    "MACHINES", "QUESTIONS", "Answer", "Question", "answers_from", "design_toml", "machine_of", "plausibility",
    "questions_of", "quoted", "read_answer",
]  # fmt: skip

_NUMBER = re.compile(r"([+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?)\s*+(.*)", re.DOTALL)
# These words may stand anywhere in a unit: "Vrms/krpm, l-l", "V/krpm (line-to-line, rms)".
_WORDS = {"rms": "rms", "eff": "rms", "peak": "peak", "pk": "peak", "line": "line", "phase": "phase"}


def machine_of(given: Mapping[str, str | None]) -> str:
    """Return the kind of machine that alone has all of these values; empty where several have.

    Parameters
    ----------
    given : mapping of key to text or None

    Returns
    -------
    str
    """
    keys = {key for key, text in given.items() if text}
    having = [
        kind for kind, questions in MACHINES.items()
        if keys <= {question.key for question in questions if not question.beside or question.beside in keys}
    ]  # fmt: skip
    return having[0] if len(having) == 1 else ""


def questions_of(machine: str) -> tuple[Question, ...]:
    """Return the questions for a kind of machine.

    Parameters
    ----------
    machine : {"motor", "plain", "linear"}

    Returns
    -------
    tuple of Question

    Raises
    ------
    RequestError
        For a kind that does not exist.
    """
    if machine not in MACHINES:
        raise RequestError(
            f"--machine '{machine}': motor (its windings are known), plain (only a torque constant is) or linear "
            f"(a moving mass and a force constant) was expected{nearest(machine, MACHINES)}"
        )
    return MACHINES[machine]


def read_answer(question: Question, text: str) -> Answer:
    """Turn ``0.84 N m/A rms`` into the field and the number of a design.

    Parameters
    ----------
    question : Question
    text : str

    Returns
    -------
    Answer

    Raises
    ------
    RequestError
        When there is no number, no unit where one is needed, or a unit that does not fit.
    """
    if question.key == "inertia" and text.strip().casefold() == "unknown":
        return Answer("J", math.nan, "")
    found = _NUMBER.fullmatch(text.strip())
    if found is None or not math.isfinite(float(found[1])):
        raise RequestError(f"{question.option} '{text}': a number with its unit was expected: {question.accepted}")
    number, unit = float(found[1]), found[2]
    if unit.startswith(","):
        raise RequestError(f"{question.option} '{text}': write the decimal mark as a point")
    if not question.units:
        if unit:
            raise RequestError(f"{question.option} '{text}': a plain number was expected")
        _require_sign(question, text, number)
        return Answer({"pole_pairs": "p"}.get(question.key, question.key), number, "")
    known = {_essence(name): name for name in question.units}
    if _essence(unit) not in known:
        words, rest = _essence(unit)
        open_ways = any(left == rest and words < have for have, left in known)  # it lacks rms, peak, line or phase
        problem = f"the unit '{unit}' is {'ambiguous' if open_ways else 'unknown'}" if unit else "the unit is missing"
        raise RequestError(f"{question.option} '{text}': {problem}; accepted: {question.accepted}")
    name = known[_essence(unit)]
    field, factor = question.units[name]
    if field == "bits":
        if not 1 <= number <= 40:
            raise RequestError(f"{question.option} '{text}': 1 to 40 bit were expected")
        return Answer("encoder_counts", 2.0**number, name)
    if field == "pitch" and number <= 0.0:
        raise RequestError(f"{question.option} '{text}': a pole pitch above 0 was expected")
    if field == "step":
        if not 1e-10 <= factor * number <= 1e-2:
            raise RequestError(f"{question.option} '{text}': a step of 0.1 nm to 10 mm was expected")
        return Answer("encoder_counts", float(round(1.0 / (factor * number))), name)
    _require_sign(question, text, number)
    return Answer(field, factor * number, name)


def _require_sign(question: Question, text: str, number: float) -> None:
    least = "of at least zero" if question.key in ("friction", "viscous", "load_inertia") else "above zero"
    if number < 0.0 or (number == 0.0 and least == "above zero"):
        raise RequestError(f"{question.option} '{text}': a number {least} was expected: {question.text}")


def _essence(unit: str) -> tuple[frozenset[str], str]:
    """Reduce a unit's spelling to its words (rms, peak, line, phase) and the rest without marks."""
    text = unit.lower().replace("²", "2").replace("ω", "ohm").replace("Ω", "ohm")
    text = re.sub(r"line[- ]to[- ]line|l-l|phase[- ]to[- ]phase|terminal[- ]to[- ]terminal|terminals?", " line ", text)
    text = re.sub(r"1000 ?(rpm|/min|1/min|min-1|min\^-1)|krpm|k?rpm/1000", "krpm", text)
    text = re.sub(r"\bper\b", "/", text)
    words = set()
    for word, meaning in _WORDS.items():
        if word in text:
            words.add(meaning)
            text = text.replace(word, "")
    return frozenset(words), re.sub(r"[\s()\[\]^*·.,_]", "", text)


def answers_from(
    given: Mapping[str, str | None], ask: Callable[[Question], str] | None = None, machine: str = "motor"
) -> dict[str, Answer]:
    """Collect the answers by key: those given, those asked for, and the defaults.

    Parameters
    ----------
    given : mapping of key to text or None
    ask : function, optional
        Asks the user for a missing value; returns the text, "" for the default.
    machine : {"motor", "plain", "linear"}

    Returns
    -------
    dict of key to Answer

    Raises
    ------
    RequestError
        When something is wrong, does not belong to this kind of machine, or is missing and cannot be asked for.
    """
    questions = questions_of(machine)
    own = {question.key for question in questions}
    for key, text in given.items():
        if text and key not in own:
            raise RequestError(f"init: {option_of(key)} does not apply to a {machine} machine")
    answers: dict[str, Answer] = {}
    missing = []
    for question in questions:
        text = given.get(question.key)
        if question.beside and question.beside not in answers:
            if text:
                raise RequestError(f"init: {question.option} needs {option_of(question.beside)} of the same motor")
            continue
        if text is None:
            text = ask(question) if ask is not None else ""
        stated = bool(text.strip())
        text = text.strip() or (question.default or "")
        if text:
            answers[question.key] = replace(read_answer(question, text), stated=stated)
        elif question.default is None:
            missing.append(question)
    if missing:
        named = ", ".join(f"{q.option} ({q.accepted})" for q in missing)
        raise RequestError(f"init: missing {named}; or run it in a terminal to be asked")
    if "torque_constant" not in answers and "emf_constant" not in answers:
        either = "one of --torque-constant and --emf-constant is needed, from which the flux follows"
        constant = next(question for question in questions if question.key == "torque_constant")
        needed = either if _has_windings(answers, machine) else f"missing {constant.option} ({constant.accepted})"
        raise RequestError(f"init: {needed}")
    return answers


def _has_windings(answers: Mapping[str, Answer], machine: str) -> bool:
    """Whether the windings are known: of a linear motor where its pole pitch is."""
    return machine == "motor" or PITCH in answers


def design_toml(name: str, answers: Mapping[str, Answer], machine: str = "motor") -> str:
    """Return the design as commented TOML.

    Parameters
    ----------
    name : str
    answers : mapping of key to Answer
    machine : {"motor", "plain", "linear"}

    Returns
    -------
    str

    Raises
    ------
    DesignError, RequestError
        When the numbers do not make a design.
    """
    tables = _tables(answers, machine)
    lines = [
        "# Written from a datasheet. Numbers keep the unit of the sheet, which their names state.",
        "# identify and sweep find the friction, tune the loops." if _has_windings(answers, machine)
        else "# identify finds the friction. Without winding data the drive cannot be simulated.",
        f"name = {quoted(name)}",
        *(['motion = "linear"'] if machine == "linear" else []),
    ]  # fmt: skip
    for table in ("motor", "load", "drive", "sensor"):
        if table in tables:
            lines += ["", f"[{table}]", *(_line(*entry) for entry in tables[table])]
    for effect in ("coulomb", "viscous"):
        lines += ["", "[[effects]]", f"id = {quoted(effect)}", *(_line(*entry) for entry in tables[effect])]
    text = "\n".join(lines) + "\n"
    Design.from_dict(tomllib.loads(text), source="init")  # raises errors before anything is written
    return text


def quoted(text: str) -> str:
    """Return a text as a string of TOML.

    Parameters
    ----------
    text : str

    Returns
    -------
    str
    """
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


UNKNOWN = "unknown"  # of an inertia
Entry = tuple[str, float | int, str]


_ROTARY_UNITS = {
    "F_c": "N m", "F_v": "N m s/rad", "J": "kg m^2", "encoder_counts": "counts per turn", "K_t": "N m per A peak",
}  # fmt: skip
_LINEAR_UNITS = {
    "F_c": "N", "F_v": "N s/m", "J": "kg", "encoder_counts": "counts per metre", "K_t": "N per A peak",
}  # fmt: skip


def _tables(answers: Mapping[str, Answer], machine: str) -> dict[str, list[Entry]]:
    """Sort the answers into the design's tables as (field, value, comment)."""
    units = _LINEAR_UNITS if machine == "linear" else _ROTARY_UNITS
    tables: dict[str, list[Entry]] = {}
    for question in MACHINES[machine]:
        answer = answers.get(question.key)
        if answer is None or (question.key == "emf_constant" and "torque_constant" in answers):
            continue
        field, value, comment = answer.field, answer.value, question.text
        if machine == "linear" and PITCH in answers:
            field, value = _of_winding(answer, field, value)
        if question.key == "inductance" and "inductance_q" in answers:
            field = {"L_mH": "L_d_mH", "L_line_to_line_mH": "L_d_line_to_line_mH"}[field]
        if field in DATASHEET:
            comment = DATASHEET[field].meaning
            if machine == "linear":
                comment = axis_unit(comment, "linear").replace("per m/s mechanical", "per m/s")
        elif field == "p" and machine == "linear":
            comment = f"pole pairs in 2 pi m: pi over the pole pitch of {answer.value:g} m"
        elif question.units:
            comment = units.get(field, answer.unit.replace("kHz", "Hz").replace("V ac", "V").replace("V dc", "V"))
        if field == "speed_rate":
            field, value, comment = _divider(answers["pwm"].value, value)
        if _assumed(answer):
            comment += "; assumed, since nothing was stated"
        tables.setdefault(question.table, []).append((field, value, comment))
    return tables


def _of_winding(answer: Answer, field: str, value: float) -> tuple[str, float]:
    """Return field and value of an answer about a linear motor with windings.

    Raises
    ------
    RequestError
        For a force constant without its amplitude, from which no flux follows.
    """
    if field == "pitch":
        return "p", math.pi / value
    if field != "K_t":
        return field, value
    if answer.unit.endswith("dc"):
        raise RequestError("--torque-constant: N/A peak or N/A rms was expected beside --pole-pitch")
    return ("K_t_rms", value / math.sqrt(0.5)) if answer.unit.endswith("rms") else ("K_t_peak", value)


def _assumed(answer: Answer) -> bool:
    """Whether a value is the usual one, which nobody stated; no friction is no assumption, it is to be found."""
    return not answer.stated and answer.value != 0.0


def _divider(f_control: float, rate: float) -> Entry:
    divider = f_control / rate if rate > 0 else 0.0
    if abs(divider - round(divider)) > 1e-6 * divider or round(divider) < 1:
        raise RequestError(
            f"--speed-loop: {rate:g} Hz does not divide the {f_control:g} Hz of --pwm; "
            f"the nearest that does is {f_control / max(1, round(divider)):g} Hz"
        )
    return "speed_divider", round(divider), f"speed loop at {rate:g} Hz"


def _line(field: str, value: float | int, comment: str) -> str:
    if math.isnan(value):
        return f"{f'{field} = {quoted(UNKNOWN)}':<30}# a log with fast reversals tells it"
    whole = field in ("p", "speed_divider", "encoder_counts") and not comment.startswith("pole pairs in 2 pi m")
    if whole and value != int(value):
        raise RequestError(f"{field}: found {value:g}, but a whole number was expected")
    shown = str(int(value)) if whole else f"{value:.10g}"
    if not whole and re.fullmatch(r"[+-]?\d+", shown):
        shown += ".0"
    return f"{f'{field} = {shown}':<30}# {comment}"


GEAR_ALONE = Template(
    "gear_alone",
    "a gear ratio of {ratio:g} without a load inertia changes nothing: state --load-inertia, at the load's own shaft",
)
EMF_MISMATCH = Template(
    "emf_mismatch", "the EMF constant gives {ratio:.3g} times the flux of the torque constant{cause}"
)


def plausibility(design: Design, answers: Mapping[str, Answer]) -> tuple[list[str], list[Notice]]:
    """Return what follows from the sheet, to be checked, and what is unlikely.

    Parameters
    ----------
    design : Design
    answers : mapping of key to Answer
        What the design was made from.

    Returns
    -------
    facts : list of str
        Torque constant, time constant, no-load speed, acceleration, and what was assumed.
    notices : list of Notice
        Empty when nothing is unlikely.
    """
    motor, linear, figures = design.motor, design.motion == "linear", figures_of(design)
    unit = "N/A" if linear else "N m/A"
    lines = [f"K_t = {design.K_t:.4g} {unit} peak = {design.K_t * math.sqrt(2):.4g} {unit} rms"]
    if "torque_constant" in answers and answers["torque_constant"].unit.endswith("dc"):
        lines = [f"K_t = {design.K_t:.4g} {unit}"]
    lines += [f"{name.removesuffix(', linear')}: {figures[name][1]}" for name in FACTS if name in figures]
    questions = {question.key: question for question in (MACHINES["linear"] if linear else QUESTIONS)}
    assumed = [f"{questions[key].option} '{questions[key].default}'" for key, one in answers.items() if _assumed(one)]
    if assumed:
        lines.append(f"not stated, so assumed: {', '.join(assumed)}")
    doubts = unlikely(design)
    if motor.p is not None and motor.psi_f is not None and {"emf_constant", "torque_constant"} <= set(answers):
        doubts += _emf_check(motor.p, motor.psi_f, answers["emf_constant"])
    if "gear" in answers and "load_inertia" not in answers:
        doubts.append(GEAR_ALONE(ratio=answers["gear"].value))
    return lines, doubts


def _emf_check(p: float, psi_f: float, emf: Answer) -> list[Notice]:
    """Both constants of a sheet state the same flux: a ratio between them is a convention that was misread."""
    ratio = DATASHEET[emf.field].to_si(emf.value, p) / psi_f
    if abs(ratio - 1.0) <= 0.08:
        return []
    reasons = {
        math.sqrt(2.0): "rms read as peak in one of them",
        math.sqrt(3.0): "line-to-line read as phase in one of them",
        math.sqrt(6.0): "rms read as peak, and line-to-line as phase",
        math.sqrt(1.5): "rms read as peak in one and line-to-line as phase in the other",
        1.5: "the drive's torque constant is for another current scaling",
        2.0: "poles read as pole pairs",
    }
    why = [text for factor, text in reasons.items() if abs(max(ratio, 1 / ratio) / factor - 1.0) < 0.04]
    cause = f": {why[0]}" if why else ""
    return [EMF_MISMATCH(ratio=ratio, cause=cause)]
