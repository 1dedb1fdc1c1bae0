"""Flat programs as text: C99, and Structured Text of IEC 61131-3 as B&R and Beckhoff take it."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from typing import Literal

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export.trees import expressions

__all__ = ["CWriter", "Flavour", "StWriter", "plain", "real", "symbols_of"]

Flavour = Literal["iec", "br", "beckhoff"]

_SIGNS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Gt: ">", ast.Lt: "<", ast.GtE: ">=", ast.LtE: "<=",
    ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
_BINDING = {ast.Add: 1, ast.Sub: 1, ast.Mult: 2, ast.Div: 2}


def real(value: float) -> str:
    """Return a real literal that C and IEC 61131-3 both take: with a decimal point, which the standard demands."""
    text = repr(float(value)).upper()
    mantissa, mark, exponent = text.partition("E")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{mark}{exponent}"


def plain(text: str) -> str:
    """Return a text that may stand in a comment of any language here: ASCII, and nothing that ends the comment."""
    for ending in ("*)", "(*", "*/", "]]>"):
        text = text.replace(ending, " ".join(ending))
    return " ".join(text.encode("ascii", "replace").decode().split())


def symbols_of(statements: Iterable[ast.stmt]) -> dict[str, float]:
    """Return the named constants that a program uses, in alphabetical order."""
    found = {}
    for expression in expressions(list(statements)):
        for node in ast.walk(expression):
            symbol = getattr(node, "symbol", "")
            if symbol and isinstance(node, ast.Constant):
                found[symbol] = node.value
    return dict(sorted(found.items()))


class _Writer:
    """What both languages share: lines, brackets, and the walk over the tree."""

    functions: Mapping[str, str]
    equal, unequal, both, either = "==", "!=", "&&", "||"
    # a branch: its first condition, a further one, what is left, the end; `#` stands for the condition
    branch_words: tuple[str, str, str, str]
    loop_words: tuple[str, str]  # head, with counter {0}, first {1} and last {2}, and end
    assignment_words: str  # with target {0} and value {1}

    def __init__(self, names: Mapping[str, str] | None = None) -> None:
        self.names = dict(names or {})

    def lines(self, statements: Iterable[ast.stmt], depth: int = 0) -> list[str]:
        """Return the lines of statements."""
        out: list[str] = []
        for statement in statements:
            out += self._statement(statement, depth)
        return out

    def _statement(self, statement: ast.stmt, depth: int) -> list[str]:
        pad = "    " * depth
        if isinstance(statement, ast.Assign):
            target, value = statement.targets[0], statement.value
            return [pad + self.assignment_words.format(self.text(target), self.text(value))]
        if isinstance(statement, ast.If):
            return self._branch(statement, depth)
        if isinstance(statement, ast.For):
            return self._loop(statement, depth)
        assert isinstance(statement, ast.Expr)
        assert isinstance(statement.value, ast.Constant)
        return [pad + self.remark(str(statement.value.value))]

    def _loop(self, statement: ast.For, depth: int) -> list[str]:
        pad, (head, end) = "    " * depth, self.loop_words
        assert isinstance(statement.iter, ast.Tuple)
        words = (self.text(e) for e in (statement.target, *statement.iter.elts))
        return [pad + head.format(*words), *self.lines(statement.body, depth + 1), pad + end]

    def _branch(self, statement: ast.If, depth: int, further: bool = False) -> list[str]:
        pad, (first, another, otherwise, end) = "    " * depth, self.branch_words
        head = (another if further else first).replace("#", self.text(statement.test))
        out = [pad + head, *self.lines(statement.body, depth + 1)]
        other = statement.orelse
        if len(other) == 1 and isinstance(other[0], ast.If):
            return out + self._branch(other[0], depth, True)
        if other:
            out += [pad + otherwise, *self.lines(other, depth + 1)]
        return [*out, pad + end]

    def text(self, node: ast.expr, within: int = 0) -> str:
        """Return an expression; brackets keep Python's own order of evaluation, rounding included."""
        if isinstance(node, ast.Constant):
            return self._constant(node, within)
        if isinstance(node, ast.Name):
            return self.names.get(node.id, node.id)
        if isinstance(node, ast.Subscript):
            assert isinstance(node.slice, ast.Tuple)
            return self.element(self.text(node.value), [self.text(i) for i in node.slice.elts])
        if isinstance(node, ast.UnaryOp):
            return self.negated(node, within)
        if isinstance(node, ast.BinOp):
            return self._operation(node, within)
        if isinstance(node, ast.Compare):
            sign = {"==": self.equal, "!=": self.unequal}.get(_SIGNS[type(node.ops[0])], _SIGNS[type(node.ops[0])])
            found = f"{self.text(node.left, 1)} {sign} {self.text(node.comparators[0], 1)}"
            return f"({found})" if within else found
        if isinstance(node, ast.BoolOp):
            found = f" {self.both if isinstance(node.op, ast.And) else self.either} ".join(
                self.text(v, 1) for v in node.values
            )
            return f"({found})" if within else found
        assert isinstance(node, ast.Call)
        return self.call(ast.unparse(node.func), [self.text(a) for a in node.args])

    def _constant(self, node: ast.Constant, within: int) -> str:
        symbol = getattr(node, "symbol", "")
        value = node.value
        if symbol:
            return self.names.get(symbol, symbol)
        if isinstance(value, bool):
            return self.flag(value)
        found = str(value) if isinstance(value, int) else real(value)  # type: ignore[arg-type]
        return f"({found})" if value < 0 and within else found  # type: ignore[operator]

    def _operation(self, node: ast.BinOp, within: int) -> str:
        if isinstance(node.op, ast.Pow):
            return self.power(node)
        binding = _BINDING[type(node.op)]
        # to the right of an equally strong sign only brackets keep the order
        found = f"{self.text(node.left, binding)} {_SIGNS[type(node.op)]} {self.text(node.right, binding + 1)}"
        return f"({found})" if binding < within else found

    def call(self, function: str, arguments: list[str]) -> str:
        """Return a call of a function that every language has."""
        return f"{self.functions[function]}({', '.join(arguments)})"

    # what the languages differ in
    def remark(self, text: str) -> str:
        """Return a comment."""
        raise NotImplementedError

    def element(self, array: str, index: list[str]) -> str:
        """Return an element of an array."""
        raise NotImplementedError

    def negated(self, node: ast.UnaryOp, within: int) -> str:
        """Return a negative number or a negated condition."""
        raise NotImplementedError

    def power(self, node: ast.BinOp) -> str:
        """Return a power."""
        raise NotImplementedError

    def flag(self, value: bool) -> str:
        """Return a truth value."""
        raise NotImplementedError


