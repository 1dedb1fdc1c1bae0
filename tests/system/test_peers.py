"""The comparison with other sparse fits: what peers are given, what they select, how that is counted."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.benchmarks.peers.cases import Case, judged, make
from tests.benchmarks.peers.library import Library, generic, library_of
from tests.benchmarks.peers.marks import OFFSET, Marks, marks
from tests.benchmarks.peers.methods import frols, greedy_bic, stlsq
from tests.benchmarks.peers.table import merged, report

PEERS: dict[str, tuple[str, Callable[[Library], list[str]]]] = {
    "greedy": ("numpy", greedy_bic), "stlsq": ("pysindy", stlsq), "frols": ("sysidentpy", frols),
}  # fmt: skip


def made(seed: int, **amounts: float) -> Library:
    """A library of six effects, `wave` with two columns; the target holds the given amounts of them and noise."""
    rng = np.random.default_rng(seed)
    names = ("slope", "wave", "wave", "bend", "lag", "drag", "drift")
    base, columns = rng.normal(size=(2000, 3)), rng.normal(size=(2000, len(names)))
    columns[:, 3] += base[:, 1]  # beside the base only half of it is its own
    target = base @ [5.0, 3.0, 2.0] + rng.normal(size=2000)
    for name, amount in amounts.items():
        target += amount * columns[:, [n == name for n in names]].sum(axis=1)
    return Library(target, base, ("J", "F_c", "F_v"), names, columns, {"lag": 1}, {}, SimpleNamespace())  # type: ignore[arg-type]


@pytest.mark.parametrize("peer", PEERS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_peer_selects_what_is_there_in_the_order_of_its_size(peer: str, seed: int) -> None:
    module, select = PEERS[peer]
    pytest.importorskip(module)
    assert select(made(seed, wave=0.8, bend=0.5))[:2] == ["wave", "bend"]
    assert len(select(made(seed))) <= 1


def test_beside_the_base_nothing_of_it_is_left() -> None:
    library = made(4, slope=0.3)
    y, x = library.beside_base()
    assert np.max(np.abs(library.base.T @ np.column_stack([y, x]))) < 1e-9
    assert np.mean(np.column_stack([y, x]) ** 2, axis=0) == pytest.approx(1.0)
    values, inside = library.solved(["slope"])
    assert values == pytest.approx([5.0, 3.0, 2.0, 0.3], abs=0.1)
    assert inside.tolist() == [True] + [False] * 6


def test_two_logs_of_drives_drawn_at_random() -> None:
    clean, hidden = make(305, False), make(351, True)
    assert clean is not None
    assert hidden is not None
    assert hidden.margin > 3.0
    rows = [
        {"case": "world", "seed": k, "hidden": case.hidden, "margin": case.margin} | row
        for k, case in enumerate((clean, hidden))
        for row in judged(case, ("base model alone", "greedy BIC"))
    ]
    assert not any("why" in row for row in rows)
    alone, greedy = rows[2:]
    assert marks(greedy).contained
    assert hidden.hidden not in marks(greedy).false
    assert greedy["held_out"] < 0.9 * alone["held_out"]
    assert greedy["error"] < alone["error"]
    assert abs(rows[1]["held_out"] / rows[0]["held_out"] - 1.0) < 0.1
    report(rows)


@pytest.mark.slow
def test_a_generic_library_names_the_products_that_are_effects() -> None:
    case = make(305, False)
    assert case is not None
    library = generic(library_of(case.design, case.log))
    assert {"viscous_asymmetry", "quadratic_drag", OFFSET} <= set(library.names)
    assert not {"omega", "direction", "alpha"} & set(library.names)


@pytest.mark.slow
def test_what_fails_is_a_row_with_its_reason() -> None:
    case = make(305, False)
    assert case is not None
    short = Case(case.design, case.log.slice(0, 40), case.held)
    rows = judged(short, ("greedy BIC",))
    assert rows[0]["named"] == []
    assert "samples" in rows[0]["why"]


def test_of_two_runs_the_later_row_counts() -> None:
    def row(method: str, seed: int, named: list[str]) -> dict[str, Any]:
        return {"method": method, "case": "world", "seed": seed, "hidden": None, "named": named}

    old, other, new = row("a", 1, ["x"]), row("b", 1, []), row("a", 1, [])
    assert merged([old, other], [new]) == [new, other]


@pytest.mark.parametrize(
    ("hidden", "named", "equivalents", "first", "but_timing", "itself", "contained", "false"),
    [
        (None, ["delay", OFFSET], [[], []], False, False, False, False, ("delay",)),
        ("stribeck", ["stribeck", "delay"], [[], []], True, True, True, True, ("delay",)),
        ("stribeck", ["delay", "stribeck"], [[], []], False, True, True, True, ("delay",)),
        ("stribeck", [OFFSET, "presliding"], [[], ["stribeck"]], True, True, False, True, ()),
        ("cogging", ["torque_ripple"], [[]], True, True, True, True, ()),
        (OFFSET, ["backlash", OFFSET], [[], []], False, False, False, True, ("backlash",)),
    ],
)
def test_what_counts_of_an_answer(
    hidden: str | None, named: list[str], equivalents: list[list[str]], first: bool, but_timing: bool, itself: bool,
    contained: bool, false: tuple[str, ...],
) -> None:  # fmt: skip
    found = marks({"hidden": hidden, "named": named, "equivalents": equivalents})
    assert found == Marks(first, but_timing, itself, contained, false)
