"""The filtered regression problem: what is explained, and the columns that may explain it.

``T_em - T_load = J alpha + sum of effect terms``. Building the problem is separate from solving it, so that the
diagnosis can add candidate columns and its own weighting.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.effects.evaluate import columns
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared, Processing, low_pass, prepare
from pmsm_ctrl.units import axis_unit

__all__ = ["Column", "Problem", "build_problem", "effect_columns", "nominal_torque", "term_signals"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Column:
    """One column of the regression.

    Attributes
    ----------
    name : str
        The parameter's symbol, with ``#2`` and so on for further instances of an effect.
    values : array, shape (m,)
        Filtered term per unit of the parameter.
    unit : str
        Unit of the parameter on this kind of axis.
    nominal, lower, upper : float
        The design's value and the effect's bounds.
    effect : str
        Id of the effect; empty for the inertia.
    entry : int
        Position among the design's effects; -1 where it is none of them.
    """

    name: str
    values: Array
    unit: str
    nominal: float
    lower: float = -np.inf
    upper: float = np.inf
    effect: str = ""
    entry: int = -1
    symbol: str = ""


@dataclass(frozen=True, eq=False)
class Problem:
    """Target and columns on the thinned grid of one log.

    Attributes
    ----------
    target : array, shape (m,)
        Filtered drive torque less load torque less the terms without linear parameters, N m (N).
    columns : tuple of Column
    mask : bool array, shape (m,)
        Samples that take part.
    inertia_cutoff : float or None
        As in `Processing`.
    t, omega, torque : array, shape (m,)
        Time, and filtered speed and drive torque for plots and for relative errors, nothing blanked.
    """

    target: Array
    columns: tuple[Column, ...]
    mask: Mask
    t: Array
    omega: Array
    torque: Array
    unit: str
    rate: float
    cutoff: float
    notes: tuple[str, ...] = ()
    inertia_cutoff: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    def matrix(self) -> Array:
        """Return the columns side by side, shape (m, number of columns)."""
        return np.column_stack([column.values for column in self.columns])

    def instruments(self) -> Array | None:
        """Return the columns with the acceleration in its narrower band, shape (m, columns), where it has one."""
        if self.inertia_cutoff is None or self.inertia_cutoff >= self.cutoff or "J" not in self.names:
            return None
        z, k = self.matrix(), self.names.index("J")
        z[:, k] = low_pass(z[:, k], self.rate, self.inertia_cutoff, steep=True)
        return z

    def with_columns(self, added: Iterable[Column]) -> Problem:
        """Return a copy with more columns."""
        return replace(self, columns=(*self.columns, *added))


def term_signals(design: Design, prepared: Prepared) -> dict[str, Array | float]:
    """Return the signals that terms may read: those of the log and the pole pairs."""
    signals: dict[str, Array | float] = dict(prepared.signals)
    if design.motor.p is not None:
        signals["p"] = float(design.motor.p)
    if prepared.acting is not None:
        signals["torque"] = prepared.acting
    return signals


def effect_columns(
    design: Design, prepared: Prepared, effect: Effect, parameters: Mapping[str, float], entry: int = -1
) -> tuple[tuple[Column, ...], Array]:
    """Return an effect's filtered columns, one per linear parameter, and its filtered remaining term, shape (m,).

    Raises
    ------
    LogError
        When the log lacks a signal that the term reads.
    """
    signals = term_signals(design, prepared)
    missing = [name for name in effect.signals if name not in signals]
    if missing:
        raise LogError(f"effect '{effect.id}' needs {', '.join(missing)}, which the log or the design does not have")
    parts, rest = columns(effect, signals, parameters)
    made = []
    for symbol, values in parts.items():
        known = effect.parameter(symbol)
        unit = axis_unit(known.unit, prepared.motion)
        nominal, filtered = parameters[symbol], prepared.column(values)
        made.append(Column(symbol, filtered, unit, nominal, known.lower, known.upper, effect.id, entry, symbol))
    return tuple(made), prepared.column(rest)


def build_problem(
    design: Design,
    log: Log | Prepared,
    *,
    processing: Processing | None = None,
    inertia: bool = True,
) -> Problem:
    """Build the inverse-dynamics regression of a design's torque effects on a log.

    Nonlinear parameters are held at the design's values.

    Parameters
    ----------
    inertia : bool
        Whether the inertia is a column; otherwise ``J alpha`` with the design's J is subtracted from the target.
    """
    prepared = log if isinstance(log, Prepared) else prepare(design, log, processing)
    if prepared.acting is None and any(_reads_torque(effect) for effect, _ in bound_effects(design)):
        prepared = replace(prepared, acting=_acting(design, prepared))
    target = prepared.column(prepared.signals["torque"])
    if "T_load" in prepared.signals:
        target -= prepared.column(prepared.signals["T_load"])
    acceleration = prepared.column(prepared.alpha)
    made: list[Column] = []
    notes = list(prepared.notes)
    if inertia:
        unit = axis_unit("kg m^2", prepared.motion)
        made.append(Column("J", acceleration, unit, design.J, lower=0.0, symbol="J"))
    else:
        target -= design.J * acceleration
    for index, (effect, parameters) in enumerate(bound_effects(design)):
        if effect.enters != "torque":
            continue  # `prepare` has undone what the catalogue knows to falsify a channel; no voltage is balanced here
        if effect.structure != "term":
            notes.append(
                f"{effect.id} has a state of its own and takes no part in the regression: output_error knows it"
            )
            continue
        parts, rest = effect_columns(design, prepared, effect, parameters, index)
        target -= rest
        for part in parts:
            twins = sum(column.symbol == part.symbol for column in made)
            made.append(replace(part, name=f"{part.symbol}#{twins + 1}") if twins else part)
    return Problem(
        target=target,
        columns=tuple(made),
        mask=prepared.mask,
        t=prepared.t[prepared.keep],
        omega=prepared.smooth(prepared.signals["omega"]),
        torque=prepared.smooth(prepared.signals["torque"]),
        unit=axis_unit("N m", prepared.motion),
        rate=prepared.thinned_rate,
        cutoff=prepared.cutoff,
        inertia_cutoff=prepared.inertia_cutoff,
        notes=tuple(notes),
    )


def _reads_torque(effect: Effect) -> bool:
    return effect.enters == "torque" and effect.structure == "term" and "torque" in effect.signals


def _acting(design: Design, prepared: Prepared) -> Array:
    """Return the drive torque that the motion takes, shape (n,), for terms that are a share of it.

    The measured torque holds its own noise, and in a regression it would explain itself: friction by load with a share
    of one, and no inertia. So the other parameters are fitted first, those terms as the design has them, and then again
    with what that gives.
    """
    signals = prepared.signals
    measured = signals["torque"]
    acting, load = measured, signals.get("T_load", np.zeros_like(measured))
    for _ in range(2):
        known = term_signals(design, replace(prepared, acting=acting))
        free, fixed = [prepared.alpha], load.copy()
        for effect, parameters in bound_effects(design):
            if effect.enters != "torque" or effect.structure != "term" or any(s not in known for s in effect.signals):
                continue
            parts, rest = columns(effect, known, parameters)
            fixed += rest
            if _reads_torque(effect):
                fixed += sum(parameters[symbol] * part for symbol, part in parts.items())
            else:
                free += list(parts.values())
        rows = np.column_stack([prepared.column(part) for part in free])[prepared.mask]
        size = np.linalg.norm(rows, axis=0)
        size[size == 0.0] = 1.0
        target = prepared.column(measured - fixed)[prepared.mask]
        values = np.linalg.lstsq(rows / size, target, rcond=1e-9)[0] / size
        acting = fixed + sum(value * part for value, part in zip(values.tolist(), free, strict=True))
    return acting


def nominal_torque(problem: Problem) -> Array:
    """Return what the design's own values explain of the target, shape (m,), without any fit."""
    return problem.matrix() @ np.array([column.nominal for column in problem.columns])
