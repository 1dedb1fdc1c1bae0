"""The inverse-dynamics regression of one log: the torque balance, and a column for each of its parameters.

``T_em - T_load = J alpha + sum of effect terms``, every column through the same zero-phase filter. Source of the
method: M. Gautier, A. Janot, P. O. Vandanjon, IEEE Trans. Control Syst. Technol. 21 (2013) 428.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.effects.evaluate import columns
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.evidence.linalg import factored
from pmsm_ctrl.log import Log
from pmsm_ctrl.regression.conditioning import Prepared, Processing, prepare
from pmsm_ctrl.regression.drive_timing import LATENESS, SPREAD, sampling_columns
from pmsm_ctrl.regression.filters import low_pass
from pmsm_ctrl.regression.notices import NO_REGRESSION
from pmsm_ctrl.regression.signals import missing_signals, term_signals
from pmsm_ctrl.section import Notice
from pmsm_ctrl.units import axis_unit

__all__ = ["Column", "Problem", "build_problem"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# Share of the band in which the time of sampling is looked for.
SAMPLING_BAND = 0.5


@dataclass(frozen=True, eq=False)
class Column:
    """One parameter of the regression.

    Attributes
    ----------
    name : str
        The symbol, with ``#2`` and so on for further instances of an effect.
    values : array, shape (m,)
        Filtered term per unit of the parameter.
    unit : str
    nominal, lower, upper : float
        The design's value and the effect's bounds.
    effect, symbol : str
        Id of the effect, empty for the inertia, and the parameter's symbol.
    entry : int
        Position among the design's effects; -1 where it is none of them.
    sigma : float
        Of a nuisance parameter, how far it may lie from `nominal`: a standard deviation. Infinite for all others.
    held : bool
        Whether a parameter stays where it is expected, as uncertain as `sigma` or `prior` says.
    prior : (float, float) or None
        Of a parameter of the axis, its value from elsewhere, and the standard error of that.
    bias : float
        By how much least squares may be off in this parameter.
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
    sigma: float = np.inf
    held: bool = False
    prior: tuple[float, float] | None = None
    bias: float = 0.0

    @property
    def expected(self) -> tuple[float, float] | None:
        """Value near which the parameter lies, and its standard deviation; None where nothing is known of it."""
        return (self.nominal, self.sigma) if self.is_nuisance else self.prior

    @property
    def is_nuisance(self) -> bool:
        """Whether this says how the log was sampled, and not what acts on the axis."""
        return bool(np.isfinite(self.sigma))

    @property
    def is_inertia(self) -> bool:
        """Whether this is the axis' own inertia, and no parameter of an effect."""
        return self.entry < 0 and self.symbol == "J"

    def clipped(self, value: float) -> float:
        """Return the value, moved inside the bounds of the parameter."""
        return float(min(max(value, self.lower), self.upper))


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
    t, omega, torque : array, shape (m,)
        Time in s, and filtered speed and drive torque, nothing blanked.
    unit : str
        Of the target.
    rate, cutoff : float
        Of the thinned grid and of the low-pass, Hz.
    notes : tuple of Notice
    inertia_cutoff : float or None
        As in `Processing`.
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
    notes: tuple[Notice, ...] = ()
    inertia_cutoff: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    @property
    def nominal(self) -> Array:
        """What the design's own values explain of the target, shape (m,), without any fit."""
        nominal: Array = self.matrix() @ np.array([column.nominal for column in self.columns])
        return nominal

    @property
    def inertia(self) -> int | None:
        """Number of the inertia's column; None where the inertia is held."""
        return next((k for k, column in enumerate(self.columns) if column.is_inertia), None)

    def matrix(self) -> Array:
        """Return the columns side by side, shape (m, number of columns)."""
        if not self.columns:  # all of them are held at their bounds
            return np.zeros((len(self.target), 0))
        return np.column_stack([column.values for column in self.columns])

    @property
    def physical(self) -> Mask:
        """Which columns are parameters of the axis, and no nuisances."""
        return np.array([not column.is_nuisance for column in self.columns], dtype=bool)

    @property
    def physical_names(self) -> tuple[str, ...]:
        """Names of the columns that are no nuisances."""
        return tuple(column.name for column in self.columns if not column.is_nuisance)

    def instruments(self) -> Array | None:
        """Return what the columns are known by, shape (m, columns): None where that is the columns themselves.

        The acceleration in its narrower band, where it has one. How the drive signal was sampled in a part of the band,
        no wider than that: its columns are derivatives of the acceleration, and the drive answers the noise of that.
        """
        own = self.inertia_cutoff is not None and self.inertia_cutoff < self.cutoff
        narrow = self.inertia_cutoff if own and self.inertia_cutoff is not None else self.cutoff
        slow = min(SAMPLING_BAND * self.cutoff, narrow)
        timed = {k for k, column in enumerate(self.columns) if column.symbol in (LATENESS, SPREAD)}
        bands = {k: slow for k in timed if not self.columns[k].held}
        if own and self.inertia is not None:
            bands[self.inertia] = narrow
        if not bands:
            return None
        z = self.matrix()
        for k, band in bands.items():
            z[:, k] = low_pass(z[:, k], self.rate, band, steep=True)
        return z


