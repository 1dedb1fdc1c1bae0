"""The catalogue of effects on paper: one entry in full, with its signature simulated."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import atomic_path
from pmsm_ctrl.report.result import CatalogueEntry
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.units import axis_unit, drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["describe_effect", "save_figure"]

FORMATS = (".svg", ".png", ".pdf")


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write a figure, atomically.

    Parameters
    ----------
    figure : Figure
    path : path
        Its suffix is the format.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    RequestError
        For a format other than SVG, PNG and PDF.
    """
    target = Path(path)
    if target.suffix.lower() not in FORMATS:
        raise RequestError(f"{target}: pictures are written as {', '.join(FORMATS)}")
    with atomic_path(target) as temporary:
        figure.savefig(temporary, format=target.suffix.lower()[1:], dpi=150)
    return target


def describe_effect(effect: Effect, design: Design | None = None) -> CatalogueEntry:
    """Return one effect in full.

    Parameters
    ----------
    effect : Effect
    design : Design, optional
        Simulated with and without the effect, which shows its signature; one without loops gives the units alone.

    Returns
    -------
    CatalogueEntry
    """
    if design is None:
        return CatalogueEntry(effect)
    if design.loops is None:
        return CatalogueEntry(effect, motion=design.motion, unlooped=True)
    ideal = design.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    base = ideal.without_effect(effect.id)
    motion = scenario("identification", base)
    without = simulate(base, motion)
    present = simulate(base, motion, truth=base.with_effect(effect.id, dict(effect.example)))
    if effect.enters == "voltage":
        channel, unit, added = "voltage u_q", "V", present["u_q"] - without["u_q"]
    else:
        channel, unit = drives(design.motion), axis_unit("N m", design.motion)
        added = design.K_t * (present["i_q"] - without["i_q"])
    return CatalogueEntry(effect, present["omega"], present["theta"], added, channel, unit, design.motion)
