"""The base model: inertia, winding, and the design's own effects, on all balances of a log, solved by GLS."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.effects.structures.interface import Known
from pmsm_ctrl.evidence.linalg import factored, occupied, orthonormal_rows
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record, Rows
from pmsm_ctrl.regression.columns import Group, UnavailableError, effect_group
from pmsm_ctrl.regression.drive_timing import stated_within
from pmsm_ctrl.regression.encoder_lines import line_swings
from pmsm_ctrl.regression.records import level_groups
from pmsm_ctrl.regression.sampling_terms import (
    Term,
    coupled_terms,
    instant_terms,
    saliency_terms,
    sampling_terms,
    speed_terms,
)
from pmsm_ctrl.regression.slow_inertia import slow_inertia
from pmsm_ctrl.regression.two_stage import HeldResponse

__all__ = [
    "FIXED",
    "LOAD_SCALE",
    "MOST_NOISE",
    "OWN",
    "TURNING",
    "Model",
    "Solved",
    "base_groups",
    "known",
    "noise_share",
    "solve_model",
    "solve_on_factors",
]

Array = NDArray[np.float64]

# How well the moments of reversal are known, all of them late or early alike: s, and samples of the log.
TURNING, TURN, TURN_SAMPLES = "tau_turn", 1e-4, 0.05
# Share by which the torque constant is too large beside a known load, which another sensor measured.
LOAD_SCALE = "kappa_load"
# Share of a term of the torque that must be its own for it to be estimated.
OWN = 0.02
TWIN = 1e-6  # share of its length that a column has beside those before it, below which the two are one
MOST_NOISE, HELD = 0.05, 0.01  # share of noise in the acceleration from which on the inertia is held, to within a share
# What the friction of an axis at rest hangs on: not on its load, its angle or its age.
DRY = frozenset(("omega", "direction", "p"))
FIXED = 1e-4  # share of a value within which it stays where it must not move
# Tolerance of a datasheet's value where the design states none.
TOLERANCE = 0.15
# Age, s, and angle over speed, s, of the voltage command: a few control periods at most.
COMMAND = 2e-3
TIMING = ("tau_u", "tau_frame")
# Angle by which the drive's d axis leads the magnets': commutation is aligned to a degree or two, rad (electrical). The
# encoder's steps, half of which it lags, are less. The torque falls by half its square, which no log tells.
ALIGNMENT, ALIGNED = "delta_frame", 0.05
ANSWER = ("kappa_d", "kappa_q")  # of the controller to noise: nothing is known of it


@dataclass(frozen=True, eq=False)
class Model:
    """Groups of columns with nominal values, tolerances and bounds of their parameters.

    Attributes
    ----------
    groups : tuple of Group
    names, nominal : one each per column
    sigma : array
        Standard deviation of the prior around the nominal value; infinite without a prior.
    matrix : array, shape (balances, m, columns)
    doubt : dict of column to float
        Standard deviation of a nominal value at which a parameter is held, where that is not `sigma`.
    bias : dict of column to float
        Possible bias of least squares, by an unbiased estimate from the same log.
    responses : tuple of HeldResponse
        Responses of the parameters that are held at a value by instruments.
    """

    groups: tuple[Group, ...]
    names: tuple[str, ...]
    nominal: Array
    sigma: Array
    matrix: Array
    doubt: Mapping[int, float] = field(default_factory=dict)
    bias: Mapping[int, float] = field(default_factory=dict)
    responses: tuple[HeldResponse, ...] = ()

    @classmethod
    def of(cls, groups: Sequence[Group], names: tuple[str, ...], nominal: Array, sigma: Array) -> Model:
        """Put groups side by side; their columns are kept once, in the matrix.

        Parameters
        ----------
        groups : sequence of Group
        names : tuple of str
        nominal, sigma : array, shape (k,)
        """
        m = next(columns.shape[1] for _, columns in groups[0].entering)
        stored = np.empty((len(groups[0].rows), len(nominal), m))  # a column's samples side by side
        views, end = [], 0
        for group in groups:
            own = slice(end, end := end + len(group.symbols))
            for row, columns in enumerate(group.rows):
                stored[row, own] = 0.0 if columns is None else columns
            rows = tuple(None if columns is None else stored[row, own] for row, columns in enumerate(group.rows))
            views.append(replace(group, rows=rows))
        return cls(tuple(views), names, nominal, sigma, stored.swapaxes(1, 2))

    def plus(self, group: Group, prior: float = np.inf) -> Model:
        """Return a copy with one more group, whose values are known to within `prior`."""
        k = len(group.symbols)
        count = sum(n.split("#")[0] in group.symbols for n in self.names) // max(k, 1)
        names = tuple(f"{s}#{count + 1}" if count else s for s in group.symbols)
        nominal, sigma = np.concatenate([self.nominal, np.zeros(k)]), np.concatenate([self.sigma, np.full(k, prior)])
        made = Model.of((*self.groups, group), (*self.names, *names), nominal, sigma)
        return replace(made, doubt=self.doubt, bias=self.bias, responses=self.responses)

    # Read in every fit, some times.
    @cached_property
    def entering(self) -> tuple[NDArray[np.int64], ...]:
        """The columns that enter each balance."""
        return tuple(occupied(matrix.T) for matrix in self.matrix)

    @property
    def prior_doubt(self) -> Array:
        """Standard deviations of the priors, in units of those that they are solved with, shape (priors,)."""
        known = np.flatnonzero(np.isfinite(self.sigma)).tolist()
        return np.array([self.doubt.get(k, self.sigma[k]) / self.sigma[k] for k in known])

    def group_of(self, column: int) -> Group:
        """Group that a column belongs to."""
        ends = np.cumsum([len(group.symbols) for group in self.groups])
        return self.groups[int(np.searchsorted(ends, column, side="right"))]

    def as_stated(self, column: int) -> bool:
        """Whether a parameter of the design's own effects is held where the design has it: none of them has a prior."""
        return self.group_of(column).entry >= 0 and bool(np.isfinite(self.sigma[column]))

    def columns_of(self, position: int) -> slice:
        """Columns of the group at this position."""
        start = sum(len(g.symbols) for g in self.groups[:position])
        return slice(start, start + len(self.groups[position].symbols))


