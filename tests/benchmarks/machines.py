"""Drawn machines, tuned, moved, compensated, tracked and exported without a hand on them.

``python -m tests.benchmarks.machines --count 200 --seed 0`` prints a table of peak error, compensation and window, what
the rows amount to, and the worst rows with what explains them. Inertia spans a factor of 1000, L/R 10 us to 30 ms,
control rates 4 to 100 kHz, 1 to 20 pole pairs, mechanical time constants 2 to 60 ms (high-resistance motors); a third
of the axes have two masses, with 0.1 to 50 times the motor's inertia behind the spring, a fifth are linear. ``--rows
FILE`` keeps every row, so that a run can be stopped and taken up again.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from pmsm_ctrl.compensate import baseline, compensated, gain_verdict, judge, run_trial, study_trials
from pmsm_ctrl.compensate.motions import at_speed
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import PmsmCtrlError
from pmsm_ctrl.export import export
from pmsm_ctrl.simulate import scenario, simulate
from pmsm_ctrl.track import track
from pmsm_ctrl.tune import tune

REVERSALS = (2.0, 10.0)  # rad/s; lengths/s of a linear axis
GAINS = (1.0, 0.5, 0.25)  # tried in turn, as one goes down the window that `compensate` prints


@dataclass(frozen=True)
class Row:
    """What became of one machine; NaN where it did not get so far.

    Attributes
    ----------
    seed : int
    machine : str
        Its size in words.
    proof : str
        Checks passed, explained and failed.
    promised, peak : float
        Peak error of the s-curve without dry friction, mrad (mm).
    rms, reversal, floor : float
        Change of the RMS error and of the peak at reversals by full compensation, worst of the reversals, and the
        change of the RMS error that an axis without friction has, %.
    safe : str
        Whether full gain with the reference speed is safe.
    gain : float
        The highest of `GAINS` that is safe, with which it is exported; 0 where none is.
    counts : float
        RMS error without compensation of the reversal with the worst change, encoder counts.
    F_c, sd_F_c : float
        Tracked value over the true one, less 1, and its stated standard error, %.
    doubts : str
        What the tracker says of its estimates.
    exported : bool
    words : str
        Why it did not get further, or what explains it.
    seconds : float
        Processor time of all steps.
    spent : dict of str to float
        Processor time of each step.
    """

    seed: int
    machine: str
    proof: str = "-"
    promised: float = math.nan
    peak: float = math.nan
    rms: float = math.nan
    reversal: float = math.nan
    floor: float = math.nan
    counts: float = math.nan
    safe: str = "-"
    gain: float = math.nan
    F_c: float = math.nan
    sd_F_c: float = math.nan
    doubts: str = ""
    exported: bool = False
    words: str = ""
    seconds: float = math.nan
    spent: dict[str, float] = field(default_factory=dict)

    @property
    def tuned(self) -> bool:
        """Whether it got through `tune` and its proof."""
        return not math.isnan(self.peak)

    @property
    def checks(self) -> tuple[int, int, int]:
        """Checks passed, explained and failed."""
        if not self.tuned:
            return 0, 0, 0
        passed, explained, total = (int(number) for number in re.findall(r"\d+", self.proof))
        return passed, explained, total - passed - explained

    @property
    def apart(self) -> float:
        """How far the simulated peak of the s-curve is from the promised one, %."""
        return 100.0 * abs(self.peak / self.promised - 1.0)

    @property
    def compensated(self) -> bool:
        """Whether nine tenths of the error are gone, or all but the noise of the axis."""
        return self.rms <= -90.0 or self.rms <= self.floor + 5.0


def machine(seed: int) -> Design:
    """Return the machine of a seed: every size from its own range, the rest follows."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(math.log(low), math.log(high))))

    rate = float(rng.choice([4000.0, 8000.0, 16000.0, 32000.0, 100000.0]))
    J, pairs, tau = between(2e-6, 2e-3), int(rng.integers(1, 21)), between(1e-5, 3e-2)
    linear = bool(rng.random() < 0.2)
    # Rated for 1000 to 5000 rad/s^2, with a mechanical time constant of 2 to 60 ms, at least 20 control periods.
    torque, mechanical = J * between(1e4, 5e4), max(between(2e-3, 6e-2), 20.0 / rate)
    speed, i_max = between(200.0, 600.0), between(3.0, 40.0)
    K_t = torque / i_max
    psi = K_t / (1.5 * pairs)
    R = mechanical * 1.5 * (pairs * psi) ** 2 / J
    u_dc = math.sqrt(3.0) * (1.5 * pairs * psi * speed + 1.2 * R * i_max)
    friction = torque * between(0.005, 0.05)
    counts = int(2 ** rng.integers(16, 23))
    if linear:
        counts = int(counts / 0.1)  # per metre, a turn being 0.1 m
    loops = int(rng.choice([1, 2, 4]))
    design = Design.from_dict(
        {
            "name": f"machine_{seed}",
            "motion": "linear" if linear else "rotary",
            "motor": {"R": R, "L_d": R * tau, "L_q": R * tau, "J": J, "p": pairs, "psi_f": psi},
            "drive": {"u_dc": u_dc, "i_max": i_max, "f_control": rate, "speed_divider": loops},
            "sensor": {
                "encoder_counts": counts,
                "current_noise": 2e-4 * i_max,
                "speed_filter": float(rng.choice([0.0, 2.0, 4.0])) * loops / rate,
                "log_divider": max(1, round(rate / 1000.0)),
            },
            "effects": [{"id": "coulomb", "F_c": friction}, {"id": "viscous", "F_v": 0.2 * friction / speed}],
        }
    )
    if rng.random() < 1.0 / 3.0:
        ratio = between(0.1, 50.0)
        J_load, w = J * ratio / (1.0 + ratio), 2.0 * math.pi * between(30.0, 500.0)
        damping = 2.0 * between(0.005, 0.05) * J_load * w
        design = design.with_effect("compliance", {"J_load": J_load, "k": J_load * w * w, "d": damping})
    return design


