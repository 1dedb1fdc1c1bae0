"""A measured frequency response as a section."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from pmsm_ctrl.frf import policy
from pmsm_ctrl.frf.result import FrequencyResponse
from pmsm_ctrl.rendering.numbers import number, percent, with_error
from pmsm_ctrl.section import Block, Picture, Section, Table, present
from pmsm_ctrl.units import drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__: list[str] = []

NAMES = {
    "J": "inertia J", "friction_slope": "friction slope", "delay": "delay", "antiresonance": "antiresonance",
    "resonance": "resonance", "damping_ratio": "damping ratio of the antiresonance", "load_inertia": "load inertia",
    "stiffness": "stiffness k", "damping": "damping d", "phase_margin": "phase margin", "gain_margin_db": "gain margin",
    "crossover": "crossover", "phase_margin_crossover": "phase margin, found at",
    "sensitivity_peak": "peak of the sensitivity",
}  # fmt: skip

NEGLIGIBLE = 1e-4  # of a parameter: a bias of which no number is shown

HELD = (
    "The excitation is held between the samples, and the log shows it whole; what its steps fold onto the current "
    "is taken off, by the design's loops."
)


@present.register
def _(result: FrequencyResponse) -> Section:
    plant, quantity = result.plant, drives(result.design.motion)
    low, high = plant.frequency[0], plant.frequency[-1]
    blocks: list[Block] = [
        f"{_verdict(result)} {len(plant)} frequencies from {low:.3g} to {high:.4g} Hz{_speed(result)}"
        f"{f', averaged over {plant.records} records' if plant.records > 1 else ''}; instrument: "
        f"{plant.instrument or 'none, the ' + quantity + ' is taken as exact'}.",
        *([HELD] if plant.held else []),
        *([_resolution(result)] if result.window_bias else []),
        *(result.notices if result.trusted else result.notices[1:]),
        _axis(result),
    ]
    if result.bands and result.trusted:
        blocks.append(_bands(result))
    if result.margins and result.trusted:
        blocks.append(_margins(result))
    blocks.append(
        Picture(
            lambda: _draw(result, "plant"),
            f"From {quantity} to speed: points with 95 % bars are measured, the line is the design. The ratio of the "
            "two is shown below.",
        )
    )
    if len(result.responses) > 1:
        blocks.append(
            Picture(
                lambda: _draw(result, "loops"), "Closed loops: reference to what it controls; 0 dB is followed exactly."
            )
        )
    return Section(f"Frequency response: {Path(result.log_name).name}", tuple(blocks))


def _speed(result: FrequencyResponse) -> str:
    """Return at which speed a log was taken; of a file that states none, where the design is evaluated."""
    speed = f"{result.speed:.3g} {'m/s' if result.design.motion == 'linear' else 'rad/s'}"
    if result.window_bias:
        return f" at {speed}"
    return f", resolution {result.plant.resolution:.2g} Hz; the file states no speed, the design's is that at {speed}"


def _verdict(result: FrequencyResponse) -> str:
    if not result.trusted:
        return f"In doubt, no answer: {result.notices[0].text}."
    if not result.bands:
        return (
            f"The design's response agrees with the measured one: no third octave deviates significantly by "
            f"{percent(policy.SMALLEST_DEVIATION, 0)} or more, the delay left out."
        )
    parts = " and ".join(_range(band.low, band.high) for band in result.bands)
    return f"The design's response differs {parts}."


def _range(low: float, high: float) -> str:
    """Return "from 3.2 to 179 Hz", or "at 179 Hz" for a single frequency."""
    return f"at {low:.3g} Hz" if f"{low:.3g}" == f"{high:.3g}" else f"from {low:.3g} to {high:.3g} Hz"


def _resolution(result: FrequencyResponse) -> str:
    """Return how wide the windows are beside the resonance, and what they change."""
    width = f"The response is smoothed in windows of {result.plant.resolution:.2g} Hz"
    if result.widths:
        antiresonance, resonance = result.widths
        width += f"; the antiresonance is {antiresonance:.2g} Hz wide, the resonance {resonance:.2g} Hz (2 zeta f)"
    bias = {name: abs(part) for name, part in result.window_bias.items()}
    small = {name for name, part in bias.items() if part < NEGLIGIBLE}
    changed = ", ".join(f"{NAMES[name]} {percent(result.window_bias[name], 2)}" for name in bias if name not in small)
    said = changed or f"less than {percent(NEGLIGIBLE, 2).lstrip('+')} of each parameter"
    return f"{width}. Bias by this width, from the fitted axis passed through the same windows: {said}."


def _axis(result: FrequencyResponse) -> Table:
    rows = tuple(
        (
            NAMES[name],
            one.unit or "1",
            with_error(one.value, one.stderr),
            "-" if one.nominal is None else number(one.nominal),
        )
        for name, one in result.estimates.items()
    )
    caption = "Axis fitted to the measured response" + ("" if result.trusted else ", not to be taken")
    return Table(("of the fitted axis", "unit", "measured", "design"), rows, caption)


def _bands(result: FrequencyResponse) -> Table:
    rows = tuple(
        (f"{one.low:.3g} to {one.high:.4g}", f"{100.0 * (one.ratio - 1.0):+.1f} %", f"{one.phase:+.1f}")
        for one in result.bands
    )
    return Table(("frequency [Hz]", "measured over design", "phase [deg]"), rows, "Where the design's response differs")


def _margins(result: FrequencyResponse) -> Table:
    crossover, at = (result.margins[name] for name in ("crossover", "phase_margin_crossover"))
    # where a resonance crosses 1 again, the phase margin does not belong to the crossover
    further = (math.isfinite(at[0].value) and at[0].value != crossover[0].value) or (
        math.isfinite(at[1]) and at[1] != crossover[1]
    )
    margins = {name: one for name, one in result.margins.items() if further or one is not at}
    points = {name: with_error(one.value, one.stderr) for name, one in result.point_margins.items()}
    rows = tuple(
        (NAMES[name], found.unit or "1", points.get(name, "-"), with_error(found.value, found.stderr), number(own))
        for name, (found, own) in margins.items()
    )
    outside = "; -: not within the measured points" if not points.keys() >= margins.keys() else ""
    return Table(
        ("of the speed loop", "unit", "measured points", "fitted axis", "design"), rows,
        f"Margins with the design's gains{outside}",
    )  # fmt: skip


def _draw(result: FrequencyResponse, what: str) -> Figure:
    from pmsm_ctrl.frf import figures

    return figures.plant(result) if what == "plant" else figures.loops(result)
