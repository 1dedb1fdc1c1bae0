"""Figures of the diagnosis. Colours of Okabe and Ito, safe for the colour-blind."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmsm_ctrl.diagnose.diagnosis import Diagnosis

__all__ = ["ladder_figure"]

BLUE, VERMILION, BLACK = "#0072B2", "#D55E00", "#000000"


def ladder_figure(d: Diagnosis) -> Figure:
    """Draw the error of every rung, and the torque residual over speed before and after."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    rungs = ["refitted", *(f"+ {s.effect}" for s in d.steps)]
    own = [d.errors["base"]["torque"]["relative"], *(s.error_after["torque"]["relative"] for s in d.steps)]
    left.plot(np.array(own) * 100, "o-", color=BLUE, label="log")
    if d.steps and d.steps[0].holdout_before:
        other = [d.steps[0].holdout_before["torque"]["relative"]]
        other += [s.holdout_after["torque"]["relative"] for s in d.steps]
        left.plot(np.array(other) * 100, "s--", color=VERMILION, label="held-out record")
    floor = d.errors["noise_floor"]["torque"]["relative"] * 100
    left.axhline(floor, color=BLACK, linestyle=":", label="noise floor")
    left.set_xticks(range(len(rungs)), rungs, rotation=30, ha="right", fontsize="small")
    left.set_ylabel("relative torque error [%]")
    left.set_ylim(bottom=0.0)
    left.set_title("The error falls with every effect")
    left.legend(fontsize="small")
    first, last = d.selection.fits[0], d.selection.fits[-1]
    omega, used = first.record.at_grid(first.record.signals["omega"]), first.record.mask
    unit = first.record.unit("torque")
    right.plot(omega[used], first.residual[0][used], ".", ms=2, color=VERMILION, label="before")
    right.plot(omega[used], last.residual[0][used], ".", ms=2, color=BLUE, label="after")
    right.set_xlabel("speed [m/s]" if first.record.linear else "speed [rad/s]")
    right.set_ylabel(f"torque residual [{unit}]")
    right.set_title("Residual over speed: a shape is a missing effect")
    right.legend(fontsize="small")
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return figure
