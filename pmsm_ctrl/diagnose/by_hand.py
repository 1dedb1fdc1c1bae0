"""The diagnosis by hand: rank the candidates, add one, take one away, and see what each does to the error.

`diagnose` takes these steps by itself. Here somebody else decides; the numbers and the criteria are the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.contributions import Contributions, contributions_of
from pmsm_ctrl.diagnose.diagnosis import condition, offered_effects, without_what_happened_once
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.fitted_design import fitted_design
from pmsm_ctrl.diagnose.outcome import errors_table
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.diagnose.result import Errors, Ranked
from pmsm_ctrl.diagnose.selection import judged_trials, name_of, with_trial
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.errors import LogError, RequestError, nearest
from pmsm_ctrl.log import Logs, as_logs
from pmsm_ctrl.regression.prediction import errors
from pmsm_ctrl.rendering.numbers import percent
from pmsm_ctrl.result import jsonable

__all__ = ["Rung", "Stepwise", "stepwise"]


@dataclass(frozen=True)
class Rung:
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
class Stepwise:
    """A design with the effects that were added so far, fitted to a log. It is frozen: undo is to keep the one before.

    Attributes
    ----------
    rungs : tuple of Rung
        The errors after every step, the base model first.
    names : tuple of str
        The effects that were added, with the order where one has an order.
    """

    rungs: tuple[Rung, ...]
    names: tuple[str, ...]
    _case: Case = field(repr=False)
    _fit: Fitted = field(repr=False)

    @property
    def design(self) -> Design:
        """The design with these effects, their parameters and standard errors, and the base parameters refitted."""
        return fitted_design(self._case.design, self._fit)

    def rank(self) -> tuple[Ranked, ...]:
        """Return the candidates, the one that explains most of what is left over first.

        Returns
        -------
        tuple of Ranked
            `refusal` says what speaks against it before everything is fitted again with it; None where nothing does.
        """
        left = self._fit.solved.chi2
        out = [
            Ranked(name_of(trial), min(1.0, max(0.0, trial.gain / left)) if left > 0.0 else 0.0, p_value, refusal)
            for trial, p_value, refusal in judged_trials(self._fit, self._case.policy)
        ]
        closed = [
            Ranked(one.effect.id, 0.0, 1.0, Refusal(Reason.UNAVAILABLE, {"why": one.why_not or "it has no column"}))
            for one in self._fit.closed
        ]
        return (*out, *closed)

    def add(self, effect: str) -> Stepwise:
        """Return the model with one more effect, everything fitted again, whether or not the log calls for it.

        Parameters
        ----------
        effect : str
            A name of `rank`, or an id, of which the best is taken.

        Raises
        ------
        RequestError
            For a name that is not among the candidates, or one that this log cannot determine.
        """
        trials = [trial for trial in self._fit.trials if effect in (name_of(trial), trial.candidate.effect.id)]
        if not trials:
            known = dict.fromkeys(name_of(trial) for trial in self._fit.trials)
            closed = next((one.why_not for one in self._fit.closed if one.effect.id == effect), "")
            raise RequestError(f"effect '{effect}': {closed or f'no candidate on this log{nearest(effect, known)}'}")
        trial = min(trials, key=lambda one: one.singular)
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

    def to_dict(self) -> dict[str, Any]:
        """Return plain values fit for JSON."""
        rungs = [{"name": rung.name, "errors": rung.errors, "holdout": rung.holdout} for rung in self.rungs]
        out: dict[str, Any] = jsonable({"effects": list(self.names), "rungs": rungs})
        return out | {"candidates": [jsonable(one.to_dict()) for one in self.rank()], "design": self.design.to_dict()}

    def __str__(self) -> str:
        """One line a step: the error of the torque on the fitted and on the held-out records."""
        lines = []
        for rung in self.rungs:
            held = f", held out {percent(rung.holdout['torque']['relative'])}" if rung.holdout else ""
            lines.append(f"{rung.name:<32} {percent(rung.errors['torque']['relative'])}{held}")
        return "\n".join(lines)

    def _with(self, fit: Fitted, name: str, names: tuple[str, ...]) -> Stepwise:
        self._case.keep(fit)
        return replace(self, rungs=(*self.rungs, _rung(self._case, fit, name)), names=names, _fit=fit)


def stepwise(
    design: Design,
    log: Logs,
    *,
    holdout: Logs | None = None,
    candidates: Iterable[str] | None = None,
    policy: Policy = POLICY,
) -> Stepwise:
    """Begin a diagnosis by hand: the base parameters fitted, and every candidate tried on what is left over.

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
    case = condition(design, logs, holdouts, offered, policy)
    if case.believed is not None and case.believed.contradictions:
        raise LogError(f"{case.name}: {case.believed.contradictions[0].text}")
    case = without_what_happened_once(case)
    fit = case.keep(case.fit(()))
    return Stepwise((_rung(case, fit, "base parameters"),), (), case, fit)


def _rung(case: Case, fit: Fitted, name: str) -> Rung:
    own, other = errors(fit.record, fit.residual), case.holdout_errors(fit)
    return Rung(name, errors_table(case.record, own), errors_table(case.record, other))
