"""A two-mass resonance in the speed loop: its frequencies, the margins it leaves, and the filter to propose.

G. Ellis, R. D. Lorenz, Resonant load control methods for industrial servo drives, IEEE IAS Annual Meeting 2000.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pmsm_ctrl.design import Design, Filter, SpeedLoop
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.tune.linearise import linearise, second_mass
from pmsm_ctrl.tune.margins import Margins, margins, resolved, response
from pmsm_ctrl.tune.requirements import Missed, Requirements
from pmsm_ctrl.tune.robust import LOAD, corners, varied, varied_load
from pmsm_ctrl.tune.sampled import Cascade, frequencies
from pmsm_ctrl.tune.speed import open_loop

__all__ = [
    "WORTH", "Family", "FilterOption", "Resonance", "moved_margins", "resonance", "resonance_frequencies", "slow_down",
    "slower_gains",
]  # fmt: skip

RATIO, STEPS = 1.15, 40  # of the search for slower gains
SLOWEST = 15  # steps of that search over the corners: seven times slower
WIDTHS = (0.2, 0.5, 1.0)  # damping of the notches that are tried
WORTH = 1.1  # crossover with a filter, as a multiple of that without, from which on the filter is taken

Family = Callable[[float, tuple[Filter, ...]], SpeedLoop]  # by how much slower they are, and the filters behind them


@dataclass(frozen=True)
class FilterOption:
    """A filter behind the speed controller, or none, and how fast the loop may be with it.

    Attributes
    ----------
    filter : Filter or None
    gains : SpeedLoop
        Those of the rigid axis with this filter: its delay is one of the small time constants.
    margins : Margins
        With these gains.
    missed : tuple of Missed
        Of these.
    worst : Margins
        With the same gains at the worst corner of the load: stiffness and the inertias of motor and load, each at one
        end of its tolerance.
    corner : str
        That corner.
    slowed : float
        Factor by which these gains must be slower to meet the requirements nominally and at every corner; inf when no
        factor up to that of the search does.
    crossover : float
        Nominal, with the slower gains, Hz; 0 without them.
    """

    filter: Filter | None
    gains: SpeedLoop
    margins: Margins
    missed: tuple[Missed, ...]
    worst: Margins
    corner: str
    slowed: float
    crossover: float


@dataclass(frozen=True)
class Resonance:
    """The resonance of a two-mass axis and the filters against it.

    Attributes
    ----------
    antiresonance, resonance : float
        Hz.
    gains : SpeedLoop
        Those of the rigid axis without a filter.
    before : Margins
        Of these gains on the real axis, without a filter.
    options : tuple of FilterOption
        Filters tried, the best one first.
    plain : FilterOption
        No filter.
    slowed : bool
        Whether the gains had to be reduced to run without a filter.
    unfiltered : float
        Crossover of the gains that a design without a filter has, Hz: nominal, or over the tolerances where those were
        asked for; 0 where there are none, NaN where gains were given and not tuned.
    used : FilterOption or None
        The filter that the tuned gains have.
    moved : mapping of str to Margins
        Of the gains of this design, by what is off: the resonance, the load's inertia, or both at their worst.
    """

    antiresonance: float
    resonance: float
    gains: SpeedLoop
    before: Margins
    options: tuple[FilterOption, ...]
    plain: FilterOption
    slowed: bool = False
    unfiltered: float = math.nan
    used: FilterOption | None = None
    moved: Mapping[str, Margins] = field(default_factory=dict)

    @property
    def proposed(self) -> FilterOption | None:
        """The option that is fastest over the tolerances of the load, if it is worth a filter; else None."""
        best = self.options[0] if self.options else None
        return best if best is not None and best.crossover > WORTH * self.plain.crossover else None


def resonance_frequencies(design: Design) -> tuple[float, float] | None:
    """Return antiresonance and resonance of a two-mass axis in Hz, or None for a rigid axis."""
    mass = second_mass(design)
    if mass is None:
        return None
    return mass.antiresonance, mass.antiresonance * math.sqrt(design.J / (design.J - mass.J_load))


def resonance(cascade: Cascade, make: Family, requirements: Requirements) -> Resonance | None:
    """Judge the gains of the rigid axis on the resonant one, without and with filters; None for a rigid axis."""
    found = resonance_frequencies(cascade.truth)
    if found is None:
        return None
    judge, gains = _Judge(cascade, make, requirements), make(1.0, ())
    options = []
    for item in _candidates(cascade, found[1]):
        with contextlib.suppress(RequestError):  # behind this filter no gains are as fast as asked
            options.append(judge.option(item))
    # The fastest over the tolerances first, then the closest to the requirements.
    options.sort(key=lambda o: (-o.crossover, requirements.shortfall(o.worst)))
    return Resonance(*found, gains, margins(open_loop(cascade, gains)), tuple(options), judge.option(None))


def moved_margins(cascade: Cascade, requirements: Requirements) -> dict[str, Margins]:
    """Return the margins of a cascade's speed loop with the load off: resonance, load inertia, the worst of both.

    The resonance moves by a tenth with the stiffness off by a fifth.
    """
    assert cascade.speed is not None
    spans = {symbol: abs(value) for symbol, value in _load_corners(cascade.truth)[-1].items()}
    single = [(symbol, sign * spans[symbol]) for symbol in LOAD if symbol in spans for sign in (-1.0, 1.0)]
    points = [{symbol: value} for symbol, value in single] + _load_corners(cascade.truth)
    grid, found = frequencies(cascade.period, 1e-3, 600), {}
    for point in points:
        loop = open_loop(off_by(cascade, point), cascade.speed)
        found[_named(point)] = margins(loop, grid)
    names = list(found)
    worst = max(names[len(single) :], key=lambda name: requirements.shortfall(found[name]))
    return {name: found[name] for name in (*names[: len(single)], worst)}


def off_by(cascade: Cascade, deviations: Mapping[str, float]) -> Cascade:
    """Return the cascade around a plant whose load is off by relative deviations of `J`, `J_load` and `k`."""
    truth, mass = varied(cascade.truth, deviations), varied_load(cascade.truth, deviations)
    return replace(cascade, truth=truth, model=linearise(truth, cascade.model.point.speed, mass=mass))


def _named(deviations: Mapping[str, float]) -> str:
    return ", ".join(f"{symbol} {100.0 * d:+.3g} %" for symbol, d in deviations.items())


class _Judge:
    """Filters on the nominal axis and at the corners of its load."""

    def __init__(self, cascade: Cascade, make: Family, requirements: Requirements) -> None:
        self._nominal, self._make, self._requirements = cascade, make, requirements
        self._grid = frequencies(cascade.period, 1e-3, 400)
        self._corners = [(point, off_by(cascade, point)) for point in _load_corners(cascade.truth)]

    def option(self, item: Filter | None) -> FilterOption:
        behind = () if item is None else (item,)
        gains = self._make(1.0, behind)
        nominal = margins(open_loop(self._nominal, gains))
        corners = [(self._margins(at, gains), deviations) for deviations, at in self._corners]
        worst, deviations = max(corners, key=lambda found: self._requirements.shortfall(found[0]))
        slowed, crossover = self._fastest(behind)
        missed = self._requirements.missed(nominal)
        return FilterOption(item, gains, nominal, missed, worst, _named(deviations), slowed, crossover)

    def _margins(self, cascade: Cascade, gains: SpeedLoop) -> Margins:
        return margins(open_loop(cascade, gains), self._grid)

    def _fails(self, cascade: Cascade, gains: SpeedLoop) -> bool:
        loop = open_loop(cascade, gains)
        # abs(S) is quick to find and decides most cases
        if np.abs(1.0 / (1.0 + response(loop, resolved(loop, self._grid)))).max() > self._requirements.sensitivity_peak:
            return True
        return bool(self._requirements.missed(margins(loop, self._grid)))

    def _fastest(self, behind: tuple[Filter, ...]) -> tuple[float, float]:
        """Return the smallest factor by which the gains must be slower, and the nominal crossover then."""
        every = [self._nominal, *(at for _, at in self._corners)]
        for k in range(SLOWEST):
            try:
                slower = self._make(RATIO**k, behind)
            except RequestError:  # the method has no gains so slow
                break
            failed = next((at for at in every if self._fails(at, slower)), None)
            if failed is None:
                return RATIO**k, self._margins(self._nominal, slower).crossover
            # It is the likeliest to fail again.
            every = [failed, *(at for at in every if at is not failed)]
        return math.inf, 0.0


def slower_gains(gains: SpeedLoop, factor: float) -> SpeedLoop:
    """Return the gains of a loop that is slower by a factor >= 1, with the same filters of the current."""
    return gains.model_copy(
        update={
            "K_p": gains.K_p / factor,
            "T_n": gains.T_n * factor,
            "reference_filter": gains.reference_filter * factor,
        }
    )


def _load_corners(design: Design) -> list[dict[str, float]]:
    """Return the corners of the load's tolerances alone: inertias of motor and load, stiffness."""
    kept = ({s: d for s, d in corner.items() if s in ("J", *LOAD)} for corner in corners(design))
    return list({tuple(corner.items()): corner for corner in kept}.values())


def _candidates(cascade: Cascade, peak: float) -> list[Filter]:
    """A notch with the resonance's own damping, in three widths, and low-passes about the resonance."""
    mass, highest = second_mass(cascade.truth), 0.9 * 0.5 / cascade.period
    assert mass is not None
    reduced = 1.0 / (1.0 / mass.J_load + 1.0 / (cascade.truth.J - mass.J_load))
    damping = max(mass.d / (2.0 * math.sqrt(mass.k * reduced)), 0.02)
    notches = [
        Filter(kind="notch", frequency=peak, width=2.0 * width * peak, depth=20.0 * math.log10(width / damping))
        for width in WIDTHS
        if width > damping
    ]
    passes = [Filter(kind="low_pass", frequency=share * peak) for share in (0.4, 0.6, 1.0, 1.5)]
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
