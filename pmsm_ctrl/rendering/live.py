"""Traces as an interactive part of a page: Bokeh draws, a script of this package moves the switches.

Bokeh is an extra (``pip install 'pmsm-ctrl[interactive]'``). Its JavaScript is taken from the installed package:
nothing comes from the network, no library is copied into this one. It is imported when a page needs it, not before.
"""

from __future__ import annotations

import base64
import importlib.util
import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.section import Traces, gaps_of

__all__ = ["available", "live_html", "scripts", "thinned"]

Array = NDArray[np.float64]
Records: TypeAlias = Sequence[Traces]

MOST_POINTS = 3000  # drawn of a record: a pixel column of a screen shows no more than its extremes
FEWEST_POINTS = 200  # of a record where many share a page
MOST_VALUES = 24_000  # that travel in a page of the fitted record, and of all held-out ones together: 130 kB
SOURCE = ("t", "measured", "predicted", "residual", "speed", "over")  # columns that are drawn
TILES = ("x", "y", "width", "height", "mean", "count", "color")  # of the map
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
    every = (traces, *traces.held_out)
    item = _document(traces, prefix)
    facts = {
        "records": [_record(one, most) for one, most in zip(every, _points(every), strict=True)],
        "errors": [_errors("fitted", (traces,)), *([_errors("held out", traces.held_out)] if traces.held_out else [])],
    }
    names = list(dict.fromkeys(name for one in every for b in one.balances for name in b.parts))
    switches = "".join(
        f'<label><input type="checkbox" checked data-part="{escape(name)}"> {escape(name)}</label>\n' for name in names
    )
    legend = "Switch an effect off, and see what it explains"
    group = f"<fieldset>\n<legend>{legend}</legend>\n{switches}</fieldset>\n" if names else ""
    jumps = "".join(
        f'<button type="button" data-record="{number}" data-start="{start:.6g}" data-stop="{stop:.6g}">'
        f"{start:.4g} to {stop:.4g} s, {escape(words)}</button>\n"
        for number, one in enumerate(every)
        for start, stop, words in one.stretches
    )
    where = f'<p class="jumps"><strong>Worst stretches:</strong>\n{jumps}' if jumps else '<p class="jumps">'
    record = _menu(f"{prefix}-record", "Record", _titles(every), "record") if traces.held_out else ""
    balance = _menu(f"{prefix}-balance", "Balance", [b.name for b in traces.balances], "balance")
    over = _menu(
        f"{prefix}-over",
        "Lowest panel: residual, blue forward and orange backward, over",
        list(traces.coordinates),
        "coordinate",
    ) + _menu(
        f"{prefix}-against",
        "Upwards",
        ["residual, as dots", *(f"{c}, as a map" for c in traces.coordinates)],
        "against",
    )
    return (
        f'<div class="live" id="{prefix}" hidden>\n{group}{balance if len(traces.balances) > 1 else ""}'
        f'<div class="meter">{"".join(_bar(one["name"], len(facts["errors"]) > 1) for one in facts["errors"])}\n'
        f'<output aria-live="polite"></output></div>\n{record}{where}'
        '<button type="button" data-start="" data-stop="">Whole record</button></p>\n'
        f'<div class="plots" id="{prefix}-plots" role="group" aria-label="Traces over time: measured and predicted, '
        f'residual, speed; residual over a coordinate"></div>\n{over}'
        f'<p class="note">{_note(every)}</p>\n'
        f'<script type="application/json" class="facts">{_json(facts)}</script>\n'
        f'<script type="application/json" class="document">{_json(item)}</script>\n</div>\n'
    )


def _titles(every: Records) -> list[str]:
    return [f"{one.name or number}, {'held out' if number else 'fitted'}" for number, one in enumerate(every)]


def _bar(name: Any, named: bool) -> str:
    track = '<div class="track"><div class="fill"></div><div class="floor"></div></div>'
    return f'<div class="bar"><span>{name}</span>{track}</div>' if named else track