class CWriter(_Writer):
    """C99 with math.h."""

    branch_words = ("if (#) {", "} else if (#) {", "} else {", "}")
    loop_words = ("for ({0} = {1}; {0} <= {2}; {0}++) {{", "}")
    assignment_words = "{0} = {1};"
    functions = {
        "abs": "fabs", "min": "fmin", "max": "fmax", "sqrt": "sqrt", "sin": "sin", "cos": "cos", "exp": "exp",
        "isfinite": "isfinite",
    }  # fmt: skip

    def remark(self, text: str) -> str:
        """Return a comment."""
        return f"/* {plain(text)} */"

    def element(self, array: str, index: list[str]) -> str:
        """Return an element of an array."""
        return array + "".join(f"[{i}]" for i in index)

    def negated(self, node: ast.UnaryOp, within: int) -> str:
        """Return a negative number or a negated condition."""
        return f"{'!' if isinstance(node.op, ast.Not) else '-'}{self.text(node.operand, 3)}"

    def power(self, node: ast.BinOp) -> str:
        """Return a power."""
        return f"pow({self.text(node.left)}, {self.text(node.right)})"

    def flag(self, value: bool) -> str:
        """Return a truth value."""
        return "1" if value else "0"


class StWriter(_Writer):
    """Structured Text. The flavours differ in powers and in the test for a number, see docs/export.md."""

    functions = {"abs": "ABS", "min": "MIN", "max": "MAX", "sqrt": "SQRT", "sin": "SIN", "cos": "COS", "exp": "EXP"}
    equal, unequal, both, either = "=", "<>", "AND", "OR"
    branch_words = ("IF # THEN", "ELSIF # THEN", "ELSE", "END_IF;")
    loop_words = ("FOR {0} := {1} TO {2} DO", "END_FOR;")
    assignment_words = "{0} := {1};"

    def __init__(self, names: Mapping[str, str] | None = None, flavour: Flavour = "iec") -> None:
        super().__init__(names)
        self.flavour = flavour

    def remark(self, text: str) -> str:
        """Return a comment."""
        return f"(* {plain(text)} *)"

    def element(self, array: str, index: list[str]) -> str:
        """Return an element of an array."""
        return f"{array}[{', '.join(index)}]"

    def negated(self, node: ast.UnaryOp, within: int) -> str:
        """Return a negative number or a negated condition; NOT binds more tightly than a comparison."""
        if isinstance(node.op, ast.Not):
            return f"NOT ({self.text(node.operand)})"
        found = f"-{self.text(node.operand, 3)}"
        return f"({found})" if within else found

    def call(self, function: str, arguments: list[str]) -> str:
        """Return a call; whether a number is one is asked without arithmetic, which might stop the controller."""
        if function != "isfinite":
            return super().call(function, arguments)
        value = arguments[0]
        if self.flavour == "beckhoff":
            # with floating-point exceptions on, a comparison with NaN stops TwinCAT's runtime
            return f"(NOT LrealIsNaN({value}) AND_THEN ABS({value}) <= 1.0E300)"
        return f"({value} >= -1.0E300 AND {value} <= 1.0E300)"

    def power(self, node: ast.BinOp) -> str:
        """Return a power; B&R's EXPT works in single precision, so there it is an exponential."""
        left, right = self.text(node.left), self.text(node.right)
        if self.flavour != "br":
            return f"EXPT({left}, {right})"
        if not (isinstance(node.left, ast.Call) and ast.unparse(node.left.func) == "abs"):
            raise RequestError(f"a power of '{left}', which may be negative, cannot be exported for B&R")
        return f"EXP({self.text(node.right, 2)} * LN(MAX({left}, 1.0E-300)))"

    def flag(self, value: bool) -> str:
        """Return a truth value."""
        return "TRUE" if value else "FALSE"
