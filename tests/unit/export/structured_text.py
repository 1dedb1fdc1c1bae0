"""Run Structured Text: parsed by tree-sitter's grammar of IEC 61131-3, turned into Python statement by statement.

The parser is somebody else's; what a statement means is written here from IEC 61131-3, not from the exporter.
"""

from __future__ import annotations

import math
import re
from typing import Any
from xml.etree import ElementTree

import pytest

OPERATORS = {"AND": "and", "OR": "or", "=": "==", "<>": "!=", "NOT": "not"}
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
KINDS = {"var_input": "input", "var_output": "output", "var_block": "variable"}
SILENT = ("comment", "empty_statement")


class FunctionBlock:
    """An instance of a parsed function block; names are not told apart by case, as in the standard."""

    def __init__(self, declaration: Any, body: Any) -> None:
        self.memory: dict[str, Any] = {f"f_{name.lower()}": function for name, function in STANDARD.items()}
        self.types: dict[str, str] = {}
        self.kinds: dict[str, str] = {}
        for section in declaration.named_children:
            if section.type in KINDS:
                constant = any(child.type == "var_qualifier_list" for child in section.named_children)
                for item in section.named_children:
                    if item.type == "variable_declaration":
                        self._declare("constant" if constant else KINDS[section.type], item)
        self.assigned: set[str] = set()
        self._code = compile("\n".join(self._block(body.children_by_field_name("body"), 0)), "<st>", "exec")

    def _declare(self, kind: str, item: Any) -> None:
        (written,) = item.children_by_field_name("names")
        name, spec = text_of(written), item.child_by_field_name("type")
        key = name.lower()
        assert key not in self.memory, f"{name} is declared twice, but for case"
        assert re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", name), f"{name} is no identifier of IEC 61131-3"
        assert len(name) <= 32
        self.kinds[key] = kind
        if spec.type == "array_type":
            self.types[key] = f"ARRAY OF {text_of(spec.child_by_field_name('element_type'))}"
            ranges = spec.children_by_field_name("range")
            assert all(text_of(r.child_by_field_name("lower")) == "0" for r in ranges)
            sizes = [int(text_of(r.child_by_field_name("upper"))) + 1 for r in ranges]
            row: Any = [0.0] * sizes[-1]
            self.memory[key] = row if len(sizes) == 1 else [list(row) for _ in range(sizes[0])]
            return
        self.types[key] = text_of(spec)
        value = item.child_by_field_name("initial_value")
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

    def _block(self, statements: Any, depth: int) -> list[str]:
        out: list[str] = []
        for statement in statements:
            if statement.type not in SILENT and statement.is_named:
                out += getattr(self, f"_{statement.type}")(statement, depth)
        return out or ["    " * depth + "pass"]

    def _assignment_statement(self, s: Any, depth: int) -> list[str]:
        target = s.child_by_field_name("left")
        base = text_of(target if target.type == "identifier" else target.child_by_field_name("object")).lower()
        assert self.kinds[base] in ("output", "variable"), f"{base} is assigned, but is of kind {self.kinds[base]}"
        self.assigned.add(base)
        value = self._text(s.child_by_field_name("right"))
        if self.types[base] == "LREAL":
            value = f"float({value})"
        return [f"{'    ' * depth}{self._text(target)} = {value}"]

    def _if_statement(self, s: Any, depth: int) -> list[str]:
        pad = "    " * depth
        out = [f"{pad}if {self._text(s.child_by_field_name('condition'))}:"]
        out += self._block(s.children_by_field_name("consequence"), depth + 1)
        for other in s.named_children:
            if other.type == "elsif_clause":
                out.append(f"{pad}elif {self._text(other.child_by_field_name('condition'))}:")
            elif other.type == "else_clause":
                out.append(f"{pad}else:")
            else:
                continue
            out += self._block(other.children_by_field_name("body"), depth + 1)
        return out

    def _for_statement(self, s: Any, depth: int) -> list[str]:
        counter, first, last = (self._text(s.child_by_field_name(name)) for name in ("control", "start", "end"))
        assert self.types[counter] == "INT"
        assert s.child_by_field_name("step") is None
        head = f"{'    ' * depth}for {counter} in range({first}, ({last}) + 1):"
        return [head, *self._block(s.children_by_field_name("body"), depth + 1)]

    # -- expressions --------------------------------------------------------------------------------------------

    def _text(self, node: Any) -> str:
        return str(getattr(self, f"_{node.type}")(node))

    def _identifier(self, node: Any) -> str:
        name = text_of(node).lower()
        assert name in self.memory, f"{name} is not declared"
        return name

    def _index_expression(self, node: Any) -> str:
        name = self._text(node.child_by_field_name("object"))
        assert self.types[name].startswith("ARRAY")
        return name + "".join(f"[{self._text(i)}]" for i in node.children_by_field_name("index") if i.is_named)

    def _binary_expression(self, node: Any) -> str:
        left, sign, right = (node.child_by_field_name(name) for name in ("left", "operator", "right"))
        return f"({self._text(left)} {OPERATORS.get(text_of(sign), text_of(sign))} {self._text(right)})"

    def _unary_expression(self, node: Any) -> str:
        sign = text_of(node.child_by_field_name("operator"))
        return f"({OPERATORS.get(sign, sign)} {self._text(node.child_by_field_name('operand'))})"

    def _parenthesized_expression(self, node: Any) -> str:
        (inner,) = node.named_children
        return f"({self._text(inner)})"

    def _real_literal(self, node: Any) -> str:
        text = text_of(node)
        assert re.fullmatch(r"-?[0-9]+\.[0-9]+([eE][+-]?[0-9]+)?", text), f"{text}: no real literal of IEC 61131-3"
        return text

    def _boolean_literal(self, node: Any) -> str:
        return text_of(node).capitalize()

    def _integer_literal(self, node: Any) -> str:
        return text_of(node)

    def _call_expression(self, node: Any) -> str:
        name = text_of(node.child_by_field_name("function")).upper()
        assert name in STANDARD, f"{name} is no function of the standard"
        arguments = node.child_by_field_name("arguments").named_children
        return f"f_{name.lower()}({', '.join(self._text(a) for a in arguments)})"


