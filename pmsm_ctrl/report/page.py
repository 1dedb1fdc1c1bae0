"""Render sections into one self-contained HTML page: no network, no script, same input same bytes."""

from __future__ import annotations

import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from itertools import zip_longest
from typing import Any

from pmsm_ctrl.report.svg import inline_svg
from pmsm_ctrl.result import Section

__all__ = ["Headline", "render", "versions"]

_LIBRARIES = ("pmsm-ctrl", "numpy", "scipy", "numba", "matplotlib", "control", "filterpy")
_UNIT = re.compile(r"\[[^]]*\]")
_MANY = 8  # columns beyond which a table is set smaller, so that a page is wide enough
_NUMBER = re.compile(r"[-+−±]?\s*\d[\d.,]*(e[-+]?\d+)?\s*%?")


@dataclass(frozen=True)
class Headline:
    """The first screen: what was done, the verdict, and the numbers that matter most.

    Attributes
    ----------
    done : str
        One or two sentences.
    verdict : str
    good : bool or None
        Colours the verdict, and a word stands beside the colour; None is neutral.
    numbers : tuple of (value, label)
        Three are best.
    """

    done: str
    verdict: str
    good: bool | None
    numbers: tuple[tuple[str, str], ...] = ()


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries whose numerics a report depends on."""
    found = {"python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def render(
    title: str,
    sections: Iterable[Section],
    *,
    headline: Headline | None = None,
    warnings: Sequence[str] = (),
    facts: Mapping[str, str] | None = None,
    design_toml: str = "",
    command: str = "",
) -> str:
    """Return one HTML page.

    Parameters
    ----------
    title : str
    sections : iterable of Section
    headline : Headline, optional
        The first screen.
    warnings : sequence of str
        Reasons to doubt, shown before the numbers.
    facts : mapping of str to str, optional
        Lines of the appendix: files with their hashes, seeds.
    design_toml : str
        The design as TOML, shown folded in the appendix.
    command : str
        The command that makes this page again.
    """
    shown = [_view(number, section) for number, section in enumerate(sections, start=1)]
    return _template().render(
        title=title,
        headline=headline,
        warnings=list(dict.fromkeys(warnings)),
        sections=shown,
        facts=dict(facts or {}),
        versions=versions(),
        design_toml=design_toml,
        command=command,
    )


def _view(number: int, section: Section) -> dict[str, Any]:
    """Prepare a section for the template: figures as SVG, cells with their alignment."""
    figures = []
    for k, (figure, caption) in enumerate(section.figures, start=1):
        name = f"s{number}f{k}"
        label = f"Figure {number}.{k}, {section.title}. {caption}"
        figures.append({"svg": inline_svg(figure, name, label), "caption": caption, "number": f"{number}.{k}"})
    named = zip_longest(section.tables, section.captions[: len(section.tables)], fillvalue="")
    tables = [_table(*table) | {"caption": caption} for table, caption in named]
    plain, doubts = [], []
    for text in section.paragraphs:
        kind, _, rest = text.partition(": ")
        (doubts.append(rest) if kind.lower() == "warning" else plain.append(text))
    return {
        "id": f"section-{number}",
        "title": section.title,
        "warnings": doubts,
        "paragraphs": plain,
        "tables": tables,
        "figures": figures,
    }


def _table(header: tuple[str, ...], rows: tuple[tuple[str, ...], ...]) -> dict[str, Any]:
    """Align whole columns: to the right where more than half of the cells are numbers; a unit is never broken."""
    right = []
    for k in range(len(header)):
        cells = [row[k] for row in rows if k < len(row) and row[k].strip() not in ("", "-")]
        right.append(2 * sum(bool(_NUMBER.fullmatch(cell)) for cell in cells) > len(cells))
    return {
        "head": [(_UNIT.sub(lambda unit: unit[0].replace(" ", "\u00a0"), cell), r)
                 for cell, r in zip(header, right, strict=True)],
        "rows": [[(cell.replace(" %", "\u00a0%"), r) for cell, r in zip(row, right, strict=False)] for row in rows],
        "small": len(header) > _MANY,
    }  # fmt: skip


def _template() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("pmsm_ctrl.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("page.html.j2")
