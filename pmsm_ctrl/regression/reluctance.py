"""The reluctance torque of a current ripple that a log does not hold.

References that are held for some control periods make the current jump at each step. The coupling ``omega L_q i_q``
turns a ripple of i_q into one of i_d, and the product of both has a mean: ``1.5 p (L_d - L_q) i_d i_q`` acts as a drag
that grows with the speed and with the square of the ripple. A torque command, a torque that was computed from i_q, and
means over a log period hold nothing of it; instants of both currents do.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.kernels.balance import torque_em
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.timing import uniform

__all__ = ["coupling_torque", "holds_ripple", "logged_ripple_torques", "ripple_torques", "saliency_torque"]

Array = NDArray[np.float64]

# Powers of speed and acceleration. A step of a held reference grows with the acceleration, and that of a held position
# with the speed: the square of their sum, times the speed, has these terms.
RIPPLES = ((1, 2), (2, 1), (3, 0))
FILTERED = 0.2  # share of a log's rate up to which its filters reach
# The shortest time for which a reference is held whose ripple matters, s: that grows with the square of the time.
HELD = 1e-3


def ripple_torques(record: Record) -> list[Array]:
    """Return the terms of the drag of a ripple as large as the largest current of the log, N m, each of shape (n,).

    Their factors are not negative. Without saliency there is none, and none where the log states that it holds instants
    of both currents: their product has the ripple's mean.

    Parameters
    ----------
    record : Record
    """
    signals = record.signals
    if _salient(record) is None:
        return []
    if "i_d" in record.prepared.signals and record.design.log.of("i_q").sampling == "instant":
        return []
    largest, speed, rate = _largest(record), *(_slow(record, signals[name]) for name in ("omega", "alpha"))
    return [largest * speed**m * rate**n for m, n in RIPPLES]


def coupling_torque(record: Record) -> Array | None:
    """Return the load of the i_d that a d-axis without decoupling lets through, N m s/V, of which no channel tells.

    Its controller of integral gain K_i answers the coupling voltage ``omega L_q i_q`` by ``i_d = d(omega L_q i_q)/dt /
    K_i`` below its bandwidth, and ``1.5 p (L_q - L_d) i_q i_d`` is lacking of the torque. This is that torque times
    K_i. Where i_q accelerates the axis it looks like a saturation of the torque constant. None without saliency, and
    where the log holds i_d.

    Parameters
    ----------
    record : Record
    """
    signals, known = record.signals, _salient(record)
    if known is None or "i_d" in record.prepared.signals:
        return None
    p, L_d, L_q = known
    i_q = signals["torque"] / record.design.K_t_assumed
    answer = record.rate_of(signals["omega"] * L_q * i_q)
    return -np.asarray(torque_em.py_func(p, 0.0, L_d, L_q, answer, i_q))


def saliency_torque(record: Record) -> Array | None:
    """Return the torque of an error of L_d - L_q of 1 H, N m/H: by as much the reluctance torque of a log is wrong.

    It is evaluated with the inductances of a datasheet. At the most torque per ampere (T. M. Jahns, G. B. Kliman, T. W.
    Neumann, IEEE Trans. Ind. Appl. IA-22 (1986) 738) i_d grows with the square of i_q, and the error looks like a
    saturation of the torque constant. A part of it in proportion to i_q is one of that constant, and left out. None
    without saliency, and where no channel holds a current along d.

    Parameters
    ----------
    record : Record
    """
    signals, known = record.signals, _salient(record)
    if known is None or "i_d" not in record.prepared.signals or not np.any(signals["i_d"]):
        return None
    i_d, i_q = signals["i_d"], signals["i_q"]
    usual = float(i_d @ i_q**2) / max(float(i_q @ i_q), 1e-300)
    return np.asarray(torque_em.py_func(known[0], 0.0, 1.0, 0.0, i_d - usual, i_q))


def holds_ripple(log: Log) -> bool:
    """Whether a log has two samples and more in the time for which a reference is held: then it shows its ripple.

    A mean over that time, or instants in step with it, hold nothing of it.

    Parameters
    ----------
    log : Log
    """
    return round(HELD / log.period, 3) >= 2.0


def logged_ripple_torques(record: Record, log: Log) -> list[Array]:
    """Return speed times the mean square of what the logged drive signal holds above the band, in two parts.

    Such a log holds a part of the current's ripple, whatever of it a mean, a filter or a command takes away: all of it
    grows and falls with that part. What share it is may change with the frequency of what excites the ripple, and so
    with the speed: of the two, each of shape (n,), one ends at the highest speed, and the other begins at rest. Their
    mean ripple is as large as that of `ripple_torques`.

    Parameters
    ----------
    record : Record
    log : Log
        At its own rate, before any filter.
    """
    t, channels, good, _ = uniform(log)
    drive = channels["torque" if "torque" in channels else "i_q"]
    rate = (len(t) - 1) / float(t[-1] - t[0])
    cutoff = min(record.cutoff, FILTERED * rate)
    fast = np.where(good, drive - low_pass(drive, rate, cutoff), 0.0)
    power = np.interp(record.prepared.t, t, low_pass(fast**2, rate, cutoff))
    drag = _largest(record) * power / max(float(np.mean(power[record.prepared.keep][record.mask])), 1e-300)
    speed = _slow(record, record.signals["omega"])
    return [drag * speed * (1.0 - speed**2), drag * speed**3]


def _salient(record: Record) -> tuple[float, float, float] | None:
    """Return pole pairs, L_d and L_q, H, of a motor with L_d and L_q apart; None of any other."""
    motor = record.design.motor
    if motor.p is None or motor.L_d is None or motor.L_q is None or motor.L_d == motor.L_q:
        return None
    return motor.p, motor.L_d, motor.L_q


def _largest(record: Record) -> float:
    """Load, N m, of a ripple as large as the largest current of the log, in either axis."""
    known = _salient(record)
    assert known is not None  # asked by `ripple_torques`
    p, L_d, L_q = known
    current = float(np.max(np.abs(record.target[0]), where=record.mask, initial=0.0)) / record.design.K_t_assumed
    return -float(torque_em.py_func(p, 0.0, L_d, L_q, current, current))


def _slow(record: Record, values: Array) -> Array:
    """The part of a signal inside the band, over its largest value."""
    slow = record.at_full_rate(record.shaped(values))
    return np.asarray(slow / max(float(np.max(np.abs(slow))), 1e-300))
