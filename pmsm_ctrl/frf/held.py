"""What a log shows of an excitation that is held between its samples, as a binary sequence is.

The log then holds the whole excitation, but the steps of the current fold onto the frequencies below half its rate,
coherently, and a held value acts half a period later than a smooth one. What the speed controller answers is smooth.
Where the two nearly cancel, below the crossover of a closed loop, this is a large part of the torque. It follows from
the excitation and the design's loops, and is taken off the samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.frf import policy
from pmsm_ctrl.frf.recorder import free_cascade, stated
from pmsm_ctrl.tune.sampled import Cascade

__all__ = ["beyond", "held_excess"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

OFFSET = 3  # lines that the mean reaches through the window
SETTLED = 12  # time constants until a filter's answer is below 1e-5
COARSE = 1000  # frequencies at which the loops are evaluated: they are smooth


def beyond(values: Array) -> float:
    """Return the share of a channel's power above `policy.HIGHEST` of its rate; its mean does not count.

    Parameters
    ----------
    values : array, shape (n,)
        Of an even rate.
    """
    power = np.abs(_spectrum(values)) ** 2
    first = math.ceil(policy.HIGHEST * len(values))
    return float(power[first:].sum() / max(power[OFFSET:].sum(), np.finfo(float).tiny))


def held_excess(
    design: Design, channels: Mapping[str, Array], added: Array, period: float, *, closed: bool, J: float, speed: float,
    mass: SecondMass | None = None,
) -> Array | None:  # fmt: skip
    """Return what the samples of the current show of a held excitation beyond what they show of a smooth one, A.

    None where the measured current agrees better with an excitation that is smooth between the samples, or where the
    design does not tell what a sample shows of either.

    Parameters
    ----------
    design : Design
        Its loops, and how its log is taken.
    channels : mapping of str to array, shape (n,)
        With ``i_q`` and ``i_q_ref``.
    added : array, shape (n,)
        The excitation in the current reference, A.
    period : float
        Of the samples, s.
    closed : bool
        Whether the speed loop answers.
    J : float
        kg m^2: how much it answers between the samples.
    speed : float
        rad/s.
    mass : SecondMass, optional
        A load behind a spring; part of `J`.
    """
    ticks, left = divmod(design.sensor.log_divider, design.drive.speed_divider)
    cascade = free_cascade(design, J, speed, mass) if stated(design, [period]) and ticks > 1 and not left else None
    if cascade is None:
        return None
    added, n = _settled(design, added, channels.get("omega_ref"), period), len(added)
    omega = 2.0 * math.pi * np.fft.rfftfreq(n, period)
    coarse = np.linspace(omega[1], omega[-1], min(COARSE, len(omega)))

    def at(values: Complex) -> Complex:
        return np.asarray(np.interp(omega, coarse, values.real) + 1j * np.interp(omega, coarse, values.imag))

    smooth, moved = (one[0] for one in _held(cascade, "i_q_ref", coarse, 1))
    current, reference, sent = (_spectrum(one) for one in (channels["i_q"], channels["i_q_ref"], added))
    rest = current - at(smooth) * reference
    inside = slice(OFFSET, math.floor(policy.HIGHEST * n))
    # a sample may be taken at any tick while the value is held
    held, _ = _held(cascade, "i_q_ref", coarse, ticks)
    power = [float(np.sum(np.abs(rest - at(one - smooth) * sent)[inside] ** 2)) for one in held]
    best = int(np.argmin(power))
    if power[best] >= float(np.sum(np.abs(rest[inside]) ** 2)):
        return None
    if closed:
        cascade = _closed(design, cascade, "theta_ref" in channels)
    shown, turned = _held(cascade, "i_q_add" if closed else "i_q_ref", coarse, ticks)
    excess = at(shown[best] - turned[best] * smooth / moved)
    excess[0] = 0.0
    return np.asarray(np.fft.irfft(excess * np.fft.rfft(added), n))


def _closed(design: Design, cascade: Cascade, in_position: bool) -> Cascade:
    assert design.loops is not None
    position = design.loops.position if in_position and design.loops.position.K_v > 0.0 else None
    return cascade.with_gains(speed=design.loops.speed, position=position)


def _held(cascade: Cascade, source: str, omega: Array, ticks: int) -> tuple[Complex, Complex]:
    """Return current and angle per A that is held for some ticks of the speed loop, sampled at each of them.

    Returns
    -------
    tuple of two complex arrays, shape (ticks, n)
    """
    system = cascade.system((source,), ("i_q", "theta"))
    A, B = np.asarray(system.A), np.asarray(system.B)
    states, inputs = [np.eye(len(A))], [np.zeros_like(B)]
    for _ in range(ticks):
        states.append(A @ states[-1])
        inputs.append(A @ inputs[-1] + B)
    z = np.exp(1j * omega * ticks * cascade.period)
    pencil = z[:, None, None] * np.eye(len(A)) - states[ticks]
    start = np.linalg.solve(pencil, np.broadcast_to(inputs[ticks], (len(z), *B.shape)))
    found = np.array([system.C @ (states[k] @ start + inputs[k]) + system.D for k in range(ticks)])
    return found[:, :, 0, 0], found[:, :, 1, 0]


def _settled(design: Design, added: Array, reference: Array | None, period: float) -> Array:
    """Return an excitation constant where a speed reference moves, and its filter settles: its answer is no excitation.

    A reference that moves most of the time is the excitation itself.
    """
    from scipy.ndimage import binary_dilation

    assert design.loops is not None
    if reference is None:
        return added
    moves = np.diff(reference) != 0.0
    behind = math.ceil(SETTLED * design.loops.speed.reference_filter / period) if moves.any() else 0
    moves = binary_dilation(moves, np.arange(-behind, behind + 1) >= 0) if behind else moves
    if np.mean(moves) > 0.5:
        return added
    return np.concatenate([added[:1], added[0] + np.cumsum(np.where(moves, 0.0, np.diff(added)))])


def _spectrum(values: Array) -> Complex:
    """Return the spectrum through a window, without the mean: a step from the end to the start is no content."""
    return np.asarray(np.fft.rfft((values - values.mean()) * np.hanning(len(values))))
