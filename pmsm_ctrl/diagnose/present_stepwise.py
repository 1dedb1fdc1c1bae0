"""The diagnosis by hand in words and tables: the falling error, what was added, what was not."""

from __future__ import annotations

from pathlib import Path

from pmsm_ctrl.diagnose.by_hand import ModelErrors, Stepwise
from pmsm_ctrl.diagnose.notices import errors_caption
from pmsm_ctrl.effects.catalogue import catalogue_of
from pmsm_ctrl.rendering.numbers import percent, probability, with_error
from pmsm_ctrl.section import Block, Section, Table, present
from pmsm_ctrl.units import axis_unit, drives

__all__: list[str] = []


@present.register
def _(found: Stepwise) -> Section:
    first, last = (_percent(one) for one in (found.models[0], found.models[-1]))
    kind = drives(found.design.motion)
    added = ", then ".join(found.names)
    verdict = f"Chosen by hand: {added or 'no effect added'}. The {kind} error"
    verdict += f" falls from {first} to {last}." if found.names else f" is {last} with the parameters refitted."
    blocks: tuple[Block, ...] = (verdict, *found.notices, found.traces(), _models(found, kind), _effects(found))
    return Section(
        f"Stepwise model of {found.design.name} from {Path(found.log_name).name}", (*blocks, _candidates(found))
    )


def _percent(one: ModelErrors) -> str:
    return percent(one.errors["torque"]["relative"])


def _models(found: Stepwise, kind: str) -> Table:
    names = list(found.models[0].errors)
    held = [name for name in names if name in found.models[0].holdout]
    words = {name: kind if name == "torque" else name for name in names}
    floor = tuple(percent(found.noise_floor[name]["relative"]) for name in names)
    head = ("model", *(words[name] for name in names), *(f"held-out {words[name]}" for name in held))
    rows = tuple(
        (
            one.name,
            *(percent(one.errors[name]["relative"]) for name in names),
            *(percent(one.holdout[name]["relative"]) for name in held),
        )
        for one in found.models
    )
    last = ("noise floor", *floor, *("" for _ in held))
    return Table(head, (*rows, last), f"{errors_caption(found.cutoff)}, step by step")


def _effects(found: Stepwise) -> Table:
    design, catalogue = found.design, catalogue_of(found.design)
    rows = []
    for entry in design.effects:
        effect = catalogue[entry.id]
        shown = (
            f"{symbol} = "
            + with_error(value, entry.stderr.get(symbol, 0.0), axis_unit(effect.parameter(symbol).unit, design.motion))
            for symbol, value in entry.parameters.items()
        )
        rows.append((effect.title_on(design.motion), ", ".join(shown)))
    return Table(("effect", "parameters"), tuple(rows), "Effects of the fitted design")


def _candidates(found: Stepwise) -> Table:
    rows = tuple(
        (one.effect, percent(one.explained, 1), probability(one.p_value), one.why_not or "significant on this log")
        for one in found.rank()
    )
    head = ("candidate", "explains of the residual", "p", "why not")
    return Table(head, rows, "Candidates beside this model", folded=True)
