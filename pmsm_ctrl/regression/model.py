"""The base model: inertia, winding, and the design's own effects, on all balances of a log, solved by GLS."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.effects.structures.interface import Known
from pmsm_ctrl.evidence.whitening import Whitener
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import Group, UnavailableError, effect_group

__all__ = [
    "MOST_NOISE",
    "OWN",
    "Model",
    "Solved",
    "base_groups",
    "column_bounds",
    "noise_share",
    "solve_model",
    "spread",
    "with_honest_errors",
    "with_torque_held",
]

Array = NDArray[np.float64]

# How well the moments of reversal are known, all of them late or early alike: s, and samples of the log.
TURN, TURN_SAMPLES = 1e-4, 0.05
# Age of a speed that the drive filtered before it was logged, s.
FILTERED = 3e-3
# Share of a term of the torque that must be its own for it to be estimated.
OWN = 0.02
# From this share of noise in the acceleration on, the inertia is held at its nominal value, to within a share of it.
MOST_NOISE, HELD = 0.05, 0.01
# What the friction of an axis at rest hangs on: not on its load, its angle or its age.
DRY = frozenset(("omega", "direction", "p"))
FIXED = 1e-4  # share of a value within which it stays where it must not move


@dataclass(frozen=True, eq=False)
class Model:
    """Groups of columns with nominal values, tolerances and bounds of their parameters.

    Attributes
    ----------
    groups : tuple of Group
    names, nominal : one each per column
    sigma : array
        How far the value may lie from the nominal one, as a prior; infinite where nothing is known.
    """

    groups: tuple[Group, ...]
    names: tuple[str, ...]
    nominal: Array
    sigma: Array
    matrix: Array

    def plus(self, group: Group, prior: float = np.inf) -> Model:
        """Return a copy with one more group."""
        k = len(group.symbols)
        count = sum(n.split("#")[0] in group.symbols for n in self.names) // max(k, 1)
        names = tuple(f"{s}#{count + 1}" if count else s for s in group.symbols)
        return Model(
            (*self.groups, group),
            (*self.names, *names),
            np.concatenate([self.nominal, np.zeros(k)]),
            np.concatenate([self.sigma, np.full(k, prior)]),
            np.concatenate([self.matrix, group.values], axis=-1),
        )

    def group_of(self, column: int) -> Group:
        """Group that a column belongs to."""
        ends = np.cumsum([len(group.symbols) for group in self.groups])
        return self.groups[int(np.searchsorted(ends, column, side="right"))]

    def columns_of(self, position: int) -> slice:
        """Columns of the group at this position."""
        start = sum(len(g.symbols) for g in self.groups[:position])
        return slice(start, start + len(self.groups[position].symbols))


@dataclass(frozen=True, eq=False)
class Solved:
    """A model fitted to a record with a noise model.

    Attributes
    ----------
    values, stderr : array, shape (k,)
    q : array, shape (rows + priors, rank)
        Orthonormal basis of the whitened columns, priors included.
    rest : array, shape (rows + priors,)
        Whitened residual, priors included.
    """

    model: Model
    values: Array
    stderr: Array
    q: Array
    rest: Array
    rows: int
    inverse: Array  # parameters from the rows: values = inverse @ q' @ b

    def predicted(self, matrix: Array | None = None) -> Array:
        """Predicted balances, shape (channels, m)."""
        return (self.model.matrix if matrix is None else matrix) @ self.values

    # Read at every trial of a candidate.
    @cached_property
    def known(self) -> Known:
        """What the fit says of the axis, for the bounds that hang on it."""
        return known(self.model, self.values)

    @property
    def chi2(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(self.rest @ self.rest)


def base_groups(design: Design, record: Record) -> tuple[Model, tuple[str, ...]]:
    """Return the model of the design as it stands, and notes on effects that this log cannot evaluate."""
    groups: list[Group] = []
    nominal: list[float] = []
    sigma: list[float] = []
    tolerance = design.motor.tolerance
    alpha = record.stack({"torque": record.signals["alpha"]})[..., None]
    groups.append(Group(None, ("J",), alpha, {}))
    nominal.append(design.J)
    share = noise_share(record, alpha[0, :, 0])
    sigma.append((tolerance.get("J", 0.15) if share < MOST_NOISE else HELD) * design.J)
    if record.dry > 0.0:
        turning = record.stack({"torque": -record.dry * record.rate_of(record.signals["direction"])})
        groups.append(Group(None, ("tau_turn",), turning[..., None], {}))
        nominal.append(0.0)
        sigma.append(TURN + TURN_SAMPLES * record.period)
    if record.age is not None:
        late = record.stack({"torque": record.rate_of(record.signals["torque"])})
        groups.append(Group(None, ("tau_speed",), late[..., None], {}))
        nominal.append(0.0)
        sigma.append(FILTERED)
    if "u_d" in record.channels:
        _winding(design, record, groups, nominal, sigma)
    notes = []
    for entry, (effect, values) in enumerate(bound_effects(design)):
        if effect.structure.replaces_direction:
            continue
        try:
            group = effect_group(record, effect, effect.structure.shape(effect, values), entry)
        except UnavailableError as why:
            notes.append(f"the design's {effect.id} is left out: {why}")
            continue
        if not np.any(group.values):
            notes.append(f"the design's {effect.id} is never excited")
        groups.append(group)
        nominal += [values[s] for s in group.symbols]
        sigma += [np.inf] * len(group.symbols)
    names: list[str] = []
    for group in groups:
        for s in group.symbols:
            twins = sum(n.split("#")[0] == s for n in names)
            names.append(f"{s}#{twins + 1}" if twins else s)
    matrix = np.concatenate([g.values for g in groups], axis=-1)
    return Model(tuple(groups), tuple(names), np.array(nominal), np.array(sigma), matrix), tuple(notes)


def with_torque_held(record: Record, model: Model, least: float = 1.0) -> Model:
    """Hold the design's terms that read the torque, unless this share of each is its own beside the other columns.

    A friction that is a share of the torque explains all of it where the axis is driven one way only: with a share of
    one, and no inertia.
    """
    used = (record.weight[0] * record.mask)[:, None]
    rows = model.matrix[0] * used
    size = np.linalg.norm(rows, axis=0)
    rows = rows / np.where(size > 0.0, size, 1.0)
    sigma = model.sigma.copy()
    for k, nominal in enumerate(model.nominal.tolist()):
        effect = model.group_of(k).effect
        if effect is None or effect.enters != "torque" or "torque" not in effect.signals or nominal == 0.0:
            continue
        others = np.delete(rows, k, axis=1)
        left = rows[:, k] - others @ np.linalg.lstsq(others, rows[:, k], rcond=1e-9)[0]
        if float(np.linalg.norm(left)) <= least:
            sigma[k] = FIXED * abs(nominal)
    return replace(model, sigma=sigma)


def known(model: Model, values: Array) -> Known:
    """Return what the values of a model say of the axis, for the bounds that hang on it."""
    by_name = dict(zip(model.names, values.tolist(), strict=True))
    dry = 0.0
    for position, group in enumerate(model.groups):
        effect = group.effect
        if effect is None or not effect.dry or not DRY.issuperset(effect.signals):
            continue
        off = {p.symbol: 0.0 for p in effect.linear} | dict(group.shape)
        for symbol, value in zip(group.symbols, values[model.columns_of(position)].tolist(), strict=True):
            dry += abs(effect.standing({**off, symbol: value}))
    return Known(by_name["J"], by_name.get("F_c", 0.0), dry)


def column_bounds(model: Model, values: Array) -> list[tuple[float, float]]:
    """Return where the parameter of every column may lie; everywhere where it is no effect's."""
    found = known(model, values)
    out: list[tuple[float, float]] = []
    for group in model.groups:
        effect = group.effect
        bounds = {} if effect is None else effect.structure.bounds(effect, found)
        out += [bounds.get(symbol, (-np.inf, np.inf)) for symbol in group.symbols]
    return out


