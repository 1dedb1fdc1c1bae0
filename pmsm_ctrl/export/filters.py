"""The filters of the current reference as a block: the lines of the simulated controller, one call a speed period."""

from __future__ import annotations

import ast

from pmsm_ctrl.design import Design, Filter
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export.blocks import Block, Value, identifier
from pmsm_ctrl.export.program import Flattener
from pmsm_ctrl.export.trees import constant, name
from pmsm_ctrl.simulate.controller_lines import COEFFICIENTS, filter_lines, filter_memory

__all__ = ["filters", "has_filters"]


def has_filters(design: Design) -> bool:
    """Return whether the current reference of a design is filtered.

    Parameters
    ----------
    design : Design
    """
    return design.loops is not None and bool(design.loops.speed.filters)


def filters(design: Design) -> Block:
    """Return the filters of a design's current reference.

    While they are not enabled the current passes, and the memory is that of a constant current, so that they start
    without a step.

    Parameters
    ----------
    design : Design
        With filters in ``[[loops.speed.filters]]``.

    Returns
    -------
    Block

    Raises
    ------
    RequestError
        When the design has none.
    """
    where = design.source or design.name
    if design.loops is None or not design.loops.speed.filters:
        raise RequestError(f"{where}: loops.speed.filters: none; `tune` places one where a resonance asks for it")
    chosen, period = design.loops.speed.filters, design.drive.speed_period
    inputs = (
        Value("i_q", "current that is asked for, all feedforward included, A"),
        Value("enable", "FALSE: the current passes", kind="flag"),
    )
    outputs = (
        Value("i_q_ref", "filtered current, to be limited, A"),
        Value("fault", "the input is not a number: no current", kind="flag"),
    )
    constants: list[Value] = []
    given: dict[str, ast.expr] = {**{value.name: name(value.name) for value in inputs}, "held": name("held")}
    taken: list[str] = []
    steady: list[str] = []
    for k, one in enumerate(chosen):
        numbers = dict(zip(COEFFICIENTS, one.biquad.sampled(period), strict=True))
        own = {symbol: f"{symbol}_{k}" for symbol in COEFFICIENTS}
        for symbol, value in numbers.items():
            label = f"FILTER_{k + 1}_{symbol.upper().replace('_', '')}"
            constants.append(Value(label, f"1, {_words(one)}, called every {1e3 * period:.6g} ms", value))
            given[own[symbol]] = constant(value, label)
        first, second = filter_memory(k)
        put = [f"held[{2 * k}] = {first}", f"held[{2 * k + 1}] = {second}"]
        taken += [f"{first} = held[{2 * k}]", f"{second} = held[{2 * k + 1}]", *filter_lines(k, own), *put]
        # a constant current w in and out, since the gain at rest is 1: w = b_0 w + first, and second = (b_2 - a_2) w
        steady += [
            f"held[{2 * k}] = wanted - {own['b_0']} * wanted",
            f"held[{2 * k + 1}] = {own['b_2']} * wanted - {own['a_2']} * wanted",
        ]
    lines = [
        "i_q_ref = 0.0",
        "fault = True",
        "if isfinite(i_q):",
        "    fault = False",
        "    wanted = i_q",
        "    if enable:",
    ]
    lines += [*(f"        {line}" for line in taken), "    else:", *(f"        {line}" for line in steady)]
    lines.append("    i_q_ref = wanted")
    begin = [f"held[{k}] = 0.0" for k in range(2 * len(chosen))]
    reserved = [value.name for value in (*inputs, *constants, *outputs)] + ["held"]
    kept = {value.name for value in outputs} | {"held"}
    flat = Flattener(reserved).program(ast.parse("\n".join(lines)).body, {}, given, kept)
    first_call = Flattener(reserved).program(ast.parse("\n".join(begin)).body, {}, given, {"held"}).statements
    return Block(
        identifier(design.name), "filter", f"Filters of the current reference of {design.name}", inputs, outputs, flat,
        constants=tuple(constants), arrays={"held": (2 * len(chosen),)}, start=first_call,
        linear=design.motion == "linear",
        notes={"held": "A, memory of the filters, two each", "wanted": "A", "passed": "A"},
    )  # fmt: skip


def _words(one: Filter) -> str:
    """Return what a filter is."""
    text = f"{one.kind.replace('_', '-')} {one.frequency:.6g} Hz"
    if one.kind == "notch":
        return f"{text}, width {one.width:.6g} Hz, " + ("complete" if one.depth is None else f"{one.depth:.4g} dB")
    return f"{text}, {one.phase:.4g} deg" if one.kind == "lead" else f"{text}, order {one.order or 2}"
