"""compensate: how much feeding friction forward gains on this axis, and how far its gain may go."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.compensate.acceptance import Verdict, accept
from pmsm_ctrl.compensate.metrics import UNITS, Metrics
from pmsm_ctrl.compensate.motions import CIRCLE, WARM_UP, Trial, study_trials
from pmsm_ctrl.compensate.runs import judge, run_trial
from pmsm_ctrl.compensate.stickslip import Hunting, hunting
from pmsm_ctrl.compensate.variants import baseline, compensated
from pmsm_ctrl.compensate.window import GAINS, GainWindow, describing_function_limit, gain_window, rows, to_plain
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError
from pmsm_ctrl.result import Result, Section, jsonable
from pmsm_ctrl.simulate.feedforward import Feedforward

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["CompensationStudy", "Row", "compensate"]

WRONG = (0.8, 1.0, 1.2)
SOURCES = ("reference", "commanded", "measured")
SWEEP_TRIALS = ("reversal 2 rad/s", "creep 1 rad/s", "positioning", "push")
AT_REST = ("positioning", "push")
ADAPTIVE = "adaptive"
SHOWN = (
    ("reversals", "rms", "reversal"), ("peak", "reversal_peak", "reversal"), ("triangle", "rms", "triangle"),
    ("creep", "rms", "creep"), ("circle", "rms", CIRCLE), ("quadrant", "reversal_peak", CIRCLE),
    ("warm-up", "rms", WARM_UP),
)  # fmt: skip


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
        As given.
    table : tuple of Row
    windows : dict of source to GainWindow
    reasons : tuple of str
    theory : Hunting or None
        Limit cycle at rest without compensation, solved exactly for loops without lags; None when there is none.
    verdicts : tuple of Verdict
        What became of the design's own acceptance.
    """

    design: Design
    table: tuple[Row, ...]
    windows: dict[str, GainWindow]
    reasons: tuple[str, ...] = ()
    theory: Hunting | None = None
    verdicts: tuple[Verdict, ...] = ()

    @property
    def accepted(self) -> bool:
        """Whether every line of the design's acceptance holds; true where it has none."""
        return all(verdict.passed for verdict in self.verdicts)

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
        lines.append(f"  {'change against no compensation':<49}" + "".join(f"{title:>11}" for title, *_ in SHOWN))
        lines += [f"  {name:<49}" + "".join(f"{cell:>11}" for cell in cells) for name, *cells in self._changes()]
        lines += self._rest()
        for window in self.windows.values():
            hint = "no limit" if window.hint is None else f"a cycle from {100 * window.hint:.0f} %"
            lines.append(
                f"  by {window.source} speed: safe up to a gain of {100 * window.safe:.0f} %, best "
                f"{100 * window.best:.0f} % (simulated; the describing function, a hint, predicts {hint})"
            )
        lines += [f"  acceptance {verdict.summary()}" for verdict in self.verdicts]
        return "\n".join(lines)

    def _changes(self) -> list[tuple[str, ...]]:
        """Variant and its changes against no compensation, as `SHOWN` says, a row each."""
        found = []
        for variant, factor in dict.fromkeys((row.variant, row.factor) for row in self.table if row.variant != "none"):
            off = "" if factor == 1.0 else f", parameters {100 * (factor - 1):+.0f} %"
            cells = (f"{100 * self.change(variant, metric, factor, motion):+.0f} %" for _, metric, motion in SHOWN)
            found.append((variant + off, *cells))
        return found

    def _rest(self) -> list[str]:
        """What the axis does while the reference rests, simulated and in theory."""
        lines = []
        found = [r for r in self.table if r.factor == 1.0 and r.motion == "positioning" and r.metrics.cycle_amplitude]
        for row in found:
            m, name = row.metrics, "without compensation" if row.variant == "none" else row.variant
            lines.append(
                f"  at rest after positioning, {name}: cycles with {1e3 * m.cycle_amplitude:.3g} mrad at "
                f"{m.cycle_frequency:.3g} Hz"
            )
        if self.theory is not None:
            lines.append(
                "  stiction in theory, if its Stribeck speed is small: hunting without compensation with "
                f"{1e3 * self.theory.amplitude:.3g} mrad at {1.0 / self.theory.period:.3g} Hz"
            )
        return lines

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
            "hunting_in_theory": None if self.theory is None else asdict(self.theory),
            "acceptance": [
                {**v.wanted.model_dump(), "value": v.value, "unit": v.unit, "passed": v.passed} for v in self.verdicts
            ],
        })  # fmt: skip

    def section(self) -> Section:
        """Return the section of the report."""
        metrics = (f"{name.replace('_', ' ')} [{unit}]" for name, unit in UNITS.items())
        header = ("compensated", "motion", "parameters", *metrics)
        body = tuple(
            (r.variant, r.motion, f"{100 * (r.factor - 1):+.0f} %", *(f"{v:.3g}" for v in r.metrics.as_dict().values()))
            for r in self.table
        )
        verdicts = tuple((v.summary().partition(": ")[2], "passed" if v.passed else "failed") for v in self.verdicts)
        sweep = tuple((source, *row) for source, window in self.windows.items() for row in rows(window))
        return Section(
            title="Friction compensation",
            paragraphs=(
                *(f"Warning: {text}" for text in self.warnings),
                "The baseline feeds inertia and delay forward already, so that friction gets no credit for theirs. "
                "A gain is safe when neither it nor any smaller one cycles at rest, where a push wakes what sleeps, or "
                "has an RMS error above that without, with the parameters right and 20 % wrong. Errors of the circle "
                "are those of its contour; the axis that warms up loses 40 % of its Coulomb and viscous friction.",
                *self._rest(),
            ),
            tables=(
                (("change against no compensation", *(title for title, *_ in SHOWN)), tuple(self._changes())),
                (header, body),
                (("by", "gain", "worst RMS of none", "worst reversal peak of none", "cycle [rad]", "verdict"), sweep),
                *(((("acceptance", "verdict"), verdicts),) if verdicts else ()),
            ),
            figures=((self.plot(), "Where the lower curve leaves zero, the compensation shakes the axis at rest."),),
            captions=(
                "RMS of the position error; peak and quadrant: largest error after a change of direction",
                "Every run",
                "The gain, step by step",
                "Acceptance of the design",
            ),
        )


