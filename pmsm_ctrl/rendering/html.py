"""A section as HTML: a part of a report page, or the output of a notebook cell."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from html import escape
from itertools import count, groupby
from pathlib import Path

from pmsm_ctrl.rendering.cells import numeric_columns
from pmsm_ctrl.rendering.live import live_html
from pmsm_ctrl.rendering.sparkline import sparkline_svg
from pmsm_ctrl.rendering.svg import inline_svg
from pmsm_ctrl.rendering.text import to_text
from pmsm_ctrl.section import Block, Notice, Picture, Section, Table, Traces

__all__ = ["gist_of", "picture_html", "tables_script", "to_html", "to_notebook"]

_UNIT = re.compile(r"\[[^][]*+\]")
_LONG = 14  # rows beyond which a table is shown on demand
_SHORT = 10  # letters of a cell that is not broken
_MANY = 8  # columns beyond which a table is set smaller, so that a page is wide enough
_NOTEBOOK_STYLE = (
    "<style>.pmsm-ctrl .warnings{border-left:.3em solid #a33c00;padding:.2em 1em}.pmsm-ctrl caption{text-align:left}"
    ".pmsm-ctrl .number{text-align:right}.pmsm-ctrl svg{max-width:50em;height:auto}</style>"
)


def to_html(
    section: Section, *, number: int = 1, heading: bool = True, opened: bool = True, interactive: bool = False
) -> str:
    """Return a section as an HTML ``<section>``, to be put into a page.

    Parameters
    ----------
    section : Section
    number : int
        Place of the section on its page, from 1; heads the title and the numbers of its figures.
    heading : bool
        Whether the title is written; under it, with the first sentence beside it, the section folds.
    opened : bool
        Whether a section with a heading is unfolded at first.
    interactive : bool
        Whether traces are drawn; the page has to hold the scripts of `rendering.live`.

    Returns
    -------
    str
        With ids ``section-NUMBER`` and, in the figures, ``sNUMBER...``, which are unique on a page.
    """
    renderer = _Renderer(section.title, str(number), f"s{number}", interactive)
    if not heading:
        return f'<section id="section-{number}">\n{renderer.blocks(section.blocks, level=3)}</section>\n'
    gist = gist_of(section)
    blocks = section.blocks[1:] if gist else section.blocks
    said = f' <span class="gist">{escape(gist)}</span>' if gist else ""
    body = renderer.blocks(blocks, level=3)
    return (  # the id stands inside, so that a link to it unfolds the section
        f'<section>\n<details class="part"{" open" if opened else ""}>\n'
        f"<summary><h2>{number}. {escape(section.title)}</h2>{said}</summary>\n"
        f'<div class="inside" id="section-{number}">\n{body}</div>\n</details>\n</section>\n'
    )


def gist_of(section: Section) -> str:
    """Return the sentence that a section begins with; empty where it begins with something else.

    Parameters
    ----------
    section : Section
    """
    first = section.blocks[0] if section.blocks else ""
    return first if isinstance(first, str) and "\n" not in first else ""


def tables_script() -> str:
    """Return the script by which the tables of a page are sorted and filtered."""
    return Path(__file__).with_name("tables.js").read_text(encoding="utf-8").rstrip()


def picture_html(picture: Picture, name: str, title: str, prefix: str) -> str:
    """Return a picture as an HTML ``<figure>``.

    Parameters
    ----------
    picture : Picture
    name : str
        Such as "Figure 1.2"; begins the caption.
    title : str
        What it belongs to, for screen readers.
    prefix : str
        Begins every id in it; unique on the page.
    """
    svg = inline_svg(picture.draw, prefix, f"{name}, {title}. {picture.caption}")
    return (
        f'<figure>\n<div class="drawing" role="region" aria-label="{name}" tabindex="0">{svg}</div>\n'
        f"<figcaption><strong>{name}.</strong> {escape(picture.caption)}</figcaption>\n</figure>\n"
    )


def to_notebook(section: Section) -> str:
    """Return a section as the HTML output of a notebook cell.

    Parameters
    ----------
    section : Section

    Returns
    -------
    str
        With ids made from what the section says, so that cells with different results share none.
    """
    prefix = "n" + hashlib.sha256(to_text(section, 1000).encode()).hexdigest()[:12]
    body = _Renderer(section.title, "", prefix).blocks(section.blocks, level=4)
    return f'<div class="pmsm-ctrl">{_NOTEBOOK_STYLE}\n<h3>{escape(section.title)}</h3>\n{body}</div>\n'


class _Renderer:
    """Writes the blocks of one section and counts its figures."""

    def __init__(self, title: str, number: str, prefix: str, interactive: bool = False) -> None:
        self.title = title
        self.number = number
        self.prefix = prefix
        self.interactive = interactive
        self.figures = count(1)
        self.tables = count(1)
        self.traces = count(1)

    def blocks(self, blocks: tuple[Block, ...], level: int) -> str:
        parts: list[str] = []
        for doubt, group in groupby(blocks, lambda block: isinstance(block, Notice)):
            if doubt:
                parts.append(_notices(group))
            else:
                parts += [self.block(block, level) for block in group]
        return "".join(parts)

    def block(self, block: Block, level: int) -> str:
        match block:
            case Section():
                return self.subsection(block, level)
            case Table():
                return self.table(block)
            case Picture():
                return self.picture(block)
            case Traces():
                return live_html(block, f"{self.prefix}t{next(self.traces)}") if self.interactive else ""
            case _:
                tag = "pre" if "\n" in str(block) else "p"
                return f"<{tag}>{escape(str(block))}</{tag}>\n"

    def subsection(self, section: Section, level: int) -> str:
        body = self.blocks(section.blocks, min(level + 1, 6))
        if section.folded:
            return f"<details>\n<summary>{escape(section.title)}</summary>\n{body}</details>\n"
        return f"<h{level}>{escape(section.title)}</h{level}>\n{body}"

    def table(self, table: Table) -> str:
        right = numeric_columns(table)
        folded = table.folded or (len(table.rows) > _LONG and not table.sortable)
        caption = f"<caption>{escape(table.caption)}</caption>\n" if table.caption and not folded else ""
        head = "".join(
            f'<th scope="col"{_class(r)}>{_unbroken(cell)}</th>' for cell, r in zip(table.header, right, strict=True)
        )
        head += "".join(f'<th scope="col">{_unbroken(heading)}</th>' for heading in table.curves)
        rows = "".join(
            "<tr>"
            + "".join(
                f"<td{_class(r)}>{_linked(_cell(c), '' if n else table.links.get(c, ''))}</td>"
                for n, (c, r) in enumerate(zip(row, right, strict=False))
            )
            + "".join(f"<td>{sparkline_svg(curves[k])}</td>" for curves in table.curves.values())
            + "</tr>\n"
            for k, row in enumerate(table.rows)
        )
        classes = ["small"] * (len(table.header) + len(table.curves) > _MANY) + ["sortable"] * table.sortable
        small = f' class="{" ".join(classes)}"' if classes else ""
        label = escape(f"Table {next(self.tables)} of {self.title}")
        text = (
            f'<div class="scroll" role="region" aria-label="{label}" tabindex="0">\n<table{small}>\n{caption}'
            f"<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table>\n</div>\n"
        )
        if not folded:
            return text
        count_of = f"{len(table.rows)} row{'' if len(table.rows) == 1 else 's'}"
        return f"<details>\n<summary>{escape(table.caption or 'Table')} ({count_of})</summary>\n{text}</details>\n"

    def picture(self, picture: Picture) -> str:
        k = next(self.figures)
        name = f"Figure {self.number}.{k}" if self.number else f"Figure {k}"
        return picture_html(picture, name, self.title, f"{self.prefix}f{k}")


def _notices(notices: Iterator[Block]) -> str:
    items = "".join(
        f'<li data-code="{escape(block.code)}">{escape(block.text)}</li>\n'
        for block in notices
        if isinstance(block, Notice)
    )
    return f'<div class="warnings" role="note"><strong>Warnings</strong>\n<ul>\n{items}</ul>\n</div>\n'


def _class(right: bool) -> str:
    return ' class="number"' if right else ""


def _unbroken(text: str) -> str:
    """A unit in a heading is never broken."""
    return escape(_UNIT.sub(lambda unit: unit[0].replace(" ", "\u00a0"), text))


def _linked(cell: str, address: str) -> str:
    return f'<a href="{escape(address)}">{cell}</a>' if address else cell


def _cell(text: str) -> str:
    """A few words, or a number with its unit, stay on one line."""
    kept = " " if len(text) <= _SHORT else " %"
    return escape(text.replace(kept, kept.replace(" ", "\u00a0")))