@dataclass(frozen=True, eq=False)
class _Term:
    """A torque effect of the design over one log, at the log's rate: ``sum(parameters * parts) + rest``."""

    index: int
    effect: Effect
    parameters: Mapping[str, float]
    parts: Mapping[str, Array]
    rest: Array

    @property
    def reads_torque(self) -> bool:
        return "torque" in self.effect.signals


def build_problem(
    design: Design, log: Log | Prepared, processing: Processing | None = None, inertia: bool = True
) -> Problem:
    """Build the regression of a design's torque effects on a log; nonlinear parameters are held at the design's values.

    Without `inertia` as a column, ``J alpha`` with the design's J is subtracted from the target.

    Raises
    ------
    LogError
        When a channel is missing that a term reads, or the axis hardly moves.
    """
    prepared = log if isinstance(log, Prepared) else prepare(design, log, processing)
    torque = prepared.signals["torque"] if prepared.acting is None else prepared.acting
    terms, left_out = _terms(design, prepared, torque)
    if prepared.acting is None and any(term.reads_torque for term in terms):
        terms, _ = _terms(design, prepared, _acting_torque(design, prepared))
    target = prepared.column(prepared.signals["torque"])
    if "T_load" in prepared.signals:
        target -= prepared.column(prepared.signals["T_load"])
    acceleration = prepared.column(prepared.alpha)
    made: list[Column] = []
    if inertia:
        unit = axis_unit("kg m^2", prepared.motion)
        least = design.load.kept(design.motor.J)  # of rotor and load the larger one has to be something beside it
        made.append(Column("J", acceleration, unit, design.J, lower=least, symbol="J"))
    else:
        target -= design.J * acceleration
    for term in terms:
        target -= prepared.column(term.rest)
        for symbol, values in term.parts.items():
            twins = sum(column.symbol == symbol for column in made)
            known = term.effect.parameter(symbol)
            unit, nominal = axis_unit(known.unit, prepared.motion), term.parameters[symbol]
            name = f"{symbol}#{twins + 1}" if twins else symbol
            filtered = prepared.column(values)
            made.append(
                Column(name, filtered, unit, nominal, known.lower, known.upper, term.effect.id, term.index, symbol)
            )
    made += _nuisances(design, prepared)
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
        notes=(*prepared.notes, *left_out),
    )


def _nuisances(design: Design, prepared: Prepared) -> Iterator[Column]:
    """Yield how the drive signal was sampled, where that is not known; see `drive_timing`."""
    sampling = prepared.sampling
    if sampling is None or not all(sampling.sigma):
        return
    period = 1.0 / prepared.rate
    acting = _acting_torque(design, prepared)
    columns = sampling_columns(acting, period, sampling.late)
    for (name, values), unit, sigma in zip(columns.items(), ("s", "s^2"), sampling.sigma, strict=True):
        yield Column(name, prepared.column(values), unit, 0.0, symbol=name, sigma=sigma)


def _terms(design: Design, prepared: Prepared, torque: Array) -> tuple[list[_Term], list[Notice]]:
    """Evaluate the torque effects of the design that are plain terms; the others are named in notices.

    Measurement effects were corrected by `prepare`, and no voltage is balanced here.
    """
    known = term_signals(design, {**prepared.signals, "torque": torque})
    terms, left_out = [], []
    for index, (effect, parameters) in enumerate(bound_effects(design)):
        if effect.enters != "torque":
            continue
        if effect.has_state:
            left_out.append(NO_REGRESSION(effect=effect.id))
            continue
        if missing := missing_signals(effect, known):
            raise LogError(f"effect '{effect.id}' needs {missing}, which the log or the design does not have")
        terms.append(_Term(index, effect, parameters, *columns(effect, known, parameters)))
    return terms, left_out


def _acting_torque(design: Design, prepared: Prepared) -> Array:
    """Return the drive torque that the motion takes, shape (n,), for terms that are a share of it.

    The measured torque holds its own noise, and in a regression it would explain itself: friction by load with a share
    of one, and no inertia. So the other parameters are fitted first, those terms as the design has them, and then again
    with what that gives.
    """
    measured = prepared.signals["torque"]
    acting: Array = measured
    for _ in range(2):
        fixed = prepared.signals.get("T_load", np.zeros_like(measured)).copy()
        free = [prepared.alpha]
        for term in _terms(design, prepared, acting)[0]:
            fixed += term.rest
            if term.reads_torque:
                fixed += sum(term.parameters[symbol] * part for symbol, part in term.parts.items())
            else:
                free += term.parts.values()
        rows = np.column_stack([prepared.column(part) for part in free])[prepared.mask]
        values = factored(rows).solve(prepared.column(measured - fixed)[prepared.mask])
        acting = fixed + sum(value * part for value, part in zip(values.tolist(), free, strict=True))
    return acting
