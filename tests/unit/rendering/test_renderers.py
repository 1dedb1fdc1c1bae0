"""One section, rendered as text, HTML and for notebooks, on stubs."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from html.parser import HTMLParser
from typing import Any

import pytest
from matplotlib.figure import Figure

from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.rendering import to_html, to_notebook, to_text
from pmsm_ctrl.result import Result
from pmsm_ctrl.section import Notice, Picture, Section, Table, Template, present

BOUND = Template("at_bound", "{symbol} is at its bound")


def figure() -> Figure:
    made = Figure(figsize=(3, 2))
    made.subplots().plot([0, 1], [1, 0])
    return made


STUB = Section(
    "Friction of axis 1",
    (
        "Verdict: F_c and F_v are identified.",
        BOUND(symbol="F_s"),
        Notice("not_excited", "the speed hardly changes"),
        Table(
            ("symbol", "value [N m]", "remark"),
            (("F_c", "0.0213 ± 0.0001", "as given"), ("F_v", "-1.68e-4", "")),
            "Parameters",
        ),
        Picture(figure, "A line."),
        Table(("k", "x"), (("1", "nan"),), "Every sample", folded=True),
        Section("Details", ("Inside.", Picture(figure, "Another line."))),
        Section("For few", ("Hidden.",), folded=True),
        "if a < b:\n    print()",
    ),
)

TEXT = """\
Friction of axis 1
==================

Verdict: F_c and F_v are identified.

warning: F_s is at its bound [at_bound]
warning: the speed hardly changes [not_excited]

Parameters
symbol      value [N m]  remark
------  ---------------  --------
F_c     0.0213 ± 0.0001  as given
F_v            -1.68e-4

Details
-------

Inside.

if a < b:
    print()"""


def columns(line: str) -> int:
    return sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in line if not unicodedata.combining(c))


def test_text() -> None:
    assert to_text(STUB, 80) == TEXT
    assert to_text(STUB) == TEXT, "without a terminal a page has 80 columns"


def test_text_follows_the_terminal_but_never_below_80(monkeypatch: pytest.MonkeyPatch) -> None:
    section = Section("x", (Table(("a", "b"), (("word " * 8, "word " * 15),)),))
    tall = {}
    for width in (20, 80, 160):
        monkeypatch.setenv("COLUMNS", str(width))
        tall[width] = len(to_text(section).splitlines())
    assert tall[20] == tall[80] > tall[160]


LONG = "the residual depends on the position with order 24 and its first harmonic"


@pytest.mark.parametrize("width", [80, 100, 133])
@pytest.mark.parametrize(
    "cells",
    [
        (LONG, LONG, "12.3 %"),
        ("a" * 300, "0.1", "b"),
        ("Reibung μ → ω·ψ² ≥ 5 %", "摩擦トルク " * 9, "e\u0301" * 50),
        ("", "nan", "-"),
        tuple(f"{k}.12345e-05" for k in range(20)),
    ],
    ids=["prose", "one word", "unicode", "nothing", "20 columns"],
)
def test_nothing_is_lost_and_nothing_sticks_out(cells: tuple[str, ...], width: int) -> None:
    table = Table(tuple(f"quantity {k} [N m]" for k in range(len(cells))), (cells, cells), LONG)
    text = to_text(Section(LONG, (table, LONG)), width)
    assert max(map(columns, text.splitlines())) <= width
    squeezed = "".join(text.split())
    for cell in cells:
        if "".join(cell.split()) in squeezed:
            continue  # a row in one line, or written cell by cell
        for word in cell.split():  # wrapped cells stand in columns: their words are whole
            assert word in text


def test_numbers_are_set_to_the_right() -> None:
    rows = (("a", "1.5", "12 %"), ("b", "-10.25", "< 1e-12"), ("c", "-", "nan"))
    lines = to_text(Section("x", (Table(("name", "value", "p"), rows),)), 80).splitlines()[3:]
    assert lines == [
        "name   value        p",
        "----  ------  -------",
        "a        1.5     12 %",
        "b     -10.25  < 1e-12",
        "c          -      nan",
    ]


def test_empty_tables_and_sections() -> None:
    section = Section("Nothing", (Table(("a", "b"), (), "Found"), "", Section("Also nothing")))
    assert to_text(section, 80).splitlines()[3:5] == ["Found", "(no rows)"]
    Page(to_html(section))
    Page(to_notebook(section))


def test_a_short_row_is_filled_up() -> None:
    assert "only" in to_text(Section("x", (Table(("a", "b"), (("only",),)),)), 80)


class Page(HTMLParser):
    """Checks nesting, and collects tags, ids and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.said = ""
        self.feed(text)
        self.close()
        assert self.open == [], f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.said += data

    def ids(self) -> list[str]:
        return [str(given["id"]) for _, given in self.tags if "id" in given]


