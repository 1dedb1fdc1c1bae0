"""A transmission: motor and load are two masses with a spring between them, with a gap or without."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.evaluate import called, compiled_loop
from pmsm_ctrl.effects.structures.interface import (
    Balances,
    Known,
    Lines,
    LogView,
    Machine,
    Search,
    SecondMass,
    Structure,
    drive_path,
    kernel_call,
)
from pmsm_ctrl.errors import DesignError

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["Transmission"]

Array = NDArray[np.float64]

# In a shape, and no names that a parameter can have: the load's own frequency sqrt(k / J_load), and its damping
# d / (2 sqrt(k J_load)). With these the load's inertia multiplies a column.
FREQUENCY, DAMPING = "(w_a)", "(zeta)"
# A transmission damped more than this is no spring: it shifts the phase like a delay or a filter. Elastomer couplings
# lose up to psi = 2 of their energy in a swing, zeta = psi / (4 pi) = 0.16.
OVERDAMPED = 0.25
# A contact damped more than this does not bounce at all.
STUCK = 2.0
LEAST_DAMPED = 1e-3
# How often the steps of the refinement are halved: the frequency of a spring that is hardly damped is as sharp as its
# damping.
SHARP = 7
PART_OF_WIDTH = 0.1  # of half the width of a resonance, which is its damping: straight enough for a slope
ABOVE_NOISE = 4.0
LEAST_LOAD = 0.02  # a load is a share of the inertia that is worth the name
SWUNG_OUT = 7.0  # time constants of a swing: a thousandth of it is left
# Lowest and highest frequency of a load on its spring, Hz, and the dampings of those that ring.
LOWEST, HIGHEST, RINGING = 10.0, 250.0, (0.01, 0.03, 0.1)
AT_ONCE, FEWEST_LANES = 4e6, 8  # bytes of columns that are made side by side, and the fewest of them
# Times in which the mean acceleration of a log carries the shaft across a gap, s, and how many gaps are searched: one
# that is crossed faster looks like an error of the moment of reversal, one that is crossed slower like a free load.
SHORTEST, LONGEST, GAPS = 0.003, 0.08, 15
# Gap over what the contact gives way under the mean acceleration: behind less, a load hangs on a damper, not on flanks.
FIRM = 2.0
# Amplitude of a wave of a turn, in the torque's rms, of which nothing is known.
UNBOUNDED = 1e3
# Twist of a spring, rad rms at its output: twice what even highly flexible couplings are rated for, at their peak.
MOST_TWIST = 0.5


@dataclass(frozen=True)
class Transmission(Structure):
    """Two masses; the term is the torque between them.

    Attributes
    ----------
    load, stiffness, damping : str
        The parameters of the inertia behind the spring, kg m^2, taken out of the total; of the stiffness, N m/rad;
        and of the damping, N m s/rad.
    gap : str
        The parameter of the gap between the flanks, rad; empty for a spring without one.
    measured : tuple of SecondMass
        What a frequency response has shown: its spring is among the shapes that are searched.
    """

    load: str
    stiffness: str
    damping: str
    gap: str = ""
    measured: tuple[SecondMass, ...] = ()
    memory: ClassVar[int] = 2
    splits_inertia: ClassVar[bool] = True

    @staticmethod
    def lines(wired: Sequence[tuple[int, Effect]], offset: int, dry: Sequence[tuple[int, Effect]]) -> Lines:
        """Two masses. A spring and a gap together are one spring with a gap, and have the spring's constants."""
        spring = next(((k, effect) for k, effect in wired if not _of(effect).gap), None)
        gap = next(((k, effect) for k, effect in wired if _of(effect).gap), None)
        k, effect = gap or spring or wired[0]
        n, constants = spring or (k, effect)
        mine, theirs = _of(effect), _of(constants)
        shared = {mine.stiffness: f"e{n}_{theirs.stiffness}", mine.damping: f"e{n}_{theirs.damping}"}
        torque = kernel_call(k, effect, twist="theta - theta_l", twist_rate="omega - omega_l", **shared)
        J_load = f"e{n}_{theirs.load}"
        return {
            "states": ["omega_l, theta_l = y[4], y[5]"],
            "coupling": [f"opposing = {torque}"],
            "acceleration": [f"domega = shaft_torque(y, t, direction, held, machine, effects) / (J - {J_load})"],
            "load": [f"domega_l = ({torque} - held[3]) / {J_load}"],
            "rates": ["return di_d, di_q, domega, omega, domega_l, omega_l"],
            "advance": ["return " + ", ".join(f"y[{n}] + h * k[{n}]" for n in range(6))],
            "landed": ["new = (new[0], new[1], 0.0, new[3], new[4], new[5])"],
            "load states": [
                f"y = (states[0], states[1], states[2], states[3], states[{offset}], states[{offset + 1}])",
            ],
            "store states": [
                "states[0], states[1], states[2], states[3] = y[0], y[1], y[2], y[3]",
                f"states[{offset}], states[{offset + 1}] = y[4], y[5]",
            ],
            "log": ["out[row, 14] = y[5]"],
        }

    @staticmethod
    def start(omega: float, theta: float) -> tuple[float, ...]:
        """Return speed and angle of the load: it turns with the motor."""
        return omega, theta

    def memory_along(self, effect: Effect, values: Mapping[str, float], omega: Array, theta: Array) -> Array:
        """Return speed and angle of a load that follows the motor, shape (n, 2)."""
        return np.column_stack([omega, theta])

    def simulated(
        self, effect: Effect, values: Mapping[str, float], machine: Machine, dry: float, label: str
    ) -> dict[str, float]:
        """Return the values where the load is a part of the total inertia.

        Raises
        ------
        DesignError
            When it is not.
        """
        if not 0.0 < values[self.load] < machine.J:
            raise DesignError(
                f"{label}.{self.load}: found {values[self.load]:g}, but the load's share should lie between 0 and the "
                f"total inertia of {machine.J:g} kg m^2"
            )
        return dict(values)

    def symbols(self, effect: Effect) -> tuple[str, ...]:
        """Return the load's inertia: all else is in the shape."""
        return (self.load,)

    def columns(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """T = J alpha + J_load (alpha_load - alpha): the load's acceleration against the rotor's."""
        return next(self.columns_each(balances, effect, [shape]))

    def columns_each(
        self, balances: Balances, effect: Effect, shapes: Sequence[Mapping[str, float]]
    ) -> Iterator[list[dict[str, Array]]]:
        """Yield the columns of several shapes; gaps are followed side by side, as many as the memory allows."""
        if not self.gap:
            for shape in shapes:
                yield [{"torque": self._behind_spring(balances, effect, shape)}]
            return
        lanes = max(FEWEST_LANES, int(AT_ONCE / (8 * len(balances.signals["theta"]))))
        for start in range(0, len(shapes), lanes):
            for column in self._behind_gap(balances, effect, shapes[start : start + lanes]):
                yield [{"torque": column}]

    def judged(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns where the load would accelerate otherwise than the shaft by more than noise.

        One that takes no part in the noise of the acceleration lowers every error, there or not. Nothing is left of a
        gap whose contact gives way further than the gap is wide.
        """
        if self.gap:  # a load in contact follows the shaft nearly always
            return self._beyond_noise(balances, values, shape, balances.shaft_noise())
        noise = min(balances.shaft_noise(), balances.noise_beside(values[0][:, 0]))
        return self._beyond_noise(balances, values, shape, noise * _apart(shape, balances.cutoff))

    @property
    def offered_apart(self) -> bool:
        """Springs of all frequencies together take up noise whatever each of them does with it."""
        return not self.gap

    def offered(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns where the load would accelerate otherwise than the shaft by more than all that is fast."""
        if self.gap:
            return self.judged(balances, effect, values, shape)
        return self._beyond_noise(balances, values, shape, balances.shaft_noise() * _passed(shape, balances.cutoff))

    def _beyond_noise(self, balances: Balances, values: Array, shape: Mapping[str, float], noise: float) -> Array:
        if self.gap and shape[self.gap] * shape[FREQUENCY] ** 2 < FIRM * _mean_acceleration(balances):
            return np.zeros_like(values)
        out = values.copy()
        for part in out[0].T:
            part[np.abs(part) <= ABOVE_NOISE * noise] = 0.0
        return out

    def rivals(self, effect: Effect, shape: Mapping[str, float], balances: Balances) -> list[dict[str, Array]]:
        """Return what bends the response of an axis with one mass, and what turns with it.

        Channels that are late, averaged or filtered, by a time tau, make a response that is smooth in the frequency: a
        Taylor series in s tau, of the torque and of what accelerates the axis. The load's swings through 180 degrees at
        its antiresonance. At a constant speed any wave of a turn is a single frequency, which a spring that resonates
        there would explain.
        """
        path = drive_path(balances)
        if balances.linear:
            return path
        s, p = balances.signals, balances.design.motor.p or 1
        free = UNBOUNDED * float(np.std(s["torque"]))
        waves = [free * wave(order * s["theta"]) for order in sorted({1, 2, p, 2 * p}) for wave in (np.cos, np.sin)]
        square = s["omega"] ** 2 / max(float(np.mean(s["omega"] ** 2)), 1e-300)
        return [*path, *({"torque": column} for column in (*waves, *(square * wave for wave in waves[:2])))]

    def search(self, effect: Effect, log: LogView) -> Search:
        """Return springs over a coarse grid, and the best of a fine one, in which none that rings can be missed.

        A load that bounces off its flanks cannot be followed: small errors of the motion grow with each bounce. One
        that stays where it struck explains most of the same torque, so contacts are searched as well damped ones.
        """
        if self.gap:
            return Search(tuple(
                {self.gap: float(gap), FREQUENCY: 2.0 * np.pi * f, DAMPING: zeta}
                for gap in _gaps(log.balances)
                for f in (80.0, 300.0)
                for zeta in (0.4, 1.2)
            ))  # fmt: skip
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
        return Search(tuple({FREQUENCY: w, DAMPING: zeta} for w, zeta in grid), len(grid) + len(ringing))

    def starting_from(self, mass: SecondMass) -> Structure:
        """Return the transmission whose search also starts from this spring; a gap tells nothing of itself by it."""
        return self if self.gap else replace(self, measured=(*self.measured, mass))

    def halvings(self, free: Iterable[str]) -> int:
        """How often the steps of the refinement are halved."""
        return SHARP if FREQUENCY in free and not self.gap else super().halvings(free)

    def ranges(self, effect: Effect) -> dict[str, tuple[float, float]]:
        """Return the frequencies and dampings of springs; behind a gap the sum of squares is rough over both."""
        if self.gap:
            return {}
        return {FREQUENCY: (2.0 * np.pi * LOWEST, 4.0 * np.pi * HIGHEST), DAMPING: (LEAST_DAMPED, OVERDAMPED)}

    def straight_over(self, shape: Mapping[str, float], name: str) -> float:
        """Step of a shape's logarithm over which the prediction is a straight line: of a resonance, part of its width.

        A gap's has no such step: the load bounces between the flanks.
        """
        plain = super().straight_over(shape, name)
        return min(plain, PART_OF_WIDTH * shape[DAMPING]) if name == FREQUENCY and not self.gap else plain

    def inside(self, effect: Effect, shape: Mapping[str, float], name: str, value: float) -> float:
        """Return the value inside the bounds; the damping's are those of a spring, or of a contact."""
        if name == DAMPING:
            return float(min(max(value, LEAST_DAMPED), STUCK if self.gap else OVERDAMPED))
        return super().inside(effect, shape, name, value)

    def at_bound(self, effect: Effect, shape: Mapping[str, float]) -> bool:
        """Whether a spring is damped so much that it is none, or a parameter ran into its bound."""
        overdamped = not self.gap and shape.get(DAMPING, 0.0) >= OVERDAMPED
        return overdamped or super().at_bound(effect, shape)

    @property
    def unlike_rivals(self) -> bool:
        """Whether no rival can resemble the column: that of a gap, which opens and closes."""
        return bool(self.gap)

    @property
    def refined_when_taken(self) -> bool:
        """Whether the shape is refined as soon as the effect is in: its candidate left out what may be noise."""
        return True

    def shape(self, effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
        """Return the load's own frequency and damping, and the gap."""
        J_load = max(values[self.load], 1e-12)
        w = float(np.sqrt(values[self.stiffness] / J_load))
        shape = {FREQUENCY: w, DAMPING: values[self.damping] / (2.0 * J_load * w)}
        return {self.gap: values[self.gap], **shape} if self.gap else shape

    def parameters(self, effect: Effect, found: Mapping[str, float]) -> dict[str, float]:
        """Return stiffness and damping from the load's inertia, frequency and damping."""
        J_load, w, zeta = found[self.load], found[FREQUENCY], found[DAMPING]
        constants = {self.stiffness: J_load * w * w, self.damping: 2.0 * zeta * w * J_load}
        return super().parameters(effect, {**found, **constants})

    def bounds(self, effect: Effect, known: Known) -> dict[str, tuple[float, float]]:
        """Return the bounds of the load's inertia: a part of the total."""
        return {self.load: (LEAST_LOAD * known.J, known.J)}

    @property
    def amounts_are_linear(self) -> bool:
        """Whether the size of the column is the amount of the effect: not that of a gap."""
        return not self.gap

    def resonance(self, shape: Mapping[str, float]) -> float | None:
        """Frequency at which the load rings on its spring, Hz."""
        return None if self.gap else shape[FREQUENCY] / (2.0 * np.pi)

    def second_mass(self, values: Mapping[str, float]) -> SecondMass | None:
        """Return the load; None where it has no inertia."""
        if values[self.load] == 0.0:
            return None
        gap = values[self.gap] if self.gap else 0.0
        return SecondMass(values[self.load], values[self.stiffness], values[self.damping], gap)

    def values_of(self, mass: SecondMass) -> dict[str, float]:
        """Return the parameters that make this mass; none where there is a gap as well."""
        return {} if self.gap else {self.load: mass.J_load, self.stiffness: mass.k, self.damping: mass.d}

    def with_inertia_scaled(self, values: Mapping[str, float], factor: float) -> dict[str, float]:
        """Return the values with the load's inertia this factor larger."""
        return {symbol: value * factor if symbol == self.load else value for symbol, value in values.items()}

    def _behind_spring(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> Array:
        """Acceleration of a load on a spring less that of the rotor, shape (n,).

        By the spectrum, of a signal that is limited to the band: exact at every frequency, where a sampled filter has
        the load's own one right or the band. The load is at rest against the rotor at first; zeros behind the log let
        its swings die away, for at most as long as the log is.
        """
        from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

        alpha, period = balances.signals["alpha"], balances.period
        w, zeta = shape[FREQUENCY], shape[DAMPING]
        count = len(alpha)
        length = next_fast_len(count + min(count, int(SWUNG_OUT / (zeta * w * period))), real=True)
        s = 2j * np.pi / w * rfftfreq(length, period)
        follow = -(s**2) / (s**2 + 2.0 * zeta * s + 1.0)
        return np.asarray(irfft(rfft(alpha, length) * follow, length)[:count])

    def _behind_gap(self, balances: Balances, effect: Effect, shapes: Sequence[Mapping[str, float]]) -> Iterator[Array]:
        """Yield the acceleration of a load behind each of several gaps less that of the rotor, shape (n,).

        The effect's own contact law is used with stiffness and damping per inertia.
        """
        loop, symbols = compiled_loop(effect, "load", _loop)
        s = balances.signals
        values = {p.symbol: np.full(len(shapes), p.start) for p in effect.parameters}
        w, zeta = (np.array([shape[name] for shape in shapes]) for name in (FREQUENCY, DAMPING))
        values[self.gap] = np.array([shape[self.gap] for shape in shapes])
        values[self.stiffness], values[self.damping] = w * w, 2.0 * zeta * w
        steps = np.maximum(4, np.ceil(balances.period * w * 4.0).astype(int))
        out = np.empty((len(shapes), len(s["theta"])))
        for substeps in np.unique(steps).tolist():
            lanes = np.flatnonzero(steps == substeps)
            own = (np.ascontiguousarray(values[symbol][lanes]) for symbol in symbols)
            loop(out, lanes, s["theta"], s["omega"], balances.period, substeps, *own)
        return (row - s["alpha"] for row in out)


def _of(effect: Effect) -> Transmission:
    assert isinstance(effect.structure, Transmission)
    return effect.structure


def _apart(shape: Mapping[str, float], cutoff: float) -> float:
    """Share of white noise in the band that a load takes no part in, rms: above its own frequency it stays behind.

    Below, it does what the shaft does and more, which raises the error that noise makes. In quadrature it does neither.
    """
    x = 2.0 * np.pi / shape[FREQUENCY] * np.linspace(0.0, cutoff, 4001)[1:]
    behind = x**2 * (1.0 - x**2) / ((1.0 - x**2) ** 2 + (2.0 * shape[DAMPING] * x) ** 2)
    return float(np.sqrt(np.mean(np.minimum(behind, 0.0) ** 2)))


def _passed(shape: Mapping[str, float], cutoff: float) -> float:
    """What a spring makes of white noise in the band, rms: one that rings is shaken by little."""
    f = np.linspace(0.0, cutoff, 4001)[1:]
    flat = np.zeros((5, len(f)))
    flat[4] = 1.0 / len(f)
    return float(np.sqrt(_sums(f, flat, np.array([[shape[FREQUENCY], shape[DAMPING]]]))[0, 2]))


def _sums(f: Array, products: Array, springs: Array) -> Array:
    """Return what `spring_sums` fills, shape (k, 3), of frequencies in Hz."""
    from pmsm_ctrl.kernels.springs import spring_sums

    out = np.empty((len(springs), 3))
    spring_sums(2.0 * np.pi * f, products, springs, out)
    return out


def _gaps(balances: Balances) -> Array:
    """Return the gaps that a log can show, rad (m): what is crossed in a given time grows with the acceleration."""
    return 0.5 * _mean_acceleration(balances) * np.geomspace(SHORTEST, LONGEST, GAPS) ** 2


def _mean_acceleration(balances: Balances) -> float:
    """Rms acceleration, rad/s^2 (m/s^2)."""
    return float(np.sqrt(np.mean(balances.acceleration()[balances.mask] ** 2)))


def _softest(balances: Balances) -> float:
    """Return the lowest frequency of a load that its acceleration twists no further than shafts bear, rad/s."""
    if balances.linear:
        return 0.0
    twist = MOST_TWIST * balances.design.load.gear
    return float(np.sqrt(_mean_acceleration(balances) / twist))


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


def _loop(effect: Effect) -> tuple[str, tuple[str, ...]]:
    """Source of the loop that follows loads along the motion, side by side, and the parameters it takes."""
    symbols = tuple(p.symbol for p in effect.parameters)
    own = {symbol: f"{symbol}[_c]" for symbol in symbols}
    call = called(effect, twist="_position - _load[_c]", twist_rate="_rate - _speed[_c]", **own)
    return (
        "import numpy as np\n\n\n"
        f"def loop(_out, _rows, _theta, _omega, _period, _substeps, {', '.join(symbols)}):\n"
        "    _h, _lanes = _period / _substeps, len(_rows)\n"
        "    _load, _speed, _before = np.empty(_lanes), np.empty(_lanes), np.empty(_lanes)\n"
        "    for _c in range(_lanes):\n"
        "        _load[_c], _speed[_c] = _theta[0], _omega[0]\n"
        "    for _n in range(len(_theta)):\n"
        "        _last = min(_n + 1, len(_theta) - 1)\n"
        "        for _c in range(_lanes):\n"
        "            _before[_c] = _speed[_c]\n"
        "        for _m in range(_substeps):\n"
        "            _x = _m / _substeps\n"
        "            _position = (1.0 - _x) * _theta[_n] + _x * _theta[_last]\n"
        "            _rate = (1.0 - _x) * _omega[_n] + _x * _omega[_last]\n"
        "            for _c in range(_lanes):\n"
        f"                _speed[_c] += _h * {call}\n"
        "                _load[_c] += _h * _speed[_c]\n"
        "        for _c in range(_lanes):\n"
        "            _out[_rows[_c], _n] = (_speed[_c] - _before[_c]) / _period\n"
    ), symbols
