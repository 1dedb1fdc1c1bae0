"""What a diagnosis starts from: design, record, candidates and held-out record travel together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.contributions import Contributions
from pmsm_ctrl.diagnose.event import Event
from pmsm_ctrl.diagnose.fit import Accepted, Fitted, fit_beside, fit_design, ranked
from pmsm_ctrl.diagnose.held_out import held_out
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.search import Trial
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.plausibility import Plausibility
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import SINGLE, forget_effects
from pmsm_ctrl.regression.fast_orders import Beyond
from pmsm_ctrl.section import Notice

__all__ = ["Case", "pooled"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Case:
    """A design, the record it is judged by, and what may be missing from it.

    Attributes
    ----------
    design : Design
        What is fitted: the given one, with friction where it states none.
    record : Record
    effects : dict of id to Effect
        The candidates.
    holdouts : tuple of Record
        Other records of the same axis, nothing of which is fitted.
    holdout_names : tuple of str
    policy : Policy
        The decision thresholds.
    believed : Plausibility or None
        Whether log and design belong together; None where that was not examined.
    remarks : tuple of Notice
        What is doubtful about the held-out record.
    events : tuple of Event
        What the record leaves out.
    name : str
        Of the log.
    given : Design or None
        The design as it was given, where that is another one.
    conditioned_with : function or None
        Returns the case with the log conditioned by another design, which has the effects found so far.
    in_band : function or None
        Returns the case with the log conditioned in another band.
    anew : function or None
        Returns the case of the log that a given one believes in, conditioned by a design that says more.
    minor_too : bool
        Whether a first effect may explain less than most of what the residual has above its noise floor, if it is
        surely of the same size in half the band.
    surely : bool
        Whether a first effect has to be of the same size there in any case.
    nameable : frozenset of str or None
        Ids that may be named, in any band: of a drive signal that is ahead, what stood beside a delay; None: any.
    beyond : Beyond or None
        Orders of a turn that are too fast for the band of the record.
    bands : dict of float to Case or None
        The same in other bands, as far as they were asked for; None where the log holds too little in one.
    fits : list of Fitted
        Those of the selections made so far: the same effects of the same shapes are not fitted twice.
    """

    design: Design
    record: Record
    effects: Mapping[str, Effect]
    holdouts: tuple[Record, ...] = ()
    holdout_names: tuple[str, ...] = ()
    policy: Policy = POLICY
    believed: Plausibility | None = None
    remarks: tuple[Notice, ...] = ()
    events: tuple[Event, ...] = ()
    name: str = "the given log"
    given: Design | None = None
    conditioned_with: Callable[[Design, Case], Case] | None = field(default=None, repr=False)
    in_band: Callable[..., Case] | None = field(default=None, repr=False)
    anew: Callable[..., Case] | None = field(default=None, repr=False)
    minor_too: bool = False
    surely: bool = False
    nameable: frozenset[str] | None = None
    beyond: Beyond | None = None
    bands: dict[float, Case | None] = field(default_factory=dict, repr=False)
    fits: list[Fitted] = field(default_factory=list, repr=False)

    @property
    def as_given(self) -> Design:
        """The design as it was given."""
        return self.design if self.given is None else self.given

    @property
    def too_fast(self) -> tuple[int, ...]:
        """Orders of a turn that are too fast for the band of the record."""
        return () if self.beyond is None else self.beyond.orders

    def fit(self, accepted: tuple[Accepted, ...]) -> Fitted:
        """Return the design with these effects fitted, and every candidate tried on the residual.

        Parameters
        ----------
        accepted : tuple of Accepted
        """
        return self._known(accepted) or fit_design(self.design, self.record, accepted, self.effects)

    def fit_beside(self, accepted: tuple[Accepted, ...], other: Fitted) -> Fitted:
        """Return the design with these effects fitted, by the noise of a fit that has fewer; no candidate is tried.

        Parameters
        ----------
        accepted : tuple of Accepted
        other : Fitted
        """
        return self._known(accepted) or fit_beside(self.design, self.record, accepted, other)

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

    def keep_alone(self, fit: Fitted) -> None:
        """Remember a fit; of a long log the earlier ones are fitted again where another search begins with them.

        Parameters
        ----------
        fit : Fitted
        """
        if len(fit.record.mask) > SINGLE:
            self.fits.clear()
        self.keep(fit)

    def forget_candidates(self, bands: bool) -> None:
        """Forget the columns of the candidates and the fits of a search: hundreds that no test needs any more.

        Parameters
        ----------
        bands : bool
            Whether the other bands are forgotten as well: where something is named, nothing is looked for in them.
        """
        forget_effects(self.record)
        self.fits.clear()
        if bands:
            self.bands.clear()

    def without_candidates(self, accepted: tuple[Accepted, ...]) -> Fitted:
        """Return the design with these effects fitted, with no candidate tried.

        Parameters
        ----------
        accepted : tuple of Accepted
        """
        return fit_design(self.design, self.record, accepted, {})

    @property
    def level_refitted(self) -> bool:
        """Whether held-out records are judged with the level of their friction refitted.

        Where several records are fitted, friction may differ from one to the next, and is not held against a model.
        """
        return len(self.record.records) > 1

    def holdout_errors(self, fit: Fitted, refitted: bool | None = None) -> dict[str, tuple[float, float]]:
        """Return rms error and its share of each balance on all held-out records, with the parameters of a fit.

        Parameters
        ----------
        fit : Fitted
        refitted : bool, optional
            Whether dry friction, viscous friction and a constant torque of each held-out record are fitted to it
            before; as `level_refitted` when left out.

        Returns
        -------
        dict of balance to (float, float)
            Empty without a held-out record.
        """
        return pooled([self.held_out(fit, number, refitted) for number in range(len(self.holdouts))])

    def held_out(self, fit: Fitted, number: int, refitted: bool | None = None) -> tuple[Record, Array]:
        """Return a held-out record, and what a fit leaves over of its balances, shape (channels, m).

        Parameters
        ----------
        fit : Fitted
        number : int
            Which of them.
        refitted : bool, optional
            As in `holdout_errors`.
        """
        refitted = self.level_refitted if refitted is None else refitted
        found = held_out(self.design, self.holdouts[number], fit, refitted)
        return found.record, found.left

    def held_out_contributions(self, fit: Fitted, number: int) -> dict[str, Contributions]:
        """Return the prediction of a held-out record by balance, taken apart.

        Parameters
        ----------
        fit : Fitted
        number : int
            Which of them.
        """
        record = self.holdouts[number]
        found = held_out(self.design, record, fit, self.level_refitted)
        return found.contributions(self.design, fit, record.signals["direction"])


def pooled(found: Sequence[tuple[Record, Array]]) -> dict[str, tuple[float, float]]:
    """Return the rms residual of each balance on all records, and its share of the measured balance.

    Parameters
    ----------
    found : sequence of (Record, array of shape (channels, m))
        Balances that not all records have are left out.
    """
    out = {}
    for name in found[0][0].channels if found else ():
        if not all(name in record.channels for record, _ in found):
            continue
        left = np.concatenate([rest[record.channels.index(name)][record.mask] for record, rest in found])
        size = np.concatenate([record.target[record.channels.index(name)][record.mask] for record, _ in found])
        rms, whole = float(np.sqrt(np.mean(left**2))), float(np.sqrt(np.mean(size**2)))
        out[name] = (rms, rms / whole if whole > 0.0 else float("nan"))
    return out
