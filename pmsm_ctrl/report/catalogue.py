"""The catalogue of effects on paper: a table of all, and one entry in full with a picture of its signature."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import CATALOGUE, Effect
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.files import atomic_path
from pmsm_ctrl.result import Result, Section
from pmsm_ctrl.simulate import scenario, simulate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CatalogueEntry", "catalogue_table", "describe_effect", "save_figure", "spoken"]

Array = NDArray[Any]
FORMATS = (".svg", ".png", ".pdf")
# The few LaTeX words the equations use, as a terminal can show them.
SPOKEN = {
    r"\mathrm{sgn}": "sgn", r"\mathrm{dz}": "dz", r"\omega": "ω", r"\theta": "θ", r"\varphi": "φ", r"\delta": "δ",
    r"\tau": "τ", r"\mu": "μ", r"\Delta": "Δ", r"\zeta": "ζ", r"\alpha": "α", r"\beta": "β", r"\sin": "sin ",
    r"\cos": "cos ", r"\quad": "  ", r"\to": "->", r"\frac{dθ}{z_s}": "dθ/z_s", r"\sqrt": "sqrt", r"\,": " ",
}  # fmt: skip


def spoken(equation: str) -> str:
    """Return a LaTeX equation as plain text."""
    for word, sign in SPOKEN.items():
        equation = equation.replace(word, sign)
    return equation.replace("{", "").replace("}", "").replace("\\", "")


def catalogue_table(effects: Mapping[str, Effect] = CATALOGUE) -> str:
    """Return the catalogue as a table: id, where it enters, term, parameters with units, what it needs to be seen."""
    import io

    from rich.console import Console
    from rich.table import Table

    table = Table(title="Effects (friction positive for positive speed)")
    for name in ("id", "enters", "term", "parameters", "needs, to be seen"):
        table.add_column(name, overflow="fold", no_wrap=name == "id")
    for effect in effects.values():
        parameters = "\n".join(f"{p.symbol} [{p.unit}]" for p in effect.parameters)
        row = (effect.id, effect.enters, spoken(effect.equation), parameters, effect.needs)
        table.add_row(*(text.replace("[", r"\[") for text in row), end_section=True)
    width = max(120, Console().width)
    console = Console(file=io.StringIO(), width=width)
    with console.capture() as captured:
        console.print(table)
    return captured.get().rstrip()


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Path:
    """Write a figure, atomically.

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


@dataclass(frozen=True, eq=False)
class CatalogueEntry(Result):
    """One effect in full.

    Attributes
    ----------
    effect : Effect
    omega, theta, residual : arrays, shape (n,), or None
        Speed, angle and what the effect adds to the drive's signal in a simulated run of the
        `identification` motion; None when no design was given to simulate with.
    channel, unit : which signal, and its unit
    """

    effect: Effect
    omega: Array | None = None
    theta: Array | None = None
    residual: Array | None = None
    channel: str = "torque"
    unit: str = "N m"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the effect's use: it has been held against nothing."""
        return () if self.effect.validated != "not at all" else ("this effect has not been validated",)

    def summary(self) -> str:
        """Return everything the catalogue knows of the effect."""
        effect = self.effect
        lines = [
            f"{effect.id}: {effect.title}",
            f"  enters      {effect.enters}",
            f"  term        {spoken(effect.equation)}",
            "  parameters  " + "\n              ".join(
                f"{p.symbol} [{p.unit}] {p.lower:g} .. {p.upper:g}: {p.description}"
                + (" (a column of the regression)" if p.linear else " (searched)")
                for p in effect.parameters
            ),
            f"  needs       {effect.needs}",
        ]  # fmt: skip
        lines += [f"  looks like  {other}: {why}" for other, why in effect.look_alikes.items()]
        lines += [f"  validated   {effect.validated}", f"  source      {effect.source}"]
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Return the signature: what the effect adds over speed and over one turn."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9, 3.4), layout="constrained")
        if self.residual is None or self.omega is None or self.theta is None:
            figure.text(0.5, 0.5, "give a design to simulate the signature", ha="center")
            return figure
        over_speed, over_turn = figure.subplots(1, 2, sharey=True)
        over_speed.plot(self.omega, self.residual, ".", markersize=1.5, alpha=0.5, color="#0072B2", rasterized=True)
        over_speed.set_xlabel("speed [rad/s]")
        over_speed.set_ylabel(f"added {self.channel} [{self.unit}]")
        turn = np.mod(self.theta, 2 * np.pi)
        over_turn.plot(turn, self.residual, ".", markersize=1.5, alpha=0.5, color="#D55E00", rasterized=True)
        over_turn.set_xlabel("angle within a turn [rad]")
        for axes in (over_speed, over_turn):
            axes.grid(alpha=0.3)
        figure.suptitle(f"{self.effect.title}: what it adds to the {self.channel} the model expects", fontsize=10)
        return figure

    def to_dict(self) -> dict[str, Any]:
        """Return the entry as plain values."""
        effect = self.effect
        return {
            "id": effect.id, "title": effect.title, "enters": effect.enters, "equation": effect.equation,
            "source": effect.source, "needs": effect.needs, "look_alikes": dict(effect.look_alikes),
            "validated": effect.validated,
            "parameters": [
                {"symbol": p.symbol, "unit": p.unit, "lower": p.lower, "upper": p.upper,
                 "description": p.description, "linear": p.linear}
                for p in effect.parameters
            ],
        }  # fmt: skip

    def section(self) -> Section:
        """Return the entry as a report section."""
        effect = self.effect
        facts = (
            ("id in a design", effect.id), ("enters", effect.enters), ("term", spoken(effect.equation)),
            ("needs, to be seen", effect.needs), ("validated on", effect.validated), ("source", effect.source),
        )  # fmt: skip
        parameters = tuple(
            (p.symbol, p.unit, f"{p.lower:g}", f"{p.upper:g}", p.description, "column" if p.linear else "searched")
            for p in effect.parameters
        )
        alike = tuple(effect.look_alikes.items())
        tables = [
            ("The effect", (("item", "what the catalogue knows"), facts)),
            ("Its parameters", (("symbol", "unit", "from", "to", "what it is", "in the regression"), parameters)),
            *([("What it is mistaken for", (("effect", "why"), alike))] if alike else []),
        ]
        caption = "Left over speed, right over one turn: the shape by which a diagnosis knows this effect."
        figures = () if self.residual is None else ((self.plot(), caption),)
        captions, shown = zip(*tables, strict=True)
        return Section(effect.title, tuple(f"Warning: {text}" for text in self.warnings), shown, figures, captions)


def describe_effect(effect: Effect, design: Design | None = None) -> CatalogueEntry:
    """Return one effect in full; with a design that can be simulated, with its signature."""
    if design is None:
        return CatalogueEntry(effect)
    ideal = design.replace(sensor={"encoder_counts": 0, "current_noise": 0.0})
    base = ideal.without_effect(effect.id)
    motion = scenario("identification", base)
    without = simulate(base, motion)
    present = simulate(base, motion, truth=base.with_effect(effect.id, dict(effect.example)))
    if effect.enters == "voltage":
        channel, unit, added = "voltage u_q", "V", present["u_q"] - without["u_q"]
    else:
        channel, unit, added = "torque", "N m", design.K_t * (present["i_q"] - without["i_q"])
    return CatalogueEntry(effect, present["omega"], present["theta"], added, channel, unit)
