"""Sections as text, as HTML and for notebooks, and numbers with sensible digits."""

from pmsm_ctrl.rendering.html import to_html, to_notebook
from pmsm_ctrl.rendering.text import to_text

__all__ = ["to_html", "to_notebook", "to_text"]
