"""Render sections into one self-contained HTML page: no network, no script, same input same bytes."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from typing import Any

from pmsm_ctrl.rendering import to_html
from pmsm_ctrl.report.result import Headline
from pmsm_ctrl.section import Notice, Section

__all__ = ["render", "versions"]

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
    sections: Iterable[Section],
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
    shown = [  # a title that the page has already is not written again
        {"title": section.title, "html": to_html(section, number=number, heading=section.title != title)}
        for number, section in enumerate(sections, start=1)
    ]
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
