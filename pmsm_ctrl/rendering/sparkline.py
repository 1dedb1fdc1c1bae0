"""A curve as small as a cell of a table, as SVG: written directly, since a page may hold thousands."""

from __future__ import annotations

from html import escape

import numpy as np

from pmsm_ctrl.section import Sparkline

__all__ = ["sparkline_svg"]

WIDTH, HEIGHT, MARGIN = 120.0, 28.0, 2.0  # px


def sparkline_svg(curve: Sparkline | None) -> str:
    """Return a curve with its band and mark as an inline SVG.

    Parameters
    ----------
    curve : Sparkline or None

    Returns
    -------
    str
        Empty where there is no curve.
    """
    if curve is None or not len(curve.y):
        return ""
    half = np.nan_to_num(curve.half)
    low, high = float(np.min(curve.y - half)), float(np.max(curve.y + half))
    left, span = float(np.min(curve.x)), float(np.ptp(curve.x)) or 1.0
    tall = (high - low) or 1.0

    def place(x: float, y: float) -> str:
        across = MARGIN + (WIDTH - 2 * MARGIN) * (x - left) / span
        return f"{across:.1f},{HEIGHT - MARGIN - (HEIGHT - 2 * MARGIN) * (y - low) / tall:.1f}"

    def line(y: np.ndarray) -> list[str]:
        return [place(*point) for point in zip(curve.x, y, strict=True)]

    band = " ".join([*line(curve.y + half), *reversed(line(curve.y - half))])
    mark = ""
    if np.isfinite(curve.mark):
        across = place(curve.mark, low).partition(",")[0]
        mark = f'<path d="M{across},0V{HEIGHT:g}" stroke="#D55E00" stroke-dasharray="3 2" fill="none"/>'
    return (
        f'<svg class="spark" role="img" aria-label="{escape(curve.label)}" width="{WIDTH:g}" height="{HEIGHT:g}" '
        f'viewBox="0 0 {WIDTH:g} {HEIGHT:g}"><title>{escape(curve.label)}</title>'
        f'<polygon points="{band}" fill="#0072B2" fill-opacity=".22"/>'
        f'<polyline points="{" ".join(line(curve.y))}" stroke="#0072B2" stroke-width="1.3" fill="none"/>{mark}</svg>'
    )
