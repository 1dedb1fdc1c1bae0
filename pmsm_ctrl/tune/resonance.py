"""A two-mass resonance in the speed loop: its frequencies, the margins it leaves, and the filter to propose.

G. Ellis, R. D. Lorenz, Resonant load control methods for industrial servo drives, IEEE IAS Annual Meeting 2000.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pmsm_ctrl.design import Design, SpeedLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune.linearise import second_mass
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.requirements import Missed, Requirements
from pmsm_ctrl.tune.sampled import Biquad, Cascade
from pmsm_ctrl.tune.speed import open_loop

__all__ = ["FilterOption", "Resonance", "resonance", "resonance_frequencies", "slow_down"]

RATIO, STEPS = 1.15, 40  # of the search for slower gains


@dataclass(frozen=True)
class FilterOption:
    """A filter behind the speed controller and the margins with it, the gains of the speed loop unchanged."""

    filter: Biquad
    margins: Margins
    missed: tuple[Missed, ...]


@dataclass(frozen=True)
class Resonance:
    """The resonance of a two-mass axis and the filters against it.

    Attributes
    ----------
    antiresonance, resonance : float
        Hz.
    gains : SpeedLoop
        Those of the rigid axis, to be used together with the proposed filter.
    before : Margins
        Of these gains on the real axis, without a filter.
    options : tuple of FilterOption
        Filters tried at the same gains, the proposed one first.
    slowed : bool
        Whether the tuned gains had to be reduced to run without a filter.
    """

    antiresonance: float
    resonance: float
    gains: SpeedLoop
    before: Margins
    options: tuple[FilterOption, ...]
    slowed: bool

    @property
    def proposed(self) -> FilterOption | None:
        """The best option that meets the requirements, or None."""
        return next((option for option in self.options if not option.missed), None)


def resonance_frequencies(design: Design) -> tuple[float, float] | None:
    """Return antiresonance and resonance of a two-mass axis in Hz, or None for a rigid axis."""
    mass = second_mass(design)
    if mass is None:
        return None
    anti = math.sqrt(mass.k / mass.J_load) / (2.0 * math.pi)
    return anti, math.sqrt(mass.k * (1.0 / mass.J_load + 1.0 / (design.J - mass.J_load))) / (2.0 * math.pi)


def resonance(cascade: Cascade, gains: SpeedLoop, requirements: Requirements, slowed: bool) -> Resonance | None:
    """Judge the gains of the rigid axis on the resonant one, without and with filters; None for a rigid axis."""
    found = resonance_frequencies(cascade.truth)
    if found is None:
        return None
    options = []
    for item in _candidates(cascade, found[1]):
        after = margins(open_loop(cascade, gains, (item,)))
        options.append(FilterOption(item, after, requirements.missed(after)))
    # The fewest requirements missed first, then the closest to the requirements.
    options.sort(key=lambda o: (len(o.missed), requirements.shortfall(o.margins)))
    return Resonance(*found, gains, margins(open_loop(cascade, gains)), tuple(options), slowed)


def _candidates(cascade: Cascade, peak: float) -> list[Biquad]:
    """A notch with the resonance's own damping, in three widths, and low-passes about the resonance."""
    mass, highest = second_mass(cascade.truth), 0.9 * 0.5 / cascade.period
    assert mass is not None
    reduced = 1.0 / (1.0 / mass.J_load + 1.0 / (cascade.truth.J - mass.J_load))
    damping = max(mass.d / (2.0 * math.sqrt(mass.k * reduced)), 0.02)
    notches = [Biquad("notch", peak, damping, width) for width in (0.2, 0.5, 1.0)]
    passes = [Biquad("low_pass", share * peak, 0.0, math.sqrt(0.5)) for share in (0.4, 0.6, 1.0, 1.5)]
    return [item for item in (*notches, *passes) if item.frequency < highest]


def slow_down(
    cascade: Cascade, make: Callable[[float], SpeedLoop], requirements: Requirements
) -> tuple[SpeedLoop, float]:
    """Return the fastest gains of a family that meet the requirements, and their factor.

    `make` returns the gains for a factor >= 1, by which the loop is slower than asked.

    Raises
    ------
    RequestError
        When no member does; the message says what the slowest one misses.
    """
    for k in range(STEPS):
        speed = make(RATIO**k)
        missed = requirements.missed(margins(open_loop(cascade, speed)))
        if not missed:
            return speed, RATIO**k
    raise RequestError(
        f"speed loop: even {RATIO ** (STEPS - 1):.0f} times slower it misses {', '.join(map(str, missed))}"
    )
