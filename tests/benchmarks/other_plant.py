"""A second simulator, written independently of the package, to judge the diagnosis.

Nothing of `pmsm_ctrl.simulate` or of the effects is used: another motor, semi-implicit Euler at 40 kHz with
set-valued friction (Moreau), another controller (10 kHz current, 2 kHz speed with a moving-average speed),
coloured current noise, other log rates, random motions, and a design whose parameters are off within tolerance.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Sequence

import numba
import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose import Diagnosis, Verdict, diagnose
from pmsm_ctrl.log import Log
from tests.benchmarks.motions import MACHINES, limited, machine, rounded
from tests.benchmarks.sizes import SIZES, sized
from tests.benchmarks.spoiled import SPOILED

# R, L_d, L_q, p, psi_f, J, F_c, F_v
MOTOR = (1.6, 5.2e-3, 6.0e-3, 5, 0.085, 2.4e-4, 0.045, 3.5e-4)
# index of each hidden effect in the vector x of the kernel, with its plain strength
HIDDEN: dict[str, dict[int, float]] = {
    "none": {},
    "stribeck": {0: 0.02, 1: 4.0},
    "viscous_asymmetry": {2: 7e-5},
    "constant_load": {3: 0.012},
    "quadratic_drag": {4: 1.2e-6},
    "load_dependent_friction": {5: 0.07},
    "position_dependent_friction": {6: 0.008},
    "thermal_drift": {7: 0.35, 8: 8.0},
    "unbalance": {9: 0.012},
    "cogging": {10: 0.012, 11: 30.0},
    "torque_ripple": {12: 0.06},
    "torque_saturation": {13: 0.03},
    "compliance": {14: 1.1e-4, 15: 60.0},
    "dead_time": {17: 3.0},
    "inductance_saturation": {18: 4e-4},
    "current_offset": {19: 0.03, 20: 0.02},
    "current_gain": {21: 0.04},
    "encoder_eccentricity": {22: 0.004},
    "encoder_eccentricity, logged angle alone": {22: 0.004, 26: 1.0},
    "delay": {23: 6e-4},
    "viscous_power": {24: 2.2e-3},
    "backlash": {14: 1.1e-4, 15: 400.0, 16: 0.012},
    "presliding": {25: 4e-3},
}


@numba.njit(cache=True)
def _simulate(m, x, ref, dt, n_current, n_speed, n_log, gains, counts, noise, colour, seed):
    R, L_d, L_q, p, psi, J, F_c, F_v = m
    np.random.seed(seed)  # noqa: NPY002 - numba's own generator
    n = ref.size
    rows = n // n_log
    out = np.zeros((rows, 8))
    i_d = i_q = w = th = 0.0
    w_l = th_l = 0.0
    u_d = u_q = u_d_next = u_q_next = 0.0
    I_d = I_q = I_w = 0.0
    i_ref = 0.0
    past = np.zeros(5)
    w_hat = 0.0
    c_d = c_q = 0.0
    lag = int(x[23] / dt + 0.5)
    line = np.zeros((max(lag, 1) + 1, 2))
    z = 0.0
    J_m = J - x[14]
    row = 0
    m_d = m_q = 0.0
    for k in range(n):
        t = k * dt
        e = p * th
        wrong = x[22] * math.sin(th + 0.4)
        th_m = math.floor((th + wrong) * counts / (2 * math.pi)) * 2 * math.pi / counts
        # one encoder: the drive turns currents and voltages by the angle that it reads
        cos_w, sin_w = math.cos(p * wrong * (1.0 - x[26])), math.sin(p * wrong * (1.0 - x[26]))
        if k % n_current == 0:
            c_d = colour * c_d + math.sqrt(1 - colour * colour) * np.random.normal() * noise  # noqa: NPY002
            c_q = colour * c_q + math.sqrt(1 - colour * colour) * np.random.normal() * noise  # noqa: NPY002
            m_d = i_d + x[19] * math.cos(e) + x[20] * math.sin(e) + c_d
            m_q = i_q - x[19] * math.sin(e) + x[20] * math.cos(e) + c_q
            # gain of phase a only: alpha current scaled
            a = (i_d * math.cos(e) - i_q * math.sin(e)) * x[21]
            m_d += a * math.cos(e)
            m_q -= a * math.sin(e)
            m_d, m_q = m_d * cos_w + m_q * sin_w, m_q * cos_w - m_d * sin_w
        if k % n_speed == 0:
            for j in range(4):
                past[j] = past[j + 1]
            past[4] = th_m
            w_hat = (past[4] - past[0]) / (4 * n_speed * dt)
            err = ref[k] - w_hat
            i_ref = gains[0] * err + I_w
            if abs(i_ref) < 12.0:
                I_w += gains[1] * err * n_speed * dt
            else:
                i_ref = math.copysign(12.0, i_ref)
        if k % n_current == 0:
            u_d, u_q = u_d_next, u_q_next
            u_d_next = gains[2] * (0.0 - m_d) + I_d - p * w_hat * L_q * m_q
            u_q_next = gains[2] * (i_ref - m_q) + I_q + p * w_hat * (L_d * m_d + psi)
            I_d += gains[3] * (0.0 - m_d) * n_current * dt
            I_q += gains[3] * (i_ref - m_q) * n_current * dt
        # plant
        line[k % line.shape[0], 0] = m_d
        line[k % line.shape[0], 1] = m_q
        v_d, v_q = u_d * cos_w - u_q * sin_w, u_q * cos_w + u_d * sin_w
        if x[17] > 0.0:
            for ph in range(3):
                angle = e - 2 * math.pi * ph / 3
                i_ph = i_d * math.cos(angle) - i_q * math.sin(angle)
                drop = x[17] * math.tanh(i_ph / 0.03) * 2.0 / 3.0
                v_d -= drop * math.cos(angle)
                v_q += drop * math.sin(angle)
        L_inc = L_q - 2.0 * x[18] * abs(i_q)
        psi_q = (L_q - x[18] * abs(i_q)) * i_q
        di_d = (v_d - R * i_d + p * w * psi_q) / L_d
        di_q = (v_q - R * i_q - p * w * (L_d * i_d + psi)) / L_inc
        T = 1.5 * p * (psi * i_q + (L_d - L_q) * i_d * i_q)
        T_el = T * (1.0 - x[13] * abs(i_q)) * (1.0 + x[12] * math.cos(6 * e + 0.7))
        warm = 1.0 - x[7] * (1.0 - math.exp(-t / x[8])) if x[7] > 0.0 else 1.0
        smooth = F_v * warm * w + x[2] * abs(w) + x[3] + x[4] * w * abs(w)
        smooth += x[9] * math.sin(th + 1.0) + x[10] * math.sin(x[11] * th + 0.3)
        level = F_c * warm + x[5] * abs(T) + x[6] * math.sin(th + 0.5)
        if x[0] > 0.0:
            level += x[0] * math.exp(-abs(w / x[1]))
        if x[24] > 0.0:
            smooth += x[24] * abs(w) ** 0.6 * (1.0 if w > 0 else (-1.0 if w < 0 else 0.0))
        spring = 0.0
        if x[14] > 0.0:
            twist = th - th_l
            if x[16] > 0.0:
                half = 0.5 * x[16]
                twist = twist - half if twist > half else (twist + half if twist < -half else 0.0)
            if twist != 0.0 or x[16] == 0.0:
                spring = x[15] * twist + 0.01 * (w - w_l)
        drive = T_el - smooth - spring
        if x[25] > 0.0:
            # Dahl bristle in place of the set-valued sign
            drive -= level * z
            w_new = w + dt * drive / J_m
        else:
            w_free = w + dt * drive / J_m
            grip = dt * level / J_m
            w_new = 0.0 if abs(w_free) <= grip else w_free - math.copysign(grip, w_free)
        if x[25] > 0.0:
            s = 1.0 if w_new >= 0 else -1.0
            travel = dt * w_new / x[25]
            z = (z + travel) / (1.0 + s * travel) if s * z > 0.0 else z + travel
        th += dt * w_new
        w = w_new
        if x[14] > 0.0:
            w_l += dt * spring / x[14]
            th_l += dt * w_l
        i_d += dt * di_d
        i_q += dt * di_q
        if k % n_log == 0 and row < rows:
            old = (k - lag) % line.shape[0]
            out[row, 0] = t
            out[row, 1] = th_m
            out[row, 2] = w_hat
            out[row, 3] = line[old, 0]
            out[row, 4] = line[old, 1]
            out[row, 5] = u_d_next
            out[row, 6] = u_q_next
            out[row, 7] = ref[k]
            row += 1
    return out


def motion(kind: int | str, duration: float, dt: float, rng: np.random.Generator) -> np.ndarray:
    """Speed reference: random S-shaped levels, summed sines, slow ramps with turns in between, or a machine's."""
    if isinstance(kind, str):
        return machine(kind, duration, dt, rng)
    t = np.arange(round(duration / dt)) * dt
    if kind == 0:
        levels = rng.choice([-1, 1], 40) * rng.choice([1.5, 4, 10, 25, 60, 110, 150], 40)
        raw = levels[np.minimum((t / (duration / 40)).astype(int), 39)]
    elif kind == 1:
        raw = sum(
            a * np.sin(2 * np.pi * f * t + rng.uniform(0, 6))
            for a, f in zip(rng.uniform(15, 60, 4), rng.uniform(0.07, 1.5, 4), strict=True)
        )
    else:
        raw = 140.0 * np.sin(2 * np.pi * t / duration * 2) ** 3 + 8.0 * np.sign(np.sin(2 * np.pi * t / duration * 5))
    return rounded(limited(t, raw, 1500.0), dt)


