"""No pattern of the package takes more than linear time: of a file, of a name in it, or of an option."""

from __future__ import annotations

import ast
import importlib
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import pmsm_ctrl
from tests.sources import nodes_of

PACKAGE = Path(pmsm_ctrl.__file__).parent
# What is repeated many times, and then does not fit.
RUNS = (
    *"01aAe \t\n_.,;:-+*/%#=\"'()[]{}<>±",
    "1.",
    "1 ",
    "a.",
    "a ",
    ". ",
    "()",
    "[a",
    "(a",
    "a[",
    "1,",
    "0-",
    '="',
    "<>",
)
ENDS = (("", "\x00"), ("a", "\x00"), ("1", "x"), ("(", ""), ("[", "x"))
METHODS = "search|match|fullmatch|sub|split|findall|finditer"
EXEMPT = {
    "fleet/paths.py": "the system bounds the length of a path",
    "rendering/svg.py": "sees its own drawings alone",
}


def patterns() -> Iterator[tuple[str, re.Pattern[str], str]]:
    """Yield every pattern with its place and the method that it is used with."""
    for path in sorted(PACKAGE.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        place = path.relative_to(PACKAGE).as_posix()
        if "re." not in source or place in EXEMPT:
            continue
        for node in nodes_of(path):
            match node:
                case ast.Call(
                    func=ast.Attribute(value=ast.Name(id="re"), attr=method),
                    args=[ast.Constant(value=str(text)), *_],
                ) if method != "compile":
                    yield f"{place}:{node.lineno}", re.compile(text), method
        if "re.compile" in source:
            module = importlib.import_module("pmsm_ctrl." + place.removesuffix(".py").replace("/", "."))
            for name, held in vars(module).items():
                for one in held if isinstance(held, list | tuple) else [held]:
                    if isinstance(one, re.Pattern) and isinstance(one.pattern, str):
                        used = set(re.findall(rf"\b{name}\.({METHODS})\(", source)) or {"fullmatch"}
                        yield from ((f"{place}:{name}", one, method) for method in sorted(used))


def within(limit: float, pattern: re.Pattern[str], method: str, text: str) -> bool:
    """Whether the pattern takes less processor time than the limit, s, at least once in three."""
    for _ in range(3):
        begin = time.process_time()
        if method == "sub":
            pattern.sub("", text)
        elif method == "finditer":
            list(pattern.finditer(text))
        else:
            getattr(pattern, method)(text)
        if time.process_time() - begin < limit:
            return True
    return False


@pytest.mark.slow
def test_time_is_linear_in_the_length() -> None:
    """By the square, 8,000 characters take 7.5 ms at the quickest; in linear time they take less than 1 ms."""
    found = list(patterns())
    assert len(found) > 50
    slow = [
        (place, method, run, head, tail, length)
        for place, pattern, method in found
        for run in RUNS
        for head, tail in ENDS
        for length, limit in ((500, 0.01), (8_000, 0.004))  # a cube would not end at the second
        if not within(limit, pattern, method, head + run * (length // len(run)) + tail)
    ]
    assert slow == []
