"""Run Structured Text: parsed by blark, turned into Python statement by statement.

The parser is somebody else's; what a statement means is written here from IEC 61131-3, not from the exporter.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import pytest

OPERATORS = {"AND": "and", "OR": "or", "AND_THEN": "and", "=": "==", "<>": "!=", "NOT": "not"}
STANDARD = {
    "ABS": abs,
    "SQRT": math.sqrt,
    "SIN": math.sin,
    "COS": math.cos,
    "EXP": math.exp,
    "LN": math.log,
    "MIN": min,
    "MAX": max,
    "EXPT": lambda base, exponent: base**exponent,
    "LREALISNAN": math.isnan,
}
ZERO = {"LREAL": 0.0, "INT": 0, "BOOL": False}


class FunctionBlock:
    """An instance of a parsed function block; names are not told apart by case, as in the standard."""

    def __init__(self, block: Any, body: Any = None) -> None:
        self.memory: dict[str, Any] = {f"f_{name.lower()}": function for name, function in STANDARD.items()}
        self.types: dict[str, str] = {}
        self.kinds: dict[str, str] = {}
        for section in block.declarations:
            for item in section.items:
                self._declare(type(section).__name__, str(section.attrs or ""), item)
        self.assigned: set[str] = set()
        self._code = compile("\n".join(self._lines((body or block.body).statements, 0)), "<structured text>", "exec")

    def _declare(self, section: str, attributes: str, item: Any) -> None:
        kind = "constant" if "CONSTANT" in attributes.upper() else section.removesuffix("Declarations").lower()
        for variable in item.variables:
            name = str(variable.variable.name)
            key = name.lower()
            assert key not in self.memory, f"{name} is declared twice, but for case"
            assert re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", name), f"{name} is no identifier of IEC 61131-3"
            assert len(name) <= 32
            self.kinds[key] = kind
            spec = item.init.spec
            if hasattr(spec, "subranges"):
                self.types[key] = f"ARRAY OF {spec.type.type_name}"
                sizes = [int(str(r.stop.value)) + 1 for r in spec.subranges]
                assert all(str(r.start.value) == "0" for r in spec.subranges)
                row: Any = [0.0] * sizes[-1]
                self.memory[key] = row if len(sizes) == 1 else [list(row) for _ in range(sizes[0])]
                continue
            self.types[key] = str(spec.type)
            value = item.init.value
            self.memory[key] = ZERO[self.types[key]] if value is None else eval(self._text(value), {}, self.memory)

    def __call__(self, **inputs: Any) -> None:
        """Run one cycle."""
        for name, value in inputs.items():
            assert self.kinds[name.lower()] == "input", name
            self.memory[name.lower()] = value
        exec(self._code, self.memory)

    def __getitem__(self, name: str) -> Any:
        return self.memory[name.lower()]

    # -- statements ---------------------------------------------------------------------------------------------

    def _lines(self, statements: Any, depth: int) -> list[str]:
        out = []
        for statement in statements:
            out += getattr(self, f"_{type(statement).__name__}")(statement, depth)
        return out or ["    " * depth + "pass"]

    def _AssignmentStatement(self, s: Any, depth: int) -> list[str]:
        (target,) = s.variables
        name = str(getattr(target, "name", "")).lower() or str(target.name.name).lower()
        base = name.split("[")[0]
        assert self.kinds[base] in ("output", "variable"), f"{base} is assigned, but is of kind {self.kinds[base]}"
        self.assigned.add(base)
        value = self._text(s.expression)
        if self.types[base] == "LREAL":
            value = f"float({value})"
        return [f"{'    ' * depth}{self._text(target)} = {value}"]

    def _IfStatement(self, s: Any, depth: int) -> list[str]:
        pad = "    " * depth
        out = [f"{pad}if {self._text(s.if_expression)}:", *self._block(s.statements, depth)]
        for other in s.else_ifs:
            out += [f"{pad}elif {self._text(other.if_expression)}:", *self._block(other.statements, depth)]
        return out + ([f"{pad}else:", *self._block(s.else_clause.statements, depth)] if s.else_clause else [])

    def _ForStatement(self, s: Any, depth: int) -> list[str]:
        counter = self._text(s.control)
        assert self.types[counter] == "INT"
        assert s.step is None
        head = f"for {counter} in range({self._text(s.from_)}, ({self._text(s.to)}) + 1):"
        return ["    " * depth + head, *self._block(s.statements, depth)]

    def _NoOpStatement(self, s: Any, depth: int) -> list[str]:
        return []

    def _block(self, statements: Any, depth: int) -> list[str]:
        return self._lines(statements.statements if statements is not None else [], depth + 1)

    # -- expressions --------------------------------------------------------------------------------------------

    def _text(self, node: Any) -> str:
        return str(getattr(self, f"_{type(node).__name__}")(node))

    def _SimpleVariable(self, node: Any) -> str:
        name = str(node.name).lower()
        if name in ("true", "false"):
            return name.capitalize()
        assert name in self.memory, f"{name} is not declared"
        return name

    def _MultiElementVariable(self, node: Any) -> str:
        name = self._text(node.name) if hasattr(node.name, "name") else str(node.name).lower()
        assert self.types[name].startswith("ARRAY")
        (element,) = node.elements
        return name + "".join(f"[{self._text(s)}]" for s in element.subscripts)

    def _BinaryOperation(self, node: Any) -> str:
        sign = str(node.op).upper()
        return f"({self._text(node.left)} {OPERATORS.get(sign, sign)} {self._text(node.right)})"

    def _UnaryOperation(self, node: Any) -> str:
        sign = str(node.op).upper()
        return f"({OPERATORS.get(sign, sign)} {self._text(node.expr)})"

    def _ParenthesizedExpression(self, node: Any) -> str:
        return f"({self._text(node.expr)})"

    def _Real(self, node: Any) -> str:
        text = str(node.value)
        assert re.fullmatch(r"[0-9]+\.[0-9]+([eE][+-]?[0-9]+)?", text), f"{text}: no real literal of IEC 61131-3"
        return text

    def _Boolean(self, node: Any) -> str:
        return str(node.value).capitalize()

    def _Integer(self, node: Any) -> str:
        return str(node.value)

    def _FunctionCall(self, node: Any) -> str:
        name = str(getattr(node.name, "name", node.name)).upper()
        assert name in STANDARD, f"{name} is no function of the standard"
        return f"f_{name.lower()}({', '.join(self._text(p.value) for p in node.parameters)})"


def _parser() -> Any:
    return pytest.importorskip("blark.parse", reason="blark not installed: the exported ST is not parsed")


def parsed(text: str) -> FunctionBlock:
    """Return the function block of a Structured Text."""
    (block,) = _parser().parse_source_code(text).transform().items
    return FunctionBlock(block)


def parsed_library(files: dict[str, str], name: str) -> FunctionBlock:
    """Return a function block of a B&R library: declared in the .fun, written in its .st."""
    (fun,) = (text for file, text in files.items() if file.endswith(".fun"))
    declared = _parser().parse_source_code(fun).transform().items
    (declaration,) = (block for block in declared if str(block.name) == name)
    assert f"<File>{name}.st</File>" in files["IEC.lby"]
    (written,) = _parser().parse_source_code(files[f"{name}.st"]).transform().items
    assert not written.declarations
    assert str(written.name) == name
    return FunctionBlock(declaration, written.body)


def parsed_tcpou(files: dict[str, str], name: str, folder: Path) -> FunctionBlock:
    """Return the function block of a .TcPOU file, which blark reads as TwinCAT does: XML around two texts."""
    path = folder / f"{name}.TcPOU"
    path.write_text(files[path.name], encoding="utf-8")
    declared, written = (part.transform().items[0] for part in _parser().parse(path))
    assert str(declared.name) == name
    return FunctionBlock(declared, written)
