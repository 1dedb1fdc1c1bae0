"""The same log in other bands, where something is looked for that the usual band hides, without what happened once."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

from pmsm_ctrl.diagnose import notices as words
from pmsm_ctrl.diagnose.bands import conditioned_in, without_events
from pmsm_ctrl.diagnose.case import Case
from pmsm_ctrl.diagnose.events import events_of
from pmsm_ctrl.diagnose.late import begun_late
from pmsm_ctrl.diagnose.policy import Policy
from pmsm_ctrl.diagnose.refusal import BESIDE_NOISE, Reason, Refusal
from pmsm_ctrl.diagnose.selection import Selection, Step, name_of
from pmsm_ctrl.errors import LogError
from pmsm_ctrl.regression.conditioning import default_cutoff
from pmsm_ctrl.regression.encoder_lines import LINES
from pmsm_ctrl.regression.fast_orders import WIDEST, orders_beyond

__all__ = [
    "hidden_by_noise", "in_bands_of_springs", "in_narrower_bands", "in_wider_band", "rings_beyond",
    "without_what_happened_once",
]  # fmt: skip

NARROWER = 1.25  # times a band: one that is wider than it by less holds the same
# Times the usual band: so much wider are the bands in which a spring is looked for that rings beyond the usual one. Of
# 100 springs of a simulator that is not part of the project four times would add one right frequency and two wrong
OF_SPRINGS = (1.6, 2.5)
EDGE = 0.8  # of a band: what is faster is in the skirts of the filters


def without_what_happened_once(case: Case) -> Case:
    """Keep what happened once out of every fit: no effect explains it, and it imitates some.

    Parameters
    ----------
    case : Case

    Returns
    -------
    Case
    """
    late = begun_late(case)  # what a delay leaves comes and goes with the motion
    fit = case.keep(case.fit(())) if late is None or late.fit is None else late.fit
    return without_events(case, events_of(fit, case.policy))


def hidden_by_noise(step: Step, shown: Collection[str], refused: Mapping[str, Refusal], policy: Policy) -> bool:
    """Whether an effect found in a narrower band is one that the usual band shows as well, beside more noise.

    Whatever is in half of a band is in the whole of it: noise makes it a small part there, and not insignificant. How
    much of the residual it explains does not matter: chance is of another size in half of the narrower band. An effect
    with a memory acts at all frequencies, and its shape adapts to what any band leaves: it is a large part, and the
    usual band refuses it for what noise does, and not for a parameter.

    Parameters
    ----------
    step : Step
        In the narrower band.
    shown : collection of str
        Candidates that are significant in the usual band.
    refused : mapping of str to Refusal
        Why they are not accepted there.
    policy : Policy
    """
    name, structure = name_of(step.trial), step.trial.candidate.effect.structure
    if name not in shown or not structure.has_memory:
        return name in shown
    refusal = refused.get(name)
    noise = refusal is not None and refusal.reason in BESIDE_NOISE
    return noise and not structure.delays and step.evidence.explained >= policy.refused_share


def in_narrower_bands(case: Case) -> Iterator[Case]:
    """Yield the case in the default band and in half of it, as far as they are narrower than its own.

    Noise of the acceleration grows with the frequency: a slow effect may be a small part of what a band holds, and most
    of what half of it does.

    Parameters
    ----------
    case : Case
    """
    default = default_cutoff(case.record.prepared.rate)
    for band in (default, 0.5 * default):
        other = conditioned_in(band, case) if case.record.cutoff >= NARROWER * band else None
        if other is not None and other.believed is not None:
            fast = orders_beyond(other.as_given, other.believed.log, other.record.cutoff)
            said = (*fast, *other.remarks, words.NARROWER_BAND(band=band, usual=case.record.cutoff))
            yield without_what_happened_once(replace(other, surely=True, remarks=tuple(dict.fromkeys(said))))


def in_wider_band(case: Case) -> Case | None:
    """Return the case in a band that holds the fast orders of a turn that its log shows; None without any.

    What the usual band holds of them, where the axis starts and stops, looks like friction. The log is conditioned with
    the largest of them in the model: without it most of the acceleration is an error of the model, and no inertia is.
    One that is the number of an encoder's lines may be their error, which is then in the model in its place.

    Parameters
    ----------
    case : Case
    """
    beyond, wave = case.beyond, next((one for one in case.effects.values() if one.order and one.repeated), None)
    if beyond is None or wave is None or case.in_band is None:
        return None
    if not NARROWER * case.record.cutoff <= beyond.band <= WIDEST * case.record.prepared.rate:
        return None
    usual = {one.symbol: one.start for one in wave.parameters}
    shown = case.design.add_effect(wave.id, usual | {wave.order: float(beyond.orders[0])})
    try:
        other = case.in_band(band=beyond.band) if beyond.orders[0] in LINES else None
        if other is None or beyond.orders[0] not in other.record.lines:
            other = case.in_band(band=beyond.band, shown=shown)
    except LogError:
        return None
    kept = [one for one in case.remarks if one is not beyond.notice]
    said = words.WIDER_BAND(band=beyond.band, usual=case.record.cutoff, orders=beyond.orders[0])
    return without_what_happened_once(replace(other, believed=case.believed, remarks=(*kept, said)))


def in_bands_of_springs(case: Case, found: Selection, shown: Collection[str]) -> Iterator[Case]:
    """Yield the case in wider bands, where a spring is significant in its own and its load may ring beyond that.

    Below its resonance a load on a spring acts as a filter of the drive signal does, and is refused for that. Where it
    rings nothing else looks like it. One that is another one in half of the usual band is an error of the model.

    Parameters
    ----------
    case : Case
    found : Selection
        In its band: its last fit has every candidate tried.
    shown : collection of str
        Candidates that are significant there.
    """
    tried = ((name_of(one), one.candidate.effect.structure.resonance(one.group.shape)) for one in found.fit.trials)
    names = [name for name, resonance in tried if name in shown and resonance is not None]
    reasons = [found.refused[name].reason for name in names if name in found.refused]
    if not reasons or Reason.OTHER_BAND in reasons:
        return
    for wider in OF_SPRINGS:
        band = wider * case.record.cutoff
        other = conditioned_in(band, case) if band <= WIDEST * case.record.prepared.rate else None
        if other is not None:
            remarks = (*case.remarks, words.BAND_OF_A_SPRING(band=band, usual=case.record.cutoff))
            yield without_what_happened_once(replace(other, remarks=remarks))


def rings_beyond(usual: float, case: Case, found: Selection) -> bool:
    """Whether what was accepted first is a load on a spring that rings beyond the usual band, and inside a wider one.

    It is most of what the wider band leaves: noise and the sampling of a drive are larger there.

    Parameters
    ----------
    usual : float
        Band, Hz.
    case : Case
        In the wider one.
    found : Selection
    """
    if not found.steps or found.steps[0].evidence.explained < case.policy.above_floor:
        return False
    one = found.fits[1].accepted[0]
    resonance = one.effect.structure.resonance(one.shape)
    return resonance is not None and EDGE * usual <= resonance <= case.record.cutoff
