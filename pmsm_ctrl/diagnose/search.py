"""Every candidate tried on the residual of a model: how much it explains, and how significantly."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose.candidates import Candidate
from pmsm_ctrl.evidence.blocks import FEWEST_RECORDS, equal_blocks, left_out_gains, record_blocks
from pmsm_ctrl.evidence.linalg import OWN_SHARE, Added, added_each
from pmsm_ctrl.evidence.tests import f_tail
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import Group, candidate_groups, groups_of_candidates
from pmsm_ctrl.regression.covariance import NoiseCovariance
from pmsm_ctrl.regression.model import Model, Solved
from pmsm_ctrl.regression.saturated import Saturated, saturated
from pmsm_ctrl.regression.two_stage import beside_held

__all__ = [
    "Offer",
    "Rows",
    "Trial",
    "as_judged",
    "beyond",
    "beyond_each",
    "blocked_gain",
    "direction_of",
    "offer",
    "plain_evidence",
    "tried",
    "try_all",
    "try_candidate",
    "try_group",
    "whitened_rows",
]

Array = NDArray[np.float64]

LONGEST_GAP = 1.0  # s left out on either side of a block that is judged
# The gap in memories of the noise, and in periods of the filter: both have died away by then.
GAP_MEMORIES, GAP_PERIODS = 3.0, 4.0
BLOCKS = 16
EVEN = 0.5  # part of a block's share that counts samples: none holds more than twice the usual one of the squares
NEGLIGIBLE = 1e-6  # length of a column beside noise of variance 1: by less a value is beyond a bound by rounding alone


@dataclass(frozen=True, eq=False)
class Rows:
    """Whitened columns of a group in the balances they enter, and what a fit has of them.

    Attributes
    ----------
    own : dict of balance to array, shape (k, n)
    shared : array, shape (rank of the fit, k)
        Products of the fit's orthonormal basis with them.
    """

    own: Mapping[int, Array]
    shared: Array


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate at its best shape, added to the model.

    Attributes
    ----------
    candidate : Candidate
    group : Group
        Its columns at that shape.
    gain : float
        Fall of the whitened sum of squares.
    score : float
        The same less Schwarz's penalty for its parameters.
    p_value : float
        Of the group F-test, corrected for the searched shapes, but not yet for the number of candidates.
    values, stderr : array, shape (k,)
    judge, plain_judge : (Solved, Whitener)
        Solution and weights from which `direction` and `plain_direction` follow.
    outside : str
        Which parameter lies where physics does not allow it, and the bound; empty where none does.
    singular : bool
        Whether the model has its columns already.
    by_weights : bool
        Whether it was judged by the weights of the estimate instead of the prewhitened rows.
    plain_gain : float
        Fall of the sum of squares by the estimate's own weights.
    """

    candidate: Candidate
    group: Group
    gain: float
    score: float
    p_value: float
    values: Array
    stderr: Array
    judge: tuple[Solved, Whitener]
    outside: str = ""
    singular: bool = False
    by_weights: bool = False
    plain_gain: float = 0.0
    plain_judge: tuple[Solved, Whitener] | None = None

    @property
    def wrong_sign(self) -> bool:
        """Whether a parameter lies where physics does not allow it."""
        return bool(self.outside)

    @property
    def direction(self) -> Array:
        """The part of the residual that only it explains, whitened, shape (rows + priors,); computed at each access."""
        return direction_of(*self.judge, self.group)

    @property
    def plain_direction(self) -> Array:
        """The same by the estimate's own weights."""
        return direction_of(*(self.plain_judge or self.judge), self.group)

    def light(self) -> Trial:
        """Return the trial of an accepted effect without the model that it was judged by: it has no direction then."""
        solved, whitener = self.judge
        groups = tuple(replace(group, rows=()) for group in solved.model.groups)
        model = replace(solved.model, groups=groups, matrix=solved.model.matrix[:, :0].copy())
        return replace(self, judge=(replace(solved.bare(), model=model), whitener), plain_judge=None)

    def spared(self) -> Trial:
        """Return the trial without its columns as well."""
        return replace(self.light(), group=replace(self.group, rows=()))

    @property
    def at_bound(self) -> bool:
        """Whether a nonlinear parameter ran into its bound: the shape wants to be another one."""
        effect = self.candidate.effect
        return effect.structure.at_bound(effect, self.group.shape)


