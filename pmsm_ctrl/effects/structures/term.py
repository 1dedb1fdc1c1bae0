"""A term that follows from the signals of one instant: it is added to its balance, or to what a sensor says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.effects.evaluate import column, columns, columns_less_noise
from pmsm_ctrl.effects.signals import CURRENTS
from pmsm_ctrl.effects.structures.interface import (
    Balances,
    Lines,
    LogView,
    Search,
    Structure,
    UnavailableError,
    default_shapes,
    kernel_call,
)

if TYPE_CHECKING:
    from pmsm_ctrl.effects.base import Effect

__all__ = ["Term", "current_balances", "readable"]

Array = NDArray[np.float64]

# In a shape, and no name that a parameter can have: 1 where the drive turns its frame by the angle that is measured
# wrongly, 0 where it commutates by another sensor, or logs another encoder.
FRAME = "(frame)"
# Signals whose noise is known, and which are known as fast as they were logged.
DRIVE = ("torque", "i_q")
# Over the cutoff: for so long the low-pass before differentiation smooths the speed.
SMOOTHED = 0.1
# Steps of the logarithm of a period: how often those of its refinement are halved, and over what the prediction is
# straight, half a radian at the end of forty waves.
SHARP, ALONG = 7, 2e-3


@dataclass(frozen=True)
class Term(Structure):
    """Added to the torque balance, to the voltages, or to what the sensors measure."""

    @staticmethod
    def lines(wired: Sequence[tuple[int, Effect]], offset: int, dry: Sequence[tuple[int, Effect]]) -> Lines:
        """Return the lines of all plain terms."""
        entering = {name: [(k, e) for k, e in wired if e.enters == name] for name in ("torque", "voltage")}
        measured = [(k, e) for k, e in wired if e.enters == "measurement"]
        torque = [f"opposing += {kernel_call(k, effect)}" for k, effect in entering["torque"]]
        return {"torque": torque} | _voltage(entering["voltage"]) | _measurement(measured)

    def reads(self, effect: Effect) -> frozenset[str]:
        """Return the term's signals; a wrong current enters beside the true one, a wrong angle by the inertia."""
        beside = {CURRENTS: CURRENTS, ("theta",): ("inertia",)}
        return frozenset((*effect.signals, *beside.get(effect.channels, ())))

    def columns(self, balances: Balances, effect: Effect, shape: Mapping[str, float]) -> list[dict[str, Array]]:
        """Return the term per unit, and for a sensor's error what follows from it to first order.

        Raises
        ------
        UnavailableError
            When no parameter multiplies a column.
        """
        values = {p.symbol: p.start for p in effect.parameters} | dict(shape)
        signals = readable(balances)
        if effect.enters == "voltage":  # its products need the current beyond the band
            signals |= {name: signals[f"{name}_wide"] for name in ("i_q", "di_q") if f"{name}_wide" in signals}
        terms = _without_noise(effect, signals, values)
        if not terms:
            raise UnavailableError("it has no parameter that multiplies a column")
        if (slow := _slow_enough(balances, effect, shape)) is not None:
            terms = {symbol: term * slow for symbol, term in terms.items()}
        return [_entering(balances, effect, terms[symbol], shape) for symbol in self.symbols(effect)]

    def judges(self, effect: Effect) -> bool:
        """Whether the term bends over the speed."""
        return bool(effect.bends_over)

    def judged(self, balances: Balances, effect: Effect, values: Array, shape: Mapping[str, float]) -> Array:
        """Return the columns without the moments at which a bend over the speed is over before the filters show it.

        What is left there is an error of the moment of reversal.
        """
        if not effect.bends_over:
            return values
        quick = np.abs(balances.acceleration()) * (SMOOTHED / balances.cutoff) > shape[effect.bends_over]
        return np.where(quick[:, None], 0.0, values)

    def corrected(
        self, effect: Effect, values: Mapping[str, float], t: Array, channels: Mapping[str, Array], p: float | None
    ) -> dict[str, Array] | None:
        """Take the term off the channels it spoils: to first order, since it reads the measured values."""
        known: dict[str, Array | float] = {"i_d": np.zeros_like(t), **channels}
        if p is not None:
            known["p"] = p
        spoiled = [name for name in effect.channels if name in channels]
        if not spoiled or any(name not in known for name in effect.signals):
            return None
        out = dict(channels)
        for name, error in zip(effect.channels, np.atleast_2d(column(effect, known, values)), strict=True):
            if name in spoiled:
                out[name] = out[name] - error
            if name == "theta" and "omega" in out:
                out["omega"] = out["omega"] - np.gradient(error, t)
        return out

    def search(self, effect: Effect, log: LogView) -> Search:
        """Return what the effect says of its own search, or multiples of the start values."""
        found = default_shapes(effect) if effect.search is None else effect.search(log)
        search = found if isinstance(found, Search) else Search(tuple(found))
        if effect.channels != ("theta",):
            return search
        frames = (1.0, 0.0) if "u_d" in log.balances.channels else (1.0,)
        return replace(search, shapes=tuple({**shape, FRAME: frame} for shape in search.shapes for frame in frames))

    def fixed(self, effect: Effect) -> frozenset[str]:
        """Return the order of the angle and the frame: whole numbers."""
        return frozenset((effect.order, FRAME))

    def halvings(self, effect: Effect, free: Iterable[str]) -> int:
        """How often the steps of the refinement are halved: until a period holds over the whole travel."""
        return SHARP if effect.period in free else super().halvings(effect, free)

    def straight_over(self, effect: Effect, shape: Mapping[str, float], name: str) -> float:
        """Step of a shape's logarithm over which the prediction is straight: of a period, part of a wave at the end."""
        return ALONG if name == effect.period else super().straight_over(effect, shape, name)

    def commutation_apart(self, shape: Mapping[str, float]) -> bool:
        """Whether the voltages do not follow the wrong angle."""
        return shape.get(FRAME, 1.0) == 0.0


