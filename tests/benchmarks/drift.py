r"""What friction that drifts between records costs a simulation, by the criterion its parameters were fitted to.

    python -m tests.benchmarks.drift --axes 10 --first 600        minutes

Axes like EMPS are simulated under their position control, two records each: on the second, dry and viscous friction are
another 5 % (one standard deviation, as the package takes for records), the offset 0.15 N. Within a record the force
wanders by 0.15 N, and depends on position. Five parameters (inertia, dry and viscous friction, asymmetry, offset) are
fitted to the first record by each criterion; the score is the official one of EMPS, on the second record. Of the
measured data only the reference of ``DATA_EMPS`` is used. The integration and the controller are written here.
"""

from __future__ import annotations

import argparse
import time
import warnings
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.identify import identify
from pmsm_ctrl.importers import read_log
from pmsm_ctrl.log import Log
from tests.benchmarks.emps import CYCLE, DATA, ROOT, Fit, Model, official, stretches

Array = NDArray[np.float64]
RECORDS, OFFSET, WANDER, PLACES = 0.05, 0.15, 0.15, 0.4  # shares; N
GRID = 5e-4  # m
WINDOWS = (1000, 3090, CYCLE)  # samples


@numba.njit
def controlled(axis, ref, along, beside, noise):  # type: ignore[no-untyped-def]
    """Return position and force under the controller of EMPS, 1 kHz."""
    J, F_c, F_v, T_0, dF_v = axis
    h, omega, theta, before = 1e-3, 0.0, ref[0], ref[0]
    measured, force = np.empty(len(ref)), np.empty(len(ref))
    for k in range(len(ref)):
        u = 0.8 * 35.15 * 243.45 * (160.18 * (ref[k] - theta) - (theta - before) / h)
        u, before = min(max(u, -351.5), 351.5), theta
        measured[k], force[k] = theta + noise[k], u
        place = min(max(int((theta + 0.01) / GRID), 0), along.shape[1] - 1)
        other = F_v * omega + dF_v * abs(omega) + T_0 + along[0 if omega > 0.0 else 1, place] + beside[k]
        free, dry = omega + h * (u - other) / J, h * F_c / J
        now = free - dry if free > dry else (free + dry if free < -dry else 0.0)
        theta, omega = theta + 0.5 * h * (omega + now), now
    return measured, force


@dataclass(frozen=True, eq=False)
class Axis:
    """Inertia, dry friction, viscous friction, offset and asymmetry, and what depends on position, by direction."""

    values: Array
    along: Array

    def record(self, t: Array, ref: Array, rng: np.random.Generator) -> Log:
        """Return a record of the axis."""
        n, middle = len(t), t / t[-1] - 0.5
        wander = np.cumsum(rng.normal(size=n)) * WANDER / np.sqrt(n) + WANDER * rng.normal() * middle
        dry = np.sign(np.gradient(ref)) * 0.2 * rng.normal() * middle
        theta, force = controlled(self.values, ref, self.along, wander + dry, rng.normal(size=n) * 1e-6)
        return Log({"t": t, "theta": theta, "torque": force}, "linear")

    def another_day(self, rng: np.random.Generator) -> Axis:
        """Return the axis with other friction and offset."""
        values = self.values.copy()
        values[1:3] *= 1.0 + RECORDS * rng.normal(size=2)
        values[3] += OFFSET * rng.normal()
        return Axis(values, self.along)


def drawn(rng: np.random.Generator) -> Axis:
    """Return an axis like EMPS."""
    values = np.array([95.0, 20.0, 200.0, 0.0, 0.0])
    values[:3] *= rng.uniform(0.8, 1.2, 3)
    values[3:] = rng.normal(size=2) * (3.0, 30.0)
    x = np.arange(540) * GRID
    waves = [[PLACES * rng.normal() * np.sin(2.0 * np.pi * x / length + rng.uniform(0.0, 7.0))
              for length in (0.4, 0.2, 0.12, 0.06)] for _ in range(2)]  # fmt: skip
    return Axis(values, np.sum(waves, axis=1))


def scores(seed: int, design: Design, t: Array, ref: Array, starts: int) -> dict[str, tuple[float, float]]:
    """Return for every criterion the error on the record that was fitted and on another one, mm."""
    rng = np.random.default_rng(seed)
    axis = drawn(rng)
    train = axis.record(t, ref, rng)
    pulses = 1.5e-4 * ((t + 0.65) % 1.0 < 0.5)
    other = axis.another_day(rng).record(t, ref + pulses, rng)
    given = design.with_effect("viscous_asymmetry", {"dF_v": 1.0})
    start = Model(identify(given, train).design)
    models = {"force (`identify`)": start}
    for length in WINDOWS:
        name = f"position, stretches of {1e-3 * length:.3g} s"
        models[name] = Fit(start).solve(train, stretches(range(4), length), length)
    models["position, whole record"] = Fit(start).whole(train, starts)[0][1]
    return {name: (official(model, train), official(model, other)) for name, model in models.items()}


def main() -> None:
    """Print the errors by criterion."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--axes", type=int, default=10)
    parser.add_argument("--first", type=int, default=600)
    parser.add_argument("--starts", type=int, default=5, help="of the fit of the whole record")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    design = Design.read(ROOT / "designs" / "emps.toml")
    measured = read_log(DATA / "DATA_EMPS.mat", design)
    began, found = time.process_time(), []
    for seed in range(args.first, args.first + args.axes):
        found.append(scores(seed, design, measured.t, measured["theta_ref"], args.starts))
        print(seed, {name: f"{own:.1f} / {other:.1f}" for name, (own, other) in found[-1].items()}, flush=True)
    print("\n| fitted to | fitted record, median mm | other record, median mm | rms mm |\n|---|---|---|---|")
    for name in found[0]:
        own, other = np.array([one[name] for one in found]).T
        print(f"| {name} | {np.median(own):.2f} | {np.median(other):.1f} | {np.sqrt(np.mean(other**2)):.1f} |")
    print(f"\n{args.axes} axes, {time.process_time() - began:.0f} s of processor time")


if __name__ == "__main__":
    main()
