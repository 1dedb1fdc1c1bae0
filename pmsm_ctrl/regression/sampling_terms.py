"""Columns for how the channels of a log were sampled, which no design can state for every log."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.drive_timing import (
    AGE,
    CURRENT_LOOP,
    EMF,
    EMF_FILTERED,
    EMF_LATE,
    INSTANT,
    LATENESS,
    SPEED_SPREAD,
    SPREAD,
    STATED_WITHIN,
    DriveTiming,
    emf_left,
)

__all__ = ["FILTERED", "Term", "instant_terms", "sampling_terms", "speed_terms"]

Array = NDArray[np.float64]

# Age of a speed that the drive filtered before it was logged, s.
FILTERED = 3e-3
# Control rate of a drive that states none, Hz; and a third of 0.1 % of the torque, as small as effects are named.
SLOWEST_CONTROL, LEAST_EXCESS = 4e3, 3e-4
VAGUE = 100.0  # prior of the delay of the drive signal, in units of what is possible


@dataclass(frozen=True, eq=False)
class Term:
    """A column of its own, with its nominal value and tolerance.

    `parts` returns what it does to each balance at the log's rate; `modelled` where that hangs on the current or torque
    that a model predicts, `kept` as "turning" where it hangs on the direction. All others are the same in every fit.
    """

    name: str
    parts: Callable[[], Mapping[str, Array]]
    nominal: float
    sigma: float
    modelled: bool = False
    kept: str = "base"


def speed_terms(record: Record, age: DriveTiming, settled: bool) -> Iterator[Term]:
    """How a logged speed was sampled, of a log without a position: its mean delay, and half the variance of its filter.

    The latter has no prior until the timing is settled.

    Parameters
    ----------
    record : Record
    age : DriveTiming
        What was corrected of it.
    settled : bool
        As in `sampling_terms`.
    """
    torque, stated = record.signals["torque"], record.design.log.of("omega").stated
    slope = record.rate_of(torque)
    yield Term(AGE, lambda: {"torque": slope}, 0.0, STATED_WITHIN * record.period if stated else FILTERED, True)
    if record.late is not None and not stated:
        known = max(record.sampling, age.lag) ** 2 / 6.0
        curved = record.rate_of(slope)
        yield Term(SPEED_SPREAD, lambda: {"torque": -curved}, 0.0, known if settled else np.inf, True)


def sampling_terms(record: Record, settled: bool) -> Iterator[Term]:
    """How the drive signal was sampled, beside the position; see `drive_timing`.

    Its mean delay, and half the variance of its impulse response; the latter has no prior until the timing is settled.
    A command is as far from the torque as the current loop is slow, and by what that lets through of the back-emf.

    Parameters
    ----------
    record : Record
    settled : bool
        Whether a filter was undone already, if there was one.
    """
    torque = record.signals["torque"]
    yield Term(LATENESS, lambda: {"torque": -record.slope_behind(torque)}, 0.0, VAGUE * record.sampling, True)
    if record.late is not None:
        curved = record.rate_of(record.rate_of(torque))
        loop = CURRENT_LOOP if record.commanded else 0.0
        known = max(record.sampling, record.timing.lag, loop) ** 2 / 6.0
        yield Term(SPREAD, lambda: {"torque": curved}, 0.0, known if settled else np.inf, True)
    if record.commanded and (columns := _emf_left(record)) is not None:
        late, filtered = columns
        yield Term(EMF, lambda: {"torque": late}, 0.0, EMF_LATE)
        yield Term(EMF_FILTERED, lambda: {"torque": filtered}, 0.0, EMF_LATE)


def instant_terms(record: Record) -> Iterator[Term]:
    """How much the currents of an instant exceed their mean over a control period T: by (p omega T)^2 / 12 at most.

    A voltage stands still in the stator while the rotor turns under it, and the current swings about its mean:
    ``L di/dt = u0 (exp(-j p omega (t - T / 2)) - mean)`` begins a period with ``-j p omega T^2 u0 / (12 L)``, of which
    ``u0 = j p omega L i`` is in phase with the current. A sampled mean of instants has it whole, one over the period
    nothing of it; torque and speed squared look like a drag or, beside a weight, like a friction by direction.

    Parameters
    ----------
    record : Record
    """
    design, omega = record.design, record.signals["omega"]
    if design.motor.p is None or record.late is None:
        return
    stated = "f_control" in design.drive.model_fields_set
    period = 1.0 / (design.drive.f_control if stated else SLOWEST_CONTROL)
    excess = (design.motor.p * omega * period) ** 2 / 12.0
    if float(excess.max()) > LEAST_EXCESS:
        torque = record.signals["torque"]
        yield Term(INSTANT, lambda: {"torque": torque * excess}, 0.0, 1.0, True)


def _emf_left(record: Record) -> tuple[Array, Array] | None:
    if (key := ("emf",)) not in record.kept:
        record.kept[key] = emf_left(record.design, record.signals["alpha"], record.period)
    columns: tuple[Array, Array] | None = record.kept[key]
    return columns