def readable(balances: Balances) -> dict[str, Array | float]:
    """Return the signals as terms read them."""
    signals: dict[str, Array | float] = {k: v for k, v in balances.signals.items() if k != "alpha"}
    if balances.design.motor.p is not None:
        signals["p"] = float(balances.design.motor.p)
    for name in {"di_d", "di_q"} - signals.keys():
        signals[name] = np.zeros(len(balances.signals["t"]))
    return signals


def _without_noise(effect: Effect, signals: dict[str, Array | float], values: Mapping[str, float]) -> dict[str, Array]:
    """Return an effect's columns at the torque and the current as they were logged, less what noise adds in the mean.

    A product of fast signals comes back into the band. Noise of standard deviation s makes a term f too large by
    s^2 f''/2 in the mean, and as much again where it is added once more: 2 f(i) - (f(i + s) + f(i - s)) / 2 is right to
    second order. A term that is straight over both is left as it is. What a sensor adds is taken off the slow signals.
    Source: R. J. Carroll et al., Measurement Error in Nonlinear Models (2006), ch. 5 and 7.
    """
    noisy = () if effect.enters == "measurement" else tuple(name for name in DRIVE if name in effect.signals)
    if not noisy or any(f"{name}_whole" not in signals for name in noisy):
        return columns(effect, signals, values)[0]
    whole = signals | {name: signals[f"{name}_whole"] for name in noisy}
    noise = {name: np.asarray(signals[f"{name}_noise"]) for name in noisy}
    return columns_less_noise(effect, whole, values, noise)


