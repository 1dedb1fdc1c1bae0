"""Render sections into one self-contained HTML page: no network, no script, same input same bytes."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from typing import Any

from pmsm_ctrl.rendering import to_html
from pmsm_ctrl.report.result import Headline
from pmsm_ctrl.result import Section as OldSection
from pmsm_ctrl.section import Block, Notice, Picture, Section, Table

__all__ = ["converted", "render", "versions"]

_LIBRARIES = ("pmsm-ctrl", "numpy", "scipy", "numba", "matplotlib", "control", "filterpy")


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
    sections: Iterable[Any],
    *,
    headline: Headline | None = None,
    notices: Sequence[Notice] = (),
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
    notices : sequence of Notice
        Reasons to doubt, shown before the numbers.
    facts : mapping of str to str, optional
        Lines of the appendix: files with their hashes, seeds.
    design_toml : str
        The design as TOML, shown folded in the appendix.
    command : str
        The command that makes this page again.
    """
    shown = [_view(number, section, title) for number, section in enumerate(sections, start=1)]
    text: str = _template().render(
        title=title,
        headline=headline,
        notices=list(dict.fromkeys(notices)),
        sections=shown,
        facts=dict(facts or {}),
        versions=versions(),
        design_toml=design_toml,
        command=command,
    )
    return text


def _view(number: int, section: Any, page_title: str) -> dict[str, str]:
    """Return a section for the template; a title that the page has already is not written again."""
    section = converted(section)
    html = to_html(section, number=number, heading=section.title != page_title)
    return {"id": f"section-{number}", "title": section.title, "html": html}


def converted(old: Any) -> Section:
    """Return a section of rooms that do not speak in blocks yet as one that does."""
    if isinstance(old, Section):
        return old
    assert isinstance(old, OldSection)
    plain: list[Block] = []
    doubts: list[Block] = []
    for text in old.paragraphs:
        kind, _, rest = text.partition(": ")
        (doubts.append(Notice("", rest)) if kind.lower() == "warning" else plain.append(text))
    captions = (*old.captions, *("",) * len(old.tables))
    tables: list[Block] = [Table(*table, caption=c) for table, c in zip(old.tables, captions, strict=False)]
    pictures: list[Block] = [Picture(lambda figure=figure: figure, caption) for figure, caption in old.figures]  # type: ignore[misc]
    return Section(old.title, (*doubts, *plain, *tables, *pictures))


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
