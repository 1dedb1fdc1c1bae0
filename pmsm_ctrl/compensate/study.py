"""compensate: how much feeding friction forward gains on this axis, and how far its gain may go."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from pmsm_ctrl.compensate.metrics import UNITS, Metrics, measure
from pmsm_ctrl.compensate.motions import study_motions
from pmsm_ctrl.compensate.window import GAINS, GainWindow, describing_function_limit, gain_window, rows, to_plain
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.result import Result, Section, jsonable
from pmsm_ctrl.simulate import Scenario, scenario, simulate
from pmsm_ctrl.simulate.feedforward import Feedforward
from pmsm_ctrl.track import track

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CompensationStudy", "Row", "baseline", "compensate", "compensated"]

WRONG = (0.8, 1.0, 1.2)
SOURCES = ("reference", "commanded", "measured")
SWEEP_MOTIONS = ("reversal 2 rad/s", "creep 1 rad/s", "positioning", "push")
AT_REST = ("positioning", "push")


@dataclass(frozen=True)
class Row:
    """One run: what was compensated, on which motion, with parameters off by which factor."""

    variant: str
    motion: str
    factor: float
    metrics: Metrics


@dataclass(frozen=True, eq=False)
class CompensationStudy(Result):
    """What compensation does to an axis.

    Attributes
    ----------
    design : Design
        The design with the compensation it had, or by reference speed with the best gain inside the safe window.
    table : tuple of Row
    windows : dict of source to GainWindow
    """

    design: Design
    table: tuple[Row, ...]
    windows: dict[str, GainWindow]
    reasons: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the numbers."""
        return self.reasons

    def change(self, variant: str, metric: str = "rms", factor: float = 1.0, motion: str = "reversal") -> float:
        """Worst change of a metric against no compensation over the motions whose name starts so; -0.8 is -80 %."""
        plain = {row.motion: row.metrics for row in self.table if row.variant == "none"}
        found = [
            getattr(row.metrics, metric) / getattr(plain[row.motion], metric) - 1.0
            for row in self.table
            if row.variant == variant and row.factor == factor and row.motion.startswith(motion)
        ]
        return max(found)

    def summary(self) -> str:
        """Return the result as text, trust first."""
        lines = [f"friction compensation of {self.design.name}"]
        lines += [f"  warning: {text}" for text in self.warnings] or ["  no reason to doubt the numbers was found"]
        variants = list(dict.fromkeys(row.variant for row in self.table if row.variant != "none"))
        for variant in variants:
            for factor in sorted({row.factor for row in self.table if row.variant == variant}):
                off = "" if factor == 1.0 else f", parameters {100 * (factor - 1):+.0f} %"
                lines.append(
                    f"  {variant + off:<40} reversals: RMS {100 * self.change(variant, 'rms', factor):+.0f} %, "
                    f"peak {100 * self.change(variant, 'reversal_peak', factor):+.0f} %"
                )
        for window in self.windows.values():
            hint = "no limit" if window.hint is None else f"a cycle from {100 * window.hint:.0f} %"
            lines.append(
                f"  by {window.source} speed: safe up to a gain of {100 * window.safe:.0f} %, best "
                f"{100 * window.best:.0f} % (simulated; the describing function, a hint, predicts {hint})"
            )
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw error and limit cycle against the gain, for each source."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8.0, 5.0), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        for (source, window), colour in zip(self.windows.items(), ("#0072B2", "#009E73", "#D55E00"), strict=False):
            percent = 100.0 * window.gains
            upper.plot(percent, 100.0 * window.rms, "o-", color=colour, markersize=3, label=f"by {source} speed")
            lower.plot(percent, 1e3 * window.cycle, "o-", color=colour, markersize=3)
            for axis in (upper, lower):
                axis.axvline(100.0 * window.safe, color=colour, linestyle=":", linewidth=1.0)
        upper.axhline(100.0, color="#000000", linewidth=0.6)
        upper.set_ylabel("worst RMS error [% of none]")
        upper.set_title("Gain sweep with parameters right and 20 % wrong; dotted: safe up to here")
        upper.legend(fontsize="small")
        lower.set_ylabel("limit cycle at rest [mrad]")
        lower.set_xlabel("gain of the compensation [%]")
        for axis in (upper, lower):
            axis.grid(alpha=0.3)
        return figure

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        return jsonable({
            "schema": "pmsm-ctrl/compensation/1",
            "warnings": self.warnings,
            "units": UNITS,
            "runs": [
                {"variant": r.variant, "motion": r.motion, "factor": r.factor, **r.metrics.as_dict()}
                for r in self.table
            ],
            "windows": {source: to_plain(window) for source, window in self.windows.items()},
        })  # fmt: skip

    def section(self) -> Section:
        """Return the section of the report."""
        header = ("compensated", "motion", "parameters", *(f"{name} [{unit}]" for name, unit in UNITS.items()))
        body = tuple(
            (r.variant, r.motion, f"{100 * (r.factor - 1):+.0f} %", *(f"{v:.3g}" for v in r.metrics.as_dict().values()))
            for r in self.table
        )
        sweep = tuple((source, *row) for source, window in self.windows.items() for row in rows(window))
        return Section(
            title="Friction compensation",
            paragraphs=(
                *(f"Warning: {text}" for text in self.warnings),
                "The baseline feeds inertia and delay forward already, so that friction gets no credit for theirs. "
                "A gain is safe when neither it nor any smaller one cycles at rest, where a push wakes what sleeps, or "
                "has an RMS error above that without, with the parameters right and 20 % wrong.",
            ),
            tables=(
                (header, body),
                (("by", "gain", "worst RMS of none", "worst reversal peak of none", "cycle [rad]", "verdict"), sweep),
            ),
            figures=((self.plot(), "Where the lower curve leaves zero, the compensation shakes the axis at rest."),),
        )


