"""Columns for how the channels of a log were sampled, which no design can state for every log."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.conditioning import default_cutoff
from pmsm_ctrl.regression.drive_timing import (
    AGE,
    CURRENT_LOOP,
    EMF,
    EMF_FILTERED,
    EMF_LATE,
    IN_STEP,
    INSTANT,
    INSTANT_EMF,
    LATENESS,
    SPEED_SPREAD,
    SPREAD,
    SURE,
    DriveTiming,
    control_period,
    emf_left,
    stated_within,
)
from pmsm_ctrl.regression.notices import SAMPLED_IN_STEP
from pmsm_ctrl.regression.reference_steps import HELD
from pmsm_ctrl.regression.reluctance import coupling_torque, saliency_torque
from pmsm_ctrl.units import axis_unit

__all__ = [
    "COUPLED",
    "FILTERED",
    "SALIENCY",
    "Term",
    "coupled_terms",
    "in_step",
    "instant_terms",
    "saliency_terms",
    "sampling_terms",
    "speed_terms",
]

Array = NDArray[np.float64]

# Age of a speed that the drive filtered before it was logged, s.
FILTERED = 3e-3
LEAST_EXCESS = 3e-4  # a third of 0.1 % of the torque, as small as effects are named
SLOWEST_LOOP = 2.0 * math.pi * 100.0  # rad/s: of a current loop
LOOPS_APART = 3.0  # largest speed loop over position loop
SALIENCY = "saliency"  # error of L_d - L_q in the torque, H
COUPLED = "coupled"  # inverse of the integral gain of the d-axis controller, A s/V
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
    yield Term(
        AGE, lambda: {"torque": slope}, 0.0, stated_within(record.design, record.period) if stated else FILTERED, True
    )
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
    if record.in_step:
        yield Term(IN_STEP, lambda: {"torque": record.signals["omega"]}, 0.0, largest_step(record))


def largest_step(record: Record) -> float:
    """Return the largest torque over speed, N m s/rad, that sampling in step with a held position reference can show.

    A position reference that is held for T steps by omega T. With a position loop of gain K_v and a speed loop of
    angular frequency w the torque jumps by J w K_v omega T and fades to its mean until the next step; where every
    sample stands at the same place of a step, half of that at most is taken for friction, of either sign. The speed
    loop is taken to be as fast as the usual band, the position loop a third of that.

    Parameters
    ----------
    record : Record
    """
    w = 2.0 * math.pi * default_cutoff(record.prepared.rate)
    return 0.5 * record.design.J * w * (w / LOOPS_APART) * HELD


def in_step(record: Record, symbol: str, slope: float, stderr: float) -> Record | None:
    """Return the record as one that was sampled in step with a held position reference; None where it is not.

    That is told from friction where viscous friction would surely be negative.

    Parameters
    ----------
    record : Record
    symbol : str
        Of the viscous friction.
    slope, stderr : float
        Torque over speed without bounds, and its standard error, N m s/rad (N s/m).
    """
    if record.in_step or record.sampling_stated or record.age is not None:
        return None
    if not SURE * stderr < -slope < largest_step(record):
        return None
    unit = axis_unit("N m s/rad", record.prepared.motion)
    said = SAMPLED_IN_STEP(quantity=record.drive, slope=-slope, unit=unit, parameter=symbol)
    return replace(record, in_step=True, notes=(*record.notes, said), memo={}, kept={})


def instant_terms(record: Record) -> Iterator[Term]:
    """How much the currents of an instant exceed their mean over a control period T: by (p omega T)^2 / 12 at most.

    A voltage stands still in the stator while the rotor turns under it, and the current swings about its mean:
    ``L di/dt = u0 (exp(-j p omega (t - T / 2)) - mean)`` begins a period with ``-j p omega T^2 u0 / (12 L)``, of which
    ``u0 = j p omega L i`` is in phase with the current. A sampled mean of instants has it whole, one over the period
    nothing of it; torque and speed squared look like a drag or, beside a weight, like a friction by direction. What the
    back-emf swings it by is a quarter of a turn ahead, and the resistance turns a part of that into the torque's axis,
    to first order ``-(psi_f / L) (R T / L) (p omega T)^3 / 240``: a drag that grows with the cube of the speed.

    Parameters
    ----------
    record : Record
    """
    design, omega, motor = record.design, record.signals["omega"], record.design.motor
    if motor.p is None or record.late is None:
        return
    period, torque = control_period(design), record.signals["torque"]
    turned = motor.p * omega * period
    excess = turned**2 / 12.0
    if float(excess.max()) > LEAST_EXCESS:
        yield Term(INSTANT, lambda: {"torque": torque * excess}, 0.0, 1.0, True)
    if motor.R is None or motor.L_q is None or motor.psi_f is None:
        return
    by_emf = design.K_t_assumed * motor.psi_f / motor.L_q * (motor.R * period / motor.L_q) * turned**3 / -240.0
    if float(np.abs(by_emf).max()) > LEAST_EXCESS * float(np.sqrt(np.mean(torque**2))):
        yield Term(INSTANT_EMF, lambda: {"torque": by_emf}, 0.0, 1.0)


def coupled_terms(record: Record) -> Iterator[Term]:
    """Torque that an i_d takes which no channel holds.

    Of its loop no more is known than that it is hardly slower than the slowest. Its controller is taken to cancel the
    pole of the winding: K_i = R w with the angular frequency w of the loop.

    Parameters
    ----------
    record : Record
    """
    R = record.design.motor.R
    if R is None or record.late is None or (load := coupling_torque(record)) is None:
        return
    yield Term(COUPLED, lambda: {"torque": load}, 0.0, 1.0 / (R * SLOWEST_LOOP), True)


def saliency_terms(record: Record) -> Iterator[Term]:
    """Reluctance torque that the inductances of the design are wrong by, inside their tolerance.

    Parameters
    ----------
    record : Record
    """
    motor = record.design.motor
    if record.late is None or (load := saliency_torque(record)) is None:
        return
    assert motor.L_d is not None  # of a motor with saliency
    assert motor.L_q is not None
    spread = math.hypot(motor.tolerance_of("L_d", 0.0) * motor.L_d, motor.tolerance_of("L_q", 0.0) * motor.L_q)
    torque = record.signals["torque"]
    if spread * float(np.abs(load).max()) > LEAST_EXCESS * float(np.sqrt(np.mean(torque**2))):
        yield Term(SALIENCY, lambda: {"torque": load}, 0.0, spread, True)


def _emf_left(record: Record) -> tuple[Array, Array] | None:
    if (key := ("emf",)) not in record.kept:
        record.kept[key] = emf_left(record.design, record.signals["alpha"], record.period)
    columns: tuple[Array, Array] | None = record.kept[key]
    return columns