@dataclass(frozen=True, eq=False)
class Offer:
    """All candidates with their columns at every shape, and the Gram matrices of those with the model's.

    Attributes
    ----------
    candidates : tuple of (Candidate, groups)
    grams : arrays, shape (1 + p + columns, 1 + p + columns)
        Per balance, weighted: of the target, the model's columns and those of all groups that enter it.
    entering : int arrays, shape (p,)
        The model's columns in each balance.
    places : tuple of dict of balance to slice
        Per group, where its columns stand in the Gram matrix of a balance.
    """

    candidates: tuple[tuple[Candidate, tuple[Group, ...]], ...]
    grams: tuple[Array, ...]
    entering: tuple[NDArray[np.int64], ...]
    places: tuple[Mapping[int, slice], ...]

    def without_columns(self) -> Offer:
        """Return the offer without the columns; the Gram matrices stay."""
        bare = tuple((one, tuple(replace(group, rows=()) for group in some)) for one, some in self.candidates)
        return replace(self, candidates=bare)


def as_judged(record: Record, trial: Trial) -> Trial:
    """Return an offered trial with the columns by which it is judged, beside what the model holds.

    A long log's offer left all columns out, and some effects are judged by others than they are offered with.

    Parameters
    ----------
    record : Record
    trial : Trial
        As `try_all` returns it.
    """
    if trial.candidate.effect.structure.offered_apart:
        return try_candidate(record, *trial.judge, trial.candidate) or trial
    group = trial.group
    if not group.rows:
        group = candidate_groups(record, trial.candidate.effect, [group.shape])[0]
    return replace(trial, group=beside_held(group, trial.judge[0].model.responses))


def offer(record: Record, model: Model, candidates: Iterable[Candidate]) -> tuple[Offer, Saturated]:
    """Lay out all candidates, and return the residual of the model with all of them.

    Parameters
    ----------
    record : Record
    model : Model
    candidates : iterable of Candidate

    Returns
    -------
    offer : Offer
    left : Saturated
    """
    some = tuple(candidates)
    groups = groups_of_candidates(record, [(one.effect, one.grid) for one in some], offered=True)
    laid = tuple((one, tuple(own)) for one, own in zip(some, groups, strict=True))
    left = saturated(record, model, [group for _, some in laid for group in some])
    return Offer(laid, left.grams, left.entering, left.places), left


def try_all(laid: Offer, solved: Solved, weights: Whitener) -> list[Trial | None]:
    """Return every candidate at the best of its shapes, by the weights alone; None where it has no column.

    All products come from the Gram matrices.

    Parameters
    ----------
    laid : Offer
    solved : Solved
        By the weights.
    weights : Whitener
    """
    groups = [group for _, some in laid.candidates for group in some]
    counts = np.array([len(group.symbols) for group in groups], dtype=np.int64)
    starts = (np.cumsum(counts) - counts).tolist()
    total = int(counts.sum())
    grams = [np.zeros((k, k)) for k in counts.tolist()]
    beside, along = np.zeros((len(solved.values), total)), np.zeros(total)
    for row, (whole, inside) in enumerate(zip(laid.grams, laid.entering, strict=True)):
        power, end = weights.channels[row].sigma ** 2, 1 + len(inside)
        entering = [np.zeros(0, dtype=np.int64)]
        for gram, start, places in zip(grams, starts, laid.places, strict=True):
            if row in places:
                gram += whole[places[row], places[row]] / power
                entering.append(np.arange(start, start + len(gram)))
        columns = np.concatenate(entering)
        beside[np.ix_(inside, columns)] += whole[1:end, end:] / power
        along[columns] += (whole[end:, 0] - whole[end:, 1:end] @ solved.values[inside]) / power
    # the fit's basis is its whitened columns, and the priors, times `inverse`
    found = iter(added_each(grams, solved.inverse.T @ beside, along))
    return [
        _best_of(candidate, [(group, next(found)) for group in some], (solved, weights))
        for candidate, some in laid.candidates
    ]


def _best_of(
    candidate: Candidate, shapes: Sequence[tuple[Group, Added]], judge: tuple[Solved, Whitener]
) -> Trial | None:
    """Return the trial of the highest score, one of the right sign where there is any; None without a shape."""
    order = sorted(shapes, key=lambda shape: -_score(candidate, shape[0], shape[1], judge[0]))
    signed = (shape for shape in order if not shape[1].rank or not _outside(*shape, judge[0]))
    best = next(signed, order[0] if order else None)
    return None if best is None else tried(candidate, *best, judge)


def _score(candidate: Candidate, group: Group, own: Added, solved: Solved) -> float:
    """Return the gain less what the parameters cost; 0 for columns that the model has already."""
    price = float(np.log(max(len(solved.rest), 2)))
    return own.gain - (own.rank + len(candidate.free(group.shape))) * price if own.rank else 0.0


