"""Functions on Python syntax trees, for programs that are flattened and printed in other languages."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Iterator
from typing import Any

__all__ = [
    "INTRINSIC", "Statements", "assign", "assigned", "base", "branch", "constant", "expressions", "folded", "intrinsic",
    "is_text", "kinds", "leaves", "name", "power", "read", "same", "without_unread",
]  # fmt: skip

Statements = list[ast.stmt]

INTRINSIC = ("abs", "min", "max", "sqrt", "sin", "cos", "exp", "tanh", "isfinite")
_COMPUTED: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip


# -- making ---------------------------------------------------------------------------------------------------------


def name(text: str) -> ast.Name:
    """Return a name."""
    return ast.Name(text)


def constant(value: float, symbol: str = "") -> ast.Constant:
    """Return a number; `symbol` is its name in the program."""
    node = ast.Constant(value)
    node.symbol = symbol  # type: ignore[attr-defined]
    return node


def assign(target: ast.expr, value: ast.expr) -> ast.stmt:
    """Return one assignment."""
    return ast.Assign([target], value, lineno=0)


def branch(test: ast.expr, body: Statements, other: Statements) -> Statements:
    """Return a branch, or nothing when neither side does anything."""
    if not _does_something(body):
        return [ast.If(ast.UnaryOp(ast.Not(), test), other, [])] if _does_something(other) else []
    return [ast.If(test, body, other if _does_something(other) else [])]


def folded(node: ast.BinOp | ast.Compare | ast.UnaryOp) -> ast.expr:
    """Evaluate constant expressions: bounds of loops, branches of a chosen variant."""
    if isinstance(node, ast.UnaryOp):
        if isinstance(node.operand, ast.Constant):
            value: Any = node.operand.value
            return constant(not value if isinstance(node.op, ast.Not) else -value)
        return node
    if isinstance(node, ast.BinOp):
        left, right, kind = node.left, node.right, type(node.op)
    else:
        left, right, kind = node.left, node.comparators[0], type(node.ops[0])  # type: ignore[assignment]
    if kind in _COMPUTED and isinstance(left, ast.Constant) and isinstance(right, ast.Constant):
        whole = isinstance(left.value, int) and isinstance(right.value, int)
        if whole or isinstance(node, ast.Compare) or not (_symbol(left) or _symbol(right)):
            return constant(_COMPUTED[kind](left.value, right.value))
    elif kind is ast.Mult and _is_one(left):
        return right
    elif kind is ast.Mult and _is_one(right):
        return left
    elif kind is ast.Sub and isinstance(left, ast.BinOp) and isinstance(left.op, ast.Add) and same(left.right, right):
        return left.left  # range(i + 1) ends with i
    return node


def _symbol(node: ast.expr) -> str:
    return getattr(node, "symbol", "")


def _is_one(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value == 1.0 and not _symbol(node)


def power(node: ast.BinOp) -> ast.expr:
    """Write a power of 0.5 as a root and of 2 as a product: not every controller has powers in double precision."""
    # a named exponent stays a power: a user may change it
    exponent = node.right.value if isinstance(node.right, ast.Constant) and not _symbol(node.right) else None
    if exponent == 0.5:
        return ast.Call(name("sqrt"), [node.left], [])
    if exponent == 2.0:
        return ast.BinOp(node.left, ast.Mult(), node.left)
    return node


# -- looking --------------------------------------------------------------------------------------------------------


def is_text(statement: ast.stmt) -> bool:
    """Whether a statement is a remark."""
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def intrinsic(call: ast.Call) -> bool:
    """Whether a call is to a function of all languages."""
    return isinstance(call.func, ast.Name) and call.func.id in INTRINSIC


def leaves(body: Statements) -> bool:
    """Whether every way through `body` returns."""
    last = body[-1] if body else None
    if isinstance(last, ast.If):
        return leaves(last.body) and leaves(last.orelse)
    return isinstance(last, ast.Return)


def base(node: ast.expr) -> str:
    """Return the name of a variable or of an element's array."""
    while isinstance(node, ast.Subscript):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


def read(node: ast.AST) -> set[str]:
    """Return the names in an expression."""
    return {inner.id for inner in ast.walk(node) if isinstance(inner, ast.Name)}


