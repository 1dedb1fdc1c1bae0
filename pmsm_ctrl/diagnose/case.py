"""What a diagnosis starts from: design, record, candidates and held-out record travel together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.event import Event
from pmsm_ctrl.diagnose.fit import Accepted, Fitted, errors, fit_design, predicted_elsewhere, ranked
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.plausibility import Plausibility
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.section import Notice

__all__ = ["Case"]


@dataclass(frozen=True, eq=False)
class Case:
    """A design, the record it is judged by, and what may be missing from it.

    Attributes
    ----------
    design : Design
    record : Record
    effects : dict of id to Effect
        The candidates.
    holdout : Record or None
        Another record of the same axis.
    policy : Policy
        The decision thresholds.
    believed : Plausibility or None
        Whether log and design belong together; None where that was not examined.
    remarks : tuple of Notice
        What is doubtful about the held-out record.
    events : tuple of Event
        What the record leaves out.
    fits : list of Fitted
        Those of the selections made so far: the same effects of the same shapes are not fitted twice.
    """

    design: Design
    record: Record
    effects: Mapping[str, Effect]
    holdout: Record | None = None
    policy: Policy = POLICY
    believed: Plausibility | None = None
    remarks: tuple[Notice, ...] = ()
    events: tuple[Event, ...] = ()
    fits: list[Fitted] = field(default_factory=list, repr=False)

    def fit(self, accepted: tuple[Accepted, ...]) -> Fitted:
        """Return the design with these effects fitted, and every candidate tried on the residual.

        Parameters
        ----------
        accepted : tuple of Accepted
        """
        return self._known(accepted) or fit_design(self.design, self.record, accepted, self.effects)

    def _known(self, accepted: tuple[Accepted, ...]) -> Fitted | None:
        asked = [(one.effect.id, one.shape) for one in accepted]
        return next((f for f in self.fits if [(one.effect.id, one.shape) for one in f.accepted] == asked), None)

    def first_beside(self, accepted: tuple[Accepted, ...]) -> Trial | None:
        """Return the candidate that explains most beside these effects; None where there is none.

        Its significance is not judged.

        Parameters
        ----------
        accepted : tuple of Accepted
        """
        known = self._known(accepted)
        trials = ranked(self.design, self.record, accepted, self.effects) if known is None else known.trials
        return trials[0] if trials else None

    def keep(self, fit: Fitted) -> Fitted:
        """Remember a fit that belongs to a selection, and return it.

        Parameters
        ----------
        fit : Fitted
        """
        if not any(fit is one for one in self.fits):
            self.fits.append(fit)
        return fit

    def without_candidates(self, accepted: tuple[Accepted, ...]) -> Fitted:
        """Return the design with these effects fitted, with no candidate tried.

        Parameters
        ----------
        accepted : tuple of Accepted
        """
        return fit_design(self.design, self.record, accepted, {})

    def holdout_errors(self, fit: Fitted) -> dict[str, tuple[float, float]]:
        """Return rms error and its share of each balance on the held-out record, with the parameters of a fit.

        Parameters
        ----------
        fit : Fitted

        Returns
        -------
        dict of balance to (float, float)
            Empty without a held-out record.
        """
        if self.holdout is None:
            return {}
        record, predicted = predicted_elsewhere(self.design, self.holdout, fit.accepted, fit, self.effects)
        common = [name for name in record.channels if name in fit.record.channels]
        return errors(record, record.target - predicted, common)
