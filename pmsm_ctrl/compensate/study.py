"""compensate: what feeding friction forward gains on this axis, and the highest safe gain."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

from pmsm_ctrl.compensate.acceptance import accept, require_known
from pmsm_ctrl.compensate.doubt import Doubt, doubt_of
from pmsm_ctrl.compensate.examples import examples_of
from pmsm_ctrl.compensate.metrics import Metrics
from pmsm_ctrl.compensate.motions import Trial, study_trials
from pmsm_ctrl.compensate.plants import judged
from pmsm_ctrl.compensate.recommendation import Sweep, recommended, swept_window
from pmsm_ctrl.compensate.result import CompensationStudy, Row, Variant
from pmsm_ctrl.compensate.runs import baseline, compensated, judge, run_trial
from pmsm_ctrl.compensate.theory import describing_function_limit, hunting
from pmsm_ctrl.compensate.window import FACTORS, GAINS, GainWindow, gain_window
from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.errors import DesignError, RequestError, require_kind
from pmsm_ctrl.simulate.feedforward import Feedforward, require_present
from pmsm_ctrl.simulate.parameters import Plant

if TYPE_CHECKING:
    from pmsm_ctrl.tune.observer import ObserverDesign

__all__ = ["SOURCES", "compensate", "with_bandwidth"]

SOURCES = ("reference", "commanded", "measured")  # of friction feedforward
SIMPLE = ("coulomb", "viscous")  # the classical compensator, with which the others are compared


@dataclass(frozen=True, eq=False)
class _Runs:
    """The metrics of each drive on each trial; what was run before is not run again."""

    plant: Design
    trials: dict[str, Trial]
    seed: int
    known: dict[tuple[str, str, str], Metrics] = field(default_factory=dict)

    def metrics(self, believed: Design, name: str, plant: Design | None = None) -> Metrics:
        """Return the metrics of a trial, on another plant where one is given."""
        truth = self.plant if plant is None else plant
        key = (name, believed.model_dump_json(), truth.model_dump_json())
        if key not in self.known:
            logs = run_trial(believed, self.trials[name], truth=truth, seed=self.seed)
            self.known[key] = judge(self.trials[name], logs, truth.encoder_step)
        return self.known[key]

    def floor(self, believed: Design, name: str, friction: tuple[str, ...]) -> Metrics:
        """Return the metrics of the same axis without friction: what noise and the loops alone leave."""
        bound = zip(self.plant.effects, bound_effects(self.plant), strict=True)
        keep = [
            entry
            for entry, (effect, _) in bound
            if effect.id not in friction and not effect.dry and not effect.structure.replaces_direction
        ]
        trial = replace(self.trials[name], changed={})
        logs = run_trial(believed, trial, truth=self.plant.replace_effects(tuple(keep)), seed=self.seed)
        return judge(trial, logs, self.plant.encoder_step)


def compensate(
    design: Design,
    *,
    truth: Design | None = None,
    gains: Iterable[float] = GAINS,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> CompensationStudy:
    """Compare no, partial, full and adaptive friction compensation, and sweep the gain for the highest safe one.

    The sweep compensates what the design compensates, or every effect where it has no compensation. A gain is judged on
    the plant and on the same one with presliding, where it has none.

    Parameters
    ----------
    design : Design
        What the controller assumes; its effects are what can be compensated.
    truth : Design, optional
        The plant; `design` itself when left out.
    gains : iterable of float
        Gains of the sweep.
    seed : int
        Of the measurement noise.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    CompensationStudy

    Raises
    ------
    DesignError
        When the drive cannot be simulated, or the design has no loops, no position gain, or no friction to compensate.
    """
    require_kind(design, Design, "design")
    Plant.of(design)  # a plain axis is refused here: to write its loops would not help
    if design.effects:
        require_present(design)
    for wanted in design.acceptance:
        require_known(design, wanted)
    base, advance = baseline(design), progress or (lambda share: None)
    runs = _Runs(truth if truth is not None else design, study_trials(design), seed)
    full = Feedforward.of(compensated(base, [entry.id for entry in design.effects])) if design.effects else None
    observer = _observer(base)
    if observer is not None:
        base = with_bandwidth(base, observer, always=True)
    if full is None:
        raise DesignError(f"{design.source or design.name}: effects: no friction to compensate; identify it first")
    every = tuple(dict.fromkeys(effect.id for effect in full.effects))
    chosen = tuple(name for name in every if name in design.compensation.effects)
    swept = chosen if design.compensation.share > 0.0 and chosen else every
    doubt = doubt_of(design, swept)
    rows, table = _compared(runs, base, every, doubt, observer is not None), []
    for row in rows:
        table.append(row)
        advance(0.5 * len(table) / (len(runs.trials) * (2 + (len(Variant) - 3) * len(FACTORS))))
    windows: dict[str, GainWindow] = {}
    sweeps: dict[str, Sweep] = {}
    motions = judged(runs.plant)
    sources = SOURCES if observer is None else (*SOURCES, "observer")
    for done, source in enumerate(sources):

        def run(gain: float, factor: float, name: str, source: str = source) -> Metrics:
            on = base if gain == 0.0 else compensated(base, swept, gain=gain, factor=factor, source=source)
            return runs.metrics(on, motions[name].trial, motions[name].plant)

        at_rest, assumed = ([n for n, m in motions.items() if getattr(m, kind)] for kind in ("at_rest", "assumed"))
        sweeps[source] = partial(
            gain_window, run, motions, source, at_rest=at_rest, resolution=runs.plant.encoder_step, assumed=assumed,
            factors=doubt.factors(source),
        )  # fmt: skip
        windows[source] = replace(swept_window(sweeps[source], gains), hint=describing_function_limit(base, source))
        advance(0.5 + 0.45 * (done + 1) / len(sources))
    stated = with_bandwidth(design, observer)
    verdicts = tuple(accept(stated, wanted, seed=seed) for wanted in design.acceptance)
    found = recommended(windows, swept, design.compensation, sweeps)
    chosen_drive = partial(compensated, base, every)
    if found is not None:
        own = found.compensation
        chosen_drive = partial(compensated, base, own.effects, gain=found.gain, source=own.source)
        table += _rows(runs, Variant.RECOMMENDED, chosen_drive, doubt.factors(own.source))
    examples = examples_of(base, runs.plant, chosen_drive(), seed)
    return CompensationStudy(
        design, tuple(table), windows, full.left_out, hunting(base), verdicts, observer, examples, found, doubt
    )  # fmt: skip


def with_bandwidth(design: Design, observer: ObserverDesign | None, *, always: bool = False) -> Design:
    """Return a design with the bandwidth of an observer, where it observes and states none, or always.

    Parameters
    ----------
    design : Design
    observer : ObserverDesign or None
    always : bool
    """
    own = design.compensation
    if observer is None or not (always or (own.source == "observer" and own.bandwidth is None)):
        return design
    return design.model_copy(update={"compensation": own.model_copy(update={"bandwidth": observer.bandwidth})})


def _observer(base: Design) -> ObserverDesign | None:
    """Return the disturbance observer that the loops allow, at the design's own bandwidth where it states one."""
    from pmsm_ctrl.tune.observer import design_observer  # loads python-control, which an acceptance does not need

    try:
        return design_observer(base)
    except RequestError:
        return None


