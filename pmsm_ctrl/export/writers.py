"""Flat programs as text: C99, and Structured Text of IEC 61131-3 as the standard, B&R and Beckhoff have it."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export.trees import expressions

__all__ = ["ST", "C", "Flavour", "Language", "Writer", "in_single", "plain", "real", "symbols_of"]

Flavour = Literal["iec", "br", "beckhoff"]

_SIGNS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Gt: ">", ast.Lt: "<", ast.GtE: ">=", ast.LtE: "<=",
    ast.Eq: "==", ast.NotEq: "!=", ast.And: "&&", ast.Or: "||",
}  # fmt: skip
_BINDING = {ast.Add: 1, ast.Sub: 1, ast.Mult: 2, ast.Div: 2}


@dataclass(frozen=True)
class Language:
    """The words of one language; braces are filled in.

    Attributes
    ----------
    functions : mapping of str to str
        Python's function names to the language's.
    signs : mapping of str to str
        Operators that differ from C's.
    branch : tuple of str
        First condition, further condition, what is left, end.
    loop : tuple of str
        Head with counter {0}, first {1} and last {2}, and end.
    assignment, remark, negated, power, tanh, is_number : str
    literal : str
        A real number.
    powers_of_magnitudes : bool
        Whether `power` is wrong for a negative base.
    between : str
        What stands between the indices of an element.
    flags : tuple of str
        False and true.
    """

    functions: Mapping[str, str]
    branch: tuple[str, str, str, str]
    loop: tuple[str, str]
    assignment: str
    remark: str
    negated: str
    power: str
    tanh: str
    is_number: str
    between: str
    flags: tuple[str, str]
    signs: Mapping[str, str] = field(default_factory=dict)
    literal: str = "{}"
    powers_of_magnitudes: bool = False


C = Language(
    functions={"abs": "fabs", "min": "fmin", "max": "fmax"},
    branch=("if ({}) {{", "}} else if ({}) {{", "} else {", "}"),
    loop=("for ({0} = {1}; {0} <= {2}; {0}++) {{", "}"),
    assignment="{} = {};",
    remark="/* {} */",
    negated="!({})",
    power="pow({}, {})",
    tanh="tanh({})",
    is_number="is_number({})",
    between="][",
    flags=("0", "1"),
)
_IEC = Language(
    functions={"abs": "ABS", "min": "MIN", "max": "MAX", "sqrt": "SQRT", "sin": "SIN", "cos": "COS", "exp": "EXP"},
    signs={"==": "=", "!=": "<>", "&&": "AND", "||": "OR"},
    branch=("IF {} THEN", "ELSIF {} THEN", "ELSE", "END_IF;"),
    loop=("FOR {0} := {1} TO {2} DO", "END_FOR;"),
    assignment="{} := {};",
    remark="(* {} *)",
    negated="NOT ({})",
    power="EXPT({}, {})",
    # the standard has none; beyond 20 it is 1 to the last digit, and EXP does not overflow
    tanh="(1.0 - 2.0 / (EXP(2.0 * MIN(MAX({}, -20.0), 20.0)) + 1.0))",
    is_number="({0} >= -1.0E300 AND {0} <= 1.0E300)",
    between=", ",
    flags=("FALSE", "TRUE"),
)
ST: Mapping[Flavour, Language] = {
    "iec": _IEC,
    # with floating-point exceptions on, a comparison with NaN stops TwinCAT's runtime
    "beckhoff": replace(_IEC, is_number="(NOT LrealIsNaN({0}) AND_THEN ABS({0}) <= 1.0E300)"),
    # B&R's EXPT works in single precision
    "br": replace(_IEC, power="EXP({1} * LN(MAX({0}, 1.0E-300)))", powers_of_magnitudes=True),
}


def in_single(language: Language) -> Language:
    """Return the language with numbers of single precision: C's functions and literals for float, bounds of REAL."""
    if language.assignment != C.assignment:
        return replace(language, is_number=language.is_number.replace("E300", "E38"))
    whole = ("abs", "min", "max", "sqrt", "sin", "cos", "exp")
    functions = {text: f"{language.functions.get(text, text)}f" for text in whole}
    return replace(language, functions=functions, power="powf({}, {})", tanh="tanhf({})", literal="{}F")


def real(value: float) -> str:
    """Return a real literal of C and IEC 61131-3, which demands a decimal point."""
    text = repr(float(value)).upper()
    mantissa, mark, exponent = text.partition("E")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{mark}{exponent}"