def baseline(design: Design) -> Design:
    """Return the design without friction compensation, inertia and delay fed forward.

    The drive's speed lags the true one; a reference that is not delayed alike makes an error of lag times
    acceleration, which must not be taken for friction's.
    """
    if design.loops is None:
        raise DesignError(f"{design.source or design.name}: loops: missing; `pmsm-ctrl tune` finds them")
    T_s = design.drive.speed_divider / design.drive.f_control
    share = 1.0 if design.sensor.speed_filter == 0.0 else -np.expm1(-T_s / design.sensor.speed_filter)
    lag = float(0.5 * T_s + T_s * (1.0 - share) / share)
    speed = design.loops.speed.model_copy(update={"reference_filter": design.loops.speed.reference_filter or lag})
    position = design.loops.position.model_copy(
        update={"acceleration_feedforward": design.loops.position.acceleration_feedforward or 1.0}
    )
    loops = design.loops.model_copy(update={"speed": speed, "position": position})
    off = design.compensation.model_copy(update={"gain": 0.0})
    return design.model_copy(update={"loops": loops, "compensation": off})


def compensated(
    design: Design, effects: Iterable[str], *, gain: float = 1.0, source: str = "reference", factor: float = 1.0,
    smoothing: float | None = None, own: Iterable[Effect] = (),
) -> Design:  # fmt: skip
    """Return the design with these effects compensated, their linear parameters off by `factor`.

    The sign of the commanded speed, which follows the measured angle, is smoothed over what five counts of the
    encoder make of it, unless `smoothing` or the design says otherwise.
    """
    chosen, own = tuple(effects), tuple(own)
    entries = []
    for entry, (effect, values) in zip(design.effects, bound_effects(design, own), strict=True):
        if effect.id in chosen:
            values = values | {p.symbol: values[p.symbol] * factor for p in effect.linear}
        entries.append(entry.model_copy(update={"parameters": values}))
    width = design.compensation.smoothing if smoothing is None else smoothing
    if smoothing is None and width == 0.0 and source == "commanded" and design.loops is not None:
        turn = 1.0 if design.motion == "linear" else 2.0 * np.pi
        width = float(5.0 * design.loops.position.K_v * turn / (design.sensor.encoder_counts or 1 << 20))
    changed = design.compensation.model_copy(
        update={"gain": gain, "source": source, "smoothing": width, "effects": chosen}
    )
    return design.replace_effects(tuple(entries)).model_copy(update={"compensation": changed})


