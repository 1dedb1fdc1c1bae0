"""An effect is one file: nothing outside `pmsm_ctrl/effects` asks for its name, its structure or a parameter's name.

python -m tests.unit.test_effect_names [PACKAGE]      counts such places in another tree of the package
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

from pmsm_ctrl.effects import CATALOGUE
from tests.sources import nodes_of

PACKAGE = Path(__file__).resolve().parents[2] / "pmsm_ctrl"
# The design page names them, they are what the toolbox tracks: F_c and F_v, of these two effects.
TRACKED = {"coulomb", "viscous", "F_c", "F_v"}
IDS = set(CATALOGUE) - TRACKED
STRUCTURES = {"term", "transmission", "spring", "bristle"}
# What columns call a parameter that is none of the effect's own.
INTERNAL = {"w_a", "zeta", "frame", "level"}
PARAMETERS = {p.symbol for effect in CATALOGUE.values() for p in effect.parameters} - TRACKED | INTERNAL
NAMES = IDS | STRUCTURES | PARAMETERS
READING = ("get", "pop", "setdefault", "startswith", "parameter", "parameters", "with_effect", "without_effect")
# Words that are something else where they stand.
ALLOWED = {
    ("track/model.py", "gap"): "a gap of the log, as an event of the tracker",
    ("sheet_questions.py", "g"): "gram",
    ("frf/bode.py", "g"): "a name of a response in a file",
    ("design_loops.py", "order"): "of a low-pass filter",
    ("design_parts.py", "J_load"): "the inertia of `SecondMass`, whose tolerance may be stated",
    ("design_parts.py", "k"): "the stiffness of `SecondMass`, whose tolerance may be stated",
    ("fleet/paths.py", "d"): "the day of a date",
    **{("fleet/example.py", name): "the plant of a simulated fleet" for name in (
        "unbalance", "viscous_asymmetry", "a_s", "a_c", "dF_v")},
    ("importers/vocabulary.py", "d"): "the direct axis",
    ("importers/vocabulary.py", "n"): "what German puts between the parts of a compound",
    ("next_steps.py", "stribeck"): "an example of the command",
    ("workbench/desk.py", "order"): "of the steps",
    ("frf/fit.py", "delay"): "of the speed behind the torque, a nuisance",
    ("frf/frf.py", "delay"): "of the speed behind the torque, a nuisance",
    ("verify/result.py", "delay"): "of the feedforward behind the reference",
    ("schemas.py", "delay"): "of the feedforward behind the reference",
    ("frf/present.py", "delay"): "of the speed behind the torque, a nuisance",
    ("tune/sampled.py", "d"): "the direct axis",
    ("tune/robust.py", "J_load"): "the inertia of `SecondMass`, and its tolerance in the design",
    ("tune/robust.py", "k"): "the stiffness of `SecondMass`, and its tolerance in the design",
    ("plausibility/foreign.py", "d"): "the direct axis",
    ("plausibility/relations.py", "d"): "the direct axis",
    ("report/present.py", "term"): "a column of the table of effects",
    ("diagnose/excitation.py", "order"): "a detail of a refusal",
    ("export/tables.py", "order"): "a key of the exported file",
    ("export/tables.py", "cogging"): "a key of the exported file",
    ("regression/records.py", "dF_c"): "a level of a record's own",
    ("regression/records.py", "dF_v"): "a level of a record's own",
    ("regression/record_result.py", "dF_c"): "a level of a record's own",
    ("regression/record_result.py", "dF_v"): "a level of a record's own",
    ("regression/present.py", "dF_c"): "a level of a record's own",
    ("regression/present.py", "dF_v"): "a level of a record's own",
    ("rendering/numbers.py", "n"): "nano",
    ("rendering/numbers.py", "k"): "kilo",
}  # fmt: skip


def names_used(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, name) wherever code compares with, looks up or lists a name of an effect, structure or parameter."""
    for node in nodes_of(path):
        if isinstance(node, ast.Compare):
            parts = [node.left, *node.comparators]
            yield from ((node.lineno, f".{name}") for name in _asked(node, parts))
            yield from ((node.lineno, name) for part in parts for name in _names(part))
        elif isinstance(node, ast.Subscript):
            yield from ((node.lineno, name) for name in _names(node.slice))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in READING:
            yield from ((node.lineno, name) for argument in node.args for name in _names(argument))
        elif isinstance(node, ast.Dict):
            yield from ((node.lineno, name) for key in node.keys if key is not None for name in _names(key))
        elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            yield from ((node.lineno, name) for name in _names(node.value))
        elif isinstance(node, ast.For):
            yield from ((node.lineno, name) for name in _names(node.iter))


def _asked(node: ast.Compare, parts: list[ast.expr]) -> Iterator[str]:
    """Yield "structure" where it is compared with anything but None, "channels" where with a tuple."""
    if any(isinstance(part, ast.Constant) and part.value is None for part in parts):
        return
    tuples = any(isinstance(part, ast.Tuple) for part in parts) and isinstance(node.ops[0], ast.Eq | ast.NotEq)
    for part in parts:
        if isinstance(part, ast.Attribute) and (part.attr == "structure" or (part.attr == "channels" and tuples)):
            yield part.attr


def _names(node: ast.expr) -> Iterator[str]:
    for part in node.elts if isinstance(node, ast.Tuple | ast.List | ast.Set) else [node]:
        if isinstance(part, ast.Tuple):
            yield from _names(part)
        if isinstance(part, ast.Constant) and part.value in NAMES:
            yield part.value


def outside(package: Path) -> list[tuple[str, int, str]]:
    """Return (file, line, name) of every such place outside the room of the effects."""
    found = []
    for path in sorted(package.rglob("*.py")):
        file = path.relative_to(package).as_posix()
        if not file.startswith("effects/"):
            found += [(file, line, name) for line, name in sorted(set(names_used(path)))]
    return found


def test_no_effect_structure_or_parameter_is_asked_for_by_name() -> None:
    found = outside(PACKAGE)
    wrong = [f"{file}:{line}: {name}" for file, line, name in found if (file, name) not in ALLOWED]
    said = "a declared attribute of the effect, or a method of its structure, should say it:"
    assert not wrong, "\n".join([said, *wrong])


def test_no_word_is_allowed_without_need() -> None:
    files = {file for file, _ in ALLOWED}
    assert {(file, name) for file in files for _, name in names_used(PACKAGE / file)} >= set(ALLOWED)


if __name__ == "__main__":
    tree = Path(sys.argv[1]) if len(sys.argv) > 1 else PACKAGE
    places = outside(tree)
    for file, line, name in places:
        print(f"{file}:{line}: {name}")
    print(f"{len({(file, line) for file, line, _ in places})} places")