@dataclass(frozen=True, eq=False)
class Solved:
    """A model fitted to a record with a noise model, in the factors of its whitened columns.

    Attributes
    ----------
    model : Model
    values, stderr : array, shape (k,)
    rest : array, shape (rows + priors,)
        Whitened residual, priors included.
    rows : int
        Of all balances, without the priors.
    inverse : array, shape (k, rank)
        The values are ``inverse @ q.T @ target``.
    bases : arrays of shape (p, n)
        Orthonormal rows that span the whitened columns of each balance.
    mixing : array, shape (sum of p + priors, rank)
        The orthonormal basis of all balances and priors together, in those of each.
    triangle : array, shape (sum of p + priors, k)
        The whitened columns in the bases of the balances, and the priors.
    along : array, shape (sum of p + priors,)
        The target in them.
    held : dict of column to float
        Parameters that were held at a bound, and that bound.
    """

    model: Model
    values: Array
    stderr: Array
    rest: Array
    rows: int
    inverse: Array
    bases: tuple[Array, ...]
    mixing: Array
    triangle: Array
    along: Array
    held: Mapping[int, float] = field(default_factory=dict)

    @property
    def rank(self) -> int:
        """Directions of the model."""
        return int(self.mixing.shape[1])

    # Read at every trial of a candidate.
    @cached_property
    def parts(self) -> tuple[slice, ...]:
        """Rows of `mixing` that belong to each balance."""
        ends = np.cumsum([len(basis) for basis in self.bases]).tolist()
        return tuple(slice(end - len(basis), end) for basis, end in zip(self.bases, ends, strict=True))

    def rest_of(self, row: int) -> Array:
        """Whitened residual of one balance, shape (n,)."""
        n = self.bases[row].shape[1]
        return self.rest[row * n : (row + 1) * n]

    def factors_of(self, row: int, model: Model) -> tuple[Array, Array] | None:
        """Basis and triangle of one balance for another model; None where that has other columns in it."""
        own, inside = self.model.entering[row], model.entering[row]
        if not self.bases or not np.array_equal(own, inside):
            return None
        if not np.array_equal(self.model.matrix[row].T[own], model.matrix[row].T[inside]):
            return None
        return self.bases[row], self.triangle[self.parts[row]][:, own]

    def predicted(self, matrix: Array | None = None) -> Array:
        """Predicted balances, shape (channels, m)."""
        return (self.model.matrix if matrix is None else matrix) @ self.values

    def bare(self) -> Solved:
        """Return values and standard errors alone: bases and residual of a long log are large."""
        return replace(self, rest=self.rest[:0], bases=())

    # Read at every trial of a candidate.
    @cached_property
    def known(self) -> Known:
        """What the fit says of the axis, for the bounds that hang on it."""
        return known(self.model, self.values)

    @property
    def chi2(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.rest @ self.rest)


