"""Render sections into one self-contained HTML page: no network, same input same bytes.

With Bokeh installed, a page that has traces holds its script and one of this package; the content security policy names
both by their hashes and permits nothing else. A page with a table that can be sorted holds a short script of this
package. Any other page holds no script at all.
"""

from __future__ import annotations

import base64
import hashlib
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from typing import Any

from pmsm_ctrl.rendering import live, to_html
from pmsm_ctrl.rendering.html import picture_html, tables_script
from pmsm_ctrl.report.result import Headline
from pmsm_ctrl.section import Notice, Section

__all__ = ["render", "versions"]

_LIBRARIES = ("pmsm-ctrl", "numpy", "scipy", "numba", "matplotlib", "control", "filterpy", "bokeh")


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
    interactive: bool | None = None,
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
    interactive : bool, optional
        Whether traces can be zoomed and effects switched; if left out, when Bokeh is installed.
    """
    pictures = headline.pictures if headline is not None else ()
    sections = [section.without(pictures) for section in sections]  # what the first screen shows is not shown again
    zoomable = live.available() if interactive is None else interactive
    shown = [  # a title that the page has already is not written again
        {
            "title": section.title,
            "html": to_html(
                section, number=number, heading=section.title != title, opened=number == 1, interactive=zoomable
            ),
        }
        for number, section in enumerate(sections, start=1)
    ]
    first_traces = next(filter(None, (re.search(r'<div class="live" id="(\w+)"', one["html"]) for one in shown)), None)
    scripts = live.scripts() if first_traces is not None else ()
    if any('class="sortable"' in one["html"] or 'class="small sortable"' in one["html"] for one in shown):
        scripts = (*scripts, tables_script())
    text: str = _template().render(
        title=title,
        headline=headline,
        pictures=[picture_html(one, f"Figure {k}", title, f"h{k}") for k, one in enumerate(pictures, start=1)],
        traces=first_traces[1] if first_traces is not None else "",
        scripts=scripts,
        permitted=" ".join(f"'sha256-{_hash(script)}'" for script in scripts) or "'none'",
        notices=list(dict.fromkeys(notices)),
        sections=shown,
        facts=dict(facts or {}),
        versions=versions(),
        design_toml=design_toml,
        command=command,
    )
    return text


def _hash(script: str) -> str:
    """Return the hash by which a content security policy names a script."""
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


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