def plain(text: str) -> str:
    """Return a text for a comment of any language here: one line of ASCII that does not end the comment."""
    for ending in ("*)", "(*", "*/", "]]>"):
        text = text.replace(ending, " ".join(ending))
    return " ".join(text.encode("ascii", "replace").decode().split())


def symbols_of(statements: Iterable[ast.stmt]) -> dict[str, float]:
    """Return the named constants that a program uses."""
    found = {}
    for expression in expressions(list(statements)):
        for node in ast.walk(expression):
            symbol = getattr(node, "symbol", "")
            if symbol and isinstance(node, ast.Constant):
                found[symbol] = node.value
    return dict(sorted(found.items()))


class Writer:
    """Prints flat programs in one language.

    Parameters
    ----------
    language : Language
    names : mapping of str to str, optional
        The program's names to those in the text, where they differ.
    """

    def __init__(self, language: Language, names: Mapping[str, str] | None = None) -> None:
        self.language, self.names = language, dict(names or {})

    def lines(self, statements: Iterable[ast.stmt], depth: int = 0) -> list[str]:
        """Return the lines of statements."""
        out: list[str] = []
        for statement in statements:
            if isinstance(statement, ast.If):
                out += self._branch(statement, depth)
            elif isinstance(statement, ast.For):
                out += self._loop(statement, depth)
            else:
                out.append("    " * depth + self._simple(statement))
        return out

    def _simple(self, statement: ast.stmt) -> str:
        if isinstance(statement, ast.Assign):
            return self.language.assignment.format(self.text(statement.targets[0]), self.text(statement.value))
        assert isinstance(statement, ast.Expr)
        assert isinstance(statement.value, ast.Constant)
        return self.language.remark.format(plain(str(statement.value.value)))

    def _loop(self, statement: ast.For, depth: int) -> list[str]:
        pad, (head, end) = "    " * depth, self.language.loop
        assert isinstance(statement.iter, ast.Tuple)
        words = (self.text(e) for e in (statement.target, *statement.iter.elts))
        return [pad + head.format(*words), *self.lines(statement.body, depth + 1), pad + end]

    def _branch(self, statement: ast.If, depth: int, further: bool = False) -> list[str]:
        pad, (first, another, otherwise, end) = "    " * depth, self.language.branch
        head = (another if further else first).format(self.text(statement.test))
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
            index = self.language.between.join(self.text(i) for i in node.slice.elts)
            return f"{self.text(node.value)}[{index}]"
        if isinstance(node, ast.Call):
            return self._call(ast.unparse(node.func), [self.text(a) for a in node.args])
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return self.language.negated.format(self.text(node.operand))
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            return self._power(node)
        if isinstance(node, ast.BinOp):
            binding = _BINDING[type(node.op)]
            # to the right of an equally strong sign only brackets keep the order
            found = f"{self.text(node.left, binding)} {self._sign(node.op)} {self.text(node.right, binding + 1)}"
            return f"({found})" if binding < within else found
        if isinstance(node, ast.UnaryOp):
            found = f"-{self.text(node.operand, 3)}"
        elif isinstance(node, ast.Compare):
            found = f"{self.text(node.left, 1)} {self._sign(node.ops[0])} {self.text(node.comparators[0], 1)}"
        else:
            assert isinstance(node, ast.BoolOp)
            found = f" {self._sign(node.op)} ".join(self.text(v, 1) for v in node.values)
        return f"({found})" if within else found

    def _sign(self, operator: ast.AST) -> str:
        sign = _SIGNS[type(operator)]
        return self.language.signs.get(sign, sign)

    def _constant(self, node: ast.Constant, within: int) -> str:
        symbol, value = getattr(node, "symbol", ""), node.value
        if symbol:
            return self.names.get(symbol, symbol)
        if isinstance(value, bool):
            return self.language.flags[value]
        assert isinstance(value, int | float)
        found = str(value) if isinstance(value, int) else self.language.literal.format(real(value))
        return f"({found})" if value < 0 and within else found

    def _call(self, function: str, arguments: list[str]) -> str:
        if function == "isfinite":
            return self.language.is_number.format(*arguments)
        if function == "tanh":
            return self.language.tanh.format(*arguments)
        return f"{self.language.functions.get(function, function)}({', '.join(arguments)})"

    def _power(self, node: ast.BinOp) -> str:
        magnitude = isinstance(node.left, ast.Call) and ast.unparse(node.left.func) == "abs"
        if self.language.powers_of_magnitudes and not magnitude:
            message = f"a power of '{self.text(node.left)}', which may be negative, cannot be exported for B&R"
            raise RequestError(message)
        return self.language.power.format(self.text(node.left), self.text(node.right, 2))
