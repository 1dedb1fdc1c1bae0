"""The loops exactly as they run: linear plant between the ticks, controller and delay at the ticks.

One pass of the cascade over a speed period is a linear map. It is written here in the order in which the drive
computes it (`pmsm_ctrl.kernels.drive_template`) and turned into matrices by applying it to the unit vectors, so that
the discrete controller with its real delays is analysed, not a continuous approximation.

The held voltage rests in the stator while the rotor turns, at the speed of the operating point and away from it.
Second-order effects are left out: quantisation and limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance, schur

from pmsm_ctrl.design import CurrentLoop, Design, Filter, PositionLoop, SpeedLoop
from pmsm_ctrl.effects.structures import SecondMass
from pmsm_ctrl.sampling import smoothing
from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.tune.held import held_period
from pmsm_ctrl.tune.linearise import STATES, Linearisation, linearise, passed_through
from pmsm_ctrl.tune.reach import within_period

__all__ = ["FAINT", "Cascade", "current_loop", "filters", "frequencies", "pi", "responses", "speed_plant"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FAINT = 1.0 / 6.0  # share of a held reference below which its images are too weak for a measurement

# The states are deviations from the operating point, or, by `Cascade.moving`, the states themselves; then the speed of
# the point is an input too.
PARTS = 16  # of a control period, in which the currents of a fast winding count as constant
INPUTS = ("omega_ref", "theta_ref", "i_q_add", "T_load", "angle_noise", "i_q_ref", "omega_point")
OUTPUTS = ("omega_hat", "omega", "i_q", "theta", "i_q_ref", "omega_load", "i_d")


def pi(K_p: float, T_n: float, period: float) -> Any:
    """Return K_p (1 + (T/T_n) / (z - 1)), the PI as it runs: forward Euler, integrator added before its update."""
    return ct.tf([K_p, K_p * (period / T_n - 1.0)], [1.0, -1.0], period)


def responses(system: Any, omega: Array) -> Complex:
    """Return the frequency responses of all outputs to the first input at omega (rad/s), shape (outputs, n)."""
    period = system.dt
    at: Complex = np.asarray(np.exp(1j * omega * period) if period else 1j * omega, dtype=np.complex128)
    if isinstance(system, ct.StateSpace) and system.nstates:
        states = _states(system.A, system.B[:, 0], at)
        return np.asarray(system.C @ states + system.D[:, :1], dtype=np.complex128)
    return np.asarray(system(at, squeeze=False), dtype=np.complex128)[:, 0]


def _states(A: Array, B: Array, at: Complex) -> Complex:
    """Return (z - A)^-1 B for all z, shape (states, n): python-control solves them one by one.

    Behind one unitary change of states they are triangles, which are solved row by row for all of them: a third of the
    time of a matrix for each. States are as different in size as a charge and an angle: they are balanced before, and
    what is left of every equation is solved once more.
    """
    with np.errstate(invalid="ignore"):  # scipy takes large scales for a permutation, of which there is none
        balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    rates, turned = schur(balanced, output="complex")
    inputs = (B / scale)[:, None]

    def solved(right: Complex) -> Complex:
        right, found = turned.conj().T @ right, np.empty((len(A), len(at)), np.complex128)
        for k in reversed(range(len(A))):
            found[k] = (right[k] + rates[k, k + 1 :] @ found[k + 1 :]) / (at - rates[k, k])
        return np.asarray(turned @ found)

    states = solved(inputs.astype(np.complex128))
    states += solved(inputs - (at * states - balanced @ states))
    return scale[:, None] * states


def frequencies(period: float, low: float = 1e-4, points: int = 2000) -> Array:
    """Return angular frequencies (rad/s) from a share of the Nyquist frequency to just below it."""
    nyquist = math.pi / period
    return np.geomspace(low * nyquist, 0.9995 * nyquist, points)


def current_loop(design: Design, loop: CurrentLoop, axis: str = "q", truth: Design | None = None) -> Any:
    """Return the open current loop of one axis in z (control.StateSpace).

    R-L plant under the held voltage (exact), the computation delay in whole periods, and the discrete PI.
    Decoupling is taken as ideal; `truth` is the plant where it differs from the design.
    """
    m = Plant.of(truth or design)
    L = m.L_q if axis == "q" else m.L_d
    K_p, T_n = loop.K_p, loop.T_n
    if axis == "d":
        K_p, T_n = loop.K_p_d or K_p, loop.T_n_d or T_n
    winding = ct.c2d(ct.ss([[-m.R / L]], [[1.0 / L]], [[1.0]], [[0.0]]), m.period, "zoh")
    delay = ct.ss(ct.tf([1.0], [1.0] + [0.0] * m.delay, m.period)) if m.delay else 1.0
    return winding * delay * ct.ss(pi(K_p, T_n, m.period))


def filters(behind: Iterable[Filter], period: float) -> Any:
    """Return filters of the current reference in z (control.StateSpace), as they run; 1 without any."""
    found: Any = 1.0
    for one in behind:
        b_0, b_1, b_2, a_1, a_2 = one.biquad.sampled(period)
        found = ct.ss(ct.tf([b_0, b_1, b_2], [1.0, a_1, a_2], period)) * found
    return found


@dataclass(frozen=True, eq=False)
class Cascade:
    """The cascade around a linear plant.

    Attributes
    ----------
    design : Design
        What the controller assumes; its `loops` are not read.
    truth : Design
        The plant.
    model : Linearisation
        Of the plant.
    current : CurrentLoop
    speed : SpeedLoop or None
        Without a speed loop `i_q_ref` is an input.
    position : PositionLoop or None
    """

    design: Design
    truth: Design
    model: Linearisation
    current: CurrentLoop
    speed: SpeedLoop | None = None
    position: PositionLoop | None = None

    @classmethod
    def of(
        cls,
        design: Design,
        current: CurrentLoop,
        speed: SpeedLoop | None = None,
        position: PositionLoop | None = None,
        *,
        truth: Design | None = None,
        at: float = 0.0,
        mass: SecondMass | None = None,
    ) -> Cascade:
        """Linearise the plant (`truth`, or `design`; its load, or `mass`) at a speed (rad/s), and close the cascade."""
        plant = truth or design
        controlled = position if position is not None and position.K_v > 0.0 else None
        return cls(design, plant, linearise(plant, at, mass=mass), current, speed, controlled)

    def with_gains(self, **changed: Any) -> Cascade:
        """Return a copy with other controllers: `current`, `speed` or `position`."""
        other = replace(self, **changed)
        vars(other)["_discrete"] = self._discrete  # the plant stays
        return other

    def moving(self, speed: float, i_q: float, i_d: float = 0.0) -> Cascade:
        """Return the cascade for a motion through a point: its states are the drive's own, not deviations.

        The products of speed and currents, and the turn of the rotor away from the held voltage, are linear about this
        point. Its speed is an input as well, ``omega_point``. Friction and spring stay as they are.

        Parameters
        ----------
        speed, i_q, i_d : float
            rad/s and A.
        """
        return replace(self, model=passed_through(self.truth, self.model, speed, i_q, i_d))

    @property
    def period(self) -> float:
        """Period of the speed loop in s."""
        return self.design.drive.speed_period

    def system(self, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Any:
        """Return the cascade from some of `INPUTS` to some of `OUTPUTS` as a control.StateSpace at `period`.

        Outputs are those at the tick, before the period that the map covers. The absolute angle is a state only
        where it is fed back or asked for; otherwise it would be an unobservable integrator.
        """
        angle = self.position is not None or "theta" in outputs
        n, m = self._size(), len(INPUTS)
        states, results = self._period(np.eye(n, n + m), np.eye(m, n + m, k=n))
        keep = self._kept(angle)
        rows = [OUTPUTS.index(name) for name in outputs]
        columns = [n + INPUTS.index(name) for name in inputs]
        return ct.ss(
            states[keep][:, :n][:, keep], states[keep][:, columns],
            results[rows][:, :n][:, keep], results[np.ix_(rows, columns)],
            self.period, inputs=list(inputs), outputs=list(outputs),
        )  # fmt: skip

    @cached_property
    def speed_plant(self) -> Any:
        """Plant of the speed controller, from `i_q_ref` to the measured speed (control.StateSpace)."""
        return self.with_gains(speed=None, position=None).system(("i_q_ref",), ("omega_hat",))

    @property
    def _first(self) -> int:
        return len(self.model.states)

    def _size(self) -> int:
        # plant; theta; pending u_d, u_q and their angle ahead of the rotor; I_d, I_q; travel; omega_hat; last angle
        # noise; I_s; filtered reference; two of every filter
        return self._first + 11 + 2 * (len(self.speed.filters) if self.speed is not None else 0)

    @cached_property
    def _discrete(self) -> tuple[Array, Array]:
        """Map of a control period for the plant's states and the angle of the held voltage ahead of the rotor.

        The angle is counted from the one at constant speed. It turns the voltage that holds the operating point.
        """
        model, m = self.model, Plant.of(self.truth)
        n, point, omega = len(model.states), model.point, STATES.index("omega")
        # With products of speed and currents alone the rates are linear in the currents of the point.
        still, per_d, per_q = (passed_through(self.truth, model, point.speed, *i).A for i in ((0, 0), (0, 1), (1, 0)))
        along = zip(*within_period(self.truth, point.speed, point.i_q, PARTS, point.i_d), strict=True)
        # Held are u_d, u_q, the load and the speed of the point.
        A, B = np.zeros((PARTS, n + 1, n + 1)), np.zeros((PARTS, n + 1, 4))
        for a, b, ((i_d, i_q), (u_d, u_q)) in zip(A, B, along, strict=True):
            a[:n, :n] = still + i_d * (per_d - still) + i_q * (per_q - still)
            a[:n, n] = m.p * model.B[:, :2] @ np.array([-u_q, u_d])
            b[:n, :3] = model.B
            b[:2, 3] = (still - a[:n, :n])[:2, omega]  # what the products of speed and currents are at the point itself
            a[n, omega], b[n, 3] = -1.0, 1.0
        return held_period(A, B, m.p * point.speed, 1.0 / self.design.drive.f_control)

    def current_step(self, duration: float) -> Array:
        """Return i_q at the control periods after a unit step of `i_q_ref`, the shaft free, the EMF fed forward."""
        bare = self.with_gains(speed=None, position=None)
        state = np.zeros((bare._size(), 1))
        trace: list[Array] = []
        inputs = np.zeros((len(INPUTS), 1))
        inputs[INPUTS.index("i_q_ref")] = 1.0
        for _ in range(math.ceil(duration / self.period)):
            state, _ = bare._period(state, inputs, trace)
        return np.array(trace)[:, 1, 0]

    def current_response(self, omega: Array) -> Any:
        """Return the open current loop (control.FRD) with the shaft free, as it is measured: current over error.

        The reference is held for a speed period, the current is sampled in every control period; both are compared
        at the same frequency, also beyond the Nyquist frequency of the speed loop. Frequencies (rad/s) that the held
        reference hardly contains are left out, as they are from a measurement.
        """
        bare = self.with_gains(speed=None, position=None)
        n = bare._size()
        trace: list[Array] = []
        of_reference = np.zeros((len(INPUTS), n + 1))
        of_reference[INPUTS.index("i_q_ref"), n] = 1.0
        states, _ = bare._period(np.eye(n, n + 1), of_reference, trace)
        keep = bare._kept(angle=False)
        ticks = np.array(trace)[:, 1]
        system = ct.ss(
            states[keep][:, :n][:, keep], states[keep][:, n:], ticks[:, :n][:, keep], ticks[:, n:], self.period
        )
        response = responses(system, omega)
        turn = np.exp(-1j * np.outer(np.arange(len(ticks)), omega) * self.period / len(ticks))
        reference, current = turn.mean(axis=0), (turn * response).mean(axis=0)
        seen = np.abs(reference) > FAINT
        return ct.frd((current / (reference - current))[seen], omega[seen])

    def sampled_motion(self, omega: Array, every: int) -> Complex:
        """Return the acceleration of the shaft over its current, (rad/s^2)/A, as a recorder sees both.

        The reference is held for a speed period, so that the current contains images of it around the multiples of
        the speed loop's rate. Samples in the instant of every n-th control period fold some of them back; those of the
        angle hardly contain any.

        Parameters
        ----------
        omega : array, shape (n,)
            rad/s.
        every : int
            Control periods between two samples.

        Returns
        -------
        complex array, shape (n,)
        """
        bare = self.with_gains(speed=None, position=None)
        n, of_reference = bare._size(), np.eye(len(INPUTS), bare._size() + len(INPUTS), k=bare._size())
        trace: list[Array] = []
        states, results = bare._period(np.eye(n, n + len(INPUTS)), of_reference, trace)
        keep, column = bare._kept(angle=True), n + INPUTS.index("i_q_ref")
        ticks = np.array(trace)[:: math.gcd(every, len(trace))]
        current, angle = ticks[:, 1], ticks[:, 3] + results[OUTPUTS.index("theta")]
        z = np.exp(1j * omega * self.period)
        A, B = states[keep][:, :n][:, keep], states[keep][:, column]
        state = np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, np.broadcast_to(B[:, None], (len(z), len(A), 1)))
        turn = np.exp(-1j * np.outer(omega, np.arange(len(ticks))) * self.period / len(ticks))

        def mean(rows: Array) -> Complex:
            return np.asarray((turn * (state[:, :, 0] @ rows[:, :n][:, keep].T + rows[:, column])).mean(axis=1))

        return np.asarray(-(omega**2) * mean(angle) / mean(current))

    def _kept(self, angle: bool) -> Array:
        """Mask of the states that the map needs; the others would be unobservable integrators."""
        keep = np.ones(self._size(), bool)
        keep[3] = False  # the travel within a period is carried by its own state
        keep[self._first] = angle
        keep[self._first + 9 :] = self.speed is not None
        return keep

    def _period(self, state: Array, inputs: Array, trace: list[Array] | None = None) -> tuple[Array, Array]:
        """Carry states (rows) through one speed period; every operation here is linear in them."""
        n = self._first
        T_s = self.period
        x, theta, held = state[:n].copy(), state[n], state[n + 1 : n + 4]
        I_d, I_q, travel, omega_hat, last_noise, I_s, filtered = state[n + 4 : n + 11]
        of_filters: list[Array] = []
        omega_ref, theta_ref, i_q_add, T_load, noise, i_q_ref, omega_point = inputs
        # Speed measurement: difference quotient of the angle over one speed period, then the filter.
        a = smoothing(T_s, self.design.sensor.speed_filter)
        omega_hat = omega_hat + a * ((travel + noise - last_noise) / T_s - omega_hat)
        theta = theta + travel
        # Position and speed controllers.
        if self.speed is not None:
            share = self.position.velocity_feedforward if self.position is not None else 1.0
            tau = self.speed.reference_filter
            if self.position is not None and self.position.velocity_filter is not None:
                tau = self.position.velocity_filter
            filtered = filtered + smoothing(T_s, tau) * (share * omega_ref - filtered)
            wanted = filtered
            if self.position is not None:
                wanted = wanted + self.position.K_v * (theta_ref - theta - noise)
            e = wanted - omega_hat
            i_q_ref, of_filters = self._filtered(self.speed.K_p * e + I_s + i_q_add, state[n + 11 :])
            I_s = I_s + T_s / self.speed.T_n * self.speed.K_p * e
        out = np.array([omega_hat, x[2], x[1], theta, i_q_ref, x[4] if n > 4 else x[2], x[0]])
        # Current controllers and plant, one control period at a time.
        x[3] = 0.0
        x, held, I_d, I_q = self._ticks((x, held, I_d, I_q), omega_hat, i_q_ref, (T_load, omega_point), trace)
        travel = x[3]
        return np.vstack([x, theta, held, I_d, I_q, travel, omega_hat, noise, I_s, filtered, *of_filters]), out

    def _filtered(self, wanted: Array, held: Array) -> tuple[Array, list[Array]]:
        """Pass what the speed controller asks for through its filters, in transposed direct form II."""
        assert self.speed is not None
        after: list[Array] = []
        for one, first, second in zip(self.speed.filters, held[::2], held[1::2], strict=True):
            b_0, b_1, b_2, a_1, a_2 = one.biquad.sampled(self.period)
            passed = b_0 * wanted + first
            after += [b_1 * wanted - a_1 * passed + second, b_2 * wanted - a_2 * passed]
            wanted = passed
        return wanted, after

    def _ticks(
        self,
        start: tuple[Array, ...],
        omega_hat: Array,
        i_q_ref: Array,
        constant: tuple[Array, Array],
        trace: list[Array] | None,
    ) -> tuple[Array, ...]:
        """Carry plant and current controllers through the control periods of one speed period.

        Constant are the load and the speed of the operating point.
        """
        x, held, I_d, I_q = start
        omega_point = constant[1]
        Phi, Gamma = self._discrete
        design, point, loop = self.design, self.model.point, self.current
        m, T = Plant.of(design), 1.0 / design.drive.f_control
        psi = design.K_t_assumed / (1.5 * m.p)
        L_d, L_q = design.assumed.L_d or m.L_d, design.assumed.L_q or m.L_q
        K_d, T_d = loop.K_p_d or loop.K_p, loop.T_n_d or loop.T_n
        for _ in range(design.drive.speed_divider):
            i_d, i_q = x[0].copy(), x[1].copy()
            if trace is not None:
                trace.append(x.copy())
            e_d, e_q = -i_d, i_q_ref - i_q
            u_d = K_d * e_d + I_d - m.p * L_q * (point.speed * i_q + point.i_q * (omega_hat - omega_point))
            u_q = loop.K_p * e_q + I_q + m.p * psi * omega_hat
            u_q = u_q + m.p * L_d * (point.speed * i_d + point.i_d * (omega_hat - omega_point))
            I_d = I_d + T / T_d * K_d * e_d
            I_q = I_q + T / loop.T_n * loop.K_p * e_q
            command = np.vstack([u_d, u_q, (m.delay + 0.5) * T * (omega_hat - omega_point)])
            # Without a computation delay no voltage is pending; an unused state must stay zero.
            acting, held = (held, command) if m.delay else (command, np.zeros_like(held))
            after = Phi @ np.vstack([x, acting[2]]) + Gamma @ np.vstack([acting[:2], *constant])
            if m.delay:
                held[2] -= after[3] - x[3] - T * omega_point  # while the pending voltage waits the rotor turns
            x = after[:-1]
        return x, held, I_d, I_q


def speed_plant(cascade: Cascade) -> Any:
    """Return the plant of the speed controller, from `i_q_ref` to the measured speed, at the speed period."""
    return cascade.speed_plant