def try_candidate(record: Record, solved: Solved, whitener: Whitener, candidate: Candidate) -> Trial | None:
    """Return the candidate at the best of its shapes, or None when it has no column on this log."""
    groups = candidate_groups(record, candidate.effect, candidate.grid)
    groups = [beside_held(group, solved.model.responses) for group in groups]
    found = beyond_each(solved, whitener, groups)
    return _best_of(
        candidate, [(group, own) for group, (_, own) in zip(groups, found, strict=True)], (solved, whitener)
    )


def try_group(solved: Solved, whitener: Whitener, candidate: Candidate, group: Group) -> Trial:
    """Test one group of columns against the model."""
    return tried(candidate, group, beyond(solved, whitener, group)[1], (solved, whitener))


def tried(candidate: Candidate, group: Group, own: Added, judge: tuple[Solved, Whitener]) -> Trial:
    """Return the trial of a candidate.

    Parameters
    ----------
    candidate : Candidate
    group : Group
    own : Added
        What its columns explain beyond the model.
    judge : (Solved, Whitener)
        The model.
    """
    solved, k = judge[0], own.rank
    if k == 0:
        none = np.zeros(len(own.size))
        return Trial(candidate, group, 0.0, 0.0, 1.0, none, np.full(len(none), np.inf), judge, singular=True)
    score = _score(candidate, group, own, solved)
    p = f_tail(own.gain / k, k, max(solved.rows - solved.rank - k, 1)) * max(candidate.searched, 1)
    values = own.values
    return Trial(
        candidate, group, own.gain, score, min(1.0, p), values, own.stderr, judge, _outside(group, own, solved)
    )


def beyond(solved: Solved, whitener: Whitener, group: Group) -> tuple[Rows, Added]:
    """Return a group's whitened columns, and what they explain beyond the model."""
    return beyond_each(solved, whitener, [group])[0]


def beyond_each(
    solved: Solved, whitener: Whitener, groups: Sequence[Group], own_share: float = OWN_SHARE
) -> list[tuple[Rows, Added]]:
    """Return the whitened columns of several groups, and what each of them explains beyond the model.

    Parameters
    ----------
    solved : Solved
    whitener : Whitener
    groups : sequence of Group
    own_share : float
        A direction of which the model leaves less than this share is in the model already.
    """
    ends = np.cumsum([0, *(len(group.symbols) for group in groups)]).tolist()
    parts = [slice(*pair) for pair in itertools.pairwise(ends)]
    grams = [np.zeros((part.stop - part.start,) * 2) for part in parts]
    shared, along = np.zeros((solved.rank, ends[-1])), np.zeros(ends[-1])
    own: list[dict[int, Array]] = [{} for _ in groups]
    for row in range(len(solved.bases)):
        inside = [k for k, group in enumerate(groups) if group.rows[row] is not None]
        if not inside:
            continue
        white = whitener.part(
            row, np.concatenate([columns for k in inside if (columns := groups[k].rows[row]) is not None])
        )
        places = np.concatenate([np.arange(parts[k].start, parts[k].stop) for k in inside])
        shared[:, places] += solved.mixing[solved.parts[row]].T @ (solved.bases[row] @ white.T)
        along[places] += white @ solved.rest_of(row)
        end = 0
        for k in inside:
            own[k][row] = white[end : (end := end + len(grams[k]))]
            grams[k] += own[k][row] @ own[k][row].T
    found = added_each(grams, shared, along, own_share)
    return [(Rows(one, shared[:, part]), new) for one, part, new in zip(own, parts, found, strict=True)]


def whitened_rows(solved: Solved, rows: Rows, back: Array) -> list[Array]:
    """Return a group's own directions in every balance, shape (rank, n) each, and last the priors'."""
    mixed = solved.mixing @ (rows.shared @ back)
    out = []
    for row, (basis, part) in enumerate(zip(solved.bases, solved.parts, strict=True)):
        left = -mixed[part].T @ basis
        if row in rows.own:
            left += back.T @ rows.own[row]
        out.append(left)
    return [*out, -mixed[solved.parts[-1].stop :].T]


def direction_of(solved: Solved, whitener: Whitener, group: Group, own_share: float = OWN_SHARE) -> Array:
    """Return the part of the residual that only a group explains, whitened, shape (rows + priors,).

    Parameters
    ----------
    solved : Solved
    whitener : Whitener
    group : Group
    own_share : float
        As in `beyond_each`.
    """
    rows, own = beyond_each(solved, whitener, [group], own_share)[0]
    if own.rank == 0:
        return np.zeros(len(solved.rest))
    return np.concatenate([own.along @ part for part in whitened_rows(solved, rows, own.back)])