def same(one: ast.expr, other: ast.expr) -> bool:
    """Whether two expressions are the same text."""
    return ast.unparse(one) == ast.unparse(other)


def assigned(statements: Statements) -> set[str]:
    """Return the scalars that statements assign."""
    out = set()
    for node in (inner for statement in statements for inner in ast.walk(statement)):
        targets: list[ast.expr] = []
        if isinstance(node, ast.Assign):
            targets = [e for t in node.targets for e in (t.elts if isinstance(t, ast.Tuple) else [t])]
        elif isinstance(node, ast.AugAssign | ast.For):
            targets = [node.target]
        out |= {t.id for t in targets if isinstance(t, ast.Name)}
    return out


def expressions(statements: Statements) -> Iterator[ast.expr]:
    """Yield every expression that is evaluated, the indices of assigned elements among them."""
    for statement in statements:
        if isinstance(statement, ast.Assign):
            yield statement.value
            if isinstance(statement.targets[0], ast.Subscript):
                yield statement.targets[0].slice
        elif isinstance(statement, ast.If):
            yield statement.test
            yield from expressions(statement.body)
            yield from expressions(statement.orelse)
        elif isinstance(statement, ast.For):
            yield statement.iter
            yield from expressions(statement.body)


# -- tidying --------------------------------------------------------------------------------------------------------


def _does_something(body: Statements) -> bool:
    return any(not is_text(statement) for statement in body)


def without_unread(statements: Statements, outputs: set[str]) -> Statements:
    """Remove scalars on which neither an output nor an array depends: strict compilers warn of them."""
    wanted = set(outputs)
    while True:
        more = wanted | _needed(statements, wanted)
        if more == wanted:
            return _keep(statements, wanted)
        wanted = more


def _needed(statements: Statements, wanted: set[str]) -> set[str]:
    """Return the names read by the wanted scalars and all elements, conditions that decide on them included."""
    out: set[str] = set()
    for statement in statements:
        if isinstance(statement, ast.Assign):
            target = statement.targets[0]
            if isinstance(target, ast.Subscript):
                out |= read(target.slice) | read(statement.value)
            elif base(target) in wanted:
                out |= read(statement.value)
        elif isinstance(statement, ast.If | ast.For):
            inner = [*statement.body, *statement.orelse]
            if _does_something(_keep(inner, wanted)):
                out |= read(statement.test if isinstance(statement, ast.If) else statement.iter)
            out |= _needed(inner, wanted)
    return out


def _keep(statements: Statements, wanted: set[str]) -> Statements:
    out: Statements = []
    for statement in statements:
        if isinstance(statement, ast.If):
            out += branch(statement.test, _keep(statement.body, wanted), _keep(statement.orelse, wanted))
        elif isinstance(statement, ast.For):
            body = _keep(statement.body, wanted)
            if _does_something(body):
                out.append(ast.For(statement.target, statement.iter, body, []))
        elif isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            if statement.targets[0].id in wanted:
                out.append(statement)
        else:
            out.append(statement)
    return out


def kinds(statements: Statements) -> dict[str, str]:
    """Return the scalars of a flat program and whether each is a "real", an "integer" or a "flag"."""
    found: dict[str, str] = {}
    for target, value in _pairs(statements):
        kind = _kind(value, found)
        found[target] = kind if found.get(target, kind) == kind else "real"
    return found


def _pairs(statements: Statements) -> Iterator[tuple[str, ast.expr | None]]:
    for statement in statements:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            yield statement.targets[0].id, statement.value
        elif isinstance(statement, ast.If):
            yield from _pairs([*statement.body, *statement.orelse])
        elif isinstance(statement, ast.For):
            yield base(statement.target), None
            yield from _pairs(statement.body)


def _kind(value: ast.expr | None, found: dict[str, str]) -> str:
    if value is None:
        return "integer"
    if isinstance(value, ast.Constant):
        return "flag" if isinstance(value.value, bool) else "integer" if isinstance(value.value, int) else "real"
    if isinstance(value, ast.Name):
        return found.get(value.id, "real")
    if isinstance(value, ast.Compare | ast.BoolOp) or (
        isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not)
    ):
        return "flag"
    if isinstance(value, ast.Call) and ast.unparse(value.func) == "isfinite":
        return "flag"
    return "real"
