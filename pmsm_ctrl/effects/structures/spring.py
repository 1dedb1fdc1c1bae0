"""A spring without a gap between motor and load: followed by its response, or in time where the load rubs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.structures.interface import Balances, Known, LogView, Search, SecondMass, Structure
from pmsm_ctrl.effects.structures.rubbing import bristle_column, rubbing_column, rubbing_shapes
from pmsm_ctrl.effects.structures.transmission import (
    DAMPING,
    FREQUENCY,
    LEAST_DAMPED,
    LEAST_LOAD,
    RUBBING,
    UNBOUNDED,
    Transmission,
    after_hard_start,
    beyond_noise,
    mean_acceleration,
    swings_damped,
)

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["Spring"]

Array = NDArray[np.float64]

# A load damped more than this hangs on no spring: it shifts the phase like a delay or a filter. Elastomer couplings
# lose up to psi = 2 of their energy in a swing, zeta = psi / (4 pi) = 0.16.
OVERDAMPED = 0.25
# One that rubs and is damped more than by an elastomer does not swing, and is a bristle.
SWINGS = 0.16
# How often the steps of the refinement are halved: the frequency of a spring that is hardly damped is as sharp as its
# damping.
SHARP = 7
PART_OF_WIDTH = 0.1  # of half the width of a resonance, which is its damping: straight enough for a slope
SWUNG_OUT = 7.0  # time constants of a swing: a thousandth of it is left
# The smallest load, as a share of the inertia: on a sharp resonance it makes most of what a model without it leaves.
LEAST_ON_SPRING = 0.0005
# Lowest and highest frequency of a load on its spring, Hz, and the dampings of those that ring.
LOWEST, HIGHEST, RINGING = 10.0, 250.0, (0.01, 0.03, 0.1)
# Twist of a spring, rad rms at its output: twice what even highly flexible couplings are rated for, at their peak.
MOST_TWIST = 0.5


@dataclass(frozen=True, kw_only=True)
class Spring(Transmission):
    """A spring and a damper between motor and load.

    Attributes
    ----------
    measured : tuple of SecondMass
        What a frequency response has shown: its spring is among the shapes that are searched.
    offered_apart : bool
        Springs of all frequencies together take up noise whatever each of them does with it.
    """

    measured: tuple[SecondMass, ...] = ()
    has_gap: ClassVar[bool] = False
    most_damped: ClassVar[float] = OVERDAMPED
    offered_apart: ClassVar[bool] = True
    least_load: ClassVar[float] = LEAST_ON_SPRING

    def slight(self, known: Known, values: Mapping[str, float]) -> bool:
        """Whether the load is less than what is worth the name of one, its resonance aside."""
        return values[self.load] < LEAST_LOAD * known.J

    def columns(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """T = J alpha + J_load (alpha_load - alpha): the load's acceleration less that of the rotor, shape (n,).

        By the spectrum, of a signal that is limited to the band: exact at every frequency, where a sampled filter has
        the load's own one right or the band. The load is at rest against the rotor at first; zeros behind the log let
        its swings die away, for at most as long as the log is. A load that rubs is followed in time.
        """
        from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

        if RUBBING in shape:
            return [{"torque": after_hard_start(balances, rubbing_column(balances, shape), shape)}]
        alpha, period = balances.signals["alpha"], balances.period
        w, zeta = shape[FREQUENCY], swings_damped(shape)
        count = len(alpha)
        length = next_fast_len(count + min(count, int(SWUNG_OUT / (zeta * w * period))), real=True)
        s = 2j * np.pi / w * rfftfreq(length, period)
        follow = -(s**2) / (s**2 + 2.0 * zeta * s + 1.0)
        return [{"torque": after_hard_start(balances, irfft(rfft(alpha, length) * follow, length)[:count], shape)}]

    def inside(self, effect: Effect, shape: Mapping[str, float], name: str, value: float) -> float:
        """Return the value inside the bounds; those of a load that rubs, which is followed in time, are narrower."""
        if RUBBING in shape:
            within = {FREQUENCY: self.ranges(effect)[FREQUENCY], DAMPING: (LEAST_DAMPED, SWINGS)}
            if name in within:
                return float(min(max(value, within[name][0]), within[name][1]))
        return super().inside(effect, shape, name, value)

    def judged(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns where the load would accelerate otherwise than the shaft by more than noise.

        One that takes no part in the noise of the acceleration lowers every error, there or not. Nothing is left of one
        that rubs and swings above the band: it is held and let go like a bristle.
        """
        if RUBBING in shape and shape[FREQUENCY] > 2.0 * np.pi * balances.cutoff:
            return np.zeros_like(values)
        noise = min(balances.shaft_noise(), balances.noise_beside(values[0][:, 0]))
        return beyond_noise(values, noise * _apart(shape, balances.cutoff))

    def offered(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns where the load would accelerate otherwise than the shaft by more than all that is fast."""
        return beyond_noise(values, balances.shaft_noise() * _passed(shape, balances.cutoff))

    def rivals(self, effect: Effect, shape: Mapping[str, float], balances: Balances) -> list[dict[str, Array]]:
        """Return the rivals of a transmission; of one that rubs also a bristle, which is the same without a mass."""
        found = super().rivals(effect, shape, balances)
        if RUBBING not in shape:
            return found
        bristle = bristle_column(balances, shape[RUBBING] / shape[FREQUENCY] ** 2)
        return [*found, {"torque": UNBOUNDED * bristle}]

    def search(self, effect: Effect, log: LogView) -> Search:
        """Return springs over a coarse grid, and the best of a fine one, in which none that rings can be missed."""
        ringing = list(_ringing(log))
        best = (max(one for one in ringing if one[2] == zeta) for zeta in RINGING)
        softest = _softest(log.balances)
        told = [self.shape(effect, self.values_of(mass)) for mass in self.measured]
        known = [(shape[FREQUENCY], self.inside(effect, shape, DAMPING, shape[DAMPING])) for shape in told]
        grid = tuple(one for one in (*_coarse(), *(one[1:] for one in best), *known) if one[0] >= softest)
        if not grid:
            return Search(
                (), why_not=f"any spring of these frequencies would twist by more than {MOST_TWIST:g} rad rms"
            )
        shapes = [{FREQUENCY: w, DAMPING: zeta} for w, zeta in grid]
        looked = len(shapes) + len(ringing)
        if self.dry:
            rubbing, tried = rubbing_shapes(log, max(softest, 2.0 * np.pi * LOWEST))
            shapes += rubbing
            looked += tried
        return Search(tuple(shapes), looked)

    def starting_from(self, mass: SecondMass) -> Structure:
        """Return the spring whose search also starts from this one."""
        return replace(self, measured=(*self.measured, mass))

    def halvings(self, effect: Effect, free: Iterable[str]) -> int:
        """How often the steps of the refinement are halved."""
        return SHARP if FREQUENCY in free else super().halvings(effect, free)

    def ranges(self, effect: Effect) -> dict[str, tuple[float, float]]:
        """Return the frequencies and dampings of springs."""
        return {FREQUENCY: (2.0 * np.pi * LOWEST, 4.0 * np.pi * HIGHEST), DAMPING: (LEAST_DAMPED, OVERDAMPED)}

    def straight_over(self, effect: Effect, shape: Mapping[str, float], name: str) -> float:
        """Step of a shape's logarithm over which the prediction is straight: at a resonance, part of its width."""
        plain = super().straight_over(effect, shape, name)
        return min(plain, PART_OF_WIDTH * swings_damped(shape)) if name == FREQUENCY else plain

    def at_bound(self, effect: Effect, shape: Mapping[str, float]) -> bool:
        """Whether a spring is damped so much that it is none, or a parameter ran into its bound."""
        most = SWINGS if RUBBING in shape else OVERDAMPED
        return shape.get(DAMPING, 0.0) >= most or super().at_bound(effect, shape)

    def resonance(self, shape: Mapping[str, float]) -> float | None:
        """Frequency at which the load rings on its spring, Hz."""
        return shape[FREQUENCY] / (2.0 * np.pi)

    def values_of(self, mass: SecondMass) -> dict[str, float]:
        """Return the parameters that make this mass."""
        return {self.load: mass.J_load, self.stiffness: mass.k, self.damping: mass.d}


def _apart(shape: Mapping[str, float], cutoff: float) -> float:
    """Share of white noise in the band that a load takes no part in, rms: above its own frequency it stays behind.

    Below, it does what the shaft does and more, which raises the error that noise makes. In quadrature it does neither.
    """
    x = 2.0 * np.pi / shape[FREQUENCY] * np.linspace(0.0, cutoff, 4001)[1:]
    behind = x**2 * (1.0 - x**2) / ((1.0 - x**2) ** 2 + (2.0 * swings_damped(shape) * x) ** 2)
    return float(np.sqrt(np.mean(np.minimum(behind, 0.0) ** 2)))


def _passed(shape: Mapping[str, float], cutoff: float) -> float:
    """What a spring makes of white noise in the band, rms: one that rings is shaken by little."""
    f = np.linspace(0.0, cutoff, 4001)[1:]
    flat = np.zeros((5, len(f)))
    flat[4] = 1.0 / len(f)
    return float(np.sqrt(_sums(f, flat, np.array([[shape[FREQUENCY], swings_damped(shape)]]))[0, 2]))


def _sums(f: Array, products: Array, springs: Array) -> Array:
    """Return what `spring_sums` fills, shape (k, 3), of frequencies in Hz."""
    from pmsm_ctrl.kernels.springs import spring_sums

    out = np.empty((len(springs), 3))
    spring_sums(2.0 * np.pi * f, products, springs, out)
    return out


def _softest(balances: Balances) -> float:
    """Return the lowest frequency of a load that its acceleration twists no further than shafts bear, rad/s."""
    if balances.linear:
        return 0.0
    twist = MOST_TWIST * balances.design.load.gear
    return float(np.sqrt(mean_acceleration(balances) / twist))


def _coarse() -> Iterator[tuple[float, float]]:
    for k, f in enumerate(np.geomspace(LOWEST, HIGHEST, 15)):
        for zeta in (0.02, 0.15) if k % 2 == 0 else (0.02,):
            yield 2.0 * np.pi * float(f), zeta


def _ringing(log: LogView) -> Iterator[tuple[float, float, float]]:
    """Gain of the torque's sum of squares by springs a fraction of their resonance's width apart, w_a and zeta.

    By Parseval over the spectra, so that each costs one product. One that would need a negative load gains nothing.
    """
    balances = log.balances
    square = (balances.weight[0] * balances.mask) ** 2
    alpha = balances.acceleration()
    f = np.fft.rfftfreq(len(alpha), 1.0 / balances.rate)
    band = (f > 0.0) & (f < balances.cutoff)
    motion, wanted, own = (np.fft.rfft(x)[band] for x in (alpha, square * log.residual, square * alpha))
    scale = 2.0 / len(alpha)
    along, beside = scale * wanted.conj() * motion, scale * own.conj() * motion
    level = scale * float(square.mean()) * (motion.real**2 + motion.imag**2)
    size = max(float(square @ alpha**2), 1e-300)
    top = max(1.2 * balances.cutoff, LOWEST)
    springs = np.array([
        (2.0 * np.pi * one, zeta)
        for zeta in RINGING
        for one in np.geomspace(LOWEST, top, int(np.log(top / LOWEST) / (1.2 * zeta)) + 1)
    ])  # fmt: skip
    products = np.stack([along.real, along.imag, beside.real, beside.imag, level])
    for (w, zeta), (gain, shared, power) in zip(
        springs.tolist(), _sums(np.asarray(f[band], dtype=float), products, springs).tolist(), strict=True
    ):
        left = power - shared**2 / size
        yield (gain**2 / left if gain > 0.0 and left > 0.0 else 0.0), w, zeta
