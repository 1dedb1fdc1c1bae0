"""Traces as an interactive part of a page: Bokeh draws, a script of this package moves the switches.

Bokeh is an extra (``pip install 'pmsm-ctrl[interactive]'``). Its JavaScript is taken from the installed package:
nothing comes from the network, no library is copied into this one. It is imported when a page needs it, not before.
"""

from __future__ import annotations

import importlib.util
import json
import re
from collections.abc import Mapping
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.section import Balance, Traces

__all__ = ["available", "live_html", "scripts", "thinned"]

Array = NDArray[np.float64]

MOST_POINTS = 3000  # drawn of a record: a pixel column of a screen shows no more than its extremes
HEIGHTS = (210, 150, 140, 240)  # of the panels, px
BLACK, BLUE, VERMILION, SOFT = "#000000", "#0072B2", "#D55E00", "#4a5768"  # Okabe and Ito, safe for the colour-blind


@cache
def available() -> bool:
    """Return whether Bokeh is installed."""
    return importlib.util.find_spec("bokeh") is not None


def scripts() -> tuple[str, ...]:
    """Return the scripts that a page with interactive parts needs, in order.

    Returns
    -------
    tuple of str
        Bokeh's, and the one of this package.
    """
    import bokeh

    library = Path(bokeh.__file__).parent / "server" / "static" / "js" / "bokeh.min.js"
    own = Path(__file__).with_name("live.js")
    return library.read_text(encoding="utf-8").rstrip(), own.read_text(encoding="utf-8").rstrip()


def thinned(rows: Array, most: int = MOST_POINTS) -> NDArray[np.intp]:
    """Choose samples so that curves keep their look: the smallest and the largest of each curve in every bin.

    Parameters
    ----------
    rows : array, shape (curves, m)
    most : int
        Samples that are chosen at most.

    Returns
    -------
    array of int
        Ascending; all samples where there are no more than `most`.
    """
    m = rows.shape[1]
    if m <= most:
        return np.arange(m)
    bins = most
    while True:
        starts = np.unique(np.linspace(0, m, bins, endpoint=False).astype(int))
        pieces = [rows[:, a:b] for a, b in zip(starts, (*starts[1:], m), strict=True)]
        low, high = (np.array([place(piece, axis=1) for piece in pieces]) for place in (np.argmin, np.argmax))
        chosen = np.unique(np.concatenate([low + starts[:, None], high + starts[:, None]]).ravel())
        if len(chosen) <= most:
            return chosen
        bins = int(0.8 * bins)


def live_html(traces: Traces, prefix: str) -> str:
    """Return the interactive part: switches, an error bar, buttons and linked panels.

    Parameters
    ----------
    traces : Traces
    prefix : str
        Begins every id; unique on the page.

    Returns
    -------
    str
        Hidden until the page's script has drawn it.
    """
    item = _document(traces, prefix)
    facts = {
        "balances": [
            {"name": b.name, "unit": b.unit, "parts": list(b.parts), "products": b.products.tolist(),
             "size": b.size, "floor": b.floor}
            for b in traces.balances
        ]
    }  # fmt: skip
    names = list(dict.fromkeys(name for b in traces.balances for name in b.parts))
    switches = "".join(
        f'<label><input type="checkbox" checked data-part="{escape(name)}"> {escape(name)}</label>\n' for name in names
    )
    legend = "Switch an effect off, and see what it explains"
    group = f"<fieldset>\n<legend>{legend}</legend>\n{switches}</fieldset>\n" if names else ""
    jumps = "".join(
        f'<button type="button" data-start="{start:.6g}" data-stop="{stop:.6g}">'
        f"{start:.4g} to {stop:.4g} s, {escape(words)}</button>\n"
        for start, stop, words in traces.stretches
    )
    where = f'<p class="jumps"><strong>Worst stretches:</strong>\n{jumps}' if jumps else '<p class="jumps">'
    balance = _menu(f"{prefix}-balance", "Balance", [b.name for b in traces.balances], "balance")
    over = _menu(f"{prefix}-over", "Lowest panel: residual over", list(traces.coordinates), "coordinate")
    return (
        f'<div class="live" id="{prefix}" hidden>\n{group}{balance if len(traces.balances) > 1 else ""}'
        '<div class="meter"><div class="track"><div class="fill"></div><div class="floor"></div></div>\n'
        f'<output aria-live="polite"></output></div>\n{where}'
        '<button type="button" data-start="" data-stop="">Whole record</button></p>\n'
        f'<div class="plots" id="{prefix}-plots" role="group" aria-label="Traces over time: measured and predicted, '
        f'residual, speed; residual over a coordinate"></div>\n{over}'
        f'<p class="note">{_note(traces)}</p>\n'
        f'<script type="application/json" class="facts">{_json(facts)}</script>\n'
        f'<script type="application/json" class="document">{_json(item)}</script>\n</div>\n'
    )


def _note(traces: Traces) -> str:
    m = len(traces.t)
    drawn = len(_chosen(traces))
    thin = "" if drawn == m else f" {drawn} of {m} samples are drawn, the extremes of each curve among them."
    return (
        f"Drag to zoom, move over a curve for its values.{thin} Errors are computed from all samples. Switched off, an "
        "effect is taken out of the prediction and all other parameters are held; in the falling error they were "
        "fitted again at each step."
    )


