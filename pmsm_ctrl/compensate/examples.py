"""A reversal and a circle with and without compensation, sample by sample, for the pictures of a study."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.compensate.motions import CIRCLE, Trial, at_speed, study_trials
from pmsm_ctrl.compensate.runs import run_trial
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log

__all__ = ["Example", "examples_of"]

Array = NDArray[np.float64]

AROUND = 0.2  # s on either side of a reversal
MOST = 1200  # samples that are kept of an example


@dataclass(frozen=True, eq=False)
class Example:
    """A part of a trial without compensation and with one.

    Attributes
    ----------
    motion : str
        The trial.
    t : array, shape (m,)
        Time, s, from the reversal; of a circle the time of the trial.
    speed : array, shape (m,)
        Reference of the first axis, rad/s (m/s).
    without, compensated : array, shape (m,)
        Position error, reference less true position, rad (m); of a circle the distance from it, outwards.
    angle : array, shape (m,), or None
        Place on the circle, rad, one turn.
    radius : float
        Of the circle; 0 for a single axis.
    label : str
        What is compensated, in words.
    """

    motion: str
    t: Array
    speed: Array
    without: Array
    compensated: Array
    angle: Array | None = None
    radius: float = 0.0
    label: str = "compensated"


def examples_of(base: Design, plant: Design, drive: Design, seed: int) -> tuple[Example, Example]:
    """Simulate a reversal and a circle.

    Parameters
    ----------
    base : Design
        Without compensation.
    plant : Design
    drive : Design
        With compensation.
    seed : int

    Returns
    -------
    (Example, Example)
    """
    trials, chosen = study_trials(base), drive.compensation
    reversal = at_speed("reversal", 2.0, base)
    runs = {
        name: [run_trial(one, trials[name], truth=plant, seed=seed) for one in (base, drive)]
        for name in (reversal, CIRCLE)
    }
    by = "disturbance observer" if chosen.source == "observer" else f"{chosen.source} speed"
    label = f"compensated, {by}, gain {100.0 * chosen.share:.0f} %"
    found = _reversal(reversal, runs[reversal]), _circle(runs[CIRCLE], trials[CIRCLE])
    return replace(found[0], label=label), replace(found[1], label=label)


def _reversal(name: str, runs: list[tuple[Log, ...]]) -> Example:
    """Keep the surroundings of the third reversal, which no start from rest disturbs."""
    (without,), (full,) = runs
    reference = without["omega_ref"]
    moving = np.flatnonzero(reference)
    turns = moving[1:][np.diff(np.sign(reference[moving])) != 0]
    turn = int(turns[min(2, len(turns) - 1)])
    kept = _thinned(np.flatnonzero(np.abs(without.t - without.t[turn]) <= AROUND))
    before, after = ((log["theta_ref"] - log["theta_true"])[kept] for log in (without, full))
    return Example(name, without.t[kept] - without.t[turn], reference[kept], before, after)


def _circle(runs: list[tuple[Log, ...]], trial: Trial) -> Example:
    """Keep one turn at constant speed."""
    x, y = runs[0]
    angle = np.unwrap(np.arctan2(y["theta_ref"], x["theta_ref"] + trial.radius))
    kept = _thinned(np.flatnonzero((angle >= np.pi) & (angle <= 3.0 * np.pi)))
    before, after = ((np.hypot(a["theta_true"] + trial.radius, b["theta_true"]) - trial.radius)[kept] for a, b in runs)
    return Example(CIRCLE, x.t[kept], x["omega_ref"][kept], before, after, angle[kept], trial.radius)


def _thinned(kept: NDArray[np.intp]) -> NDArray[np.intp]:
    return kept[:: max(1, -(-len(kept) // MOST))]
