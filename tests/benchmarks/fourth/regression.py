"""The simulator's own regression: how far a hidden effect stands above the noise of its log.

Torque on the true columns of inertia, dry and viscous friction, an offset, a delay and the effect, below 50 Hz or a
fifth of the log's rate. `ratio` is the rms of what the other columns cannot take of the effect over the rms of the
residual, `share` the same over the torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy import signal

from tests.benchmarks.fourth.axis import Array
from tests.benchmarks.fourth.effects import Hidden
from tests.benchmarks.fourth.recorder import Channels, low_pass
from tests.benchmarks.fourth.world import World

BAND = 50.0  # Hz
AT_REST = ("presliding", "backlash", "compliance", "stribeck")  # effects for which samples at rest count


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def smoother(log_rate: float) -> Callable[[Array], Array]:
    b, a = signal.butter(2, 2 * min(BAND, 0.2 * log_rate) / log_rate)
    return lambda x: signal.filtfilt(b, a, x)


def solve(columns: Array, side: Array) -> tuple[Array, Array]:
    """Return coefficients and residual of scaled least squares."""
    scale = np.linalg.norm(columns, axis=0)
    found, *_ = np.linalg.lstsq(columns / scale, side, rcond=None)
    return found / scale, side - (columns / scale) @ found


def regress(world: World, run: Channels, log: Channels, effect: str | None, part: Array | None) -> dict[str, float]:
    """Return J, F_c and F_v over the true ones, and `ratio` and `share` of the effect.

    Parameters
    ----------
    world, run, log
        What was simulated, its columns, the log's channels.
    effect
        The hidden one.
    part
        Its part of the torque at the log's rate, if the run does not hold it.
    """
    p, step, rate = world.parameters, world.decimation, world.log_rate
    torque = log["torque"] if "torque" in log else log["i_q"] * p["K_t"]
    n = len(torque)
    smooth = smoother(rate)
    angle = run["measured angle"][::step][:n]
    speed = np.gradient(smooth(angle - angle[0])) * rate
    acceleration = np.gradient(speed) * rate

    def of_run(name: str) -> Array:
        return smooth(low_pass(run[name], step)[:n]) if step > 1 else smooth(run[name][:n])

    side = smooth(torque)
    slope = np.gradient(side) * rate
    columns = [acceleration, of_run("dry friction") / p["F_c"], speed]
    columns += [slope] if effect == "constant_load" else [np.ones(n), slope]
    used = np.ones(n, bool)
    edge = int(rate * 0.1) + 1
    used[:edge] = used[-edge:] = False
    if effect not in AT_REST:
        used &= np.abs(run["omega"][::step][:n]) > 1e-12 * world.top
    own = np.column_stack(columns)[used]
    part = of_run("added torque") if part is None else smooth(part[:n])
    present = rms(part) > 1e-9 * torque.std()
    found, residual = solve(np.column_stack([own, part[used]]) if present else own, side[used])
    result = {"J": found[0] / p["J"], "F_c": found[1] / p["F_c"], "F_v": found[2] / p["F_v"]}
    if present:
        _, alone = solve(own[:, :4] if effect == "delay" else own, part[used])
        result |= {"ratio": rms(alone) / residual.std(), "share": rms(alone) / side[used].std()}
    return {name: float(value) for name, value in result.items()}


def regress_voltage(world: World, run: Channels, log: Channels, hidden: Hidden) -> dict[str, float]:
    """Return `ratio` and `share` of an inverter's dead time in u_q."""
    p, rate, x = world.parameters, world.log_rate, hidden.terms
    i_q, i_d, u_q = log["i_q"], log["i_d"], log["u_q"]
    n = len(i_q)
    smooth = smoother(rate)
    angle = p["p"] * run["theta"][:: world.decimation][:n]
    c, s = np.cos(angle), np.sin(angle)
    alpha, beta = c * i_d - s * i_q, s * i_d + c * i_q
    phases = np.stack([alpha, -0.5 * alpha + 0.866 * beta, -0.5 * alpha - 0.866 * beta])
    signs = np.clip(phases / x["dead_current"], -1, 1)
    u_alpha = x["dead_voltage"] * (2 * signs[0] - signs[1] - signs[2]) / 3
    u_beta = x["dead_voltage"] * (signs[1] - signs[2]) / math.sqrt(3)
    part = smooth(-s * u_alpha + c * u_beta)
    speed = run["omega"][:: world.decimation][:n]
    columns = [smooth(i_q), np.gradient(smooth(i_q)) * rate, smooth(speed), np.ones(n), smooth(speed * i_d)]
    used = slice(50, -50)
    own, side = np.column_stack(columns), smooth(u_q)
    _, residual = _solve_inside(np.column_stack([own, part]), side, used)
    _, alone = _solve_inside(own, part, used)
    return {"ratio": float(alone.std() / residual.std()), "share": float(alone.std() / side[used].std())}


def _solve_inside(columns: Array, side: Array, used: slice) -> tuple[Array, Array]:
    return solve(columns[used], side[used])
