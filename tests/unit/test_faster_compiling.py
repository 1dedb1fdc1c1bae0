"""What the tests replace in numba to compile faster gives what numba's own gives."""

from __future__ import annotations

import cmath
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from numba.core.compiler import Flags
from numba.core.cpu import CPUContext
from numba.core.targetconfig import TargetConfig

from tests.faster_compiling import equal, hashed, once, untold, values


def flags(**changed: Any) -> Flags:
    made = Flags()
    for name, value in changed.items():
        setattr(made, name, value)
    return made


SETS = [
    {}, {"nrt": True}, {"nrt": False}, {"fastmath": {"contract"}}, {"fastmath": False}, {"error_model": "numpy"},
    {"error_model": "python"}, {"nrt": True, "boundscheck": None, "inline": "always"},
]  # fmt: skip


@pytest.mark.parametrize("changed", SETS)
def test_options_are_those_that_numba_reads_one_by_one(changed: dict[str, Any]) -> None:
    made = flags(**changed)
    own = {name: getattr(made, name) for name in made.options}
    assert values(made) == own
    assert list(values(made)) == list(own)
    assert hashed(made) == hash(tuple(sorted(own)))
    values(made).clear()
    assert values(made) == own


@pytest.mark.parametrize("one", SETS)
def test_options_are_equal_where_all_values_are(one: dict[str, Any]) -> None:
    """One that is set to its default equals one that is not set."""
    for other in SETS:
        a, b = flags(**one), flags(**other)
        assert equal(a, b) is all(getattr(a, name) == getattr(b, name) for name in a.options)
    assert equal(flags(**one), one) is NotImplemented


def test_a_method_runs_once_for_each_object() -> None:
    class Context(SimpleNamespace):
        __hash__ = object.__hash__

    calls: list[Any] = []
    method, (one, other) = once(calls.append), (Context(), Context())
    for context in (one, one, other, one, other):
        method(context)
    assert [id(context) for context in calls] == [id(one), id(other)]


def test_events_of_one_kind_are_not_told() -> None:
    told: list[Any] = []
    tell = untold(lambda *details, **more: told.append((details, more)), "lock")
    for event in ("lock", "compile"):
        tell(event, 1, data=2)
    assert told == [(("compile", 1), {"data": 2})]


def test_the_tests_compile_that_way_and_right() -> None:
    assert TargetConfig.values is values
    assert CPUContext.load_additional_registries.__qualname__.startswith("once")

    @numba.njit(error_model="numpy")
    def ratio(x: Any, y: Any) -> Any:
        return x[0] / y

    @numba.njit(error_model="python")
    def checked(x: Any, y: Any) -> Any:
        return x[0] / y

    assert ratio(np.ones(1), 0.0) == np.inf
    with pytest.raises(ZeroDivisionError):
        checked(np.ones(1), 0.0)
    assert numba.njit(lambda z: cmath.sqrt(z))(-1.0 + 0.0j) == 1j  # of a registry that is loaded once