def base_groups(
    design: Design, record: Record, settled: bool = True, further: Sequence[Group] = ()
) -> tuple[Model, tuple[str, ...]]:
    """Return the model of the design as it stands, and notes on effects that this log cannot evaluate.

    Parameters
    ----------
    design : Design
    record : Record
    settled : bool
        Whether a filter of the drive signal was undone already, if there was one.
    further : sequence of Group
        Of effects beside those of the design; they come last.
    """
    terms = [*_motion_terms(design, record), *(_winding(design, record) if "u_d" in record.channels else ())]
    timing = list(sampling_terms(record, settled) if record.age is None else speed_terms(record, record.age, settled))
    swung = [*instant_terms(record), *coupled_terms(record), *saliency_terms(record)]
    of_torque = [term for term in (*timing, *swung) if term.modelled]
    measured = [*terms, *(term for term in (*timing, *swung) if not term.modelled)]
    # what follows from a modelled torque is filtered already
    columns = _columns_of(record, measured) | _columns_of(record, of_torque, record.late is not None)
    groups = [Group(None, (term.name,), columns[term.name], {}) for term in terms]
    misread = record.age is None  # an old speed says when the torque acts, and nothing wrong of the torque
    groups += [Group(None, (term.name,), columns[term.name], {}, sampling=misread) for term in timing]
    groups += [Group(None, (term.name,), columns[term.name], {}, sampling=True) for term in swung]
    terms += [*timing, *swung]
    nominal, sigma, doubt = [term.nominal for term in terms], [term.sigma for term in terms], {}
    if noise_share(record, record.acceleration(), record.shaft_noise()) >= MOST_NOISE:
        nominal[0], doubt[0] = slow_inertia(design, record, sigma[0])
        sigma[0] = HELD * nominal[0]
    notes = []
    for entry, (effect, values) in enumerate(bound_effects(design)):
        if effect.structure.replaces_direction:
            continue
        try:
            group = effect_group(record, effect, effect.structure.shape(effect, values), entry)
        except UnavailableError as why:
            notes.append(f"{effect.id} of the design is not part of the model: {why}")
            continue
        if not any(np.any(columns) for _, columns in group.entering):
            notes.append(f"{effect.id} of the design is not excited by this motion")
        groups.append(group)
        nominal += [values[s] for s in group.symbols]
        sigma += [np.inf] * len(group.symbols)
    for group, spread in (*level_groups(record), *((group, np.inf) for group in further)):
        groups.append(group)
        nominal += [0.0] * len(group.symbols)
        sigma += [spread] * len(group.symbols)
    names: list[str] = []
    for group in groups:
        for s in group.symbols:
            twins = sum(n.split("#")[0] == s for n in names)
            names.append(f"{s}#{twins + 1}" if twins else s)
    model = Model.of(groups, tuple(names), np.array(nominal), np.array(sigma))
    return replace(model, doubt=doubt), tuple(notes)


def _columns_of(record: Record, terms: Sequence[Term], filtered: bool = False) -> dict[str, Rows]:
    """Return the columns of terms, filtered side by side; what follows from the motion alone is remembered."""
    known = {term.name: (term.kept, term.name) for term in terms if not term.modelled}
    out: dict[str, Rows] = {name: record.kept[key] for name, key in known.items() if key in record.kept}
    missing = [term for term in terms if term.name not in out]
    parts = [term.parts() for term in missing]
    stacked = record.stack_all(parts, filtered)
    for k, (term, part) in enumerate(zip(missing, parts, strict=True)):
        rows = tuple(
            columns[k : k + 1].copy() if columns is not None and name in part else None
            for name, columns in zip(record.channels, stacked, strict=True)
        )
        out[term.name] = rows
        if term.name in known:
            record.kept[known[term.name]] = rows
    return out