def _menu(identifier: str, label: str, choices: list[str], role: str) -> str:
    options = "".join(f"<option>{escape(one)}</option>" for one in choices)
    return (
        f'<p class="menu"><label for="{identifier}">{label}</label> '
        f'<select id="{identifier}" data-role="{role}">{options}</select></p>\n'
    )


def _json(value: Mapping[str, Any]) -> str:
    """Return JSON in which no text can end the script element that holds it."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _chosen(traces: Traces) -> NDArray[np.intp]:
    curves = []
    for b in traces.balances:
        left = b.measured - b.predicted
        curves += [b.measured, left, left + sum(b.parts.values(), np.zeros_like(left))]
    return thinned(np.array([*curves, next(iter(traces.coordinates.values()))]))


def _document(traces: Traces, prefix: str) -> dict[str, Any]:
    """Return the panels as Bokeh's own JSON, with ids that depend on nothing but the page."""
    from bokeh.embed import json_item

    item: Any = json_item(_panels(traces, prefix), f"{prefix}-plots")
    text = json.dumps(item)
    fresh: dict[str, str] = {}
    text = re.sub(r'"(p\d+)"', lambda found: f'"{fresh.setdefault(found[1], f"{prefix}-{len(fresh)}")}"', text)
    text = re.sub(r'"([0-9a-f]{8}-[0-9a-f-]{27})"', f'"{prefix}-root"', text)
    named: dict[str, Any] = json.loads(text)
    return named


def _columns(traces: Traces, keep: NDArray[np.intp]) -> dict[str, Any]:
    data: dict[str, Array] = {"t": traces.t}
    for k, b in enumerate(traces.balances):
        data |= {f"measured{k}": b.measured, f"predicted{k}": b.predicted}
        data |= {f"part{k}_{n}": values for n, values in enumerate(b.parts.values())}
    data |= {f"over{k}": values for k, values in enumerate(traces.coordinates.values())}
    out = {name: np.asarray(values[keep], dtype=np.float32) for name, values in data.items()}
    first: Balance = traces.balances[0]
    out["measured"], out["predicted"] = out["measured0"], out["predicted0"]
    out["residual"] = np.asarray((first.measured - first.predicted)[keep], dtype=np.float32)
    out["over"] = out["over0"]
    return out


def _panels(traces: Traces, prefix: str) -> Any:
    """Return the linked panels as a Bokeh layout."""
    from bokeh.layouts import column
    from bokeh.models import ColumnDataSource, CrosshairTool, Range1d, Span

    source = ColumnDataSource(_columns(traces, _chosen(traces)), name=f"{prefix}-source")
    first, motion = traces.balances[0], next(iter(traces.coordinates))
    time = Range1d(float(traces.t[0]), float(traces.t[-1]), name=f"{prefix}-time")
    time.bounds = (float(traces.t[0]), float(traces.t[-1]))
    cursor = Span(dimension="height", line_dash="dotted", line_color=SOFT)
    upper, middle, lower = (
        _panel(label, height, time)
        for label, height in zip(
            (f"{first.name} [{first.unit}]", f"residual [{first.unit}]", motion), HEIGHTS, strict=False
        )
    )
    upper.name, middle.name, lower.name = (f"{prefix}-{place}" for place in ("upper", "middle", "lower"))
    lower.xaxis.axis_label = "time [s]"
    measured = upper.line("t", "measured", source=source, color=BLACK, line_width=1.8, legend_label="measured")
    upper.line("t", "predicted", source=source, color=VERMILION, line_width=1.0, legend_label="predicted")
    upper.legend.orientation = "horizontal"
    upper.legend.location = "top_left"
    upper.legend.background_fill_alpha = 0.7
    left = middle.line("t", "residual", source=source, color=BLUE, line_width=1.0)
    moved = lower.line("t", "over0", source=source, color=BLACK, line_width=1.0)
    for panel, drawn in ((upper, measured), (middle, left), (lower, moved)):
        panel.add_tools(CrosshairTool(overlay=cursor), _hover(drawn))
    scatter = _panel(f"residual [{first.unit}]", HEIGHTS[3], None)
    scatter.name = f"{prefix}-scatter"
    scatter.xaxis.axis_label = motion
    scatter.scatter("over", "residual", source=source, size=3, color=BLUE, alpha=0.35, line_color=None)
    return column(upper, middle, lower, scatter, sizing_mode="stretch_width")


def _panel(label: str, height: int, time: Any) -> Any:
    from bokeh.plotting import figure

    linked = {} if time is None else {"x_range": time}
    tools = "xbox_zoom,xpan,xwheel_zoom,undo,reset,save" if time is not None else "box_zoom,pan,undo,reset,save"
    panel = figure(
        height=height, sizing_mode="stretch_width", tools=tools, toolbar_location="above" if time is None else "right",
        active_scroll=None, y_axis_label=label, min_border_left=62, **linked,
    )  # fmt: skip
    panel.toolbar.logo = None
    panel.toolbar.autohide = True
    panel.yaxis.axis_label_text_font_style = panel.xaxis.axis_label_text_font_style = "normal"
    panel.yaxis.ticker.desired_num_ticks = 4
    panel.grid.grid_line_alpha = 0.5
    return panel


def _hover(drawn: Any) -> Any:
    from bokeh.models import HoverTool

    rows = [
        ("time [s]", "@t{0.0000}"),
        ("measured", "@measured"),
        ("predicted", "@predicted"),
        ("residual", "@residual"),
    ]
    return HoverTool(renderers=[drawn], tooltips=[*rows, ("speed", "@over0")], mode="vline", line_policy="nearest")
