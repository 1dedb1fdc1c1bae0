"""Which source and gain to take: the safe one with which the least error is left, as simulated."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pmsm_ctrl.compensate.window import FULL, LESS, GainWindow, best_place
from pmsm_ctrl.design_parts import Compensation

__all__ = ["FINE", "Recommendation", "Sweep", "finer_may_help", "first_unsafe", "recommended", "swept_window"]

FINE = 0.02  # step of the finest sweep that is offered
FINER = 0.1  # step of the gain below a first step that is not safe already
Sweep = Callable[..., GainWindow]  # takes the gains by name


@dataclass(frozen=True)
class Recommendation:
    """A compensation that is safe, and what it leaves.

    Attributes
    ----------
    compensation : Compensation
        For the design: source, gain and effects.
    rms : float
        Worst RMS error left over the motions of the design's plant that the encoder resolves, and parameter errors, as
        a share of that without compensation.
    others : dict of str to float
        The worst RMS error left by every other source at its own best safe gain; 1 where no gain is safe or lowers it.
    worst : str
        The motion, and its plant, on which that error is left.
    """

    compensation: Compensation
    rms: float
    others: Mapping[str, float]
    worst: str = ""

    @property
    def gain(self) -> float:
        """Share of the modelled friction that is fed forward."""
        return self.compensation.share


def first_unsafe(window: GainWindow) -> float | None:
    """Return the smallest gain of a sweep where already that one is not safe, else None.

    Parameters
    ----------
    window : GainWindow
    """
    return float(window.gains[1]) if window.safe == 0.0 and len(window.gains) > 1 else None


def swept_window(sweep: Sweep, gains: Iterable[float]) -> GainWindow:
    """Sweep the gain; where the first step is not safe, in finer steps up to the first one that is not.

    Parameters
    ----------
    sweep : callable
        Returns the window of these gains.
    gains : iterable of float

    Returns
    -------
    GainWindow
    """
    window = sweep(gains=gains)
    end = first_unsafe(window)
    between = [] if end is None else [round(FINER * k, 6) for k in range(1, math.ceil(end / FINER - 1e-9))]
    for gain in between:
        window = sweep(gains=(*window.gains.tolist(), gain))
        if window.safe < gain:
            break
    return window


def finer_may_help(window: GainWindow) -> bool:
    """Return whether a gain between those of a sweep may lower the error, where none of the sweep does.

    A gain g takes off a share g of the friction's error at most. The error is about a straight line over the gain, so
    that its RMS value, and the largest of several, is convex: it lies above the line through two neighbours of the
    sweep, outside of them.

    Parameters
    ----------
    window : GainWindow
    """
    unsafe = window.gains[window.gains > window.safe]
    between = np.arange(FINE, min([FULL, *unsafe.tolist()]) - 1e-9, FINE)
    left, right = window.gains[:-1, None], window.gains[1:, None]
    slope = np.diff(window.rms)[:, None] / (right - left)
    lines = window.rms[:-1, None] + slope * (between - left)
    least = np.where((between <= left) | (between >= right), lines, 0.0).max(axis=0, initial=0.0)
    return bool((np.maximum(least, 1.0 - between) <= LESS).any())


def recommended(
    windows: dict[str, GainWindow], effects: Iterable[str], stated: Compensation, sweeps: Mapping[str, Sweep]
) -> Recommendation | None:
    """Return the source that leaves the least error at a safe gain; of equals with less on the assumed plant, or first.

    The first closes no loop.

    Its half is tried as well, as an export does: the window of that source is replaced.

    Parameters
    ----------
    windows : dict of str to GainWindow
        By source.
    effects : iterable of str
        Those whose friction was fed forward in the sweep.
    stated : Compensation
        That of the design, for all but source, gain and effects.
    sweeps : mapping of str to callable
        Returns the window of other gains, by source.

    Returns
    -------
    Recommendation or None
        None where no safe gain lowers the error to 95 % or less, or the encoder resolves none.
    """
    source = _least(windows)
    while source and (window := _with_half(windows[source], sweeps[source])) is not windows[source]:
        windows[source] = window
        source = _least(windows)
    if not source:
        return None
    kept = "adaptive" if (stated.source, source) == ("adaptive", "reference") else source  # judged by the reference
    changed = {"source": kept, "gain": _best(windows[source]), "effects": tuple(effects)}
    return Recommendation(
        stated.model_copy(update=changed), _left(windows[source]),
        {other: _left(window) for other, window in windows.items() if other != source},
        windows[source].worst[_place(windows[source])] if windows[source].worst else "",
    )  # fmt: skip


def _least(windows: Mapping[str, GainWindow]) -> str:
    """Return the source that leaves least, in whole per cent: less is no reason to close a loop; "" where none does.

    Of equals it is the one that leaves less on the plant with the assumed presliding.
    """
    left = {source: round(_left(window), 2) for source, window in windows.items()}
    beside = {source: round(_beside(window), 2) for source, window in windows.items()}
    source = min(left, key=lambda one: (left[one], beside[one]), default="")
    return source if source and left[source] <= LESS else ""


def _beside(window: GainWindow) -> float:
    """Return what is left on the assumed plant; 1 where nothing is known of it."""
    left = float(window.assumed_rms[_place(window)])
    return 1.0 if math.isnan(left) else left


def _place(window: GainWindow) -> int:
    return best_place(window.gains, window.rms, window.safe)


def _best(window: GainWindow) -> float:
    return float(window.gains[_place(window)])


def _left(window: GainWindow) -> float:
    return float(window.rms[_place(window)])


def _with_half(window: GainWindow, sweep: Sweep) -> GainWindow:
    """Return the window with half of its best gain, where it does not hold it."""
    half = 0.5 * _best(window)
    if half == 0.0 or any(math.isclose(half, gain) for gain in window.gains.tolist()):
        return window
    return replace(sweep(gains=(*window.gains.tolist(), half)), hint=window.hint)