def compensate(
    design: Design,
    *,
    truth: Design | None = None,
    gains: Iterable[float] = GAINS,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> CompensationStudy:
    """Compare no, partial, full and adaptive friction compensation, and sweep the gain for its safe window.

    The sweep compensates what the design compensates, or every effect where it has no compensation.

    Parameters
    ----------
    design : Design
        What the controller believes; its effects are what can be compensated.
    truth : Design, optional
        The plant; `design` itself when left out.
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
    plant, base = truth if truth is not None else design, baseline(design)
    trials = study_trials(design)
    usable = [entry.id for entry in design.effects]
    full = Feedforward.of(compensated(base, usable)) if usable else None
    if full is None:
        raise DesignError(f"{design.source or design.name}: effects: no friction to compensate; identify it first")
    every = tuple(dict.fromkeys(effect.id for effect in full.effects))
    chosen = tuple(name for name in every if name in design.compensation.effects)
    swept = chosen if design.compensation.gain > 0.0 and chosen else every
    advance = progress or (lambda share: None)

    def run(believed: Design, trial: Trial) -> Metrics:
        return judge(trial, run_trial(believed, trial, truth=plant, seed=seed))

    table = _compared(run, base, plant, trials, every, lambda share: advance(0.5 * share))
    windows = {}
    for done, source in enumerate(SOURCES):
        windows[source] = gain_window(
            _swept(run, base, swept, source, trials),
            SWEEP_TRIALS,
            source,
            gains=gains,
            hint=describing_function_limit(base, source),
            at_rest=AT_REST,
        )
        advance(0.5 + 0.5 * (done + 1) / len(SOURCES))
    verdicts = tuple(accept(design, wanted, seed=seed) for wanted in design.acceptance)
    doubts = _doubts(design, table, windows, full.notes, verdicts)
    return CompensationStudy(design, tuple(table), windows, doubts, hunting(base), verdicts)


def _compared(
    run: Callable[[Design, Trial], Metrics], base: Design, plant: Design, trials: dict[str, Trial],
    every: tuple[str, ...], advance: Callable[[float], None],
) -> list[Row]:  # fmt: skip
    """Run every variant on every trial, with the parameters right and wrong."""
    simple = tuple(name for name in ("coulomb", "viscous") if name in every)
    right = base.replace_effects(plant.effects)
    variants = {
        "Coulomb + viscous": (base, simple, "reference"),
        "all effects": (base, every, "reference"),
        "all effects, commanded speed": (base, every, "commanded"),
        ADAPTIVE: (base, every, "adaptive"),
        "perfect model": (right, tuple(entry.id for entry in right.effects), "reference"),
    }
    table = [Row("none", name, 1.0, run(base, trial)) for name, trial in trials.items()]
    known: dict[tuple[str, str], Metrics] = {}  # without another truth the perfect model has been run before
    for done, (variant, (start, chosen, source)) in enumerate(variants.items()):
        for factor in WRONG:
            believed = compensated(start, chosen, factor=factor, source=source)
            for name, trial in trials.items():
                key = (name, believed.to_toml())
                if key not in known:
                    known[key] = run(believed, trial)
                table.append(Row(variant, name, factor, known[key]))
        advance((done + 1) / len(variants))
    return table


def _swept(
    run: Callable[[Design, Trial], Metrics], base: Design, chosen: tuple[str, ...], source: str,
    trials: dict[str, Trial],
) -> Callable[[float, float, str], Metrics]:  # fmt: skip
    @cache
    def at(gain: float, factor: float, name: str) -> Metrics:
        return run(compensated(base, chosen, gain=gain, factor=factor, source=source), trials[name])

    return at


def _doubts(
    design: Design,
    table: list[Row],
    windows: dict[str, GainWindow],
    notes: tuple[str, ...],
    verdicts: tuple[Verdict, ...],
) -> tuple[str, ...]:
    doubts = [verdict.summary() for verdict in verdicts if not verdict.passed]
    doubts += notes
    gain, chosen = design.compensation.gain, design.compensation.source
    own = windows["reference" if chosen == "adaptive" else chosen]
    if gain > own.safe:
        doubts.append(
            f"the design's own gain of {100 * gain:.0f} % by {chosen} speed is not safe: {100 * own.safe:.0f} % is"
        )
    for source, window in windows.items():
        if window.safe < 1.0:
            doubts.append(f"by {source} speed a gain of 100 % is not safe: {100 * window.safe:.0f} % is")
    cycles = sorted({row.motion for row in table if row.variant == "none" and row.metrics.cycle_amplitude > 0.0})
    if cycles:
        doubts.append(
            f"the axis cycles at rest even without compensation ({', '.join(cycles)}); "
            "a gain counts as safe that leaves such a cycle as it is"
        )
    return tuple(doubts)
