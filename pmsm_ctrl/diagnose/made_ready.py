"""The log made ready: believed or not, conditioned, in one band, with the held-out ones in the same way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.held_out import same_as_log
from pmsm_ctrl.diagnose.in_step import as_found
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.log import Log, Logs, as_logs, names_of
from pmsm_ctrl.plausibility import doubts_about, of_holdout
from pmsm_ctrl.plausibility.late_steps import moved_by_its_steps
from pmsm_ctrl.regression.balances import Record
from pmsm_ctrl.regression.columns import SINGLE
from pmsm_ctrl.regression.fast_orders import beyond_band
from pmsm_ctrl.regression.joining import name_of as name_of_log
from pmsm_ctrl.regression.made import Made, for_design
from pmsm_ctrl.regression.one_axis import other_record
from pmsm_ctrl.regression.timed_record import timed_record, with_friction

__all__ = ["condition"]


def condition(
    design: Design, log: Logs, holdouts: tuple[Log, ...], offered: Mapping[str, Effect], policy: Policy,
    made: Made | None = None, shown: Design | None = None, first: Case | None = None, band: float | None = None,
    nameable: frozenset[str] | None = None,
) -> Case:  # fmt: skip
    """Condition the log, and the held-out ones in the same way.

    Parameters
    ----------
    design : Design
    log : Log or sequence of Log
    holdouts : tuple of Log
    offered : dict of id to Effect
        The candidates.
    policy : Policy
    made : Made, optional
        What was made of the log before.
    shown : Design, optional
        The same with effects that the log has shown, which say more of how it was sampled.
    first : Case, optional
        The same log conditioned without these, or in its usual band.
    band : float, optional
        Low-pass, Hz, in place of the one that the log calls for.
    nameable : frozenset of str, optional
        Ids that may be named; any where left out.

    Returns
    -------
    Case
    """
    believed = (first and first.believed) or doubts_about(design, log)
    anew, made = made is None, made or Made.kept(believed.log)
    whole = with_friction(design)
    record = timed_record(shown or whole, believed.log, made, band)
    if anew and shown is None and (late := moved_by_its_steps(believed, record)) is not None:
        believed, made = late, Made.kept(late.log)
        record = timed_record(whole, believed.log, made, band)
    made.forget_models(record)
    record = record if first is None else as_found(record, first.record)
    if shown is not None:
        record = for_design(record, whole)
        if first is not None and not anew and (record.cutoff, record.timing, record.age) == (
            first.record.cutoff, first.record.timing, first.record.age,
        ):  # fmt: skip
            return replace(first, record=record, conditioned_with=None, events=(), fits=[])
    others: list[Record] = []
    # a band in which a name is checked says nothing of its own; see `in_narrower_bands`
    beyond = None if band else beyond_band(design, believed.log, record.cutoff)
    remarks = [*([] if beyond is None else [beyond.notice]), *same_as_log(as_logs(log), holdouts)]
    for holdout in holdouts:
        held_out = doubts_about(design, holdout)
        if first is not None and believed.lag > 0.0 and believed.logged is None:
            held_out = held_out.as_logged  # as the log is judged
        zero = first.holdouts[len(others)].shifts if first is not None else None
        others.append(other_record(design, held_out.log, record, zero))
        remarks += map(of_holdout, held_out.notices)
    names = tuple(name_of_log(one, number) for number, one in enumerate(holdouts, start=1))
    again = partial(condition, design, log, holdouts, offered, policy, made, nameable=nameable)
    long = len(record.mask) > SINGLE
    return Case(
        whole, record, offered, tuple(others), names, policy, believed, tuple(dict.fromkeys(remarks)),
        name=names_of(as_logs(log), "the given log"), given=design, beyond=beyond,
        conditioned_with=None if long or (shown and not anew) else partial(again, band=band), in_band=again,
        anew=partial(condition, design, log, holdouts, offered, policy), nameable=nameable,
    )  # fmt: skip
