"""A transmission: motor and load are two masses, and the term is the torque between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.structures.interface import (
    Balances,
    Known,
    Lines,
    Machine,
    SecondMass,
    Structure,
    kernel_call,
)
from pmsm_ctrl.effects.structures.paths import drive_path, observed_path
from pmsm_ctrl.errors import DesignError

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = [
    "DAMPING",
    "DECELERATIONS",
    "FREQUENCY",
    "LEAST_DAMPED",
    "RUBBING",
    "Transmission",
    "after_hard_start",
    "beyond_noise",
    "mean_acceleration",
    "swings_damped",
]

Array = NDArray[np.float64]

# In a shape, and no names that a parameter can have: the load's own frequency sqrt(k / J_load), and its damping
# d / (2 sqrt(k J_load)). With these the load's inertia multiplies a column.
FREQUENCY, DAMPING = "(w_a)", "(zeta)"
# In a shape, what a load's own friction decelerates it by where it is free, F_load / J_load in rad/s^2 (m/s^2).
RUBBING = "(f)"
DECELERATIONS = (1e-6, 1e9)  # rad/s^2 (m/s^2): less never holds a load, and more always does
LEAST_DAMPED = 1e-3
ROUNDING = 1e-6  # of a friction that a fit holds at its bound, and a design file states with few digits
ABOVE_NOISE = 4.0
LEAST_LOAD = 0.02  # share of the inertia that is worth the name of a load, and that the rotor has in any case
# Time constants of its swings after which 2 % of what a load did before the log is left; the share of a log that these
# may take, a block of cross-validation; and the acceleration of a hard start, in its rms over the log.
SETTLED, AT_MOST, HARD = 4.0, 1.0 / 16.0, 3.0
# Amplitude of a wave of a turn, in the torque's rms, of which nothing is known.
UNBOUNDED = 1e3


@dataclass(frozen=True, kw_only=True)
class Transmission(Structure):
    """What a spring and a gap share: the load, its part of the inertia, and its place in the kernel.

    Attributes
    ----------
    load, stiffness, damping : str
        The parameters of the load's inertia, kg m^2, taken out of the total; of the stiffness, N m/rad; and of the
        damping, N m s/rad.
    dry : str
        The parameter of the load's part of the Coulomb friction, N m; empty where the load has none.
    has_gap : bool
        Whether motor and load can move against each other without a torque.
    most_damped : float
        Highest damping ratio of the load.
    least_load : float
        Smallest load, as a share of the inertia.
    """

    load: str
    stiffness: str
    damping: str
    dry: str = ""
    memory: ClassVar[int] = 2
    least_load: ClassVar[float] = LEAST_LOAD
    splits_inertia: ClassVar[bool] = True
    refined_when_taken: ClassVar[bool] = True
    has_gap: ClassVar[bool]
    most_damped: ClassVar[float]

    @staticmethod
    def lines(wired: Sequence[tuple[int, Effect]], offset: int, dry: Sequence[tuple[int, Effect]]) -> Lines:
        """Two masses. A spring and a gap together are one spring with a gap, and have the spring's constants."""
        k, effect = max(wired, key=lambda one: _of(one[1]).has_gap)
        n, constants = min(wired, key=lambda one: _of(one[1]).has_gap)
        mine, theirs = _of(effect), _of(constants)
        shared = {mine.stiffness: f"e{n}_{theirs.stiffness}", mine.damping: f"e{n}_{theirs.damping}"}
        torque = kernel_call(k, effect, twist="theta - theta_l", twist_rate="omega - omega_l", **shared)
        J_load = f"e{n}_{theirs.load}"
        load = [f"domega_l = ({torque} - held[3]) / {J_load}"]
        rubbing = _rubbing_lines(k, effect, shared, f"e{n}_{theirs.carried()}", J_load) if theirs.carried() else {}
        if rubbing:
            load = [
                f"domega_l = ({torque} - held[3] - held[4] * e{n}_{theirs.carried()}) / {J_load}",
                *rubbing.pop("load"),
            ]
        return {
            "states": ["omega_l, theta_l = y[4], y[5]"],
            "coupling": [f"opposing = {torque}"],
            "acceleration": [f"domega = shaft_torque(y, t, direction, held, machine, effects) / (J - {J_load})"],
            "load": load,
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
            **rubbing,
        }

    def carried(self) -> str:
        """The load's part of the Coulomb friction."""
        return self.dry

    def absent(self, effect: Effect, values: Mapping[str, float]) -> frozenset[str]:
        """Return the load's dry friction where it has none: with any, it would stick."""
        carried = self.carried()
        return frozenset((carried,)) if carried and values[carried] == 0.0 else frozenset()

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
        rubbing = values[self.carried()] if self.carried() else 0.0
        if rubbing > dry * (1.0 + ROUNDING):
            raise DesignError(
                f"{label}.{self.carried()}: found {rubbing:g}, but the load's share should lie between 0 and the dry "
                f"friction of {dry:g} N m of the whole axis"
            )
        return dict(values)

    def symbols(self, effect: Effect) -> tuple[str, ...]:
        """Return the load's inertia: all else is in the shape."""
        return (self.load,)

    def rivals(self, effect: Effect, shape: Mapping[str, float], balances: Balances) -> list[dict[str, Array]]:
        """Return what bends the response of an axis with one mass, and what turns with it.

        Channels that are late, averaged or filtered, by a time tau, make a response that is smooth in the frequency: a
        Taylor series in s tau, of the torque and of what accelerates the axis. The load's swings through 180 degrees at
        its antiresonance. At a constant speed any wave of a turn is a single frequency, which a spring that resonates
        there would explain.
        """
        path = [*drive_path(balances), *observed_path(balances)]
        if balances.linear:
            return path
        s, p = balances.signals, balances.design.motor.p or 1
        free = UNBOUNDED * float(np.std(s["torque"]))
        waves = [free * wave(order * s["theta"]) for order in sorted({1, 2, p, 2 * p}) for wave in (np.cos, np.sin)]
        square = s["omega"] ** 2 / max(float(np.mean(s["omega"] ** 2)), 1e-300)
        return [*path, *({"torque": column} for column in (*waves, *(square * wave for wave in waves[:2])))]

    def inside(self, effect: Effect, shape: Mapping[str, float], name: str, value: float) -> float:
        """Return the value inside the bounds; the damping's are those of the load, not those of its parameter."""
        if name == DAMPING:
            return float(min(max(value, LEAST_DAMPED), self.most_damped))
        if name == RUBBING:
            return float(min(max(value, DECELERATIONS[0]), DECELERATIONS[1]))
        return super().inside(effect, shape, name, value)

    def shape(self, effect: Effect, values: Mapping[str, float]) -> dict[str, float]:
        """Return the load's own frequency and damping, and the deceleration by its friction where it has any."""
        J_load = max(values[self.load], 1e-12)
        w = float(np.sqrt(values[self.stiffness] / J_load))
        found = {FREQUENCY: w, DAMPING: values[self.damping] / (2.0 * J_load * w)}
        rubbing = values.get(self.dry, 0.0)  # a frequency response tells none
        return found if rubbing == 0.0 else {**found, RUBBING: rubbing / J_load}

    def parameters(self, effect: Effect, found: Mapping[str, float]) -> dict[str, float]:
        """Return stiffness, damping and friction from the load's inertia, frequency, damping and deceleration."""
        J_load, w, zeta = found[self.load], found[FREQUENCY], found[DAMPING]
        constants = {self.stiffness: J_load * w * w, self.damping: 2.0 * zeta * w * J_load}
        if self.dry:
            constants[self.dry] = J_load * found.get(RUBBING, 0.0)
        return super().parameters(effect, {**found, **constants})

    def bounds(self, effect: Effect, known: Known, shape: Mapping[str, float]) -> dict[str, tuple[float, float]]:
        """Return the bounds of the load's inertia: a part of the total, whose friction is a part of the total.

        None above where the total is not positive.
        """
        if known.J <= 0.0:
            low, high = 0.0, np.inf
        else:
            low, high = self.least_load * known.J, (1.0 - LEAST_LOAD) * known.J
        if shape.get(RUBBING, 0.0) > 0.0:
            high = min(high, max(known.F_c / shape[RUBBING], float(np.nextafter(low, np.inf))))
        return {self.load: (low, high)}

    def second_mass(self, values: Mapping[str, float]) -> SecondMass | None:
        """Return the load; None where it has no inertia."""
        if values[self.load] == 0.0:
            return None
        return SecondMass(values[self.load], values[self.stiffness], values[self.damping])

    def with_inertia_scaled(self, values: Mapping[str, float], factor: float) -> dict[str, float]:
        """Return the values with the load's inertia this factor larger."""
        return {symbol: value * factor if symbol == self.load else value for symbol, value in values.items()}


