"""The diagnosis by hand: rank the candidates, add one, take one away, and see what each does to the error.

`diagnose` takes these steps by itself. Here somebody else decides; the numbers and the criteria are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.candidates import offered_effects
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.contributions import Contributions, contributions_of
from pmsm_ctrl.diagnose.diagnosis import searched
from pmsm_ctrl.diagnose.explorer import HeldOutTraces, coordinates_of, traces_between
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.made_ready import condition
from pmsm_ctrl.diagnose.other_bands import without_what_happened_once
from pmsm_ctrl.diagnose.outcome import errors_table, noise_floor
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.preview import beside_model
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.result import Diagnosis, Errors, Ranked
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.diagnose.selection import Selection, judged_trials, name_of, with_trial
from pmsm_ctrl.diagnose.written import finished
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import LogError, RequestError, nearest
from pmsm_ctrl.log import Log, Logs, as_logs
from pmsm_ctrl.plausibility import with_inertia
from pmsm_ctrl.regression.prediction import errors
from pmsm_ctrl.rendering.numbers import percent
from pmsm_ctrl.residuals.orders import strongest_orders
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice, Traces

__all__ = ["ModelErrors", "Stepwise", "stepwise"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ModelErrors:
    """The errors of one model.

    Attributes
    ----------
    name : str
        What was added or taken away, ``+ cogging 24`` or ``- stribeck``; ``base parameters`` for the first one.
    errors, holdout : dict of balance to rms, unit and relative error
        On the fitted and on the held-out records; the latter is empty without one.
    """

    name: str
    errors: Errors
    holdout: Errors = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Stepwise(Result):
    """A design with the effects that were added so far, fitted to a log. It is frozen: undo is to keep the one before.

    Attributes
    ----------
    models : tuple of ModelErrors
        The errors after every step, the base model first.
    names : tuple of str
        The effects that were added, with the order where one has an order.
    """

    models: tuple[ModelErrors, ...]
    names: tuple[str, ...]
    _case: Case = field(repr=False)
    _fit: Fitted = field(repr=False)
    _holdouts: tuple[Log, ...] = field(default=(), repr=False)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Reasons to doubt the logs or their conditioning."""
        believed = self._case.believed.notices if self._case.believed is not None else ()
        return tuple(dict.fromkeys((*believed, *self._case.remarks, *self._fit.record.notes)))

    @property
    def log_name(self) -> str:
        """The name of the fitted log."""
        return self._case.name

    @property
    def design(self) -> Design:
        """The design with these effects, their parameters and standard errors, and the base parameters refitted."""
        return fitted_design(self._case.design, self._fit)

    def rank(self) -> tuple[Ranked, ...]:
        """Return the candidates, the one that explains most of the residual first.

        Returns
        -------
        tuple of Ranked
            `explained` is the share of the residual's sum of squares, as the estimate weighs it. `refusal` says what
            speaks against it before everything is fitted again with it; None where nothing does.
        """
        left = self._fit.plain.chi2
        out = [
            Ranked(name_of(trial), min(1.0, max(0.0, trial.plain_gain / left)) if left > 0.0 else 0.0, p_value, refusal)
            for trial, p_value, refusal in judged_trials(self._fit, self._case.policy, self._case)
        ]
        closed = [
            Ranked(one.effect.id, 0.0, 1.0, Refusal(Reason.UNAVAILABLE, {"why": one.why_not or "it has no column"}))
            for one in self._fit.closed
        ]
        return (*out, *closed)

    def add(self, effect: str) -> Stepwise:
        """Return the model with one more effect, everything fitted again, whether or not the log supports it.

        Parameters
        ----------
        effect : str
            A name of `rank`, or an id, of which the best is taken.

        Raises
        ------
        RequestError
            For a name that is not among the candidates, or one that this log cannot determine.
        """
        trial = self._trial(effect)
        if trial.singular:
            needs = trial.candidate.effect.needs
            raise RequestError(
                f"effect '{effect}': not distinguishable from the design's on this log; it needs {needs}"
            )
        name = name_of(trial)
        return self._with(with_trial(self._case, self._fit, trial), f"+ {name}", (*self.names, name))

    def remove(self, effect: str) -> Stepwise:
        """Return the model without an effect that was added, everything fitted again.

        Parameters
        ----------
        effect : str
            A name or an id.

        Raises
        ------
        RequestError
            When it was not added.
        """
        ids = [one.effect.id for one in self._fit.accepted]
        place = next((k for k, pair in enumerate(zip(self.names, ids, strict=True)) if effect in pair), None)
        if place is None:
            raise RequestError(f"effect '{effect}': not added (added: {', '.join(self.names) or 'none'})")
        accepted = (*self._fit.accepted[:place], *self._fit.accepted[place + 1 :])
        names = (*self.names[:place], *self.names[place + 1 :])
        return self._with(self._case.fit(accepted), f"- {self.names[place]}", names)

    def contributions(self, channel: str = "torque") -> Contributions:
        """Take the prediction of a balance apart, as `Diagnosis.contributions`.

        Parameters
        ----------
        channel : str

        Returns
        -------
        Contributions

        Raises
        ------
        RequestError
            When the log has no such balance.
        """
        return contributions_of(self._fit, channel, self._case.record.signals["direction"])

    @property
    def noise_floor(self) -> Errors:
        """The error of each balance that noise alone leaves on the fitted records."""
        return noise_floor(self._case.record, self._fit)

    @property
    def cutoff(self) -> float:
        """The low-pass of both sides of a balance, Hz: the fitted logs choose it, and it is that of all errors."""
        return self._case.record.cutoff

    @property
    def balances(self) -> tuple[str, ...]:
        """The balances of the log: ``torque`` and, with voltages, ``u_d`` and ``u_q``."""
        return self._fit.record.channels

    @property
    def held_out_names(self) -> tuple[str, ...]:
        """The names of the held-out records."""
        return self._case.holdout_names

    def held_out(self, number: int) -> dict[str, Contributions]:
        """Return the prediction of a held-out record by balance, taken apart.

        Parameters
        ----------
        number : int
            Which of them, from 0.

        Returns
        -------
        dict of balance to Contributions
            The balances that the fitted records have as well.

        Raises
        ------
        RequestError
            When there is no such record.
        """
        if not 0 <= number < len(self._case.holdouts):
            raise RequestError(f"held-out record {number}: there are {len(self._case.holdouts)}")
        return self._case.held_out_contributions(self._fit, number)

    def coordinates(self, held_out: int | None = None) -> dict[str, Array]:
        """Return what a residual can be drawn over, by label.

        Parameters
        ----------
        held_out : int, optional
            Of this held-out record, and not of the fitted ones.

        Returns
        -------
        dict of label to array, shape (m,)
            On the time axis of `contributions`, or of `held_out`; the speed first.
        """
        return coordinates_of(self._fit.record if held_out is None else self._case.holdouts[held_out])

    def orders(self, held_out: int | None = None) -> Array | None:
        """Return how much of the torque's residual repeats with every turn.

        Parameters
        ----------
        held_out : int, optional
            Of this held-out record, and not of the fitted ones.

        Returns
        -------
        array, shape (2, orders), or None
            Amplitude of orders 1, 2, ... of a turn, and what noise alone exceeds in one of a hundred spectra, N m; NaN
            where no turn is slow enough for an order. None for a linear axis, which has no turns.
        """
        if held_out is None:
            record, residual = self._fit.record, self._fit.left
        else:
            record, residual = self._case.held_out(self._fit, held_out)
        if record.linear:
            return None
        return strongest_orders(record.prepared, residual[0], record.mask, record.weight[0], 1)[0]

    def traces(self) -> Traces:
        """Return the balances for a page on which one zooms, and switches the added effects on and off."""
        others = tuple(
            HeldOutTraces(name, self._case.holdouts[number], self.held_out(number))
            for number, name in enumerate(self._case.holdout_names)
        )
        fitted = {channel: self.contributions(channel) for channel in self.balances}
        return traces_between(self._case.fits[0], self._fit, fitted, self.noise_floor, others, self.log_name)

    def preview(self, effect: str, channel: str = "torque") -> Array:
        """Return the part of the residual that a candidate explains, before a refit.

        Parameters
        ----------
        effect : str
            A name of `rank`, or an id, of which the best is taken.
        channel : str

        Returns
        -------
        array, shape (m,)
            On the time axis of `contributions`. Only what the model cannot explain by its own parameters.

        Raises
        ------
        RequestError
            For an unknown name or balance.
        """
        if channel not in self.balances:
            raise RequestError(f"unknown balance '{channel}': this log has {', '.join(self.balances)}")
        curve: Array = beside_model(self._fit, self._trial(effect))[self.balances.index(channel)]
        return curve

    def find(
        self, *, plan: bool = False, progress: Callable[[float], None] | None = None,
        each: Callable[[ModelErrors], None] | None = None,
    ) -> tuple[Stepwise, Diagnosis]:  # fmt: skip
        """Let the diagnosis choose, from the base model on: what was added so far does not count.

        Parameters
        ----------
        plan : bool
            Whether to look for the next experiment, as in `diagnose`.
        progress : function, optional
            Called with the share done, 0 to 1, at least once a step. What it raises ends the search.
        each : function, optional
            Called with the errors after every effect that is accepted. Later ones may replace it.

        Returns
        -------
        (Stepwise, Diagnosis)
            The model with the effects that were found, and what `diagnose` returns.
        """
        case, advance = replace(self._case, fits=self._case.fits[:1]), progress or (lambda share: None)

        def report(selection: Selection) -> None:
            if each is not None:
                each(_model_errors(case, selection.fit, f"+ {name_of(selection.steps[-1].trial)}"))

        case, found = searched(case, plan, advance, report)
        found = finished(case, found, self._holdouts)
        fits = found.selection.fits
        names = tuple(one.effect.label(one.shape) for one in found.selection.accepted)
        titles = ("base parameters", *(f"+ {name}" for name in names))
        models = tuple(_model_errors(case, fit, title) for fit, title in zip(fits, titles, strict=True))
        return replace(self, models=models, names=names, _case=case, _fit=fits[-1]), found

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        models = [{"name": one.name, "errors": one.errors, "holdout": one.holdout} for one in self.models]
        out: dict[str, Any] = jsonable({"effects": list(self.names), "models": models})
        return out | {"candidates": [jsonable(one.to_dict()) for one in self.rank()], "design": self.design.to_dict()}

    def __str__(self) -> str:
        """One line a step: the error of the torque on the fitted and on the held-out records."""
        lines = []
        for one in self.models:
            held = f", held out {percent(one.holdout['torque']['relative'])}" if one.holdout else ""
            lines.append(f"{one.name:<32} {percent(one.errors['torque']['relative'])}{held}")
        return "\n".join(lines)

    def _trial(self, effect: str) -> Trial:
        trials = [trial for trial in self._fit.trials if effect in (name_of(trial), trial.candidate.effect.id)]
        if not trials:
            known = dict.fromkeys(name_of(trial) for trial in self._fit.trials)
            closed = next((one.why_not for one in self._fit.closed if one.effect.id == effect), "")
            raise RequestError(f"effect '{effect}': {closed or f'no candidate on this log{nearest(effect, known)}'}")
        return min(trials, key=lambda one: one.singular)

    def _with(self, fit: Fitted, name: str, names: tuple[str, ...]) -> Stepwise:
        self._case.keep(fit)
        return replace(self, models=(*self.models, _model_errors(self._case, fit, name)), names=names, _fit=fit)