def run(seed: int) -> Row:
    """Take one machine through the chain."""
    design = machine(seed)
    motor, drive = design.motor, design.drive
    assert motor.L_q is not None
    assert motor.R is not None
    spring = design.parameters("compliance")
    spent: dict[str, float] = {}
    masses = f", load {spring['J_load'] / (design.J - spring['J_load']):.1f} x" if spring else ""
    kind = f"{design.motion}, J {design.J:.1e}, L/R {1e6 * motor.L_q / motor.R:.0f} us, {1e-3 * drive.f_control:g} kHz"
    found: dict[str, object] = {"machine": kind + masses}
    words: list[str] = []
    for stage in (_tuned, _compensated, _tracked, _exported):
        name, begin = stage.__name__[1:], time.process_time()
        try:
            design = stage(design, found, words)
        except PmsmCtrlError as error:
            words.append(f"{name}: {str(error).splitlines()[0]}")
            if stage is _tuned:
                break
        finally:
            spent[name] = round(time.process_time() - begin, 3)
    return Row(seed, words="; ".join(words), seconds=sum(spent.values()), spent=spent, **found)  # type: ignore[arg-type]


def _tuned(design: Design, found: dict[str, object], words: list[str]) -> Design:
    tuning = tune(design)
    assert tuning.proof is not None
    counts = [sum(check.outcome == outcome for check in tuning.proof.checks) for outcome in ("passed", "explained")]
    found["proof"] = f"{counts[0]}+{counts[1]}/{sum(counts) + len(tuning.proof.failed)}"
    words += [f"{c.subject}: {c.quantity} {c.predicted:.4g}, simulated {c.simulated:.4g}" for c in tuning.proof.failed]
    s_curve = tuning.proof.moves[-1]
    found["promised"], found["peak"] = 1e3 * s_curve.smooth_promised.peak, 1e3 * s_curve.smooth_simulated.peak
    if s_curve.limited:
        words.append("the move meets the voltage or current limit")
    return tuning.design