def _compared(runs: _Runs, base: Design, every: tuple[str, ...], doubt: Doubt, observed: bool) -> Iterator[Row]:
    """Run every variant on every trial, with the parameters right and wrong."""
    simple = tuple(name for name in SIMPLE if name in every)
    right = base.replace_effects(runs.plant.effects)
    yield from (Row(Variant.FLOOR, name, 1.0, runs.floor(base, name, every)) for name in runs.trials)
    variants = {
        Variant.SIMPLE: (base, simple, "reference"),
        Variant.ALL: (base, every, "reference"),
        Variant.COMMANDED: (base, every, "commanded"),
        Variant.ADAPTIVE: (base, every, "adaptive"),
        Variant.PERFECT: (right, tuple(entry.id for entry in right.effects), "reference"),
        **({Variant.OBSERVER: (base, (), "observer")} if observed else {}),
    }
    yield from (Row(Variant.NONE, name, 1.0, runs.metrics(base, name)) for name in runs.trials)
    for variant, (start, chosen, source) in variants.items():
        yield from _rows(runs, variant, partial(compensated, start, chosen, source=source), doubt.factors(source))


def _rows(runs: _Runs, variant: Variant, drive: Callable[..., Design], factors: Iterable[float]) -> Iterator[Row]:
    """Run a compensation on every trial, with the parameters right and wrong."""
    for factor in factors:
        believed = drive(factor=factor)
        yield from (Row(variant, name, factor, runs.metrics(believed, name)) for name in runs.trials)