def _motion_terms(design: Design, record: Record) -> Iterator[Term]:
    """Inertia, and what is not known of the moments of reversal, of a known load and of the encoder's lines."""
    s, tolerance = record.signals, design.tolerance("J", TOLERANCE)
    yield Term("J", lambda: {"torque": s["alpha"]}, design.J, tolerance * design.J)
    if record.dry > 0.0:
        yield Term(
            TURNING, lambda: {"torque": -record.dry * record.rate_of(s["direction"])}, 0.0,
            TURN + TURN_SAMPLES * record.period, kept="turning",
        )  # fmt: skip
    for at in record.changes:
        yield Term(f"dF_c at {at:.4g} s", partial(_changed, record, at), 0.0, np.inf, kept="turning")
    if "T_load" in s and np.ptp(s["T_load"]) > 0.0:
        yield Term(LOAD_SCALE, lambda: {"torque": s["T_load"]}, 0.0, design.motor.tolerance_of("psi_f", TOLERANCE))
    for lines in record.lines:
        for number, wave in enumerate(("sin", "cos")):
            yield Term(f"{wave} {lines}", partial(_line_error, record, lines, number), 0.0, 1.0)


def _line_error(record: Record, lines: int, number: int) -> Mapping[str, Array]:
    """Sine or cosine of the error of the encoder's lines, as large as it may be."""
    return {"torque": line_swings(record, lines)[number]}


def _changed(record: Record, at: float) -> Mapping[str, Array]:
    """Dry friction from a time on, s."""
    return {"torque": record.signals["direction"] * (record.prepared.t >= at)}


def known(model: Model, values: Array) -> Known:
    """Return what the values of a model say of the axis, for the bounds that hang on it."""
    F_c = dry = 0.0
    for position, group in enumerate(model.groups):
        effect = group.effect
        if effect is None or not effect.dry or not DRY.issuperset(effect.signals):
            continue
        off = {p.symbol: 0.0 for p in effect.linear} | dict(group.shape)
        for symbol, value in zip(group.symbols, values[model.columns_of(position)].tolist(), strict=True):
            dry += abs(effect.standing({**off, symbol: value}))
            F_c += value if effect.id == "coulomb" else 0.0
    return Known(float(values[model.names.index("J")]), F_c, dry)


def noise_share(record: Record, alpha: Array, noise: float | None = None) -> float:
    """Share of noise in the acceleration where it counts: noise makes an estimated inertia too small by that share."""
    weight, noise = (record.weight[0] * record.mask) ** 2, record.noise_of(alpha) if noise is None else noise
    return float(noise**2 * np.sum(weight) / max(float(weight @ alpha**2), 1e-300))


def _winding(design: Design, record: Record) -> Iterator[Term]:
    """R, L_d, L_q, psi_f and nuisances: age and angle of the voltage command, its sampling."""
    from pmsm_ctrl.kernels.balance import voltage_d, voltage_q

    s, motor = record.signals, design.motor
    assert motor.p is not None
    zero = np.zeros_like(s["omega"])
    i_d, i_q, di_d, di_q = s["i_d"], s["i_q_wide"], s["di_d"], s["di_q_wide"]
    w, p = s["omega"], float(motor.p)
    d, q = voltage_d.py_func, voltage_q.py_func

    def per_unit(R: float, L_d: float, L_q: float, psi_f: float) -> Mapping[str, Array]:
        # the balance is linear in these four: each column is the balance with that parameter 1 and the others 0
        u_d = d(R, L_d, L_q, p, i_d, i_q, di_d, w) if not psi_f else zero
        return {"u_d": u_d, "u_q": q(R, L_d, L_q, p, psi_f, i_d, i_q, di_q, w)}

    parts: dict[str, tuple[Callable[[], Mapping[str, Array]], bool]] = {
        "R": (lambda: per_unit(1.0, 0.0, 0.0, 0.0), True),
        "L_d": (lambda: per_unit(0.0, 1.0, 0.0, 0.0), False),
        "L_q": (lambda: per_unit(0.0, 0.0, 1.0, 0.0), True),
        "psi_f": (lambda: per_unit(0.0, 0.0, 0.0, 1.0), False),
        "tau_u": (lambda: {"u_d": record.rate_of(s["u_d"]), "u_q": record.rate_of(s["u_q"])}, False),
        "tau_frame": (lambda: {"u_d": p * w * s["u_q"], "u_q": -p * w * s["u_d"]}, False),
        ALIGNMENT: (lambda: {"u_d": p * w * float(motor.psi_f or 0.0)}, False),
        # the controller's answer to what is measured beyond the modelled current, noise above all
        # logs and drives share a clock: voltage is sampled just after the reference moved, always the same way
        "kappa_d": (lambda: {"u_d": di_d}, False),
        "kappa_q": (lambda: {"u_q": di_q}, True),
    }
    for name, (part, modelled) in parts.items():
        nominal, sigma = 0.0, np.inf
        if name in TIMING:
            sigma = stated_within(record.design, record.period) if record.design.log.of("u_q").stated else COMMAND
        elif name == ALIGNMENT:
            sigma = ALIGNED
        elif name not in ANSWER:
            nominal = float(getattr(motor, name))
            sigma = motor.tolerance_of(name, TOLERANCE) * nominal
        yield Term(name, part, nominal, sigma, modelled)
    for row, found in record.prepared.swings.items():
        for signal, swing in zip(("omega", "alpha"), found, strict=True):
            if swing > 0.0:
                yield Term(f"{row} in step by {signal}", partial(_of_signal, record, row, signal), 0.0, swing)


