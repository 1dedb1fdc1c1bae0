"""An effect's term as C or Structured Text, from its own source: the physics is not written a second time.

One expression tree, Python's own, serves both languages.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Mapping

from pmsm_ctrl.effects import Effect
from pmsm_ctrl.errors import RequestError

__all__ = ["term_text"]

_C = {"exp": "exp", "sin": "sin", "cos": "cos", "sqrt": "sqrt", "abs": "fabs", "min": "fmin", "max": "fmax"}
_ST = {"exp": "EXP", "sin": "SIN", "cos": "COS", "sqrt": "SQRT", "abs": "ABS", "min": "MIN", "max": "MAX"}
_OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_COMPARE = {ast.Gt: ">", ast.Lt: "<", ast.GtE: ">=", ast.LtE: "<=", ast.Eq: "==", ast.NotEq: "!="}


def term_text(effect: Effect, names: Mapping[str, str], language: str) -> str:
    """Return the term as an expression.

    Parameters
    ----------
    names : mapping of the term's arguments to what stands for them
    language : {"c", "st"}

    Raises
    ------
    RequestError
        When the term is more than one returned expression, or uses what cannot be translated.
    """
    function = ast.parse(textwrap.dedent(inspect.getsource(effect.py_term))).body[0]
    assert isinstance(function, ast.FunctionDef)
    body = [s for s in function.body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
    if len(body) != 1 or not isinstance(body[0], ast.Return) or body[0].value is None:
        raise RequestError(f"effect '{effect.id}': only a term that is one expression can be exported")
    return _Writer(effect.id, names, language).text(body[0].value)


class _Writer:
    def __init__(self, effect: str, names: Mapping[str, str], language: str) -> None:
        self.effect, self.names, self.language = effect, names, language
        self.functions = _C if language == "c" else _ST

    def text(self, node: ast.expr) -> str:
        """Return the text of a node, in brackets where it is not a leaf."""
        if isinstance(node, ast.Name) and node.id in self.names:
            return self.names[node.id]
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
            return repr(float(node.value))
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return f"(-{self.text(node.operand)})"
        if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
            return f"({self.text(node.left)} {_OPERATORS[type(node.op)]} {self.text(node.right)})"
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            left, right = self.text(node.left), self.text(node.right)
            return f"{'pow' if self.language == 'c' else 'EXPT'}({left}, {right})"
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in self.functions:
            return f"{self.functions[node.func.id]}({', '.join(self.text(a) for a in node.args)})"
        if isinstance(node, ast.IfExp):
            return self._choice(node)
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in _COMPARE:
            return self._comparison(node)
        raise RequestError(f"effect '{self.effect}': its term uses '{ast.unparse(node)}', which cannot be exported")

    def _choice(self, node: ast.IfExp) -> str:
        test, yes, no = self.text(node.test), self.text(node.body), self.text(node.orelse)
        return f"({test} ? {yes} : {no})" if self.language == "c" else f"SEL({test}, {no}, {yes})"

    def _comparison(self, node: ast.Compare) -> str:
        sign = _COMPARE[type(node.ops[0])]
        if self.language == "st":
            sign = {"==": "=", "!=": "<>"}.get(sign, sign)
        return f"({self.text(node.left)} {sign} {self.text(node.comparators[0])})"