def _rubbing_lines(k: int, effect: Effect, shared: Mapping[str, str], friction: str, J_load: str) -> Lines:
    """Return the lines of a load that rubs: its direction holds for a step.

    A load at rest stays there while what acts on it is less than its friction. Where one meets rest inside a step, what
    is left of the step has the acceleration of its end. The shaft has the rest of the friction.
    """
    pull = kernel_call(k, effect, twist="y[3] - y[5]", twist_rate="y[2] - y[4]", **shared)
    at_rest = kernel_call(k, effect, twist="y[3] - y[5]", twist_rate="y[2]", **shared)
    return {
        "behind": [f"opposing -= direction * {friction}"],
        "load": [f"if held[4] == 0.0 and {friction} != 0.0:", "    domega_l = 0.0"],
        "held": ["held = (held[0], held[1], held[2], held[3], 0.0)"],
        "load at rest": [
            f"pull = {pull} - held[3]",
            "turning = 1.0 if y[4] > 0.0 else (-1.0 if y[4] < 0.0 else 0.0)",
            f"if turning == 0.0 and abs(pull) > {friction}:",
            "    turning = 1.0 if pull > 0.0 else -1.0",
            "before = y[4]",
            "held = (held[0], held[1], held[2], held[3], turning)",
        ],
        "load landed": [
            f"if {friction} != 0.0 and turning * y[4] < 0.0:",
            f"    pull = {at_rest} - held[3]",
            f"    free = max(abs(pull) - {friction}, 0.0) * (1.0 if pull > 0.0 else -1.0) / {J_load}",
            "    y = (y[0], y[1], y[2], y[3], free * h * y[4] / (y[4] - before), y[5])",
        ],
    }


