"""A two-mass resonance in the speed loop: where it is, what it does to the margins, and which filter to propose.

G. Ellis, R. D. Lorenz, Resonant load control methods for industrial servo drives, IEEE IAS Annual Meeting 2000.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from pmsm_ctrl.design import Design, SpeedLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune.linearise import second_mass
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.requirements import Requirements
from pmsm_ctrl.tune.sampled import Biquad, Cascade
from pmsm_ctrl.tune.speed import open_loop

__all__ = ["FilterOption", "Resonance", "resonance", "resonance_frequencies", "slow_down"]


@dataclass(frozen=True)
class FilterOption:
    """A filter behind the speed controller and the margins with it, at the speed loop's unchanged gains."""

    filter: Biquad
    margins: Margins
    missed: tuple[str, ...]


@dataclass(frozen=True)
class Resonance:
    """The resonance of a two-mass axis and what is proposed against it.

    Attributes
    ----------
    antiresonance, resonance : Hz
    inertia_ratio : load inertia over motor inertia
    before : Margins of the loop that a rigid axis would get, on the real one, without a filter
    options : filters tried at the same gains, the proposed one first
    proposed : FilterOption or None when no filter saves these gains
    gains : SpeedLoop the gains of the rigid axis, to be used together with the proposed filter
    slowed : bool, whether the tuned gains had to be reduced to run without a filter
    """

    antiresonance: float
    resonance: float
    inertia_ratio: float
    before: Margins
    before_missed: tuple[str, ...]
    options: tuple[FilterOption, ...]
    gains: SpeedLoop
    slowed: bool

    @property
    def proposed(self) -> FilterOption | None:
        """The first option that keeps the requirements."""
        return next((option for option in self.options if not option.missed), None)


def resonance_frequencies(design: Design) -> tuple[float, float, float] | None:
    """Return antiresonance and resonance in Hz and the inertia ratio, or None for a rigid axis."""
    mass = second_mass(design)
    if mass is None:
        return None
    J_m = design.J - mass.J_load
    anti = math.sqrt(mass.k / mass.J_load) / (2.0 * math.pi)
    return anti, math.sqrt(mass.k * (1.0 / mass.J_load + 1.0 / J_m)) / (2.0 * math.pi), mass.J_load / J_m


def resonance(cascade: Cascade, rigid: SpeedLoop, requirements: Requirements, slowed: bool) -> Resonance | None:
    """Judge the gains of the rigid axis on the resonant one, without and with filters; None for a rigid axis."""
    found = resonance_frequencies(cascade.truth)
    if found is None:
        return None
    anti, peak, ratio = found
    nyquist = 0.5 / cascade.period
    before = margins(open_loop(cascade, rigid))
    options = []
    for item in _candidates(cascade, peak, nyquist):
        after = margins(open_loop(cascade, rigid, (item,)))
        options.append(FilterOption(item, after, requirements.missed(after)))
    # The fewest requirements missed first, then the closest to the requirements.
    options.sort(key=lambda o: (len(o.missed), requirements.shortfall(o.margins)))
    return Resonance(anti, peak, ratio, before, requirements.missed(before), tuple(options), rigid, slowed)


def _candidates(cascade: Cascade, peak: float, nyquist: float) -> list[Biquad]:
    """A notch with the resonance's own damping, wider and narrower, and low-passes below the resonance."""
    mass = second_mass(cascade.truth)
    assert mass is not None
    reduced = 1.0 / (1.0 / mass.J_load + 1.0 / (cascade.truth.J - mass.J_load))
    damping = max(mass.d / (2.0 * math.sqrt(mass.k * reduced)), 0.02)
    out = []
    if peak < 0.9 * nyquist:
        out += [Biquad("notch", peak, damping, width) for width in (0.2, 0.5, 1.0)]
    for share in (0.4, 0.6, 1.0, 1.5):
        if share * peak < 0.9 * nyquist:
            out.append(Biquad("low_pass", share * peak, 0.0, math.sqrt(0.5)))
    return out


def slow_down(
    cascade: Cascade, make: Any, requirements: Requirements, *, steps: int = 40, ratio: float = 1.15
) -> tuple[SpeedLoop, Margins, float]:
    """Return the fastest gains of a family that keep the requirements.

    Parameters
    ----------
    cascade : Cascade
    make : function of a factor >= 1 by which the loop is slower than asked
    requirements : Requirements

    Returns
    -------
    speed, margins, factor by which it is slower than asked

    Raises
    ------
    RequestError
        When no member does; the message says what the slowest one misses.
    """
    for k in range(steps):
        speed = make(ratio**k)
        found = margins(open_loop(cascade, speed))
        if not requirements.missed(found):
            return speed, found, ratio**k
    raise RequestError(
        f"speed loop: even {ratio ** (steps - 1):.0f} times slower it misses {', '.join(requirements.missed(found))}"
    )
