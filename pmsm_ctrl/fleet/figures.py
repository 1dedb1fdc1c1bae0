"""The figure of an axis: its parameters over time. Colours of Okabe and Ito."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

import numpy as np
from matplotlib.figure import Figure

from pmsm_ctrl.fleet.answers import Series

__all__ = ["series_figure"]

BLUE, VERMILION, GREY = "#0072B2", "#D55E00", "#7f8a97"


def series_figure(series: Sequence[Series], marks: Mapping[str, float]) -> Figure:
    """Return parameters over time with 95 % bands, the design's value, and the place of a step.

    Parameters
    ----------
    series : sequence of Series
    marks : dict of str to float
        Days since 1970 of a step, by parameter.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    figure = Figure(figsize=(8.0, 0.6 + 1.7 * len(series)), layout="constrained")
    for axes, one in zip(np.atleast_1d(figure.subplots(len(series), 1, sharex=True)), series, strict=True):
        when = [datetime.fromtimestamp(86400.0 * day, UTC) for day in one.days]
        axes.errorbar(when, one.value, 1.96 * np.nan_to_num(one.stderr), fmt="o-", color=BLUE, ms=3, lw=1, capsize=2)
        if np.isfinite(one.nominal):
            axes.axhline(one.nominal, color=GREY, ls="--", lw=1, label="design")
        if np.isfinite(marks.get(one.name, np.nan)):
            axes.axvline(datetime.fromtimestamp(86400.0 * marks[one.name], UTC), color=VERMILION, ls=":", label="step")
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="best", fontsize="small")
        axes.set_ylabel(f"{one.name} [{one.unit}]")
        axes.margins(y=0.15)  # the design's line beside the frame
        dates = AutoDateLocator(maxticks=8)  # type: ignore[no-untyped-call]
        axes.xaxis.set_major_locator(dates)
        axes.xaxis.set_major_formatter(ConciseDateFormatter(dates))  # type: ignore[no-untyped-call]
    return figure