def noise_share(record: Record, alpha: Array) -> float:
    """Share of noise in the acceleration where it counts.

    Noise makes an estimated inertia too small by that share: where fast transients are all that accelerates the axis
    and the log's rate is too low for them, hardly anything else is left.
    """
    weight = (record.weight[0] * record.mask) ** 2
    return float(record.noise_of(alpha) ** 2 * np.sum(weight) / max(float(weight @ alpha**2), 1e-300))


TIMING = ("tau_u", "tau_frame")  # of the voltage command: its age, and the angle it was meant for


def _winding(design: Design, record: Record, groups: list[Group], nominal: list[float], sigma: list[float]) -> None:
    """Add R, L_d, L_q, psi_f and nuisances: age and angle of the voltage command, its sampling."""
    from pmsm_ctrl.kernels.balance import voltage_d, voltage_q

    s, motor = record.signals, design.motor
    assert motor.p is not None
    zero = np.zeros_like(s["omega"])
    i_d, i_q, di_d, di_q, w, p = s["i_d"], s["i_q"], s["di_d"], s["di_q"], s["omega"], float(motor.p)
    d, q = voltage_d.py_func, voltage_q.py_func
    parts = {
        # the balance is linear in these four: each column is the balance with that parameter 1 and the others 0
        "R": (d(1.0, 0.0, 0.0, p, i_d, i_q, di_d, w), q(1.0, 0.0, 0.0, p, 0.0, i_d, i_q, di_q, w)),
        "L_d": (d(0.0, 1.0, 0.0, p, i_d, i_q, di_d, w), q(0.0, 1.0, 0.0, p, 0.0, i_d, i_q, di_q, w)),
        "L_q": (d(0.0, 0.0, 1.0, p, i_d, i_q, di_d, w), q(0.0, 0.0, 1.0, p, 0.0, i_d, i_q, di_q, w)),
        "psi_f": (zero, q(0.0, 0.0, 0.0, p, 1.0, i_d, i_q, di_q, w)),
        "tau_u": (record.rate_of(s["u_d"]), record.rate_of(s["u_q"])),
        "tau_frame": (p * w * s["u_q"], -p * w * s["u_d"]),
        # the controller's answer to what is measured beyond the modelled current, noise above all
        # logs and drives share a clock: voltage is sampled just after the reference moved, always the same way
        "kappa_d": (di_d, zero),
        "kappa_q": (zero, di_q),
    }
    for name, (u_d, u_q) in parts.items():
        groups.append(Group(None, (name,), record.stack({"u_d": u_d, "u_q": u_q})[..., None], {}))
        if name in TIMING:
            nominal.append(0.0)
            sigma.append(2e-3)
        elif name.startswith("kappa"):
            nominal.append(0.0)
            sigma.append(np.inf)
        else:
            value = float(getattr(motor, name))
            nominal.append(value)
            sigma.append(motor.tolerance.get(name, 0.15) * value)