def stepwise(
    design: Design,
    log: Logs,
    *,
    holdout: Logs | None = None,
    candidates: Iterable[str] | None = None,
    policy: Policy = POLICY,
) -> Stepwise:
    """Begin a diagnosis step by step: fit the base parameters, and try every candidate on the residual.

    Parameters
    ----------
    design : Design
        Its own effects are candidates beside the catalogue.
    log : Log or sequence of Log
        As in `diagnose`.
    holdout : Log or sequence of Log, optional
        Other records of the same axis, to which nothing is fitted.
    candidates : iterable of str, optional
        Ids to choose from; the whole catalogue and the design's own effects when left out.
    policy : Policy
        The decision thresholds.

    Returns
    -------
    Stepwise

    Raises
    ------
    LogError
        When a channel is missing, the axis hardly moves, or log and design do not belong together.
    DesignError, RequestError
        When the design or `candidates` names an unknown effect.
    """
    offered = offered_effects(catalogue_of(design), candidates)
    logs, holdouts = as_logs(log), () if holdout is None else as_logs(holdout, "holdout")
    design = with_inertia(design, logs)
    case = condition(design, logs, holdouts, offered, policy)
    if case.believed is not None and case.believed.contradictions:
        raise LogError(f"{case.name}: {case.believed.contradictions[0].text}")
    case = without_what_happened_once(case)
    fit = case.keep(case.fit(()))
    return Stepwise((_model_errors(case, fit, "base parameters"),), (), case, fit, holdouts)


def _model_errors(case: Case, fit: Fitted, name: str) -> ModelErrors:
    own, other = errors(fit.record, fit.left), case.holdout_errors(fit)
    return ModelErrors(name, errors_table(case.record, own), errors_table(case.record, other))
