"""Matplotlib figures as inline SVG: small, reproducible, and free of clashes on one page; and in a notebook."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["inline_svg", "shown_in_notebook"]

_PLACES = re.compile(r' (?:d|x|y)="[^"]*"|translate\([^)]*\)')
_COMMAND = re.compile(r"\s*\n\s*([A-Za-z]) ")
_LONG = re.compile(r"-?\d+\.\d{3,}")
_REFERRED = re.compile(r'(href="#|url\(#)([^")]+)')
# A curve keeps to its course within a third of a point: noise of many samples a point becomes a band all the same.
_SETTINGS: dict[Any, Any] = {"svg.fonttype": "path", "svg.image_inline": True, "path.simplify_threshold": 1.0 / 3.0}
_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


def inline_svg(draw: Callable[[], Figure], prefix: str, label: str) -> str:
    """Return a figure as an ``<svg>`` element.

    Parameters
    ----------
    draw : function without arguments
        Returns the figure.
    prefix : str
        Put before every id, so that no two figures of a page share one; unique on the page.
    label : str
        Text for screen readers.
    """
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    buffer = io.StringIO()
    # Text as outlines looks the same on every device. The salt fixes ids that would otherwise be random.
    with matplotlib.rc_context(_SETTINGS | {"svg.hashsalt": prefix}):
        # `savefig` draws a figure once more before, to lay it out: drawing does that as well, with the same bytes.
        canvas: Any = FigureCanvasSVG(draw())
        canvas.print_svg(buffer, metadata=_NO_METADATA)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = _with_short_ids(text, prefix)
    text = _PLACES.sub(lambda found: _COMMAND.sub(r"\1", _LONG.sub(_rounded, found[0])), text)
    text = text.replace("xlink:href", "href")
    text = re.sub(r"\n\s*", "\n", text).strip()
    head, _, body = text.partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None  # matplotlib always writes one
    spoken = label.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return f'<svg {box[0]} role="img" aria-label="{spoken}">{body}'


def shown_in_notebook(figure: Figure) -> Figure:
    """Return the same figure, which a notebook shows as a picture: without pyplot it would print its type alone.

    Parameters
    ----------
    figure : Figure
    """

    def png() -> bytes:
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=100)
        return buffer.getvalue()

    figure._repr_png_ = png  # type: ignore[attr-defined]
    return figure


def _with_short_ids(text: str, prefix: str) -> str:
    """Name what is referred to by the prefix and a number, and nothing else."""
    names = {
        name: f"{prefix}-{k}" for k, name in enumerate(dict.fromkeys(found[1] for found in _REFERRED.findall(text)))
    }
    text = re.sub(r' id="([^"]*)"', lambda found: f' id="{names[found[1]]}"' if found[1] in names else "", text)
    return _REFERRED.sub(lambda found: f"{found[1]}{names[found[2]]}", text)


def _rounded(found: re.Match[str]) -> str:
    """Return a coordinate, in points, to a hundredth: finer than any screen or printer."""
    return f"{float(found[0]):.2f}".rstrip("0").rstrip(".")