def current_balances(balances: Balances, wrong: Array) -> dict[str, Array]:
    """Balances built from currents that are measured less true by `wrong`, shape (2, n)."""
    s, motor = balances.signals, balances.design.motor
    d, q = wrong
    if motor.p is None or motor.L_d is None or motor.L_q is None or motor.R is None:
        return {"torque": balances.design.K_t_assumed * q}
    i_d = s.get("i_d", np.zeros_like(d))
    salient = 1.5 * motor.p * (motor.L_d - motor.L_q)
    out = {"torque": balances.design.K_t_assumed * q + salient * (i_d * q + s["i_q"] * d)}
    if "u_d" in balances.channels:
        # i_q follows from the motion here and is right; the loop holds the measured i_d, so the true one is off
        out["u_d"] = -(motor.R * d + motor.L_d * balances.rate_of(d))
        out["u_q"] = -motor.p * s["omega"] * motor.L_d * d
    return out


def _entering(balances: Balances, effect: Effect, term: Array, shape: Mapping[str, float]) -> dict[str, Array]:
    """What a term per unit does to each balance, at the log's rate."""
    if effect.enters == "torque":
        return {"torque": term}
    if effect.enters == "voltage":
        return {"u_d": term[0], "u_q": term[1]}
    if effect.channels == ("theta",):
        return _angle(balances, term, shape.get(FRAME, 1.0))
    return current_balances(balances, term)


def _angle(balances: Balances, wrong: Array, frame: float) -> dict[str, Array]:
    """Balances built from an angle that is measured less true by `wrong`, shape (n,).

    The acceleration is wrong by its second derivative, and u_q loses p psi_f times the false speed. Where the drive
    turns its frame by the same angle (`frame` 1), the magnets' flux stands askew in it: u_d gains
    p^2 omega psi_f delta.
    """
    motor = balances.design.motor
    speed = balances.rate_of(wrong)
    out = {"torque": -balances.inertia * balances.rate_of(speed)}
    if motor.p is not None and motor.psi_f is not None:
        out["u_d"] = frame * motor.p**2 * balances.signals["omega"] * motor.psi_f * wrong
        out["u_q"] = -motor.p * motor.psi_f * speed
    return out


def _slow_enough(balances: Balances, effect: Effect, shape: Mapping[str, float]) -> Array | None:
    """Where an order of the angle lies below the log's Nyquist frequency; above it, it would come back as an alias.

    None of it is lost: the balances are filtered far below. None where there is no order.
    """
    if effect.order not in shape and effect.period not in shape:
        return None
    waves = effect.waves(shape, balances.design.motor.p or 1)
    fastest = 0.8 * np.pi / balances.period
    return np.asarray(waves * np.abs(balances.signals["omega"]) < fastest, dtype=float)


def _voltage(effects: Sequence[tuple[int, Effect]]) -> Lines:
    """Voltage lost; what depends on di_q/dt stands beside L_q as incremental inductance."""
    lines = []
    slopes = []
    for k, effect in effects:
        lines += [f"e_d, e_q = {kernel_call(k, effect)}", "u_d -= e_d", "u_q -= e_q"]
        if "di_q" in effect.signals:
            slopes.append(f"{kernel_call(k, effect, di_q='1.0')}[1] - {kernel_call(k, effect)}[1]")
    if not slopes:
        return {"voltage": lines}
    lines.append(f"L_q_incremental = L_q + {' + '.join(slopes)}")
    current = "di_q = (u_q - voltage_q(R, L_d, L_q, p, psi_f, i_d, i_q, 0.0, omega)) / L_q_incremental"
    return {"voltage": lines, "incremental inductance": [current]}


def _measurement(effects: Sequence[tuple[int, Effect]]) -> Lines:
    angle = [kernel_call(k, effect) for k, effect in effects if effect.channels == ("theta",)]
    lines: Lines = {"measure current": []}
    if angle:
        lines["encoder"] = [f"theta_m = quantise(theta + {' + '.join(angle)}, counts)"]
    for k, effect in effects:
        if effect.channels == CURRENTS:
            lines["measure current"] += [f"e_d, e_q = {kernel_call(k, effect)}", "i_d_m += e_d", "i_q_m += e_q"]
    return lines
