"""Axes whose friction changes, as own effects that read the time, and the bound no tracker can beat."""

from __future__ import annotations

import linecache
import math
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect
from pmsm_ctrl.effects.base import Parameter

TERMS = 40
# s: the torque of the triangle in `consistency` steps at every corner and at every reversal; how long that is felt.
BETWEEN_STEPS, STEPPED = 0.5, 0.05


@numba.njit
def _step(t: float, direction: float, dF_c: float, t_0: float) -> float:
    return dF_c * direction if t >= t_0 else 0.0


step_of_F_c = Effect(
    id="step_of_F_c",
    title="F_c steps",
    equation="",
    source="",
    enters="torque",
    parameters=(Parameter("dF_c", "N m", 0.0, -1.0, 1.0, "step", True), Parameter("t_0", "s", 0.0, 0.0, 1e6, "when")),
    term=_step,
    needs="",
)


@numba.njit
def _ramp(t: float, omega: float, rate: float, t_0: float) -> float:
    # ends after 100 s: the simulation's step must resolve a term at any time, and without an end it would be viscous
    # beyond measure
    return rate * min(max(t - t_0, 0.0), 100.0) * omega


ramp_of_F_v = Effect(
    id="ramp_of_F_v",
    title="F_v drifts steadily",
    equation="",
    source="",
    enters="torque",
    parameters=(
        Parameter("rate", "N m/rad", 0.0, -1.0, 1.0, "rate", True),
        Parameter("t_0", "s", 0.0, 0.0, 1e6, "when"),
    ),
    term=_ramp,
    needs="",
)


def _wander_source() -> str:
    c = ", ".join(f"c{k}" for k in range(TERMS))
    v = ", ".join(f"v{k}" for k in range(TERMS))
    lines = [
        f"def term(t, omega, direction, T, {c}, {v}):",
        "    a = 0.0",
        "    b = 0.0",
        f"    x = {math.pi!r} * t / T",
    ]
    # Karhunen and Loeve's series of a random walk: W(t) = sum z_k sqrt(2 T) sin((k - 1/2) pi t/T) / ((k - 1/2) pi)
    for k in range(TERMS):
        lines += [f"    s = sin({k + 0.5!r} * x)", f"    a += c{k} * s", f"    b += v{k} * s"]
    return "\n".join([*lines, "    return a * direction + b * omega"])


def _wander() -> Any:
    scope: dict[str, Any] = {"sin": math.sin}
    text = _wander_source()
    linecache.cache["<wander>"] = (len(text), None, text.splitlines(keepends=True), "<wander>")
    exec(compile(text, "<wander>", "exec"), scope)
    return numba.njit(scope["term"])


wander = Effect(
    id="wander",
    title="F_c and F_v walk randomly",
    equation="",
    source="",
    enters="torque",
    parameters=(
        Parameter("T", "s", 1.0, 0.0, 1e6, "length"),
        *(
            Parameter(f"{n}{k}", u, 0.0, -1.0, 1.0, "", True)
            for n, u in (("c", "N m"), ("v", "N m s/rad"))
            for k in range(TERMS)
        ),
    ),
    term=_wander(),
    needs="",
)


def with_known_effects(design: Design) -> Design:
    """Return the design with effects of angle, speed and torque, which a tracker takes as known."""
    return (
        design.with_effect("cogging", {"a_s": 0.004, "a_c": 0.002, "order": 24.0})
        .with_effect("stribeck", {"dF_s": 0.01, "w_s": 8.0, "delta": 2.0})
        .with_effect("load_dependent_friction", {"mu": 0.02})
    )


def walk(T: float, rate_c: float, rate_v: float, rng: np.random.Generator) -> tuple[dict[str, float], float, float]:
    """Return parameters of `wander` for a walk of these rates per square root of a second, and both ends at T."""
    half = np.arange(TERMS) + 0.5
    scale = math.sqrt(2.0 * T) / (half * math.pi)
    parameters = {"T": T}
    ends = []
    for name, rate in (("c", rate_c), ("v", rate_v)):
        weights = rate * scale * rng.standard_normal(TERMS)
        parameters |= {f"{name}{k}": float(w) for k, w in enumerate(weights)}
        ends.append(float(weights @ np.sin(half * math.pi)))
    return parameters, ends[0], ends[1]


