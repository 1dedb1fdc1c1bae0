"""Lines of the speed controller that a design adds: compensation, filters of the current reference, their memory.

What is switched off adds no line, so that it costs nothing. The code export prints the same lines of a filter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pmsm_ctrl.effects import Effect
from pmsm_ctrl.simulate.feedforward import compensation_lines, observer_lines

__all__ = ["COEFFICIENTS", "PLAIN", "SpeedParts", "filter_lines", "filter_memory"]

COEFFICIENTS = ("b_0", "b_1", "b_2", "a_1", "a_2")  # of a filter, in the order of `Biquad.sampled`
FIRST_GAIN = 15  # place of the first filter's coefficients among the gains of the controller


@dataclass(frozen=True)
class SpeedParts:
    """What the speed controller has beside its PI.

    Attributes
    ----------
    observes : bool
        A disturbance observer.
    turns : bool
        Compensated friction turns over a ramp at reversals.
    filters : int
        How many filters the current reference passes through.
    """

    observes: bool = False
    turns: bool = False
    filters: int = 0

    @property
    def memory(self) -> tuple[tuple[str, str], ...]:
        """Names of the memory that these parts need, and what each is after a speed period."""
        own: tuple[tuple[str, str], ...] = ()
        if self.observes:
            own = (("observed", "observed"), ("applied", "i_q_ref"))
        elif self.turns:
            own = (("swing", "swing"),)
        held = tuple((name, name) for k in range(self.filters) for name in filter_memory(k))
        return own + held

    def lines(self, compensated: Sequence[Effect]) -> dict[str, list[str]]:
        """Return the lines for the marks of the drive kernel."""
        own = observer_lines() if self.observes else compensation_lines(compensated, turns=self.turns)
        filters: list[str] = []
        for k in range(self.filters):
            values = ", ".join(f"gains[{FIRST_GAIN + len(COEFFICIENTS) * k + n}]" for n in range(len(COEFFICIENTS)))
            filters += [f"{', '.join(COEFFICIENTS)} = {values}", *filter_lines(k)]
        return {"compensation": own, "filters": filters} | (_memory_lines(self.memory) if self.memory else {})


PLAIN = SpeedParts()


def filter_memory(number: int) -> tuple[str, str]:
    """Return the names of a filter's memory."""
    return f"filter_{number}_1", f"filter_{number}_2"


def filter_lines(number: int, names: Mapping[str, str] | None = None) -> list[str]:
    """Return the lines by which a filter (transposed direct form II) changes `wanted`.

    Parameters
    ----------
    number : int
    names : mapping of str to str, optional
        Of its `COEFFICIENTS`, where they are not called so.
    """
    first, second = filter_memory(number)
    b_0, b_1, b_2, a_1, a_2 = ((names or {}).get(symbol, symbol) for symbol in COEFFICIENTS)
    return [
        f"passed = {b_0} * wanted + {first}",
        f"{first} = {b_1} * wanted - {a_1} * passed + {second}",
        f"{second} = {b_2} * wanted - {a_2} * passed",
        "wanted = passed",
    ]


def _memory_lines(memory: Sequence[tuple[str, str]]) -> dict[str, list[str]]:
    """Return the lines by which this memory goes with that of the PI; the last states hold it between two runs."""
    names, values = zip(*memory, strict=True)
    places = ", ".join(f"states[{k - len(names)}]" for k in range(len(names)))
    states = f"states[6], states[7], states[8], states[14], {places}"
    return {
        "speed memory": [f"I_s, theta_last, omega_hat, omega_filtered, {', '.join(names)} = memory"],
        "speed result": [f"return (I_s, theta_m, omega_hat, omega_filtered, {', '.join(values)}), i_q_ref"],
        "load speed memory": [f"speed_memory = ({states})"],
        "store speed memory": [f"{states} = speed_memory"],
    }
