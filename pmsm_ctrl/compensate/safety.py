"""Whether one gain is safe: the gain that a design states, before it is exported or downloaded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from pmsm_ctrl.compensate.metrics import Metrics
from pmsm_ctrl.compensate.motions import study_trials
from pmsm_ctrl.compensate.runs import baseline, compensated, count_angle, judge, run_trial
from pmsm_ctrl.compensate.window import AT_REST, SWEEP_TRIALS, GainWindow, gain_window
from pmsm_ctrl.design import Design
from pmsm_ctrl.errors import DesignError, PmsmCtrlError
from pmsm_ctrl.simulate.feedforward import Feedforward

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

    The plant is the design; the compensated parameters are right and 20 % wrong. An adaptive compensation is judged
    by the reference speed.

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
        return GainVerdict(None, str(error))
    except PmsmCtrlError as error:  # the simulation diverged, say
        return GainVerdict(False, str(error))
    if window.safe >= gain:
        return GainVerdict(True)
    cycle = float(window.cycle.max())
    turn = "mm" if design.motion == "linear" else "mrad"
    if cycle > 0.0:
        return GainVerdict(False, f"the axis has a limit cycle of {1e3 * cycle:.3g} {turn} at rest")
    return GainVerdict(False, f"the RMS error is {float(window.rms.max()):.3g} times that without compensation")


def _window(design: Design, gain: float) -> GainWindow:
    base, trials = baseline(design), study_trials(design)
    source = "reference" if design.compensation.source == "adaptive" else design.compensation.source
    chosen = [name for name in design.compensation.effects if any(e.id == name for e in design.effects)]
    if Feedforward.of(compensated(base, chosen)) is None:
        raise DesignError(f"{design.source or design.name}: no effect to compensate")

    def run(at: float, factor: float, name: str) -> Metrics:
        on = base if at == 0.0 else compensated(base, chosen, gain=at, factor=factor, source=source)
        return judge(trials[name], run_trial(on, trials[name], truth=design), count_angle(design))

    return gain_window(run, SWEEP_TRIALS, source, gains=(0.5 * gain, gain), at_rest=AT_REST,
                       resolution=count_angle(design))  # fmt: skip
