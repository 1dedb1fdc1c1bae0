"""Flatten compiled Python functions into one program for a PLC or a drive.

The source is the package's own kernels. Every call is replaced by the callee's statements, early returns become
branches, and the result consists of assignments, branches and loops of fixed length on scalars and arrays: Python's
syntax tree, which `pmsm_ctrl.export.writers` prints as C or Structured Text.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from types import FunctionType
from typing import Any

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export.trees import (
    Statements,
    assign,
    assigned,
    base,
    branch,
    constant,
    folded,
    intrinsic,
    is_text,
    kinds,
    leaves,
    name,
    power,
    read,
    same,
    without_unread,
)  # fmt: skip

__all__ = ["Flattener", "Program", "body_of"]

LONGEST = 32  # characters of a name: some controllers take no more


@dataclass(frozen=True, eq=False)
class Program:
    """Statements of a flattened program, and the kinds ("real", "integer", "flag") of the scalars it works with."""

    statements: tuple[ast.stmt, ...]
    variables: Mapping[str, str]


@dataclass(eq=False)
class _Frame:
    """One call: the expressions of its arguments, and the scope of its names."""

    function: str
    given: dict[str, ast.expr]
    scope: Mapping[str, Any]
    own: set[str] = field(default_factory=set)


def body_of(function: Any) -> tuple[ast.FunctionDef, Mapping[str, Any]]:
    """Return the tree of a function, compiled or not, without its docstring, and its global names.

    Raises
    ------
    RequestError
        When the object is not a function with source.
    """
    source = getattr(function, "py_func", function)
    if not inspect.isfunction(source):
        raise RequestError(
            f"'{getattr(source, '__name__', source)}' has no counterpart on a controller; it cannot be exported"
        )
    return _tree_of(source), source.__globals__


@cache  # a kernel is entered many times, and its tree is only read
def _tree_of(function: FunctionType) -> ast.FunctionDef:
    tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    if not isinstance(tree, ast.FunctionDef):
        raise RequestError(f"{function}: only a function can be exported")
    doc = ast.get_docstring(tree)
    tree.body = tree.body[1:] if doc else tree.body
    tree.doc = (doc or "").split("\n")[0]  # type: ignore[attr-defined]
    return tree


def _uses(tree: ast.AST, text: str) -> int:
    return sum(isinstance(node, ast.Name) and node.id == text for node in ast.walk(tree))


class Flattener:
    """Replaces calls by the statements of the callees.

    Parameters
    ----------
    reserved : iterable of str
        Inputs, outputs and arrays, which keep their names.
    symbols : mapping of str to str, optional
        Constants of the source to their names in the program; others become plain numbers.
    fixed : mapping of (array, index) to ast.expr, optional
        Elements that are a constant, a variable or another array's element in the program.
    sections : mapping of (array, symbol) to str, optional
        Arrays that stand for the elements from the constant of this name on: ``s[DRIFT + i]`` is ``drift[i]``.
    """

    def __init__(
        self,
        reserved: Iterable[str],
        symbols: Mapping[str, str] | None = None,
        fixed: Mapping[tuple[str, int], ast.expr] | None = None,
        sections: Mapping[tuple[str, str], str] | None = None,
    ) -> None:
        self.symbols, self.fixed, self.sections = dict(symbols or {}), dict(fixed or {}), dict(sections or {})
        self._elements = {value.id: array for (array, _), value in self.fixed.items() if isinstance(value, ast.Name)}
        self._names: dict[str, tuple[str, str]] = {}
        for text in (*reserved, *self.symbols.values()):
            self._names[text.lower()] = ("", text)
        self._count = 0

    def program(
        self, statements: Statements, scope: Mapping[str, Any], given: Mapping[str, ast.expr], outputs: Iterable[str]
    ) -> Program:
        """Flatten statements whose free names are `given` or stand in `scope`; `outputs` are read afterwards."""
        frame = _Frame("", dict(given), scope, assigned(statements) - set(given))
        flat = without_unread(self._block(statements, frame, None), set(outputs))
        return Program(tuple(flat), kinds(flat))

    # -- statements ---------------------------------------------------------------------------------------------

    def _block(self, statements: Statements, frame: _Frame, targets: list[ast.expr] | None) -> Statements:
        """Flatten statements; a return assigns to `targets`, and what follows it is not reached."""
        out: Statements = []
        for k, statement in enumerate(statements):
            if isinstance(statement, ast.Return):
                self._return(statement, frame, targets, out)
                break
            if isinstance(statement, ast.If):
                test = self._expression(statement.test, frame, out)
                rest = statements[k + 1 :]
                if isinstance(test, ast.Constant):
                    chosen = statement.body if test.value else statement.orelse
                    return out + self._block([*chosen, *rest], frame, targets)
                if any(isinstance(inner, ast.Return) for inner in ast.walk(statement)):
                    return out + self._branch_that_returns(statement, test, rest, frame, targets)
                body, other = (self._block(part, frame, targets) for part in (statement.body, statement.orelse))
                out += branch(test, body, other)
                continue
            self._plain(statement, frame, out)
        return out

    def _branch_that_returns(
        self, statement: ast.If, test: ast.expr, rest: Statements, frame: _Frame, targets: list[ast.expr] | None
    ) -> Statements:
        if leaves(statement.body):
            return branch(test, self._block(statement.body, frame, targets),
                       self._block([*statement.orelse, *rest], frame, targets))  # fmt: skip
        if statement.orelse and leaves(statement.orelse):
            return branch(test, self._block([*statement.body, *rest], frame, targets),
                       self._block(statement.orelse, frame, targets))  # fmt: skip
        # only some branches return: a flag tells whether the rest still runs
        flag = self._fresh(frame.function, "going")
        going = [*(targets or []), flag]
        out: Statements = [assign(flag, constant(True))]
        inner = [self._block(part, frame, going) for part in (statement.body, statement.orelse)]
        out += branch(test, *inner)
        return out + branch(flag, self._block(rest, frame, targets), [])

    def _return(self, statement: ast.Return, frame: _Frame, targets: list[ast.expr] | None, out: Statements) -> None:
        if targets is None:
            return
        value = statement.value
        elements: list[ast.expr] = list(value.elts) if isinstance(value, ast.Tuple) else [value] if value else []
        # flags of unfinished branches follow the results
        flags = targets[len(elements) :]
        if len(elements) == 1 and isinstance(elements[0], ast.Call) and len(targets) - len(flags) != 1:
            raise RequestError(f"{frame.function}: a call that returns several values cannot be returned on")
        self._assign_all(targets[: len(elements)], [self._expression(e, frame, out) for e in elements], frame, out)
        out += [assign(flag, constant(False)) for flag in flags]

    def _plain(self, statement: ast.stmt, frame: _Frame, out: Statements) -> None:
        if isinstance(statement, ast.Assign):
            self._assignment(statement, frame, out)
        elif isinstance(statement, ast.AugAssign):
            target = self._expression(statement.target, frame, out)
            value = ast.BinOp(target, statement.op, self._expression(statement.value, frame, out))
            out.append(assign(target, value))
        elif isinstance(statement, ast.For):
            out += self._loop(statement, frame)
        elif isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
            self._call(statement.value, frame, out, [])
        elif is_text(statement):
            out.append(statement)
        elif not isinstance(statement, ast.Pass):
            raise RequestError(f"'{ast.unparse(statement)}' cannot be exported")

    def _assignment(self, statement: ast.Assign, frame: _Frame, out: Statements) -> None:
        first = statement.targets[0]
        elements = list(first.elts) if isinstance(first, ast.Tuple) else [first]
        targets = [self._expression(e, frame, out) for e in elements]
        value = self._settled(statement.value, frame)
        if isinstance(value, ast.IfExp) and len(targets) == 1:
            self._choose(targets[0], value, frame, out)
        elif isinstance(value, ast.Call) and not intrinsic(value) and not self._one_expression(value, frame):
            self._call(value, frame, out, targets)
        else:
            parts = list(value.elts) if isinstance(value, ast.Tuple) else [value]
            self._assign_all(targets, [self._expression(e, frame, out) for e in parts], frame, out)
        for other in statement.targets[1:]:
            out.append(assign(self._expression(other, frame, out), targets[0]))

    def _assign_all(self, targets: list[ast.expr], values: list[ast.expr], frame: _Frame, out: Statements) -> None:
        """Assign several targets at once: a value that reads an earlier target is held in a variable first."""
        if len(targets) != len(values):
            raise RequestError(f"{frame.function}: {len(values)} values for {len(targets)} names")
        for k, value in enumerate(values):
            if {base(t) for t, v in zip(targets[:k], values, strict=False) if not same(t, v)} & read(value):
                held = self._fresh(frame.function, f"held_{k}")
                out.append(assign(held, value))
                values[k] = held
        out += [assign(t, v) for t, v in zip(targets, values, strict=True) if not same(t, v) and base(t) != "_"]

    def _loop(self, statement: ast.For, frame: _Frame) -> Statements:
        call = statement.iter
        if not (isinstance(call, ast.Call) and ast.unparse(call.func) == "range" and len(call.args) <= 2):
            raise RequestError(f"'for {ast.unparse(statement.target)}': only a loop over a range can be exported")
        head: Statements = []
        bounds = [self._expression(a, frame, head) for a in call.args]
        start, stop = bounds if len(bounds) == 2 else (constant(0), bounds[0])
        counter = self._expression(statement.target, frame, head)
        body = self._block(statement.body, frame, None)
        last = folded(ast.BinOp(stop, ast.Sub(), constant(1)))
        # after flattening, a loop's range is first and last, both included
        loop = ast.For(counter, ast.Tuple([start, last]), body, [])
        return [*head, loop] if body else head

    # -- expressions --------------------------------------------------------------------------------------------

    def _expression(self, node: ast.expr, frame: _Frame, out: Statements) -> ast.expr:
        """Return the node in the program's names; statements that must run before it are appended to `out`."""
        text = ast.unparse(node) if isinstance(node, ast.Subscript | ast.Attribute) else ""
        if text in frame.given:
            return frame.given[text]
        if isinstance(node, ast.Constant):
            value: Any = node.value
            return constant(value)
        if isinstance(node, ast.Name):
            return self._name(node.id, frame)
        if isinstance(node, ast.Subscript):
            return self._element(node, frame, out)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
            return folded(ast.UnaryOp(node.op, self._expression(node.operand, frame, out)))
        if isinstance(node, ast.BinOp):
            pair = ast.BinOp(self._expression(node.left, frame, out), node.op, self._expression(node.right, frame, out))
            return power(pair) if isinstance(node.op, ast.Pow) else folded(pair)
        if isinstance(node, ast.BoolOp):
            return ast.BoolOp(node.op, [self._expression(v, frame, out) for v in node.values])
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            sides = self._expression(node.left, frame, out), self._expression(node.comparators[0], frame, out)
            return folded(ast.Compare(sides[0], node.ops, [sides[1]]))
        if isinstance(node, ast.IfExp):
            return self._choice(node, frame, out)
        if isinstance(node, ast.Call):
            return self._value(node, frame, out)
        raise RequestError(f"'{ast.unparse(node)}' cannot be exported")

    def _name(self, text: str, frame: _Frame) -> ast.expr:
        if text in frame.given:
            return frame.given[text]
        if text in frame.own:
            return name("_") if text == "_" else self._local(frame.function, text)
        value = frame.scope.get(text)
        if isinstance(value, int | float) and math.isfinite(value):
            return constant(value, self.symbols.get(text, ""))
        raise RequestError(f"{frame.function or 'program'}: '{text}' is not a constant of the program")

    def _element(self, node: ast.Subscript, frame: _Frame, out: Statements) -> ast.expr:
        array = self._expression(node.value, frame, out)
        parts = list(node.slice.elts) if isinstance(node.slice, ast.Tuple) else [node.slice]
        index = [self._expression(p, frame, out) for p in parts]
        if len(index) == 1 and isinstance(index[0], ast.Constant) and isinstance(array, ast.Name):
            key = (array.id, index[0].value)
            if key in self.fixed:
                return self.fixed[key]
        if len(index) == 1 and isinstance(index[0], ast.BinOp) and isinstance(array, ast.Name):
            section = self.sections.get((array.id, getattr(index[0].left, "symbol", "")))
            if section is not None:
                return ast.Subscript(name(section), ast.Tuple([index[0].right]))
        return ast.Subscript(array, ast.Tuple(index))

    def _choice(self, node: ast.IfExp, frame: _Frame, out: Statements) -> ast.expr:
        settled = self._settled(node, frame)
        if not isinstance(settled, ast.IfExp):
            return self._expression(settled, frame, out)
        chosen = self._fresh(frame.function, "choice")
        self._choose(chosen, settled, frame, out)
        return chosen

    def _settled(self, node: ast.expr, frame: _Frame) -> ast.expr:
        """Return the taken side of a conditional expression whose condition is constant."""
        while isinstance(node, ast.IfExp):
            test = self._expression(node.test, frame, [])
            if not isinstance(test, ast.Constant):
                break
            node = node.body if test.value else node.orelse
        return node

    def _choose(self, target: ast.expr, node: ast.IfExp, frame: _Frame, out: Statements) -> None:
        """Turn a conditional expression into a branch; a PLC's SEL would evaluate both sides."""
        test = self._expression(node.test, frame, out)
        sides = []
        for part in (node.body, node.orelse):
            side: Statements = []
            value = self._expression(part, frame, side)
            sides.append([*side, *([] if same(target, value) else [assign(target, value)])])
        out += branch(test, *sides)

    # -- calls --------------------------------------------------------------------------------------------------

    def _callee(self, call: ast.Call, frame: _Frame) -> Callable[..., Any]:
        if not isinstance(call.func, ast.Name) or call.keywords or call.func.id not in frame.scope:
            raise RequestError(f"'{ast.unparse(call)}' cannot be exported")
        callee: Callable[..., Any] = frame.scope[call.func.id]
        return callee

    def _one_expression(self, call: ast.Call, frame: _Frame) -> bool:
        body = body_of(self._callee(call, frame))[0].body
        return len(body) == 1 and isinstance(body[0], ast.Return) and not isinstance(body[0].value, ast.Tuple)

    def _value(self, call: ast.Call, frame: _Frame, out: Statements) -> ast.expr:
        if intrinsic(call):
            return ast.Call(call.func, [self._expression(a, frame, out) for a in call.args], [])
        if self._one_expression(call, frame):
            tree, inner = self._enter(call, frame, out)
            returned = tree.body[0]
            assert isinstance(returned, ast.Return)
            assert returned.value is not None
            return self._expression(returned.value, inner, out)
        result = self._fresh(self._callee(call, frame).__name__, "value")
        self._call(call, frame, out, [result])
        return result

    def _call(self, call: ast.Call, frame: _Frame, out: Statements, targets: list[ast.expr]) -> None:
        tree, inner = self._enter(call, frame, out)
        out.append(ast.Expr(ast.Constant(f"{tree.name}: {tree.doc}")))  # type: ignore[attr-defined]
        out += self._block(tree.body, inner, targets)

    def _enter(self, call: ast.Call, frame: _Frame, out: Statements) -> tuple[ast.FunctionDef, _Frame]:
        """Bind the arguments of a call."""
        tree, scope = body_of(self._callee(call, frame))
        own = assigned(tree.body)
        inner = _Frame(tree.name, {}, scope, own)
        arguments = [self._expression(a, frame, out) for a in call.args]
        arrays = {a.id for a in arguments if isinstance(a, ast.Name)}
        for parameter, value in zip([a.arg for a in tree.args.args], arguments, strict=True):
            # an element whose array is an argument as well may be assigned by the callee
            element = isinstance(value, ast.Name) and self._elements.get(value.id) in arrays
            plain = (isinstance(value, ast.Name | ast.Constant) and not element) or (
                isinstance(value, ast.Subscript) and base(value) not in arrays
            )
            if parameter not in own and (plain or (len(tree.body) == 1 and _uses(tree, parameter) <= 1)):
                inner.given[parameter] = value
                continue
            held = self._local(tree.name, parameter)
            out.append(assign(held, value))
            inner.given[parameter] = held
            own.discard(parameter)
        return tree, inner

    # -- names --------------------------------------------------------------------------------------------------

    def _local(self, function: str, text: str) -> ast.Name:
        """Return the program's name of a function's variable: unique without regard to case, no doubled underscore."""
        wanted = "_".join(part for part in f"{function}_{text}".split("_") if part)[:LONGEST]
        key, candidate, number = (function, text), wanted, 1
        while self._names.setdefault(candidate.lower(), key) != key:
            number += 1
            candidate = f"{wanted[: LONGEST - 3]}_{number}"
        return name(candidate)

    def _fresh(self, function: str, text: str) -> ast.Name:
        """Return a new variable."""
        self._count += 1
        return self._local(function or "step", f"{text}_{self._count}")