def _compensated(design: Design, found: dict[str, object], words: list[str]) -> Design:
    base, trials = baseline(design), study_trials(design)
    believed = compensated(base, ("coulomb", "viscous"))
    smooth = design.without_effect("coulomb").without_effect("viscous")
    rms, reversal, floor, counts = [], [], [], []
    for speed in REVERSALS:
        name = at_speed("reversal", speed, design)
        plain, on, free = (
            judge(trials[name], run_trial(b, trials[name], truth=plant), design.encoder_step)
            for b, plant in ((base, design), (believed, design), (base, smooth))
        )
        rms.append(on.rms / plain.rms - 1.0)
        reversal.append(on.reversal_peak / plain.reversal_peak - 1.0)
        floor.append(free.rms / plain.rms - 1.0)
        counts.append(plain.rms / design.encoder_step)
    found["rms"], found["reversal"], found["floor"] = (100.0 * max(values) for values in (rms, reversal, floor))
    found["counts"] = counts[int(np.argmax(rms))]
    for gain in GAINS:
        stated = design.model_copy(update={"compensation": design.compensation.model_copy(update={"gain": gain})})
        verdict = gain_verdict(stated, gain)
        if gain == GAINS[0]:
            found["safe"] = {True: "yes", False: "no", None: "?"}[verdict.safe]
        if verdict.why:
            words.append(f"gain {100.0 * gain:.0f} %: {verdict.why}")
        if verdict.safe:
            found["gain"] = gain
            return stated
    found["gain"] = 0.0
    return stated


def _tracked(design: Design, found: dict[str, object], words: list[str]) -> Design:
    off = design.model_copy(update={"compensation": design.compensation.model_copy(update={"gain": 0.0})})
    believed = off.with_effect("coulomb", {"F_c": 0.8 * design.parameters("coulomb")["F_c"]})
    log = simulate(off, scenario("triangle", off, speed=100.0, period=2.0, cycles=3.0), seed=1)
    tracked, true = track(believed, log), design.parameters("coulomb")["F_c"]
    found["F_c"] = 100.0 * (float(tracked.history["F_c"][-1]) / true - 1.0)
    found["doubts"] = "; ".join(one.text for one in tracked.notices)
    found["sd_F_c"] = 100.0 * float(tracked.stderr["F_c"][-1]) / true
    return design


def _exported(design: Design, found: dict[str, object], words: list[str]) -> Design:
    found["exported"] = bool(export(design, "c")) and bool(export(design, "st"))
    return design


def table(rows: list[Row], report: Callable[[str], None] = print) -> None:
    """Print the rows and what they amount to."""
    columns = (
        "seed", "machine", "checks passed + explained / all", "s-curve peak promised, simulated [mrad]", "RMS",
        "peak at reversals", "RMS without friction", "highest safe gain", "F_c tracked", "exported",
    )  # fmt: skip
    report(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}")
    for r in rows:
        changes = " | ".join(f"{value:+.0f} %" for value in (r.rms, r.reversal, r.floor))
        done = "yes" if r.exported else "no"
        report(
            f"| {r.seed} | {r.machine} | {r.proof} | {r.promised:.3g}, {r.peak:.3g} | {changes} | "
            f"{100.0 * r.gain:.0f} % | {r.F_c:+.1f} % | {done} |"
        )
    summary(rows, report)
    worst(rows, report)


def listed(rows: list[Row]) -> str:
    """Return seeds as words."""
    return ", ".join(str(r.seed) for r in rows) or "none"