def compensate(
    design: Design,
    *,
    truth: Design | None = None,
    own: Iterable[Effect] = (),
    gains: Iterable[float] = GAINS,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> CompensationStudy:
    """Compare no, partial, full and adaptive friction compensation, and sweep the gain for its safe window.

    Parameters
    ----------
    design : Design
        What the controller believes; its effects are what can be compensated.
    truth : Design, optional
        The plant; `design` itself when left out.
    own : iterable of Effect
        A user's own effects that the designs name.
    gains : iterable of float
        Gains of the sweep.
    seed : int
        Seed of the measurement noise.
    progress : function, optional
        Called with the share done, 0 to 1.

    Raises
    ------
    DesignError
        When the design has no loops, no position gain, or no friction to compensate.
    """
    own = tuple(own)
    plant, base = truth if truth is not None else design, baseline(design)
    motions = study_motions(design)
    usable = [entry.id for entry in design.effects]
    full = Feedforward.of(compensated(base, usable, own=own), own) if usable else None
    if full is None:
        raise DesignError(f"{design.source or design.name}: effects: no friction to compensate; identify it first")
    every = tuple(dict.fromkeys(effect.id for effect in full.effects))
    simple = tuple(name for name in ("coulomb", "viscous") if name in every)

    def run(believed: Design, motion: Scenario) -> Metrics:
        return measure(simulate(believed, motion, truth=plant, seed=seed, own=own, keep_truth=True))

    table = [Row("none", name, 1.0, run(base, motion)) for name, motion in motions.items()]
    variants = {
        "Coulomb + viscous": (simple, "reference"),
        "all effects": (every, "reference"),
        "all effects, commanded speed": (every, "commanded"),
    }
    for variant, (chosen, source) in variants.items():
        for factor in WRONG:
            believed = compensated(base, chosen, factor=factor, source=source, own=own)
            table += [Row(variant, name, factor, run(believed, motion)) for name, motion in motions.items()]
    for factor in (0.8, 1.2):
        learnt = _learnt(compensated(base, every, gain=0.0, factor=factor, own=own), plant, own, seed)
        believed = compensated(learnt, every, own=own)
        table += [Row("adaptive", name, factor, run(believed, motion)) for name, motion in motions.items()]
    right = base.replace_effects(plant.effects)
    table += [Row("perfect model", name, 1.0, run(_perfect(right, own), motion)) for name, motion in motions.items()]
    windows = {}
    for done, source in enumerate(SOURCES):
        hint = describing_function_limit(base) if source == "measured" else None
        windows[source] = gain_window(
            _swept(run, base, every, source, motions, own),
            SWEEP_MOTIONS,
            source,
            gains=gains,
            hint=hint,
            at_rest=AT_REST,
        )
        if progress is not None:
            progress((done + 1) / len(SOURCES))
    return CompensationStudy(design, tuple(table), windows, _doubts(table, windows, full.notes))


def _swept(
    run: Callable[[Design, Scenario], Metrics], base: Design, chosen: tuple[str, ...], source: str,
    motions: dict[str, Scenario], own: tuple[Effect, ...],
) -> Callable[[float, float, str], Metrics]:  # fmt: skip
    @cache
    def at(gain: float, factor: float, name: str) -> Metrics:
        return run(compensated(base, chosen, gain=gain, factor=factor, source=source, own=own), motions[name])

    return at


def _perfect(design: Design, own: tuple[Effect, ...]) -> Design:
    return compensated(design, [entry.id for entry in design.effects], own=own)


def _learnt(believed: Design, plant: Design, own: tuple[Effect, ...], seed: int) -> Design:
    """Return the design with F_c and F_v as tracked in a run of 12 s before the motion that is judged."""
    log = simulate(
        believed, scenario("triangle", believed, period=2.0, cycles=6.0), truth=plant, seed=seed + 1, own=own
    )  # fmt: skip
    return track(believed, log, own=own).design_at(float(log.t[-1]))


def _doubts(table: list[Row], windows: dict[str, GainWindow], notes: tuple[str, ...]) -> tuple[str, ...]:
    doubts = list(notes)
    for source, window in windows.items():
        if window.safe < 1.0:
            doubts.append(f"by {source} speed a gain of 100 % is not safe: {100 * window.safe:.0f} % is")
    cycles = sorted({row.motion for row in table if row.variant == "none" and row.metrics.cycle_amplitude > 0.0})
    if cycles:
        doubts.append(f"the axis cycles at rest even without compensation ({', '.join(cycles)})")
    return tuple(doubts)