def plain_evidence(
    covariance: NoiseCovariance, candidate: Candidate, group: Group, found: tuple[Rows, Added] | None = None
) -> tuple[float, float]:
    """Return gain and p-value of the estimate by weighted least squares, its covariance that of correlated noise.

    Less powerful than the prewhitened test where a column is right at every frequency; where its fast part is not,
    as that of a differentiated current, the prewhitened estimate is drawn to zero and this one is not.

    Parameters
    ----------
    covariance : NoiseCovariance
        Of the fit by weighted least squares.
    candidate : Candidate
    group : Group
    found : (Rows, Added), optional
        What `beyond` returns of it and that fit, where it is known already.
    """
    plain = covariance.fit
    rows, own = beyond(plain, covariance.weights, group) if found is None else found
    k = own.rank
    if k == 0:
        return 0.0, 1.0
    spread = covariance.of_added(rows.own, rows.shared, own.back)
    gain = float(own.along @ np.linalg.solve(spread, own.along))
    p = f_tail(gain / k, k, max(plain.rows - plain.rank - k, 1)) * max(candidate.searched, 1)
    return gain, min(1.0, p)


def _outside(group: Group, own: Added, solved: Solved) -> str:
    """Return which linear parameter lies where physics does not allow it; not where rounding alone puts it there."""
    assert group.effect is not None
    bounds = group.effect.structure.bounds(group.effect, solved.known, group.shape)
    for symbol, value, size in zip(group.symbols, own.values.tolist(), own.size.tolist(), strict=True):
        low, high = bounds[symbol]
        slack = NEGLIGIBLE / max(size, 1e-300)
        if not low - slack <= value <= high + slack:
            return f"{symbol} at its bound {low if value < low else high:.3g}"
    return ""


def blocked_gain(
    record: Record, solved: Solved, whitener: Whitener, group: Group, direction: Array, memory: float,
    position: bool = False,
) -> Array:  # fmt: skip
    """Return the gains of left-out blocks, shape (blocks,); empty where too few can be judged.

    Contiguous blocks that hold equal shares of what the candidate could explain and of the samples; around each,
    samples within the gap (1 s, or less where the noise forgets sooner) are used neither to fit nor to judge. Of three
    records or more each is left out as a whole. Model and candidate are
    fitted again in the coordinates of their orthonormal directions, in which the priors stay what they are.

    Parameters
    ----------
    record : Record
    solved : Solved
    whitener : Whitener
    group : Group
    direction : array, shape (rows + priors,)
        What the candidate could explain, whitened.
    memory : float
        Of the noise, s.
    position : bool
        Whether parts of the way are left out, however often the axis passes them, in place of parts of the time.
    """
    rows, own = beyond(solved, whitener, group)
    balances, n = len(solved.bases), len(whitener.used)
    parts = whitened_rows(solved, rows, own.back)
    columns = np.empty((balances, n, 1 + solved.rank + own.rank))
    for row in range(balances):
        columns[row, :, 0] = solved.rest_of(row)
        columns[row, :, 1 : 1 + solved.rank] = solved.bases[row].T @ solved.mixing[solved.parts[row]]
        columns[row, :, 1 + solved.rank :] = parts[row].T
    full = np.eye(columns.shape[2])
    full[0, 0] = solved.chi2
    full[0, 1 + solved.rank :] = full[1 + solved.rank :, 0] = own.along
    t = record.t[whitener.used]
    explained = direction[: solved.rows].reshape(balances, n) ** 2
    if position:
        way = record.at_grid(record.signals["theta"])[whitener.used]
        order = np.argsort(way, kind="stable")
        edges = equal_blocks(explained[:, order], way[order], BLOCKS, EVEN)
        return left_out_gains(columns[:, order], full, way[order], edges, 0.0, solved.rank)[0]
    gap = min(LONGEST_GAP, max(GAP_MEMORIES * memory, GAP_PERIODS / record.prepared.cutoff))
    left_out = None
    if len(record.records) < FEWEST_RECORDS:
        edges = equal_blocks(explained, t, BLOCKS, EVEN)
    else:
        half = 0.5 * record.period
        spans = [(one.start - half, one.stop + half) for one in record.records]
        edges, left_out = record_blocks(explained, t, spans, BLOCKS)
    return left_out_gains(columns, full, t, edges, gap, solved.rank, left_out=left_out)[0]