def _of(effect: Effect) -> Transmission:
    assert isinstance(effect.structure, Transmission)
    return effect.structure


def beyond_noise(values: Array, noise: float) -> Array:
    """Return the columns of shape (channels, m, k), zero where the load's acceleration is less than noise would show.

    Parameters
    ----------
    values : array, shape (channels, m, k)
    noise : float
        Rms of the noise that the columns take part in, rad/s^2 (m/s^2).
    """
    out = values.copy()
    for part in out[0].T:
        part[np.abs(part) <= ABOVE_NOISE * noise] = 0.0
    return out


def mean_acceleration(balances: Balances) -> float:
    """Return the rms acceleration of a log, rad/s^2 (m/s^2).

    Parameters
    ----------
    balances : Balances
    """
    return float(np.sqrt(np.mean(balances.acceleration()[balances.mask] ** 2)))


def swings_damped(shape: Mapping[str, float]) -> float:
    """Return the damping by which the swings of a load end; one without any would swing for longer than any log.

    Parameters
    ----------
    shape : mapping
        With the load's damping.
    """
    return max(shape[DAMPING], LEAST_DAMPED)


def after_hard_start(balances: Balances, column: Array, shape: Mapping[str, float], beside: float = 0.0) -> Array:
    """Return the acceleration of a load less that of the rotor, 0 while it swings from a hard start of the log.

    What came before the first sample is not known, and a filter needs both sides. Where nothing later in the log is as
    hard, an error of a twentieth of this swing is larger than all that the load does otherwise, and no parameter mends
    it. With a rigid axis there, the error is no larger than without the effect.

    Parameters
    ----------
    balances : Balances
    column : array, shape (n,)
    shape : mapping
        With the load's own frequency and its damping.
    beside : float
        Time before it swings at all, s.

    Returns
    -------
    array, shape (n,)
    """
    key, period = ("alpha", "hard start"), balances.period  # asked of every column
    if key not in balances.kept:
        alpha = balances.signals["alpha"]
        first = np.abs(alpha[: max(1, round(2.0 / balances.cutoff / period))])
        balances.kept[key] = not float(first.max()) < HARD * float(np.sqrt(np.mean(alpha**2)))
    if not balances.kept[key]:
        return column
    swings = min(SETTLED / (swings_damped(shape) * shape[FREQUENCY]) + beside, AT_MOST * len(column) * period)
    out = column.copy()
    out[: round(swings / period)] = 0.0
    return out
