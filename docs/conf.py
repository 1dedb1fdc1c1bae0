"""The site: `sphinx-build -W docs site`. Markdown by MyST, NumPy docstrings by napoleon, equations as MathML.

Sphinx rather than MkDocs Material, which its makers have put into maintenance. MathML, because a page that fetches a
script to show its equations is blank behind a plant's firewall.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from docutils import nodes

sys.path.insert(0, str(Path(__file__).resolve().parent))
import generate

import pmsm_ctrl

project = "pmsm-ctrl"
version = release = pmsm_ctrl.__version__
project_copyright = "its contributors, MIT licence"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_gallery.gen_gallery"]
html_theme = "furo"
html_title = f"pmsm-ctrl {release}"
html_theme_options = {"footer_icons": []}
exclude_patterns = ["_build", "examples", "notebooks/*.ipynb", "notebooks/*.py"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
# README and the pages link to files of the repository that are no pages of the site.
suppress_warnings = ["myst.xref_missing"]
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False
nitpicky = False
sphinx_gallery_conf = {
    "examples_dirs": "examples", "gallery_dirs": "notebooks",
    "only_warn_on_example_error": False, "abort_on_example_error": True, "plot_gallery": True,
    "download_all_examples": False, "show_memory": False, "write_computation_times": False, "min_reported_time": 1e9,
    "within_subsection_order": "FileNameSortKey", "capture_repr": ("_repr_html_",),
}  # fmt: skip


def _mathml(text: str, display: str) -> str:
    from latex2mathml.converter import convert

    return convert(text, display=display)


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(_mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def _displayed(writer: Any, node: nodes.math_block) -> None:
    # A class of our own: the theme's gives every equation a scroll bar.
    style = "overflow-x: auto; overflow-y: hidden; padding: 0.3em 0 0.5em"
    writer.body.append(f'<div class="equation" style="{style}">{_mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def _property(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep napoleon from taking what stands before a property's colon for its type."""
    if what == "property" and lines:
        lines[0] = lines[0].replace(": ", ", ", 1)


def setup(app: Any) -> dict[str, bool]:
    """Register the equations' renderer and write the pages that are made at every build."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_displayed, None))
    app.config.html_math_renderer = "mathml"
    app.connect("autodoc-process-docstring", _property, priority=1)
    generate.build(Path(__file__).resolve().parent / "printed")
    return {"parallel_read_safe": True, "parallel_write_safe": True}