def summary(rows: list[Row], report: Callable[[str], None] = print) -> None:
    """Print what the rows amount to."""
    tuned, lost = [r for r in rows if r.tuned], [r for r in rows if not r.tuned]
    passed, explained, failed = (sum(r.checks[k] for r in tuned) for k in range(3))
    apart = sorted(tuned, key=lambda r: -r.apart)[:3]
    deep = sum(r.rms <= -90.0 for r in tuned)
    off = np.abs([r.F_c for r in tuned if not math.isnan(r.F_c)])
    stages = ("tuned", "compensated", "tracked", "exported")
    share = {name: sum(r.spent.get(name, 0.0) for r in rows) / len(rows) for name in stages}
    lines = {
        "tuned": f"{len(tuned)}; not: {listed(lost)}",
        "checks of the proof, profiled moves included": f"{passed} passed, {explained} explained (on "
        f"{sum(r.checks[1] > 0 for r in tuned)} machines), {failed} failed",
        "moves that met a limit": listed([r for r in tuned if "voltage or current limit" in r.words]),
        "largest differences of promised and simulated peak of the s-curve": ", ".join(
            f"{r.apart:.2g} % ({r.seed})" for r in apart
        ),
        "RMS error at reversals less by 90 %": f"{deep}",
        "less, down to 5 points above that of the axis without friction": f"{sum(r.compensated for r in tuned) - deep}",
        "neither": listed([r for r in tuned if not r.compensated]),
        "full gain safe by reference speed": f"{sum(r.safe == 'yes' for r in tuned)}",
        "exported, at the highest safe gain": ", ".join(
            f"{sum(r.exported and r.gain == gain for r in tuned)} at {100.0 * gain:.0f} %" for gain in GAINS
        ),
        "error of the tracked F_c": f"median {np.median(off):.2g} %, 95 % below {np.quantile(off, 0.95):.2g} %"
        if off.size
        else "-",
        "processor time a machine": ", ".join(f"{name} {seconds:.1f} s" for name, seconds in share.items()),
    }
    report(f"\n| what | of {len(rows)} machines |\n|---|---|")
    for what, how in lines.items():
        report(f"| {what} | {how} |")


def worst(rows: list[Row], report: Callable[[str], None] = print) -> None:
    """Print the worst rows with what explains them."""
    tuned = [r for r in rows if r.tuned]
    kinds: dict[str, list[tuple[Row, str]]] = {
        "Not tuned, or a check failed": [(r, r.words) for r in rows if not r.tuned or r.checks[2]],
        "Not compensated by 90 %, nor to the noise of the axis": [
            (
                r,
                f"{r.rms:+.0f} %, without friction {r.floor:+.0f} %, where the rms error is {r.counts:.2g} encoder "
                "counts without compensation",
            )
            for r in tuned
            if not r.compensated
        ],
        "Full gain not safe": [
            (r, f"{r.words.split('; ')[0]}; exported with {100.0 * r.gain:.0f} %" if r.exported else r.words)
            for r in tuned
            if r.safe != "yes"
        ],
        "F_c off by more than 5 %": [
            (r, f"{r.F_c:+.1f} %, at a stated standard error of {r.sd_F_c:.1f} %; {r.doubts}")
            for r in tuned
            if abs(r.F_c) > 5.0
        ],
    }
    for kind, found in kinds.items():
        report(f"\n{kind}:\n")
        for r, why in found:
            report(f"- {r.seed} ({r.machine}): {why}")


def kept(path: Path | None) -> dict[int, Row]:
    """Return the rows of an earlier run, by seed."""
    if path is None or not path.exists():
        return {}
    return {row.seed: row for row in (Row(**json.loads(line)) for line in path.read_text().splitlines())}


def main() -> None:
    """Draw, run and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the first machine")
    parser.add_argument("--rows", type=Path, help="file of rows: those in it are not run again, others are added")
    asked = parser.parse_args()
    before, rows, start = kept(asked.rows), [], time.perf_counter()
    for seed in range(asked.seed, asked.seed + asked.count):
        if seed in before:
            rows.append(before[seed])
            continue
        rows.append(run(seed))
        print(f"# {seed}: {rows[-1]} ({time.perf_counter() - start:.0f} s)", flush=True)
        if asked.rows is not None:
            with asked.rows.open("a") as file:
                file.write(json.dumps(asdict(rows[-1])) + "\n")
    table(rows)


if __name__ == "__main__":
    main()