def cramer_rao(
    design: Design, t: Any, omega: Any, torque_density: float, angle_variance: float, prior: Any, drift: Any
) -> Any:
    """Posterior Cramer-Rao bound of (F_c, F_v) at the end: Tichavsky's recursion along the true motion.

    P. Tichavsky, C. Muravchik, A. Nehorai, IEEE Trans. Signal Process. 46 (1998) 1386. States (omega, theta, F_c,
    F_v), every angle of the log used. The motion is that of the log: for a linear, Gaussian model the recursion
    is Kalman's Riccati equation, written here in information form and so independent of the filters.
    """
    J = design.J
    F_v = design.parameters("viscous")["F_v"]
    information = np.diag([1e4, 1.0 / angle_variance, *(1.0 / np.asarray(prior) ** 2)])
    look = np.zeros((4, 4))
    look[1, 1] = 1.0 / angle_variance
    for k in range(1, t.size):
        h = t[k] - t[k - 1]
        w = omega[k - 1]
        A = np.array([[-F_v / J, 0, -np.sign(w) / J, -w / J], [1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]])
        F = np.eye(4) + h * A + 0.5 * h * h * A @ A
        g = torque_density / J**2
        Q = np.diag([g * h, g * h**3 / 3, *(np.asarray(drift) ** 2 * h)])
        Q[0, 1] = Q[1, 0] = g * h * h / 2
        back = np.linalg.inv(F)
        moved = back.T @ information @ back
        # (moved^-1 + Q)^-1, without inverting what may be nearly singular
        information = moved @ np.linalg.inv(np.eye(4) + Q @ moved) + look
        information = 0.5 * (information + information.T)
    return np.linalg.inv(information)[2:, 2:]


def end_statistics(tracking: Any, F_c: float, F_v: float) -> tuple[Any, float]:
    """Return the errors at the end, (F_c, F_v), and their normalised square (NEES)."""
    error = np.array([tracking.history["F_c"][-1] - F_c, tracking.history["F_v"][-1] - F_v])
    sd = np.array([tracking.stderr["F_c"][-1], tracking.stderr["F_v"][-1]])
    shared = tracking.correlation[-1] * sd[0] * sd[1]
    P = np.array([[sd[0] ** 2, shared], [shared, sd[1] ** 2]])
    return error, float(error @ np.linalg.solve(P, error))


@dataclass(frozen=True)
class Consistency:
    """Shares of runs inside their 95 % bands, mean errors, and mean squared errors against the bound.

    `nis` is that of steady torque: at a step of it the filter allows for a torque that is logged late, which is no
    noise of these logs; `nis_at_steps` is the mean of the normalised innovations squared there.
    """

    runs: int
    nees: float
    nis: float
    nis_at_steps: float
    bias: tuple[float, float]
    efficiency: tuple[float, float]


def consistency(design: Design, runs: int, *, walking: bool, measure: Any = "theta", first: int = 0) -> Consistency:
    """Track axes whose friction is drawn from the filter's own prior and, if `walking`, walks as it assumes."""
    from scipy.stats import chi2

    from pmsm_ctrl.simulate import scenario, simulate
    from pmsm_ctrl.track import Settings, track
    from pmsm_ctrl.track.settings import numbers

    F_c, F_v = design.parameters("coulomb")["F_c"], design.parameters("viscous")["F_v"]
    drift = 0.01 if walking else 0.0
    settings = Settings(measure=measure, drift=drift, prior=0.2, estimate=())
    motion = scenario("triangle", design, speed=150.0, period=2.0, cycles=3.0)
    rng = np.random.default_rng(first)
    inside = {"nees": 0, "nis": 0}
    errors: list[Any] = []
    at_steps: list[float] = []
    for k in range(runs):
        true = np.array([F_c, F_v]) * (1.0 + 0.2 * rng.standard_normal(2))
        axis = design.with_effect("coulomb", {"F_c": true[0]}).with_effect("viscous", {"F_v": true[1]})
        ends = np.zeros(2)
        if walking:
            parameters, *at_end = walk(motion.duration, drift * F_c, drift * F_v, rng)
            axis, ends = axis.with_own_effects(wander).with_effect("wander", parameters), np.array(at_end)
        log = simulate(design, motion, truth=axis, seed=first + k, keep_truth=True)
        found = track(design, log, settings, adapt=False)
        error, nees = end_statistics(found, *(true + ends))
        judged = np.isfinite(found.nis)
        stepped = log.t % BETWEEN_STEPS < STEPPED
        at_steps.append(float(np.mean(found.nis[judged & stepped])))
        nis = found.nis[judged & ~stepped]
        inside["nees"] += chi2.cdf(nees, 2) > 0.025 and chi2.sf(nees, 2) > 0.025
        inside["nis"] += chi2.cdf(nis.sum(), nis.size) > 0.025 and chi2.sf(nis.sum(), nis.size) > 0.025
        errors.append(error)
    s = numbers(design, settings, log.period)
    scale = np.array([F_c, F_v])
    angle = (2.0 * math.pi / design.sensor.encoder_counts) ** 2 / 12.0
    bound = cramer_rao(design, log.t, log["omega_true"], s[2], angle, 0.2 * scale, drift * scale)
    bias, efficiency = np.mean(errors, axis=0) / scale, np.diag(bound) / np.mean(np.square(errors), axis=0)
    return Consistency(
        runs,
        inside["nees"] / runs,
        inside["nis"] / runs,
        float(np.mean(at_steps)),
        (float(bias[0]), float(bias[1])),
        (float(efficiency[0]), float(efficiency[1])),
    )


def settling(t: Any, values: Any, target: float, tolerance: float, since: float) -> float:
    """Return the time after `since` from which the values stay within a relative tolerance of the target, s."""
    outside = np.flatnonzero((np.abs(values / target - 1.0) > tolerance) & (t >= since))
    return float(t[outside[-1]] - since) if outside.size else 0.0
