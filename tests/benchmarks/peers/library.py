"""What every peer is given of a log: the conditioned torque, the base columns, and the columns of the candidates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.fit import fit_design
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.policy import POLICY
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.log import Log
from pmsm_ctrl.plausibility import doubts_about
from pmsm_ctrl.regression.balances import STANDSTILL, Record, make_record
from pmsm_ctrl.regression.columns import Group, candidate_groups
from pmsm_ctrl.regression.conditioning import Processing
from pmsm_ctrl.regression.model import base_groups
from pmsm_ctrl.regression.modelled import with_modelled_torque

__all__ = ["Library", "base_torque", "generic", "held_out", "library_of", "read_alike", "relative"]

Array = NDArray[np.float64]

# Of a column, the share beside the base columns below which nothing of it is left to select.
NOTHING = 1e-3
# Products of signals that are a column of the catalogue under another name.
KNOWN = {
    "1": "constant_load", "direction*omega": "viscous_asymmetry", "omega*omega*direction": "quadratic_drag",
    "sin": "unbalance", "cos": "unbalance", "direction*sin": "position_dependent_friction",
    "direction*cos": "position_dependent_friction",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Library:
    """Rows of one log: weighted, masked, filtered and thinned as `pmsm_ctrl.diagnose` does it.

    Attributes
    ----------
    target : array, shape (n,)
        Measured torque.
    base : array, shape (n, b)
        Inertia, Coulomb and viscous friction, and what nuisances the base model of the diagnosis has. In every model.
    base_names : tuple of str
    names : tuple of str, one per column
        The effect that a column belongs to.
    columns : array, shape (n, k)
    free : dict of effect to int
        Nonlinear parameters that were searched for its columns.
    groups : dict of effect to Group
        Empty for a generic library.
    record : Record
    """

    target: Array
    base: Array
    base_names: tuple[str, ...]
    names: tuple[str, ...]
    columns: Array
    free: Mapping[str, int]
    groups: Mapping[str, Group]
    record: Record

    def beside_base(self) -> tuple[Array, Array]:
        """Return target and columns without their share of the base columns, each of rms 1.

        Source: R. Frisch, F. V. Waugh, Econometrica 1 (1933) 387: the regression on these has the same coefficients.
        """
        basis = _basis(self.base)
        left = self.columns - basis @ (basis.T @ self.columns)
        target = self.target - basis @ (basis.T @ self.target)
        return target / _rms(target), left / np.maximum(_rms(left), 1e-300)

    def solved(self, chosen: Iterable[str]) -> tuple[Array, Array]:
        """Return the coefficients of the base columns and of those of the chosen effects, by least squares."""
        chosen = set(chosen)
        inside = np.array([name in chosen for name in self.names], dtype=bool)
        a = np.column_stack([self.base, self.columns[:, inside]])
        size = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
        values = np.linalg.lstsq(a / size, self.target, rcond=1e-10)[0] / size
        return values, inside


def _rms(values: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _basis(columns: Array) -> Array:
    size = np.linalg.norm(columns, axis=0)
    u, s, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return np.asarray(u[:, s > 1e-8 * s[0]])


def _rows(record: Record, values: Array) -> Array:
    """Rows that take part, shape (n, ...), weighted."""
    out: Array = (np.atleast_2d(values) * record.weight[0] * record.mask)[:, record.mask].T
    return out


def _made(
    record: Record, base: tuple[Array, tuple[str, ...]], named: list[tuple[str, Array]],
    free: Mapping[str, int] | None = None, groups: Mapping[str, Group] | None = None,
) -> Library:  # fmt: skip
    target = _rows(record, record.target[0])[:, 0]
    basis = _basis(base[0])
    names, columns = [], []
    for name, part in named:
        for column in _rows(record, part).T:
            left = column - basis @ (basis.T @ column)
            if np.linalg.norm(left) > NOTHING * np.linalg.norm(column):
                names.append(name)
                columns.append(column)
    stacked = np.column_stack(columns) if columns else np.zeros((len(target), 0))
    return Library(target, *base, tuple(names), stacked, free or {}, groups or {}, record)


def library_of(design: Design, log: Log) -> Library:
    """Return the physical library: one group of columns per effect of the catalogue that enters the torque.

    Nonlinear parameters stand where the first round of the diagnosis puts them.
    """
    effects = catalogue_of(design)
    fit = fit_design(design, condition(design, log, (), effects, POLICY).record, (), effects)
    named, free, groups = [], {}, {}
    for trial in fit.trials:
        columns, effect = trial.group.rows[0], trial.candidate.effect.id
        if columns is not None and np.any(columns):
            named.append((effect, columns))
            free[effect], groups[effect] = len(trial.candidate.free(trial.group.shape)), trial.group
    return _made(fit.record, (_rows(fit.record, fit.model.matrix[0].T), fit.model.names), named, free, groups)


def generic(library: Library) -> Library:
    """Return the same rows with a library that knows no physics: products of the signals up to the third degree."""
    record, s = library.record, library.record.signals
    top, fast = np.quantile(np.abs(s["omega"]), 0.99), np.quantile(np.abs(s["alpha"]), 0.99)
    signals = {"omega": s["omega"] / top, "direction": s["direction"], "alpha": s["alpha"] / fast}
    if not record.linear:
        signals |= {"sin": np.sin(s["theta"]), "cos": np.cos(s["theta"])}
    one = np.ones(len(s["omega"]))
    found: dict[str, Array] = {"1": one}
    for degree, names in ((2, tuple(signals)), (3, ("omega", "direction"))):
        for size in range(1, degree + 1):
            for picked in combinations_with_replacement(names, size):
                if picked.count("direction") < 2:
                    found["*".join(picked)] = np.prod([signals[name] for name in picked], axis=0)
    known = {tuple(sorted(k.split("*"))): v for k, v in KNOWN.items()}
    base = {("omega",), ("direction",), ("alpha",)}
    named = []
    for name, values in found.items():
        key = tuple(sorted(name.split("*")))
        if key not in base:
            named.append((known.get(key, name), record.shaped(values)))
    return _made(record, (library.base, library.base_names), named)


def read_alike(design: Design, log: Log, record: Record) -> Record:
    """Return another log of the same axis, conditioned as the first one was."""
    same = Processing(standstill=STANDSTILL, cutoff=record.prepared.cutoff)
    return make_record(design, doubts_about(design, log).log, same, record.age_elsewhere, record.timing)


def held_out(library: Library, record: Record, chosen: Iterable[str]) -> float:
    """Return the relative torque error of a peer's model on another record, nothing fitted to it.

    Unweighted, over the samples that take part, as `pmsm_ctrl.regression.prediction.errors` does it.
    """
    values, inside = library.solved(chosen)
    count = library.base.shape[1]
    alone = dict(zip(library.base_names, library.solved(())[0].tolist(), strict=True))
    design = record.design
    acting = base_torque(design, record, alone, acting=True)
    record = with_modelled_torque(record, acting, library.record.late or 0.0)
    predicted = base_torque(design, record, dict(zip(library.base_names, values[:count].tolist(), strict=True)))
    names = [name for name, used in zip(library.names, inside, strict=True) if used]
    for name in dict.fromkeys(names):
        own = values[count:][[n == name for n in names]]
        columns = candidate_groups(record, library.groups[name].effect, [library.groups[name].shape])
        if not columns or columns[0].rows[0] is None or len(columns[0].rows[0]) != len(own):
            continue
        predicted += own @ columns[0].rows[0]
    return relative(record, predicted)


def base_torque(design: Design, record: Record, values: Mapping[str, float], acting: bool = False) -> Array:
    """Return what the base columns add up to on a record; a parameter that is not among the values counts as zero.

    Where it is `acting`, without what is only measured wrongly, as by a late sample.
    """
    model, _ = base_groups(design, record)
    known = np.array([values.get(name, 0.0) for name in model.names])
    for position, group in enumerate(model.groups):
        if acting and group.misread:
            known[model.columns_of(position)] = 0.0
    out: Array = model.matrix[0] @ known
    return out


def relative(record: Record, predicted: Array) -> float:
    """Return the rms of measured less predicted torque over the rms of the measured one."""
    used = record.mask
    left, size = record.target[0] - predicted, record.target[0]
    return float(np.sqrt(np.mean(left[used] ** 2) / np.mean(size[used] ** 2)))