def _points(every: Records) -> list[int]:
    """Return how many samples of every record are drawn, so that a page stays below a few megabytes."""
    columns = [1 + len(one.coordinates) + sum(2 + len(b.parts) for b in one.balances) for one in every]
    shares = (1, *(len(every) - 1 for _ in every[1:]))
    return [
        max(FEWEST_POINTS, min(MOST_POINTS, MOST_VALUES // (count * share)))
        for count, share in zip(columns, shares, strict=True)
    ]


def _record(traces: Traces, most: int) -> dict[str, Any]:
    """Return the samples of a record that travel in the page."""
    keep = _chosen(traces, most)
    balances = [
        {"name": b.name, "unit": b.unit, "measured": _floats(b.measured[keep]), "predicted": _floats(b.predicted[keep]),
         "parts": {name: _floats(values[keep]) for name, values in b.parts.items()}}
        for b in traces.balances
    ]  # fmt: skip
    return {
        "start": float(traces.t[0]), "stop": float(traces.t[-1]), "t": _floats(_times(traces, keep)),
        "balances": balances,
        "over": [_floats(values[keep]) for values in traces.coordinates.values()],
    }  # fmt: skip


def _times(traces: Traces, keep: NDArray[np.intp]) -> Array:
    """Return the times of the samples that are drawn; the last one before a gap has none, which breaks the lines."""
    t = traces.t[keep].copy()
    before = np.searchsorted(keep, gaps_of(traces.t)) - 1
    t[before[before >= 0]] = np.nan
    return t


def _floats(values: Array) -> str:
    return base64.b64encode(np.asarray(values, dtype="<f4").tobytes()).decode()


def _errors(name: str, records: Records) -> dict[str, Any]:
    """Return what the error of each balance with any parts switched off follows from, over all samples of records."""
    out: dict[str, Any] = {}
    for channel in dict.fromkeys(b.name for one in records for b in one.balances):
        balances = [b for one in records for b in one.balances if b.name == channel]
        parts = list(dict.fromkeys(part for b in balances for part in b.parts))
        count = sum(b.count for b in balances)
        products, square, floor = np.zeros((len(parts) + 1, len(parts) + 1)), 0.0, 0.0
        for b in balances:
            places = [0, *(parts.index(part) + 1 for part in b.parts)]
            products[np.ix_(places, places)] += b.products * (b.count / count)
            square += b.size**2 * (b.count / count)
            floor += (b.floor * b.size) ** 2 * (b.count / count)
        size = float(np.sqrt(square))
        out[channel] = {
            "parts": parts, "products": products.tolist(), "size": size,
            "floor": float(np.sqrt(floor)) / size if size > 0.0 else 0.0,
        }  # fmt: skip
    return {"name": name, "balances": out}


def _note(every: Records) -> str:
    drawn, m, left = (
        sum(counts) for counts in zip(
            *((len(_chosen(one, most)), len(one.counting), len(one.t) - len(one.counting))
              for one, most in zip(every, _points(every), strict=True)),
            strict=True,
        )
    )  # fmt: skip
    thin = "" if drawn == m else f" {drawn} of {m} samples are drawn, the extremes of each curve among them."
    if left:
        thin += f" {left} samples at rest, or where a record begins or ends, do not count and are not drawn."
    which = "all samples that count" if left else "all samples"
    return (
        f"Drag to zoom, move over a curve for its values.{thin} Errors are computed from {which}. Switched off, an "
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


def _chosen(traces: Traces, most: int) -> NDArray[np.intp]:
    curves = []
    for b in traces.balances:
        left = b.measured - b.predicted
        curves += [b.measured, left, left + sum(b.parts.values(), np.zeros_like(left))]
    counting = traces.counting
    return counting[thinned(np.array([*curves, next(iter(traces.coordinates.values()))])[:, counting], most)]


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


def _panels(traces: Traces, prefix: str) -> Any:
    """Return the linked panels as a Bokeh layout."""
    from bokeh.layouts import column
    from bokeh.models import ColumnDataSource, CrosshairTool, HoverTool, Range1d, Span

    # the page's script puts what is chosen in its place; without any data Bokeh complains of having no ranges
    begun: dict[str, Any] = {name: [0.0, 1.0] for name in SOURCE} | {"direction": [BLUE, VERMILION]}
    source = ColumnDataSource(begun, name=f"{prefix}-source")
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
    moved = lower.line("t", "speed", source=source, color=BLACK, line_width=1.0)
    for panel, drawn in ((upper, measured), (middle, left), (lower, moved)):
        panel.add_tools(CrosshairTool(overlay=cursor), _hover(drawn))
    scatter = _panel(f"residual [{first.unit}]", HEIGHTS[3], None)
    scatter.name = f"{prefix}-scatter"
    scatter.xaxis.axis_label = motion
    dots = scatter.scatter("over", "residual", source=source, size=3, color="direction", alpha=0.35, line_color=None)
    tiles = ColumnDataSource({name: [] for name in TILES}, name=f"{prefix}-tiles")
    drawn = scatter.rect(
        "x", "y", "width", "height", source=tiles, fill_color="color", line_color=SOFT, line_width=0.3, visible=False
    )
    dots.name, drawn.name = f"{prefix}-dots", f"{prefix}-map"
    scatter.x_range.only_visible = scatter.y_range.only_visible = True
    rows = [("over", "@x{0.000}"), ("upwards", "@y{0.000}"), ("mean residual", "@mean"), ("samples", "@count")]
    scatter.add_tools(HoverTool(renderers=[drawn], tooltips=rows))
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
    return HoverTool(renderers=[drawn], tooltips=[*rows, ("speed", "@speed")], mode="vline", line_policy="nearest")