def with_honest_errors(solved: Solved, weights: Whitener, whitener: Whitener) -> Solved:
    """Return a fit by weighted least squares with standard errors that allow for the noise's correlation.

    With the weights V and the prewhitener W (W'W the inverse covariance) the estimate is ``P V y`` and its
    covariance ``P V (W'W)^-1 V' P'``; priors add their own unit variance.
    """
    P = solved.inverse @ solved.q.T
    covariance = spread(P.T, weights, whitener)
    return replace(solved, stderr=np.sqrt(np.maximum(np.diag(covariance), 0.0)))


def spread(weights_of: Array, weights: Whitener, whitener: Whitener) -> Array:
    """Covariance of sums of weighted rows, ``weights_of.T @ rows``, under the noise's correlation.

    Rows beyond the balances' are priors of unit variance.

    Parameters
    ----------
    weights_of : array, shape (rows + priors, k)

    Returns
    -------
    array, shape (k, k)
    """
    start = 0
    covariance = np.zeros((weights_of.shape[1],) * 2)
    for row, coarse in enumerate(weights.matrices):
        scale = np.asarray(coarse.sum(axis=1)).ravel()
        count = coarse.shape[0]
        block = weights_of[start : start + count] * np.where(scale > 0.0, scale, 0.0)[:, None]
        back = whitener.backward(row, block) if count else block
        covariance += back.T @ back
        start += count
    prior = weights_of[start:]
    return covariance + prior.T @ prior


def solve_model(record: Record, model: Model, whitener: Whitener) -> Solved:
    """Solve by generalised least squares with the parameters' tolerances as priors."""
    rows = whitener(model.matrix)
    known = np.isfinite(model.sigma)
    prior = np.diag(1.0 / model.sigma[known]) @ np.eye(len(model.sigma))[known]
    a = np.vstack([rows, prior])
    b = np.concatenate([whitener(record.target), model.nominal[known] / model.sigma[known]])
    scale = np.linalg.norm(a, axis=0)
    scale[scale == 0.0] = 1.0
    u, s, vt = np.linalg.svd(a / scale, full_matrices=False)
    kept = s > 1e-7 * s[0]
    u = u[:, kept]
    inverse = vt[kept].T / s[kept]
    values = inverse @ (u.T @ b) / scale
    stderr = np.sqrt(np.sum(inverse**2, axis=1)) / scale
    return Solved(model, values, stderr, u, b - u @ (u.T @ b), len(rows), inverse / scale[:, None])
