"""Whether one gain is safe: the gain that a design states, before it is exported or downloaded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from pmsm_ctrl.compensate.metrics import Metrics
from pmsm_ctrl.compensate.motions import study_trials
from pmsm_ctrl.compensate.plants import judged
from pmsm_ctrl.compensate.runs import baseline, compensated, judge, run_trial
from pmsm_ctrl.compensate.window import GainWindow, gain_window
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, PmsmCtrlError
from pmsm_ctrl.simulate.feedforward import Feedforward
from pmsm_ctrl.units import axis_unit

__all__ = ["GainVerdict", "gain_verdict"]


@dataclass(frozen=True)
class GainVerdict:
    """Whether a gain is safe.

    Attributes
    ----------
    safe : bool or None
        None where it cannot be judged.
    why : str
        Why it is not, or why it cannot be judged; empty for a safe gain.
    """

    safe: bool | None
    why: str = ""


def gain_verdict(design: Design, gain: float) -> GainVerdict:
    """Judge a gain of a design's compensation as the sweep of `compensate` does, at half of it and at all of it.

    The plant is the design, and the design with presliding; the compensated parameters are right and 20 % wrong. An
    adaptive compensation is judged by the reference speed.

    Parameters
    ----------
    design : Design
        With its ``[compensation]``.
    gain : float

    Returns
    -------
    GainVerdict
    """
    if gain == 0.0:
        return GainVerdict(True)
    return _judged(_Judged(design), gain)


class _Judged:
    """A design that equals another one with the same text and the same own effects, so that it is judged once."""

    def __init__(self, design: Design) -> None:
        self.design, self._key = design, (design.to_toml(), design.own_effects)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Judged) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key[0])


@lru_cache(maxsize=32)
def _judged(judged: _Judged, gain: float) -> GainVerdict:
    design = judged.design
    try:
        window = _window(design, gain)
    except DesignError as error:
        # Without loops or electrical data nothing can be judged; a design that contradicts itself is not safe.
        sound = design.loops is not None and design.motor.electrical and design.loops.position.K_v > 0.0
        return GainVerdict(False if sound else None, str(error))
    except PmsmCtrlError as error:  # the simulation diverged, say
        return GainVerdict(False, str(error))
    if window.safe >= gain:
        return GainVerdict(True)
    cycle = float(window.cycle[1:].max())  # the first is that of the axis without compensation
    milli, on = f"m{axis_unit('rad', design.motion)}", f" (trial: {window.limited_by})"
    if cycle > 0.0:
        counts = f" ({float(window.cycle_counts[1:].max()):.3g} encoder counts)" if window.count > 0.0 else ""
        return GainVerdict(False, f"the axis has a limit cycle of {1e3 * cycle:.3g} {milli}{counts} at rest{on}")
    rms = float(window.judged.max())
    return GainVerdict(False, f"the RMS error is {rms:.3g} times that without compensation{on}")


def _window(design: Design, gain: float) -> GainWindow:
    base, trials, motions = baseline(design), study_trials(design), judged(design)
    source = "reference" if design.compensation.source == "adaptive" else design.compensation.source
    chosen = [name for name in design.compensation.effects if any(e.id == name for e in design.effects)]
    if source != "observer" and Feedforward.of(compensated(base, chosen)) is None:
        raise DesignError(f"{design.source or design.name}: no effect to compensate")

    def run(at: float, factor: float, name: str) -> Metrics:
        on = base if at == 0.0 else compensated(base, chosen, gain=at, factor=factor, source=source)
        trial = trials[motions[name].trial]
        return judge(trial, run_trial(on, trial, truth=motions[name].plant), design.encoder_step)

    at_rest = [name for name, motion in motions.items() if motion.at_rest]
    return gain_window(run, motions, source, gains=(0.5 * gain, gain), at_rest=at_rest, resolution=design.encoder_step)