def _of_signal(record: Record, row: str, signal: str) -> Mapping[str, Array]:
    """A signal in one balance."""
    return {row: record.signals[signal]}


def solve_model(record: Record, model: Model, whitener: Whitener, like: Solved | None = None) -> Solved:
    """Solve by generalised least squares with the parameters' tolerances as priors.

    The whitened columns of each balance are factored, and the model is solved on the triangular factors.

    Parameters
    ----------
    record : Record
    model : Model
    whitener : Whitener
    like : Solved, optional
        Another model solved with the same whitener: its factors serve in the balances in which both have the same
        columns.
    """
    count = len(model.sigma)
    bases, triangles, along, rest = [], [], [], []
    for row, matrix in enumerate(model.matrix):
        shared = None if like is None else like.factors_of(row, model)
        basis, triangle = shared or orthonormal_rows(whitener.part(row, matrix.T[model.entering[row]]))
        full = np.zeros((len(triangle), count))
        full[:, model.entering[row]] = triangle
        bases.append(basis)
        triangles.append(full)
        target = whitener.part(row, record.target[row])
        along.append(bases[-1] @ target)
        rest.append(target)
    known = np.isfinite(model.sigma)
    prior = np.diag(1.0 / model.sigma[known]) @ np.eye(count)[known]
    triangle = np.vstack([*triangles, prior])
    b = np.concatenate([*along, model.nominal[known] / model.sigma[known]])
    return solve_on_factors(model, triangle, b, tuple(bases), rest)


def solve_on_factors(
    model: Model, triangle: Array, along: Array, bases: tuple[Array, ...], target: Sequence[Array],
    held: Mapping[int, float] | None = None,
) -> Solved:  # fmt: skip
    """Solve on the triangular factors.

    Parameters
    ----------
    model : Model
    triangle, along : array
        As in `Solved`.
    bases : arrays of shape (p, n)
        As in `Solved`.
    target : arrays of shape (n,)
        Whitened, per balance.
    held : dict of column to float, optional
        Parameters that stay at these values.
    """
    held = held or {}
    values = np.zeros(len(model.sigma))
    at, free = list(held), [k for k in range(len(values)) if k not in held]
    values[at] = list(held.values())
    factor = factored(triangle[:, free])
    inverse = np.zeros((len(values), factor.basis.shape[1]))
    inverse[free] = factor.inverse
    fixed = triangle[:, at] @ values[at]
    on_basis = factor.basis.T @ (along - fixed)
    predicted = fixed + factor.basis @ on_basis
    values = values + inverse @ on_basis
    stderr = np.sqrt(np.sum(inverse**2, axis=1))
    stderr[at] = np.nan
    rest, start = [], 0
    for whole, basis in zip(target, bases, strict=True):
        rest.append(whole - predicted[start : start + len(basis)] @ basis)
        start += len(basis)
    rows = sum(len(one) for one in rest)
    whole = np.concatenate([*rest, along[start:] - predicted[start:]])
    return Solved(model, values, stderr, whole, rows, inverse, bases, factor.basis, triangle, along, held)