def other_log(effect: str, seed: int, *, strength: float = 1.0, kind: int | str | None = None, duration: float = 30.0):
    """Return (design, log): a drive with this hidden effect, and a design that knows nothing of it."""
    rng = np.random.default_rng(1000 * seed + sum(map(ord, effect)))
    dt = 1.0 / 40000.0
    x = np.zeros(27)
    x[1] = x[8] = x[11] = 1.0
    shapes = {1, 8, 11, 26}
    for index, value in HIDDEN[effect].items():
        scaled = index not in shapes and not (index in (14, 15) and effect in ("compliance", "backlash"))
        x[index] = value * (strength if scaled else 1.0)
    kind = seed % 3 if kind is None else kind
    R, L_d, L_q, p, psi, J, F_c, F_v = MOTOR
    gains = np.array([2 * np.pi * 35 * J / (1.5 * p * psi), 2 * np.pi * 35 * J / (1.5 * p * psi) * 45.0, 12.0, 4000.0])
    n_log = int(rng.choice([20, 40, 80]))
    table = _simulate(
        np.array(MOTOR, dtype=float), x, motion(kind, duration, dt, rng), dt, 4, 20, n_log, gains,
        float(rng.choice([2**16, 2**18, 2**20])), rng.uniform(0.003, 0.015), rng.uniform(0.0, 0.6), seed,
    )  # fmt: skip
    names = ("t", "theta", "omega", "i_d", "i_q", "u_d", "u_q", "omega_ref")
    log = Log({name: table[:, column] for column, name in enumerate(names)})
    off = lambda share: 1.0 + rng.uniform(-share, share)  # noqa: E731
    design = Design.from_dict({
        "name": f"other, {effect}",
        "motor": {"R": R * off(0.05), "L_d": L_d * off(0.05), "L_q": L_q * off(0.05), "p": p,
                  "psi_f": psi * off(0.01), "J": J * off(0.04)},
        "drive": {"f_control": 10000.0, "speed_divider": 5, "u_dc": 560.0, "i_max": 12.0},
        "sensor": {"log_divider": n_log // 4},
        "effects": [{"id": "coulomb", "F_c": F_c * off(0.1)}, {"id": "viscous", "F_v": F_v * off(0.1)}],
    })  # fmt: skip
    return design, log


def right(effect: str, result: Diagnosis) -> bool:
    """Whether the hidden effect, or what the log cannot tell from it, is named first."""
    if effect == "none":
        return result.verdict == "consistent"
    first = result.steps[0] if result.steps else None
    return first is not None and effect.split(",")[0] in (first.effect, *first.equivalents)


def answer(case: tuple[str, int, str | None, str | None]) -> tuple[bool, str]:
    """Whether the diagnosis of a case is right, and what it names; a kind of spoiling is as good as one of motion."""
    effect, seed, kind, size = case
    design, log = other_log(effect, seed, kind=None if kind in SPOILED else kind)
    if size is not None:
        design, log = sized(design, log, *SIZES[size])
    result = diagnose(design, SPOILED[kind](log, design) if kind in SPOILED else log, plan=False)
    return right(effect, result), "+".join(step.effect for step in result.steps) or result.verdict


def judge(
    effects: Sequence[str], seeds: range, clean: int, kinds: Sequence[str | None], size: str | None = None
) -> None:
    """Print what the diagnosis says of every hidden effect, how often it is wrong, and false alarms."""
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from rich.progress import track

    cases = [(effect, seed, kind, size) for kind in kinds for effect in effects for seed in seeds]
    cases += [("none", 100 + seeds.start + seed, kind, size) for kind in kinds for seed in range(clean)]
    rows: dict[str, list[str]] = {}
    hits = alarms = wrong = 0
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads that wait for each other cost every process half
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        every = track(pool.map(answer, cases), description="diagnosing", total=len(cases))
        for (effect, seed, kind, _), (good, named) in zip(cases, every, strict=True):
            hits += good and effect != "none"
            alarms += not good and effect == "none"
            wrong += not good and effect != "none" and named not in set(Verdict)
            rows.setdefault(effect, []).append(f"{'' if good else '(!) '}{named}")
            if not good:
                print(f"  {effect}, seed {seed}{f', {kind}' if kind else ''}: {named}", flush=True)
    for effect, answers in rows.items():
        print(f"{effect:42s} {', '.join(f'{n} {name}' for name, n in Counter(answers).most_common())}")
    alone = len(kinds) * clean
    print(f"named first: {hits} of {len(cases) - alone}; another name: {wrong}; false alarms: {alarms} of {alone}")


if __name__ == "__main__":
    import argparse

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, help="logs per hidden effect")
    parser.add_argument("--first", type=int, default=0, help="first seed; every third has the same kind of motion")
    parser.add_argument("--effects", nargs="*", default=[e for e in HIDDEN if e != "none"])
    parser.add_argument("--clean", type=int, default=20, help="logs without a hidden effect")
    parser.add_argument(
        "--machines", nargs="*", choices=MACHINES, help="motions of machines instead; all, if none is given"
    )
    parser.add_argument("--spoiled", action="store_true", help="logs as recorders spoil them")
    parser.add_argument("--size", choices=SIZES, help="the same drive in another size")
    words = parser.parse_args()
    kinds = [None] if words.machines is None else words.machines or list(MACHINES)
    judge(
        words.effects,
        range(words.first, words.first + words.seeds),
        words.clean,
        list(SPOILED) if words.spoiled else kinds,
        words.size,
    )
