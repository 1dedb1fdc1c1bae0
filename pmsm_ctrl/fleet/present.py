"""What a run over a fleet has to say."""

from __future__ import annotations

from pmsm_ctrl.fleet.result import FleetResult
from pmsm_ctrl.section import Block, Section, Table, present

__all__: list[str] = []


@present.register
def _(result: FleetResult) -> Section:
    answered = result.logs - len(result.lost)
    verdict = (
        f"{result.logs} logs of {result.axes} axes: {answered} with an answer; {result.evaluated} evaluated in "
        f"{result.seconds:.3g} s, {result.reused} from earlier runs."
    )
    blocks: list[Block] = [verdict, *result.notices]
    if result.verdicts:
        rows = tuple((name.replace("_", " "), str(count)) for name, count in result.verdicts.items())
        blocks.append(Table(("verdict of the diagnosis", "logs"), rows))
    if result.lost:
        lost = tuple((one.record, one.axis, one.reason) for one in result.lost)
        blocks.append(Table(("log", "axis", "no answer, because"), lost, "Logs without an answer"))
    return Section("Fleet", tuple(blocks))