def test_html_keeps_the_order_and_says_everything() -> None:
    page = Page(to_html(STUB, number=3))
    wanted = [
        "3. Friction of axis 1", "Verdict", "Warnings", "F_s is at its bound", "the speed", "Parameters",
        "0.0213 ± 0.0001", "Figure 3.1.", "Every sample (1 row)", "nan", "Details", "Inside.", "Figure 3.2.",
        "For few", "Hidden.", "if a < b:\n    print()",
    ]  # fmt: skip
    places = [page.said.index(words) for words in wanted]
    assert places == sorted(places)
    kinds = [tag for tag, _ in page.tags]
    assert kinds.count("details") == kinds.count("summary") == 3  # the section itself folds, too
    assert kinds.count("svg") == 2
    assert [given["data-code"] for tag, given in page.tags if tag == "li"] == ["at_bound", "not_excited"]
    assert [tag for tag in kinds if tag in ("h2", "h3", "h4")] == ["h2", "h3"]
    assert len(set(page.ids())) == len(page.ids())


def test_html_escapes_what_stands_in_files() -> None:
    evil = "<script>alert(\"1\")</script> & 'x'"
    section = Section(evil, (evil, Notice(evil, evil), Table((evil,), ((evil,),), evil), Picture(figure, evil)))
    for text in (to_html(section), to_notebook(section)):
        assert "<script" not in text
        page = Page(text)
        assert page.said.count(evil) >= 6


def test_html_without_its_heading() -> None:
    assert "<h2>" not in to_html(STUB, heading=False)


def test_notebook_cells_share_no_ids() -> None:
    first, second = Page(to_notebook(STUB)), Page(to_notebook(Section("Other", (*STUB.blocks, "More."))))
    assert first.ids()
    assert not set(first.ids()) & set(second.ids())
    assert to_notebook(STUB) == to_notebook(STUB)


@dataclass(frozen=True)
class Stub(Result):
    """A result that a room registers with `present`."""

    blocks: tuple[Any, ...]
    notices: tuple[Notice, ...]

    def to_dict(self) -> dict[str, Any]:
        return {"blocks": len(self.blocks), **self.doubts()}


@present.register
def _(result: Stub) -> Section:
    return Section("Stub", (*result.notices, *result.blocks))


def test_a_result_says_it_all_from_one_section() -> None:
    stub = Stub((Section("Inner", (Picture(figure, "Seen."),)), "Words."), (BOUND(symbol="J"),))
    assert stub.summary() == ("Stub\n====\n\nwarning: J is at its bound [at_bound]\n\nInner\n-----\n\nWords.")
    assert stub.section() == present(stub)
    assert isinstance(stub.plot(), Figure)
    assert "Seen." in stub._repr_html_()
    assert stub.warnings == ("J is at its bound",)
    assert stub.to_dict() == {"blocks": 2, "warnings": ["J is at its bound"], "warning_codes": ["at_bound"]}
    assert stub.notices[0].detail == {"symbol": "J"}


def test_a_result_without_a_figure_says_so() -> None:
    with pytest.raises(RequestError, match="Stub: this result has no figure"):
        Stub(("Words.",), ()).plot()


def test_a_result_that_no_room_presents() -> None:
    with pytest.raises(TypeError, match="int has no presentation"):
        present(1)
