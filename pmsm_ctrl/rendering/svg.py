"""Matplotlib figures as inline SVG: small, reproducible, and free of clashes on one page."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["inline_svg"]

_NO_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


def inline_svg(figure: Figure, prefix: str, label: str) -> str:
    """Return a figure as an ``<svg>`` element.

    Parameters
    ----------
    figure : Figure
    prefix : str
        Put before every id, so that no two figures of a page share one; unique on the page.
    label : str
        Text for screen readers.
    """
    import matplotlib

    buffer = io.StringIO()
    # Text as outlines looks the same on every device. The salt fixes ids that would otherwise be random.
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": prefix, "svg.image_inline": True}):
        figure.savefig(buffer, format="svg", metadata=_NO_METADATA)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{prefix}-', text)
    text = re.sub(r'href="#', f'href="#{prefix}-', text)
    text = text.replace("url(#", f"url(#{prefix}-")
    text = re.sub(r"\n\s*", "\n", text).strip()
    head, _, body = text.partition(">")
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None  # matplotlib always writes one
    spoken = label.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return f'<svg xmlns:xlink="http://www.w3.org/1999/xlink" {box[0]} role="img" aria-label="{spoken}">{body}'
