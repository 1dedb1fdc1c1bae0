"""Events in a log: a push, something that brakes for a while, friction that steps. They are kept out of the fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose import notices
from pmsm_ctrl.diagnose.event import Event
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.level import level_of
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.effects.structures.paths import observed_path
from pmsm_ctrl.evidence.events import Burst, Search, Shift, basis_of, bursts, explained_by, shift
from pmsm_ctrl.regression.balances import Record

__all__ = ["events_of"]

Array = NDArray[np.float64]

# Hat functions of the signed speed and of the acceleration, and orders of a turn: what a motion can explain by itself.
SPEED_HATS, ACCELERATION_HATS, ORDERS = 24, 8, 24
MOST_ROWS = 150_000  # samples of the thinned grid; several of a longer record are merged
FEWEST = 200  # samples of the thinned grid; fewer hold no event beside a null
# s; a brake and a push are the same in motion of one direction. A longer stretch is called a brake.
ONE_WAY, LONG = 0.95, 1.0


def events_of(fit: Fitted, policy: Policy = POLICY) -> tuple[Event, ...]:
    """Return the events in the torque balance, in the order of time.

    Only where the model explains most of the torque: what departs from a poor model is no event.

    Parameters
    ----------
    fit : Fitted
        The design as it stands, every candidate tried on its residual.
    policy : Policy
    """
    record = fit.record
    weight = record.weight[0] * record.mask / max(float(fit.weights.sigma[0]), 1e-300)
    if int(np.count_nonzero(weight)) < FEWEST or level_of(fit, 0).explained < policy.explained_torque:
        return ()
    merged = _Merged(weight, -(-len(weight) // MOST_ROWS))
    direction = np.sign(merged(record.at_grid(record.signals["omega"])))
    least = policy.events.size * float(np.sqrt(np.mean(record.target[0][record.mask] ** 2)))
    given = merged.weight, direction, basis_of(_motion(fit, merged), merged.weight)
    found, step = _told_apart(merged(fit.residual[0]), given, (policy.events, record.rate / merged.by))
    found = [one for one in found if abs(one.size) >= least]
    step = step if step is not None and abs(step.size) >= least else None
    time = record.t[:: merged.by][: len(direction)]
    events = [
        *(_stretch(record, time, one, direction) for one in found),
        *([] if step is None else [_step(record, time, step)]),
    ]
    return tuple(sorted(events, key=lambda event: event.start))


def _told_apart(
    residual: Array, given: tuple[Array, Array, Array], search: tuple[Search, float]
) -> tuple[list[Burst], Shift | None]:
    """Return stretches and step; of a stretch and a step that imitate each other the one that explains more."""
    found, step = bursts(residual, *given, search), shift(residual, *given, search)
    if step is None:
        return found, None
    if sum(explained_by(one, residual, *given) for one in found) < explained_by(step, residual, *given):
        after = np.arange(len(residual)) >= step.start
        return bursts(residual - after * (step.size * given[1] + step.offset), *given, search), step
    weight = given[0].copy()
    for one in found:
        weight[one.start : one.stop] = 0.0
    direction, basis = given[1], basis_of(given[2], (weight > 0.0).astype(np.float64))
    return found, shift(residual, weight, direction, basis, search)


@dataclass(frozen=True)
class _Merged:
    """Several samples of a long record as one: their mean, by the squares of their weights.

    An event lasts for hundreds of samples, and all that the motion can explain of an hour would fill the memory.
    """

    each: Array
    by: int

    @property
    def weight(self) -> Array:
        """Of the merged samples, shape (n,)."""
        return np.asarray(np.sqrt(np.sum(self._parts(self.each) ** 2, axis=-1)))

    def __call__(self, values: Array) -> Array:
        """Merge signals, shape (..., m), to shape (..., n)."""
        if self.by == 1:
            return values
        square = self._parts(self.each) ** 2
        whole = np.sum(square, axis=-1)
        share = np.where(whole[:, None] > 0.0, square / np.where(whole > 0.0, whole, 1.0)[:, None], 1.0 / self.by)
        return np.asarray(np.einsum("...nk,nk->...n", self._parts(values), share))

    def _parts(self, values: Array) -> Array:
        count = values.shape[-1] // self.by
        return values[..., : count * self.by].reshape(*values.shape[:-1], count, self.by)


def _motion(fit: Fitted, merged: _Merged) -> Array:
    """Columns of everything that the motion may explain: the model, the candidates, speed, acceleration and angle."""
    record = fit.record
    matrix = fit.model.matrix[0].T
    columns = [merged(matrix[np.any(matrix, axis=1)])]
    for trial in fit.trials:
        rows = trial.group.rows[0]
        if rows is not None and not TIME.intersection(trial.candidate.effect.signals):
            columns.append(merged(rows))
    columns += [merged(record.shaped(one["torque"])[None]) for one in observed_path(record)]
    direction = np.sign(record.at_grid(record.signals["omega"]))
    # friction may hang on the load
    for x, count, way in (
        (record.at_grid(record.signals["omega"]), SPEED_HATS, 1.0),
        (record.at_grid(record.signals["alpha"]), ACCELERATION_HATS, 1.0),
        (np.abs(record.at_grid(record.signals["torque"])), ACCELERATION_HATS, direction),
    ):
        knots = np.unique(np.quantile(x[record.mask], np.linspace(0.0, 1.0, count)))
        columns += [merged(np.interp(x, knots, hat) * way)[None] for hat in np.eye(len(knots))]
    if not record.linear and "theta" in record.signals:
        angle = record.at_grid(record.signals["theta"])
        columns += [merged(wave(n * angle))[None] for wave in (np.cos, np.sin) for n in range(1, ORDERS + 1)]
    stacked = np.empty((sum(map(len, columns)), columns[0].shape[1]))
    end = len(stacked)
    while columns:  # of a long record they are large: each is dropped when it was copied
        rows = columns.pop()
        stacked[end - len(rows) : end] = rows
        end -= len(rows)
    return stacked.T


# Signals that tell the time: an effect that reads them can imitate an event.
TIME = frozenset(("t", "temperature"))


def _stretch(record: Record, time: Array, found: Burst, direction: Array) -> Event:
    """Name a stretch: what opposes the motion either way, or for long, brakes; all else is a push or a load."""
    start, stop = float(time[found.start]), float(time[found.stop - 1])
    part = direction[found.start : found.stop]
    way = float(np.median(part))
    opposing = found.size if found.along else found.size * way
    one_way = float(np.mean(part == way)) > ONE_WAY
    brakes = opposing > 0.0 and (stop - start > LONG if one_way else found.along)
    words = notices.EVENT_BRAKE if brakes else notices.EVENT_PUSH
    size = opposing if brakes else found.size * (way if found.along else 1.0)
    return Event(start, stop, size, words(start=start, stop=stop, size=size, unit=record.unit("torque")))


def _step(record: Record, time: Array, found: Shift) -> Event:
    at, unit = float(time[found.start]), record.unit("torque")
    return Event(at, at, found.size, notices.EVENT_STEP(at=at, size=found.size, unit=unit))
