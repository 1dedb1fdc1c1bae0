r"""Several short records of one axis, from the third simulator: what a joint fit gains over each record alone.

    python -m tests.benchmarks.records --worlds 12                 a joint fit against each record alone, and the bound
    python -m tests.benchmarks.records --worlds 12 --spread 0.1    and how well friction that differs is told apart

Every world is drawn as for the judgement of the diagnosis. Each record has a motion and a noise of its own; dry
friction, viscous friction and a constant torque differ from record to record by normal deviates. Seeds from 70000 on.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log, Provenance
from tests.benchmarks.worlds.motion import reference
from tests.benchmarks.worlds.plant import HIDDEN, PLACE, run
from tests.benchmarks.worlds.recorder import record
from tests.benchmarks.worlds.world import World, draw

__all__ = ["Axis", "Several", "axis_with_records"]

Array = NDArray[np.float64]

# What is held alike in all worlds here: motions that one short record can hold, and a log that is usual.
FIXED = {"log_rate": 1000.0}
MOTIONS = ("speed steps", "ramps", "sines", "moves", "jerk-limited")


@dataclass(frozen=True, eq=False)
class Axis:
    """True values of an axis and of every record of it, in SI units."""

    J: float
    F_c: Array
    F_v: Array
    offset: Array


@dataclass(frozen=True, eq=False)
class Several:
    """Records of one world."""

    design: Design
    logs: tuple[Log, ...]
    truth: Axis


def axis_with_records(
    seed: int,
    count: int,
    seconds: float,
    spread: float = 0.0,
    hidden: dict[str, float] | None = None,
    sound: bool = False,
    **fixed: object,
) -> Several:
    """Simulate short records of a world whose friction and offset differ between them.

    Parameters
    ----------
    seed : int
        Of the world, its records and their friction.
    count : int
    seconds : float
        Of each record.
    spread : float
        Standard deviation of dry and viscous friction as a share of their values, and of a constant torque as a share
        of the dry friction.
    hidden : dict, optional
        Entries of the plant's hidden physics.
    sound : bool
        An encoder without line error, and currents at the instant of the position: what is judged are the records, and
        not the recorder.
    fixed
        Properties of the world that are not drawn.
    """
    chosen = {"motion": MOTIONS[seed % len(MOTIONS)], **FIXED, **fixed}
    world = replace(draw(seed, **chosen), dropped=0.0, runs=1, duration=seconds)
    if sound:
        turn = 2.0 * np.pi / 0.01 if world.linear else 1.0
        world = replace(
            world, mode="instant", channel="torque" if world.linear else "i_q", encoder=(2.0**20 * turn, 0.0, 64.0),
            reference_hold=0.0,
        )  # fmt: skip
    rng = np.random.default_rng([seed, 41])
    motor = np.array(world.motor)
    factors = 1.0 + spread * rng.standard_normal((3, count))
    loads = motor[6] * (factors[2] - 1.0)
    logs = []
    for k in range(count):
        own = motor.copy()
        own[6:8] *= factors[:2, k]
        logs.append(
            _record(replace(world, motor=tuple(own.tolist())), k, {**(hidden or {}), "constant_load": loads[k]})
        )
    # what a log shows of a torque is its current times the design's torque constant
    scale = 1.0 if world.linear else world.design.K_t_assumed / (1.5 * motor[3] * motor[4])
    truth = Axis(
        scale * float(motor[5]), *(scale * one for one in (motor[6] * factors[0], motor[7] * factors[1], loads))
    )
    return Several(world.design, tuple(logs), truth)


def _record(world: World, number: int, hidden: dict[str, float]) -> Log:
    x = np.zeros(len(HIDDEN))
    x[PLACE["stribeck_speed"]] = x[PLACE["warm_time"]] = x[PLACE["dead_current"]] = 1.0
    for name, value in hidden.items():
        x[PLACE[name]] = value
    substeps = max(2, math.ceil(3.1e4 / world.f_control))
    sizes = np.array([1.0 / world.f_control, substeps, world.divider, world.delay])
    ref, mode = reference(world, 100 + number, world.duration)
    loops, noise, encoder = (np.array(one) for one in (world.loops, world.noise, world.encoder))
    table = run(np.array(world.motor), x, ref, sizes, loops, mode, noise, encoder, world.seed * 100 + number)
    if not np.all(np.isfinite(table)):
        raise ArithmeticError(f"world {world.seed}: the drive leaves the finite numbers")
    log = record(world, [table])
    return Log(log.channels, log.motion, provenance=Provenance(f"record_{number + 1}.csv"))


NAMES = ("J", "F_c", "F_v")


@dataclass(frozen=True, eq=False)
class Found:
    """What a fit says of inertia and friction: values, standard errors, and the information of each record on them."""

    values: Array
    stderr: Array
    information: Array


def fitted(design: Design, logs: tuple[Log, ...]) -> tuple[Found, list[Array], list[float]]:
    """Return the base fit of records; with several, also z-scores of what each has of its own, and Holm's p-values.

    Parameters
    ----------
    design : Design
    logs : tuple of Log
    """
    from pmsm_ctrl.plausibility import doubts_about
    from pmsm_ctrl.regression.base_fit import base_fit
    from pmsm_ctrl.regression.records import members
    from pmsm_ctrl.regression.spread import disagreement, levels_of
    from pmsm_ctrl.regression.timed_record import timed_record

    record = timed_record(design, doubts_about(design, logs).log)
    fit = base_fit(design, record)
    where = [fit.model.names.index(name) for name in NAMES]
    rows = fit.whitener.part(0, fit.model.matrix[0][:, where].T)
    inside = members(fit.record)[:, fit.whitener.used] if record.records else [slice(None)]
    information = np.array([rows[:, here] @ rows[:, here].T for here in inside])
    found = Found(fit.plain.values[where], fit.plain.stderr[where], information)
    if len(record.records) < 2:
        return found, [], []
    levels = levels_of(fit.record, fit.plain, fit.weights, fit.whitener)
    own = [np.array([levels.deviation[s], levels.stderr[s]]) for s in ("dF_c", "dF_v", "offset")]
    return found, own, disagreement(fit.record, fit.model, fit.weights, fit.whitener)


def joint_against_alone(seed: int, count: int, seconds: float) -> dict[str, Array]:
    """Return the errors of a joint fit and of each record alone, in standard deviations of the bound of all records.

    Cramer and Rao's bound of inertia and friction, for the noise that the joint fit leaves, all else known.

    Parameters
    ----------
    seed, count, seconds
        As in `axis_with_records`, with no spread.
    """
    world = axis_with_records(seed, count, seconds, sound=True)
    true = np.array([world.truth.J, world.truth.F_c[0], world.truth.F_v[0]])
    alone = [fitted(world.design, (log,))[0] for log in world.logs]
    joint = fitted(world.design, world.logs)[0]
    size = np.sqrt(np.diag(np.linalg.inv(joint.information.sum(axis=0))))
    return {
        "joint": (joint.values - true) / size,
        "alone": np.array([(one.values - true) / size for one in alone]),
        "said": joint.stderr / size,
        "said alone": np.array([one.stderr / size for one in alone]),
        "bound alone": np.array([np.sqrt(np.diag(np.linalg.inv(one))) / size for one in joint.information]),
    }


def apart(seed: int, count: int, seconds: float, spread: float) -> tuple[Array, list[float]]:
    """Return z-scores of what each record has of its own, shape (3, records), and the p-values of disagreement.

    Parameters
    ----------
    seed, count, seconds, spread
        As in `axis_with_records`.
    """
    world = axis_with_records(seed, count, seconds, spread, sound=True)
    _, rows, p_values = fitted(world.design, world.logs)
    truth = world.truth
    true = [truth.F_c - truth.F_c.mean(), truth.F_v - truth.F_v.mean(), truth.offset]
    return np.array([(row[0] - own) / row[1] for row, own in zip(rows, true, strict=True)]), p_values


def main() -> None:
    """Print the gain of a joint fit and its bound, or how well what differs is told apart."""
    import warnings

    from rich.progress import track

    from pmsm_ctrl.errors import PmsmCtrlError

    warnings.simplefilter("ignore")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=12)
    parser.add_argument("--first", type=int, default=70000)
    parser.add_argument("--records", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--spread", type=float, default=0.0)
    args = parser.parse_args()
    rows, told, alarms, refused = [], [], [], 0
    for seed in track(range(args.first, args.first + args.worlds), disable=True):
        try:
            if args.spread > 0.0:
                scores, p_values = apart(seed, args.records, args.seconds, args.spread)
                told.append(scores)
                alarms.append(min(p_values))
                print(f"{seed}: rms z {np.sqrt(np.mean(scores**2, axis=1)).round(2)}, smallest p {min(p_values):.2g}")
            else:
                rows.append(joint_against_alone(seed, args.records, args.seconds))
                print(f"{seed}: joint {rows[-1]['joint'].round(2)}, said {rows[-1]['said'].round(2)}")
        except (PmsmCtrlError, ArithmeticError) as error:
            refused += 1
            print(f"{seed}: {error}")
    if rows:
        print("\n| errors in standard deviations of the bound of all records | J | F_c | F_v |\n|---|---|---|---|")
        for label, values in (
            ("joint, rms", _rms([r["joint"] for r in rows])),
            ("joint, its own standard error", _rms([r["said"] for r in rows])),
            ("each alone, rms", _rms(np.concatenate([r["alone"] for r in rows]))),
            ("each alone, its own standard error", _rms(np.concatenate([r["said alone"] for r in rows]))),
            ("each alone, its bound", _rms(np.concatenate([r["bound alone"] for r in rows]))),
            ("joint, median of the absolute error / 0.674", np.median(np.abs([r["joint"] for r in rows]), 0) / 0.6745),
            (
                "each alone, median of the absolute error / 0.674",
                np.median(np.abs(np.concatenate([r["alone"] for r in rows])), 0) / 0.6745,
            ),
        ):
            print(f"| {label} | " + " | ".join(f"{x:.2f}" for x in values) + " |")
        print(f"theory: joint 1, each alone about {math.sqrt(args.records):.2f}; worlds {len(rows)}, refused {refused}")
    if told:
        inside = np.mean(np.abs(np.concatenate(told, axis=1)) < 1.96, axis=1)
        print(f"\ncoverage of 95 % intervals: dry {inside[0]:.3f}, viscous {inside[1]:.3f}, constant {inside[2]:.3f}")
        print(f"a record disagrees (p < 0.01) in {np.sum(np.array(alarms) < 0.01)} of {len(alarms)}; refused {refused}")


def _rms(values: object) -> Array:
    return np.sqrt(np.mean(np.asarray(values) ** 2, axis=0))


if __name__ == "__main__":
    main()
