"""What a recorder makes of a run: a log with few channels, thinned, filtered and rounded, and its design."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy import signal

from tests.benchmarks.fourth.axis import Array
from tests.benchmarks.fourth.world import Reference, World

Channels = dict[str, Array]
UNITS = {"t": "s", "theta": "rad", "omega": "rad/s", "i_q": "A", "i_d": "A", "u_d": "V", "u_q": "V", "torque": "N m"}
LINEAR_UNITS = UNITS | {"theta": "m", "omega": "m/s", "torque": "N"}


def low_pass(x: Array, decimation: int) -> Array:
    """Thin `x` behind a linear-phase filter of 0.8 of the new Nyquist frequency."""
    taps = signal.firwin(8 * decimation + 1, 0.8 / decimation)
    padded = np.pad(x, (4 * decimation, 4 * decimation), mode="edge")
    return signal.fftconvolve(padded, taps, "valid")[::decimation]


def thinned(x: Array, how: str, decimation: int) -> Array:
    """Thin by one of the recorder's ways: `instant`, `fir` or `mean`."""
    if how == "fir":
        return low_pass(x, decimation)
    if how == "mean":
        n = len(x) // decimation
        means = x[: n * decimation].reshape(n, decimation).mean(1)
        return np.concatenate([[x[0]], means])[: len(x[::decimation])]
    return x[::decimation]


def mean_before(x: Array, length: int) -> Array:
    """Mean over the last samples."""
    return np.convolve(np.pad(x, (length - 1, 0), mode="edge"), np.ones(length) / length, "valid")


def record(
    world: World, run: Channels, reference: Reference, *, delay: int = 0, spoiling_filter: float | None = None
) -> Channels:
    """Return the channels of the log.

    Parameters
    ----------
    world, run, reference
        What was simulated, its columns, what was asked.
    delay
        Of the current, in samples of the speed controller.
    spoiling_filter
        Time constant in s of a filter of the torque that nobody declares.
    """
    r, step = world.recorder, world.decimation
    way = r["thinning"]
    angles = "instant" if way == "mean" else way
    t = np.arange(len(run["theta"][::step])) / world.log_rate
    log = {"t": np.round(t, 4) if r["coarse_time"] and world.log_rate <= 5000 else t}
    if r["theta"]:
        log["theta"] = thinned(run["measured angle"], angles, step)
    speed = _speed(world, run)
    if speed is not None:
        log["omega"] = speed
    log |= _torque(world, run, delay, spoiling_filter)
    if r["voltages"]:
        log |= {name: thinned(run[name], way, step) for name in ("i_d", "u_d", "u_q")}
    if r["reference"]:
        if world.parameters["speed_only"]:
            log["omega_ref"] = reference[1][::step]
        elif r["theta"]:
            log["theta_ref"] = reference[0][::step]
    shortest = min(len(x) for x in log.values())
    return {name: x[:shortest] for name, x in log.items()}


def _speed(world: World, run: Channels) -> Array | None:
    r, step = world.recorder, world.decimation
    estimate, way = run["speed estimate"], r["thinning"]
    if r["omega"] == "drive":
        return thinned(estimate, way, step)
    if r["omega"] == "mean":
        return thinned(mean_before(estimate, r["mean_length"]), way, step)
    if r["omega"] == "difference":
        return np.concatenate([[0], np.diff(run["measured angle"][::step])]) * world.log_rate
    if r["omega"] == "rounded":
        unit = world.top / 2000
        return np.round(thinned(estimate, way, step) / unit) * unit
    return None


def _torque(world: World, run: Channels, delay: int, spoiling_filter: float | None) -> Channels:
    r, rate = world.recorder, world.rate
    i_q = run["i_q command"] if r["torque"] == "command" else run["i_q"]
    if delay:
        i_q = np.concatenate([np.full(delay, i_q[0]), i_q[:-delay]])
    if r["torque_filter"] > 0:
        kept = math.exp(-1 / rate / r["torque_filter"])
        i_q = signal.lfilter([1 - kept], [1, -kept], i_q, zi=[kept * i_q[0]])[0]
    if spoiling_filter is not None:
        i_q = signal.lfilter(*signal.butter(2, 1 / (math.pi * rate * spoiling_filter) * 0.5), i_q)
    i_q = thinned(i_q, r["thinning"], world.decimation)
    if r["torque"] in ("i_q", "command"):
        return {"i_q": i_q}
    torque = i_q * world.parameters["K_t"]
    if r["torque"] == "permille":
        unit = world.rated * 1e-3 * (0.1 if world.seed % 2 else 1.0)
        torque = np.round(torque / unit) * unit
    return {"torque": torque}


def write(world: World, log: Channels, base: Path) -> tuple[Path, Path]:
    """Write log and design; return their paths, the design's first."""
    r = world.recorder
    units = LINEAR_UNITS if world.linear else UNITS
    columns = dict(log)
    heads = {name: f"{name} [{units[name.removesuffix('_ref')]}]" for name in columns}
    lines = design_lines(world)
    if r["counts"]:
        columns["theta"] = np.round(columns["theta"] / world.parameters["encoder_step"])
        heads["theta"] = f"pos [{units['theta']}]"
        lines += ["", "[log.channels]", *(f'{name} = "{heads[name]}"' for name in columns)]
        lines += ["", "[log.scale]", f"theta = {world.parameters['encoder_step']!r}"]
    design = base.with_suffix(".toml")
    design.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if r["format"] == "npz" and not r["counts"]:
        path = base.with_suffix(".npz")
        np.savez(path, **columns)
        return design, path
    path = base.with_suffix(".csv")
    formats = [_number_format(name, r) for name in columns]
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, fmt=formats, delimiter=",", header=",".join(heads[name] for name in columns), comments="")
    return design, path


def _number_format(name: str, recorder: dict[str, object]) -> str:
    if name == "theta" and recorder["counts"]:
        return "%d"
    if name == "t":
        return "%.4f" if recorder["coarse_time"] else "%.6f"
    if name in ("theta", "theta_ref"):
        return "%.9g" if int(str(recorder["digits"])) < 7 else "%.11g"
    return f"%.{recorder['digits']}g"


def design_lines(world: World) -> list[str]:
    """Return the lines of the design that the owner of this axis would write."""
    p, b = world.parameters, world.believed
    lines = [f'name = "w{world.seed}"', *(['motion = "linear"'] if world.linear else []), "", "[motor]"]
    if world.recorder["motor_known"]:
        lines += [
            f"p = {p['p']}", f"R = {b['R']:.5g}", f"L_d = {b['L_d']:.5g}", f"L_q = {b['L_q']:.5g}",
            f"psi_f = {b['psi_f']:.6g}", f"J = {b['J']:.6g}", "", "[drive]", f"u_dc = {world.u_dc:.1f}",
            f"i_max = {p['i_max']:.4g}", f"f_control = {1 / p['T_control']:.1f}",
            f"speed_divider = {int(p['speed_divider'])}",
        ]  # fmt: skip
    else:
        lines += [f"J = {b['J']:.6g}", f"K_t = {b['K_t']:.6g}"]
    if not world.linear:
        lines += ["", "[sensor]", f"encoder_counts = {round(2 * math.pi / p['encoder_step'])}"]
    lines += ["", "[[effects]]", 'id = "coulomb"', f"F_c = {b['F_c']:.5g}"]
    return [*lines, "", "[[effects]]", 'id = "viscous"', f"F_v = {b['F_v']:.5g}"]
