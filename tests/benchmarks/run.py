"""All benchmarks in one run: ``python -m tests.benchmarks`` prints a table (``--quick``: fewer repeats).

These are figures, not tests: nothing fails here.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import Plant, Scenario, scenario
from pmsm_ctrl.simulate.batch import simulate_batch
from tests.benchmarks import others
from tests.benchmarks.twin import LANES, Pair, alternate, compile_lanes, compile_twin, gcc, run_lanes, with_six

ROOT = Path(__file__).resolve().parents[2]
Row = tuple[str, str, str]

FIRST = """
import time; start, cpu = time.perf_counter(), time.process_time()
import sys
from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import simulate, scenario
design = Design.read("designs/seed_motor.toml")
for name in sys.argv[1:]:
    symbol = {"cogging": "a_s", "quadratic_drag": "k_2", "stribeck": "dF_s", "unbalance": "a_s"}[name]
    design = design.with_effect(name, {symbol: 1e-7})
imported = time.process_time()
simulate(design, scenario("hold", duration=0.1))
print(time.process_time() - imported, time.process_time() - cpu, time.perf_counter() - start)
"""

LONG = """
import resource, sys, time
from pmsm_ctrl.design import Design
from pmsm_ctrl.simulate import simulate, scenario
duration, divider = float(sys.argv[1]), int(sys.argv[2])
design = Design.read("designs/seed_motor.toml").replace(sensor={"log_divider": divider})
simulate(design, scenario("warm_up", design, duration=1.0))
start = time.process_time()
log = simulate(design, scenario("warm_up", design, duration=duration))
print(time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0, log.t.size)
"""


def against_c(design: Design, pairs: int) -> Iterator[Row]:
    """The kernel against the same loop in C, CPU time in alternating pairs; medians of the ratios."""
    if gcc() is None:
        yield "kernel against C", "gcc not installed: NOT MEASURED", ""
        return
    quiet = {"current_noise": 0.0}
    cases = (
        ("base drive", design, False, "1.10"),
        ("base drive without current noise", design.replace(sensor=quiet), False, "1.10"),
        ("six effects", with_six(design), True, "1.50"),
        ("six effects without current noise", with_six(design.replace(sensor=quiet)), True, "1.50"),
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, case, six, goal in cases:
            library = compile_twin(Path(folder), six=six, noise=case.sensor.current_noise > 0.0)
            pair = Pair(case, scenario("identification", case), 1 << 17, library)
            ours, theirs = (np.array(times) for times in alternate(pair.kernel, pair.c, pairs, time.process_time))
            rate = 1e-9 / np.median(ours) * pair.ticks / 16000.0 * 1e9
            text = f"{np.median(ours / theirs):.3f} x C ({np.median(ours) / pair.ticks * 1e9:.1f} ns a period"
            yield f"{name}, gcc -O3", f"{text}, {rate:.0f} simulated s/s)", f"at most {goal} x"


def against_others(design: Design) -> Iterator[Row]:
    """Factors against simulators in Python."""
    for name, rate, factor in others.speeds(design):
        yield name, f"{factor:,.0f} x slower ({rate:.3g} simulated s/s)", ""
    for name, call in others.OPTIONAL:
        version = others.installed(name)
        if version is None:
            yield name, "not installed: NOT MEASURED", ""
            continue
        speed = others.optional_speed(design, call)
        if isinstance(speed, Exception):
            text = "installed, but its interface is not the one known here: NOT MEASURED"
            yield f"{name} {version}", f"{text} ({type(speed).__name__})", ""
        else:
            row = f"{name} {version}, sampled, no Coulomb friction"
            yield row, f"{speed[1]:,.0f} x slower ({speed[0]:.3g} simulated s/s)", ""


def _python(code: str, *arguments: str, cache: Path | None = None) -> list[float]:
    environment = os.environ | ({"PMSM_CTRL_CACHE": str(cache)} if cache is not None else {})
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True)
    return [float(word) for word in done.stdout.split()]


def start_up(repeats: int) -> Iterator[Row]:
    """First simulation after installation, first use of a combination, warm process; medians."""
    first, new, warm = [], [], []
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as folder:
            cache = Path(folder)
            first.append(_python(FIRST, cache=cache))
            new.append(_python(FIRST, "stribeck", "cogging", cache=cache))
            warm += [_python(FIRST, "stribeck", "cogging", cache=cache) for _ in range(3)]
    (_, cpu, wall), (call, _, _), (again, warm_cpu, warm_wall) = (np.median(x, axis=0) for x in (first, new, warm))
    yield "first simulation after installation, imports included", f"{cpu:.2f} s of CPU, {wall:.2f} s", ""
    text = f"{call:.2f} s of CPU, {call - again:.2f} s of it compiling"
    yield "first use of a new effect combination", text, "1 s"
    yield "warm process: start to first result", f"{warm_cpu:.2f} s of CPU, {warm_wall:.2f} s", "under 2 s"


def long_runs() -> Iterator[Row]:
    """An hour of drive time, and memory against simulated time at the same number of logged rows."""
    _, short, rows = _python(LONG, "60", "16")
    seconds, long, rows_long = _python(LONG, "3600", "960")
    yield "one hour at 16 kHz control", f"{seconds:.1f} s of one core", "under 60 s"
    text = f"{short:.0f} MiB after 1 min, {long:.0f} MiB after 60 min"
    yield f"memory with {rows:.0f} and {rows_long:.0f} rows kept", text, "flat"


def batch(design: Design, drives: int, pairs: int) -> Iterator[Row]:
    """Many drives with different parameters on one core and on all."""
    cores = os.cpu_count() or 1
    rng = np.random.default_rng(1)
    designs = [design.with_parameters(J=design.J * factor) for factor in rng.uniform(0.7, 1.3, drives)]
    motion = scenario("sweep", design, dwell=0.25)

    for lanes, how in ((True, "side by side"), (False, "one by one")):

        def run(workers: int, lanes: bool = lanes) -> list[float]:
            return simulate_batch(designs, motion, keep=lambda log: log.t.size, workers=workers, lanes=lanes)

        one, many = alternate(lambda: run(1), lambda: run(cores), pairs, time.perf_counter)
        gain = np.median(np.array(one) / np.array(many))
        rate = drives * motion.duration / np.median(many)
        name = f"{drives} drives x {motion.duration:g} s on {cores} cores, {how}"
        busy = os.getloadavg()[0] - cores
        doubt = f"; load {os.getloadavg()[0]:.1f}, others held the cores: NOT VALID" if busy > 1.0 else ""
        figure = f"{gain:.2f} x one core ({np.median(many):.1f} s, {rate:,.0f} simulated s/s){doubt}"
        yield name, figure, "at least 1.8 x"
    yield from side_by_side(design, motion, 3)


def side_by_side(design: Design, motion: Scenario, pairs: int) -> Iterator[Row]:
    """Drives side by side against one by one, and against C, on one core: CPU time, whatever else runs."""
    quiet = design.replace(sensor={"current_noise": 0.0})
    rates = {}
    for name, case in (("base", design), ("base without current noise", quiet), ("six effects", with_six(design))):
        drives = [case.with_parameters(J=case.J * factor) for factor in np.linspace(0.7, 1.3, 4 * LANES)]

        def run(lanes: bool, drives: list[Design] = drives) -> list[int]:
            return simulate_batch(drives, motion, keep=lambda log: log.t.size, workers=1, lanes=lanes)

        times = alternate(lambda: run(True), lambda: run(False), pairs, time.process_time)
        together, alone = (np.array(seconds) for seconds in times)
        rates[name] = len(drives) * motion.duration / np.median(together)
        yield (
            f"{LANES} side by side, one core, {name}",
            f"{np.median(alone / together):.2f} x one by one ({rates[name]:,.0f} simulated s/s)",
            "",
        )
    if gcc() is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        best, gain = limits_in_c(design, Path(folder))
    share = rates["base without current noise"] / best
    yield (
        f"{LANES} side by side in C, no noise, limits or log",
        f"{best:,.0f} simulated s/s; the kernel without noise reaches {100.0 * share:.0f} % of it",
        "",
    )
    yield f"the same in C on {os.cpu_count()} cores", f"{gain:.2f} x one core: what this machine's cores share", ""


def limits_in_c(design: Design, folder: Path, ticks: int = 1 << 21) -> tuple[float, float]:
    """Return simulated seconds per second of the C lane loop on one core, and how much all cores together gain.

    Cores that are two threads of one share its vector units: there no batch of vector instructions gains much.
    """
    run, cores = compile_lanes(folder), os.cpu_count() or 1

    def on(threads: int) -> None:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda _: run_lanes(run, design, ticks), range(cores)))

    one, many = alternate(lambda: on(1), lambda: on(cores), 5, time.perf_counter)
    rate = cores * ticks * Plant.of(design).period * LANES / float(np.min(one))
    return rate, float(np.median(np.array(one) / np.array(many)))


def show(title: str, rows: Iterator[Row]) -> None:
    """Print rows as they are measured."""
    print(f"\n{title}")
    for name, figure, goal in rows:
        print(f"  {name:<54} {figure}" + (f"  [goal: {goal}]" if goal else ""), flush=True)


def main() -> None:
    """Measure everything and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer repeats, a smaller batch")
    quick = parser.parse_args().quick
    design = Design.read(ROOT / "designs/seed_motor.toml")
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(f"Speed of the simulation: {os.cpu_count()} cores x86-64, load before the run {load:.1f}")
    show("Against the same loop in C (alternating pairs, median of ratios)", against_c(design, 11 if quick else 41))
    show("Against simulators in Python (the same drive and reversal)", against_others(design))
    show("Long runs", long_runs())
    show("Batch", batch(design, 100 if quick else 1000, 1))
    show("Start-up", start_up(1 if quick else 3))


if __name__ == "__main__":
    main()
