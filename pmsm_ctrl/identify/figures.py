"""Figures that several results share. Colours of Okabe and Ito, safe for the colour-blind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["BLACK", "BLUE", "GREEN", "VERMILION", "measured_against_predicted"]

BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"

Array = NDArray[np.float64]


def measured_against_predicted(
    t: Array, measured: Array, predicted: Array, mask: NDArray[np.bool_], quantity: str, unit: str
) -> Figure:
    """Draw measured and predicted over the residual, masked samples left out, shape (n,) each."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.8), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    hidden = np.where(mask, 1.0, np.nan)
    upper.plot(t, measured * hidden, color=BLACK, linewidth=0.6, alpha=0.6, label="measured")
    upper.plot(t, predicted * hidden, color=BLUE, linewidth=1.3, label="predicted")
    upper.set_ylabel(f"{quantity} [{unit}]")
    upper.legend(loc="upper right", fontsize="small")
    upper.set_title(f"{quantity.capitalize()}: measured and predicted, filtered; standstill left out")
    lower.plot(t, (measured - predicted) * hidden, color=VERMILION, linewidth=0.8)
    lower.axhline(0.0, color=BLACK, linewidth=0.5)
    lower.set_ylabel(f"residual [{unit}]")
    lower.set_xlabel("time [s]")
    for axes in (upper, lower):
        axes.grid(alpha=0.3)
    return figure
