"""The step "Design": an example, a file in TOML, or the form of a datasheet whose errors stand at their fields."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pmsm_ctrl.datasheet import MACHINES, answers_from, design_toml, plausibility, read_answer
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError, RequestError
from pmsm_ctrl.sheet_questions import PITCH

__all__ = ["FormError", "form", "from_form", "from_text", "shown"]

WORDS = {
    "motor": "Motor with winding data (resistance, inductance)",
    "plain": "Motor of which only the torque constant is known",
    "linear": "Linear motor or screw axis: a mass and a force constant, and windings where the pole pitch is known",
}
LONGEST_NAME = 80


class FormError(RequestError):
    """Some fields of the form are wrong.

    Parameters
    ----------
    fields : dict of field to message
    """

    def __init__(self, fields: Mapping[str, str]) -> None:
        super().__init__("; ".join(fields.values()))
        self.fields = dict(fields)


def form() -> list[dict[str, Any]]:
    """Return the questions for every kind of machine, for a page.

    Returns
    -------
    list of dict
    """
    return [
        {
            "machine": machine,
            "words": WORDS[machine],
            "questions": [
                {
                    "key": q.key, "text": q.text, "units": list(q.units), "default": q.default,
                    "needed": q.default is None and not q.beside,
                }
                for q in questions
            ],
        }
        for machine, questions in MACHINES.items()
    ]  # fmt: skip


def from_text(text: str, name: str) -> Design:
    """Return the design of an uploaded TOML file.

    Parameters
    ----------
    text : str
    name : str
        Of the file, for messages.

    Returns
    -------
    Design
    """
    return Design.from_toml(text, source=name).model_copy(update={"source": ""})


def from_form(name: str, machine: str, given: Mapping[str, str]) -> tuple[Design, list[str], list[str]]:
    """Return the design of a filled form, what follows from its numbers, and what of that is unlikely.

    Parameters
    ----------
    name : str
    machine : {"motor", "plain", "linear"}
    given : dict of question to text
        Number and unit.

    Returns
    -------
    (Design, list of str, list of str)

    Raises
    ------
    FormError
        With a message for every wrong field.
    """
    import tomllib

    if machine not in MACHINES:
        raise FormError({"machine": "choose a kind of machine"})
    wrong: dict[str, str] = {}
    if not name.strip() or len(name) > LONGEST_NAME:
        wrong["name"] = f"a name of 1 to {LONGEST_NAME} characters was expected"
    for question in MACHINES[machine]:
        text = given.get(question.key, "").strip()
        asked = not question.beside or bool(given.get(question.beside, "").strip())
        if not text and question.default is None and asked:
            wrong[question.key] = "a number is needed here"
        elif text and not asked:
            wrong[question.beside] = "a number is needed here beside those of the windings"
        elif text:
            try:
                read_answer(question, text)
            except RequestError as error:
                wrong[question.key] = str(error).partition(": ")[2]
    wound = machine == "motor" or bool(given.get(PITCH, "").strip())
    torque = ("torque_constant", "emf_constant") if wound else ("torque_constant",)
    if not any(given.get(key, "").strip() for key in torque):
        either = "one of torque constant and EMF constant is needed"
        wrong |= dict.fromkeys(torque, either if wound else "a number is needed here")
    if wrong:
        raise FormError(wrong)
    answers = answers_from({key: text for key, text in given.items() if text.strip()}, None, machine)
    try:
        design = Design.from_dict(tomllib.loads(design_toml(name.strip(), answers, machine)))
    except PmsmCtrlError as error:
        raise FormError(_placed(str(error), {key: answer.field for key, answer in answers.items()})) from None
    facts, doubts = plausibility(design, answers)
    return design, facts, [doubt.text for doubt in doubts]


def _placed(message: str, fields: Mapping[str, str]) -> dict[str, str]:
    """Put the message of a design under the question that it came from; under the name where that is not told."""
    said = message.removeprefix("init: ")
    place = said.partition(":")[0]
    field = place.rpartition(".")[2].strip("- ").replace("-", "_")
    for key, own in fields.items():
        if field in (key, own):
            return {key: said.partition(": ")[2]}
    return {"name": said}


def shown(
    design: Design, origin: str, facts: list[str] | None = None, doubts: list[str] | None = None
) -> dict[str, Any]:
    """Return what a session keeps of a design.

    Parameters
    ----------
    design : Design
    origin : str
        Where it comes from, in words.
    facts, doubts : list of str, optional
        Of `from_form`; without, what follows from the design's own numbers.

    Returns
    -------
    dict
    """
    if facts is None:
        facts, notices = plausibility(design, {})
        doubts = [notice.text for notice in notices]
    return {
        "name": design.name, "toml": design.to_toml(), "origin": origin, "facts": facts, "doubts": doubts or [],
        "motion": design.motion, "effects": [entry.id for entry in design.effects],
        "simulated": bool(design.motor.electrical),
    }  # fmt: skip
