"""What tracking promises, as one table: ``python -m tests.benchmarks.tracking [runs]``.

Speeds are taken in alternating pairs of processor time, so that a busy machine slows both alike.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.export import export_files
from pmsm_ctrl.export.blocks import identifier
from pmsm_ctrl.log import Log
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.track import FrictionTracker, Settings, track
from pmsm_ctrl.track.inputs import samples_of
from pmsm_ctrl.track.settings import numbers
from pmsm_ctrl.track.tracking import filter_samples

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.unit.track.tracking_axes import consistency, ramp_of_F_v, settling, step_of_F_c  # noqa: E402

F_C, F_V = 0.0213, 0.000168


def speeds(design: Design, log: Log, pairs: int = 5) -> tuple[float, float]:
    """Return samples per second of processor time: filterpy's filter, the compiled twin."""
    settings = Settings()
    samples = samples_of(design, log, "theta")
    s = numbers(design, settings, log.period)
    rows = list(zip(samples.t.tolist(), samples.z.tolist(), samples.torque.tolist(), strict=True))[:4000]
    filter_samples(design, settings, s, samples)
    slow, fast = [], []
    for _ in range(pairs):
        tracker = FrictionTracker(design, settings)
        start = time.process_time()
        for row in rows:
            tracker.step(*row)
        slow.append((time.process_time() - start) / len(rows))
        start = time.process_time()
        for _ in range(20):
            filter_samples(design, settings, s, samples)
        fast.append((time.process_time() - start) / 20 / len(log))
    return 1.0 / float(np.median(slow)), 1.0 / float(np.median(fast))


def difference(design: Design, log: Log) -> float:
    """Return the largest difference of estimates and deviations, relative to the largest of each."""
    tracker, found = FrictionTracker(design), track(design, log, Settings())
    rows = zip(*(log[name].tolist() for name in ("t", "i_q", "theta", "i_d")), strict=True)
    readings = [tracker.update(t, i_q=i_q, theta=theta, i_d=i_d) for t, i_q, theta, i_d in rows]
    pairs = [([getattr(r, n) for r in readings], found.history[n]) for n in ("F_c", "F_v")]
    pairs += [([getattr(r, f"stderr_{n}") for r in readings], found.stderr[n]) for n in ("F_c", "F_v")]
    return max(float(np.abs(np.array(a) - b).max() / np.abs(b).max()) for a, b in pairs)


def exported(design: Design, log: Log) -> tuple[float, float]:
    """Return nanoseconds per sample of the exported C at -O2, and its largest relative difference from the twin."""
    axis = f"{identifier(design.name)}_tracker"
    loop = f"""#include "{axis}.h"
    void loop(int n, const double *t, const double *theta, const double *i_d, const double *i_q, double *F_c) {{
        {axis}_t self; {axis}_init(&self);
        for (int k = 0; k < n; k++) {{
            {axis}_update(&self, k ? t[k] - t[k - 1] : 1.0, theta[k], i_d[k], i_q[k], 0.0);
            F_c[k] = self.F_c;
        }}
    }}"""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, text in {**export_files(design, "c"), "loop.c": loop}.items():
            (folder / name).write_text(text, encoding="utf-8")
        sources = [str(folder / f"{axis}.c"), str(folder / "loop.c")]
        subprocess.run(
            ["gcc", "-std=c99", "-O2", "-shared", "-fPIC", *sources, "-o", f"{place}/a.so", "-lm"], check=True
        )
        run = ctypes.CDLL(f"{place}/a.so").loop
        F_c = np.zeros(len(log))
        channels = [np.ascontiguousarray(log[name]) for name in ("t", "theta", "i_d", "i_q")]
        arguments = [ctypes.c_void_p(a.ctypes.data) for a in (*channels, F_c)]
        took = []
        for _ in range(20):
            start = time.process_time()
            run(len(log), *arguments)
            took.append((time.process_time() - start) / len(log))
    wanted = track(design, log, Settings()).history["F_c"]
    return 1e9 * float(np.median(took)), float(np.abs(F_c - wanted).max() / np.abs(wanted).max())


def row(name: str, figure: str, wanted: str) -> None:
    """Print one line of the table."""
    print(f"| {name} | {figure} | {wanted} |", flush=True)


def main() -> None:
    """Print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    design = Design.read(ROOT / "designs" / "hand_tuned.toml")
    triangle = scenario("triangle", design, speed=150.0, period=2.0, cycles=5.0)
    log = simulate(design, triangle, seed=1)
    print("| what | measured | wanted |\n|---|---|---|")
    slow, fast = speeds(design, log)
    row("samples/s, filterpy's filter and its twin", f"{slow:,.0f} and {fast:,.0f}, {fast / slow:.0f} x", "350 x")
    row("largest relative difference, filterpy's filter and twin", f"{difference(design, log):.0e}", "1e-9")
    took, apart = exported(design, log)
    row("exported C of the extended filter, ns per sample, and difference from the twin", f"{took:.0f}, {apart:.0e}",
        "1e-6")  # fmt: skip
    steps = []
    for seed in range(20):
        for share in (0.3, -0.3):
            truth = design.with_own_effects(step_of_F_c).with_effect("step_of_F_c", {"dF_c": share * F_C, "t_0": 4.0})
            moved = simulate(design, triangle, truth=truth, seed=seed)
            steps.append(settling(moved.t, track(design, moved).history["F_c"], F_C * (1.0 + share), 0.05, 4.0))
    row("30 % step of F_c followed to 5 %, s", f"median {np.median(steps):.2f}, worst of 40 {max(steps):.2f}", "< 2")
    lags = []
    for seed in range(10):
        rate = 0.02 * F_V
        truth = design.with_own_effects(ramp_of_F_v).with_effect("ramp_of_F_v", {"rate": rate, "t_0": 4.0})
        motion = scenario("triangle", design, speed=150.0, period=2.0, cycles=15.0)
        moved = simulate(design, motion, truth=truth, seed=seed)
        behind = F_V + rate * np.maximum(moved.t - 4.0, 0.0) - track(design, moved).history["F_v"]
        lags.append(float(behind[moved.t > 12.0].mean()) / rate)
    row("lag behind a drift of F_v, s", f"mean {np.mean(lags):.2f}, worst of 10 {max(lags):.2f}", "< 3")
    for walking in (False, True):
        for measure in ("theta", "omega"):
            c = consistency(design, runs, walking=walking, measure=measure, first=1000)
            label = f"from {measure}, friction {'walks' if walking else 'constant'}, {runs} runs"
            row(
                f"NEES, NIS (torque steady) in their 95 % bands, {label}",
                f"{100 * c.nees:.1f} %, {100 * c.nis:.1f} %",
                "93-97 %",
            )
            row(f"bias of F_c, F_v, {label}", f"{100 * c.bias[0]:+.3f} %, {100 * c.bias[1]:+.3f} %", "< 1 %")
            row(f"efficiency (posterior Cramer-Rao bound / squared error), {label}",
                f"{c.efficiency[0]:.2f}, {c.efficiency[1]:.2f}", "printed")  # fmt: skip


if __name__ == "__main__":
    main()