def text_of(node: Any) -> str:
    """Return the source text of a node."""
    return str(node.text.decode())


def tree_of(text: str) -> dict[str, Any]:
    """Return the function blocks of a Structured Text by name; a syntax error fails the test."""
    binding = pytest.importorskip("tree_sitter", reason="tree-sitter not installed: the exported ST is not run")
    grammar = pytest.importorskip("tree_sitter_iec61131_3_st", reason="no grammar of ST: the exported ST is not run")
    # the short-circuit AND is Beckhoff's own
    root = (
        binding.Parser(binding.Language(grammar.language())).parse(text.replace("AND_THEN", "AND").encode()).root_node
    )
    assert not root.has_error
    blocks = [node for node in root.named_children if node.type == "function_block_declaration"]
    return {text_of(node.child_by_field_name("name")): node for node in blocks}


def parsed(text: str) -> FunctionBlock:
    """Return the function block of a Structured Text."""
    (block,) = tree_of(text).values()
    return FunctionBlock(block, block)


def parsed_library(files: dict[str, str], name: str) -> FunctionBlock:
    """Return a function block of a B&R library: declared in the .fun, written in its .st."""
    (fun,) = (text for file, text in files.items() if file.endswith(".fun"))
    assert f"<File>{name}.st</File>" in files["IEC.lby"]
    written = tree_of(files[f"{name}.st"])
    assert list(written) == [name]
    assert not any(child.type in KINDS for child in written[name].named_children)
    return FunctionBlock(tree_of(fun)[name], written[name])


def parsed_tcpou(files: dict[str, str], name: str) -> FunctionBlock:
    """Return the function block of a .TcPOU file: XML around declaration and body."""
    unit = ElementTree.fromstring(files[f"{name}.TcPOU"].encode())
    declaration, body = unit.findtext("POU/Declaration"), unit.findtext("POU/Implementation/ST")
    block = tree_of(f"{declaration}\n{body}\nEND_FUNCTION_BLOCK\n")[name]
    return FunctionBlock(block, block)
