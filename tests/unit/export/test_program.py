"""Flattening: whatever a kernel may be written like, the flat program does what Python does."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from math import tanh
from typing import Any

import numpy as np
import pytest

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export.blocks import Block, Value, identifier
from pmsm_ctrl.export.files import c_source, st_block
from pmsm_ctrl.export.program import Flattener
from pmsm_ctrl.export.trees import name
from pmsm_ctrl.export.writers import plain, real
from tests.unit.export.structured_text import parsed

LIMIT = 0.5


def early(a: float, b: float) -> float:
    """Leave from several places."""
    if a > LIMIT:
        if b > 0.0:
            return 1.0
        a = a - 1.0
    elif b < -1.0:
        return a
    else:
        if a < -1.0:
            a = -a
            if b > a:
                return 7.0
        b = b * 2.0
    for i in range(3):
        a += i * b
    return a - b


def swapped(a: float, b: float) -> float:
    """Assign side by side, in a chain, and with names apart by case alone."""
    S, s = a, b
    S, s = s, S
    x = y = S - s
    A = x * s
    return A + y * S


def guarded(a: float, b: float) -> float:
    """Evaluate one side of a choice only: the other divides by zero or takes the root of a negative number."""
    root = a**0.5 if a > 0.0 else -1.0
    share = a / b if b != 0.0 else (1.0 if a > 0.0 else 2.0)
    return max(root, share) + (abs(b) ** 1.5 if not (a < 0.0 or b > 1.0) else 0.0)


def pair(a: float, b: float) -> tuple[float, float]:
    """Return two values from either side."""
    return (b, a) if False else (a + b, a - b)


def halves(a: float, b: float) -> tuple[float, float]:
    """Return two values."""
    if a > b:
        return a, b
    return b, a


def nested(a: float, b: float) -> float:
    """Call the same function inside its own arguments, and as one of several values."""
    big, small = halves(a, b)
    twice = early(early(a, b), early(b, a))
    big, small = halves(small * 3.0, big)
    return twice + 2.0 * big - small * weigh(a - 1.0, weigh(b, a))


def weigh(a: float, b: float) -> float:
    """One expression whose arguments come up more than once."""
    return a * a - b / (1.0 + b * b) + a * b


def reused(a: float, b: float) -> float:
    """Change an argument, and use a value that a later call computes anew."""
    kept = weigh(a, b)
    a *= -2.0
    b -= a
    return kept - weigh(a, b) + math.pi * 0.0 + kept


def bent(a: float, b: float) -> float:
    """Use the hyperbolic tangent, which Structured Text does not have."""
    return tanh(30.0 * a) + tanh(b) * a


def flat(function: Callable[..., Any]) -> Block:
    """Return a block that calls the function."""
    body = ast.parse("result = f(a, b)").body
    inputs = {text: name(text) for text in ("a", "b")}
    program = Flattener(["a", "b", "result"]).program(body, {"f": function}, inputs, {"result"})
    values = tuple(Value(text, "a number") for text in ("a", "b"))
    return Block("axis", "part", "test", values, (Value("result", "what comes out"),), program)


@pytest.mark.parametrize("function", [early, swapped, guarded, nested, weigh, bent])
def test_flat_programs_do_what_python_does(function: Callable[..., float]) -> None:
    block = parsed(st_block(flat(function)))
    rng = np.random.default_rng(11)
    corners = [(a, b) for a in (-2.0, 0.0, 0.5, 0.75, 2.0) for b in (-2.0, -1.0, 0.0, 1.5)]
    for a, b in [*corners, *rng.normal(0.0, 2.0, (200, 2)).tolist()]:
        block(a=a, b=b)
        assert block["result"] == pytest.approx(function(a, b), rel=1e-14, abs=1e-14), (a, b)


def test_names_that_differ_by_case_alone_are_told_apart() -> None:
    names = [text.lower() for text in flat(swapped).program.variables]
    assert len(names) == len(set(names)) >= 4


def wasteful(a: float, b: float) -> float:
    """Work for nothing."""
    unused, other = a * b, b
    for i in range(3):
        other += unused * i
        if other > 1.0:
            other = 0.0
    return a


def test_what_nobody_reads_is_left_out() -> None:
    assert set(flat(wasteful).program.variables) == {"result"}


def repeating(a: float, b: float) -> float:
    """Iterate until it has converged."""
    while a > b:
        a *= 0.5
    return a


def secretive(a: float, b: float) -> float:
    """Read what is only known when it runs."""
    return a * np.random.default_rng().random() + b


def named(a: float, b: float) -> float:
    """Pass an argument by name."""
    return weigh(a, b=b)


def endless(a: float, b: float) -> float:
    """Count to an infinite number."""
    return a + b * math.inf


@pytest.mark.parametrize("function", [repeating, secretive, named, endless])
def test_what_a_controller_should_not_do_is_refused(function: Callable[..., float]) -> None:
    with pytest.raises(RequestError, match=r"cannot be exported|not a constant of the program"):
        flat(function)


def test_literals_and_remarks() -> None:
    assert [real(x) for x in (1e-7, 2.0, -3e22, 0.1)] == ["1.0E-07", "2.0", "-3.0E+22", "0.1"]
    assert plain("a *) b */ c ]]> ü\nd") == "a * ) b * / c ] ] > ? d"
    assert [identifier(text) for text in ("2 kW", "a--b_", "", "Ü")] == ["axis_2_kW", "a_b", "axis", "axis"]


def test_c_of_a_block_without_memory_is_one_function() -> None:
    text = c_source(flat(early), with_header=True)
    assert text.count("double axis_part(double a, double b)") == 2
    assert "#include <math.h>" in text
