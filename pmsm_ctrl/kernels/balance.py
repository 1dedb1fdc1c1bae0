"""The voltage and torque balance of the PMSM in rotor coordinates, written once.

Amplitude-invariant dq scaling; source: R. Krishnan, Permanent Magnet Synchronous and Brushless DC Motor Drives,
CRC Press 2010, ch. 3; P. Pillay and R. Krishnan, IEEE Trans. Ind. Appl. 25 (1989) 265.
"""

from __future__ import annotations

from pmsm_ctrl.kernels import kernel

__all__ = ["torque_em", "voltage_d", "voltage_q"]


@kernel
def voltage_d(R: float, L_d: float, L_q: float, p: float, i_d: float, i_q: float, di_d: float, omega: float) -> float:
    """u_d = R i_d + L_d di_d/dt - p omega L_q i_q in V."""
    return R * i_d + L_d * di_d - p * omega * L_q * i_q


@kernel
def voltage_q(
    R: float,
    L_d: float,
    L_q: float,
    p: float,
    psi_f: float,
    i_d: float,
    i_q: float,
    di_q: float,
    omega: float,
) -> float:
    """u_q = R i_q + L_q di_q/dt + p omega (L_d i_d + psi_f) in V."""
    return R * i_q + L_q * di_q + p * omega * (L_d * i_d + psi_f)


@kernel
def torque_em(p: float, psi_f: float, L_d: float, L_q: float, i_d: float, i_q: float) -> float:
    """T = 3/2 p (psi_f i_q + (L_d - L_q) i_d i_q) in N m."""
    return 1.5 * p * (psi_f * i_q + (L_d - L_q) * i_d * i_q)
