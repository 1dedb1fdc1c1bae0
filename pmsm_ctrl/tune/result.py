"""What tuning returns: the gains, what is predicted for them, and the reasons to doubt them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.design import Design, Loops
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.likely import unlikely
from pmsm_ctrl.result import Result, jsonable
from pmsm_ctrl.section import Notice, Section, present
from pmsm_ctrl.tune import notices
from pmsm_ctrl.tune.drive_units import drive_units
from pmsm_ctrl.tune.requirements import Requirements, Specification
from pmsm_ctrl.units import axis_unit

if TYPE_CHECKING:
    from pmsm_ctrl.tune.delays import Delays
    from pmsm_ctrl.tune.linearise import OperatingPoint
    from pmsm_ctrl.tune.margins import Margins
    from pmsm_ctrl.tune.noise import Noise
    from pmsm_ctrl.tune.position import Stiffness
    from pmsm_ctrl.tune.proof import Proof
    from pmsm_ctrl.tune.resonance import FilterOption, Resonance
    from pmsm_ctrl.tune.robust import Robustness
    from pmsm_ctrl.tune.sampled import Cascade
    from pmsm_ctrl.tune.steps import Step

__all__ = ["PointMargins", "Tuning", "UnstableLoopError"]

RIPPLE_LIMIT = 0.02  # current ripple from the encoder, as a share of the current limit


class UnstableLoopError(RequestError):
    """A loop is unstable with the gains given; its section shows the Nyquist plot.

    Parameters
    ----------
    loop : str
        Name of the loop.
    system : control.StateSpace
        The open loop.
    found : Margins
    """

    def __init__(self, loop: str, system: Any, found: Margins) -> None:
        super().__init__(
            f"{loop} loop: unstable with the gains given (phase margin {found.phase_margin:.1f} deg at "
            f"{found.phase_margin_crossover:.4g} Hz); reduce them, or let `tune` find others"
        )
        self.loop, self.system, self.found = loop, system, found

    def section(self) -> Section:
        """Return the section of a report that shows it."""
        return present(self)


@dataclass(frozen=True)
class PointMargins:
    """An operating point and the speed loop there.

    Attributes
    ----------
    point : OperatingPoint
    slowest : float
        Real part of the slowest pole of the drive without control, rad/s; 0 for a stuck shaft.
    margins : Margins or None
        None for a stuck shaft, which does not move.
    """

    point: OperatingPoint
    slowest: float
    margins: Margins | None


@dataclass(frozen=True, eq=False)
class Tuning(Result):
    """Tuned loops, what is predicted for them, and the simulated check.

    Attributes
    ----------
    design : Design
        With its loops set.
    specification : Specification or None
        How the loops were tuned; None for gains that were given.
    requirements : Requirements
    cascade : Cascade
        The linear sampled cascade for which the predictions are made.
    points : tuple of PointMargins
        Standstill first.
    delays : Delays
    delay_models : mapping of str to Margins
        Of the current loop, by how its delay is modelled.
    margins : mapping of str to Margins
        Of the discrete loops as they run; "current" is that of the winding alone, "current, shaft free" includes the
        EMF of the moving shaft and its late feedforward.
    highest : mapping of str to float
        Highest crossover that the delays allow at 45 deg, Hz.
    stiffness : Stiffness
    noise : Noise
    robustness : Robustness
    resonance : Resonance or None
        None for a rigid axis.
    predicted : mapping of str to Step
    slowed : mapping of str to float
        By loop, the factor by which it was slowed down to meet the requirements.
    limited : mapping of str to float
        By limit of the drive ("voltage": the current loop, "encoder": the speed loop), the factor that it took.
    proof : Proof or None
    """

    design: Design
    specification: Specification | None
    requirements: Requirements
    cascade: Cascade
    points: tuple[PointMargins, ...]
    delays: Delays
    delay_models: Mapping[str, Margins]
    margins: Mapping[str, Margins]
    highest: Mapping[str, float]
    stiffness: Stiffness
    noise: Noise
    robustness: Robustness
    resonance: Resonance | None
    predicted: Mapping[str, Step]
    slowed: Mapping[str, float] = field(default_factory=dict)
    proof: Proof | None = None
    limited: Mapping[str, float] = field(default_factory=dict)

    @property
    def loops(self) -> Loops:
        """The gains."""
        return self.design.require_loops()

    @property
    def gains(self) -> dict[str, dict[str, float]]:
        """The gains in the units that drives take, by manufacturer."""
        return drive_units(self.design)

    @property
    def margins_met(self) -> bool:
        """Whether all nominal margins meet the requirements."""
        return not any(self.requirements.missed(found) for found in self.margins.values())

    @property
    def defended(self) -> bool:
        """Whether the nominal margins are met and no check in simulation failed."""
        return self.margins_met and (self.proof is None or self.proof.passed)

    @property
    def against(self) -> tuple[Notice, ...]:
        """Why the gains are not defended: nominal margins that are missed, and failed checks."""
        codes = (notices.MARGIN.code, notices.CHECK.code)
        return tuple(notice for notice in self.notices if notice.code in codes)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Reasons to doubt the gains."""
        return (*unlikely(self.design), *self._margin_notices(), *self._drive_notices())

    def _margin_notices(self) -> list[Notice]:
        missed, out = self.requirements.missed, []
        for name, found in self.margins.items():
            out += [notices.MARGIN(loop=name, missed=item) for item in missed(found)]
        for loop, corner, item in self.robustness.missed:
            out.append(notices.CORNER(loop=loop, corner=corner.name, missed=item))
        for at in self.points:
            if at.margins is not None and (items := missed(at.margins)):
                words = ", ".join(map(str, items))
                per_second, torque = (axis_unit(unit, self.design.motion) for unit in ("rad/s", "N m"))
                point = {"speed": at.point.speed, "per_second": per_second, "load": at.point.load, "torque": torque}
                out.append(notices.POINT(**point, missed=words))
        return out

    def _drive_notices(self) -> list[Notice]:
        out, resonant, ripple = [], self.resonance, self.noise.encoder_ripple
        if resonant is not None and resonant.slowed and resonant.used is None:
            out.append(self._unfiltered(resonant))
        limit = self.design.drive.i_max
        if (factor := self.limited.get("voltage")) is not None:
            out.append(notices.VOLTAGE(factor=factor))
        if (factor := self.limited.get("encoder")) is not None:
            out.append(notices.ENCODER(factor=factor))
        if math.isfinite(limit) and ripple > RIPPLE_LIMIT * limit:
            out.append(notices.RIPPLE(ripple=1e3 * ripple, share=100.0 * RIPPLE_LIMIT))
        failed = self.proof.failed if self.proof is not None else ()
        return out + [
            notices.CHECK(
                subject=c.subject, quantity=c.quantity, unit=c.unit, predicted=c.predicted, simulated=c.simulated
            )
            for c in failed
        ]

    def _unfiltered(self, resonant: Resonance) -> Notice:
        """Return why a loop that a resonance slows down has no filter."""
        asked = self.specification
        if asked is not None and not asked.filters:
            return notices.SLOWED(resonance=resonant.resonance)
        best = resonant.options[0] if resonant.options else None
        if best is None or best.filter is None or best.crossover == 0.0:
            return notices.NO_FILTER(resonance=resonant.resonance)
        how = "over all tolerances" if asked is not None and asked.robust else "nominally"
        return notices.FILTER(
            resonance=resonant.resonance, kind=best.filter.kind.replace("_", "-"), frequency=best.filter.frequency,
            crossover=best.crossover, how=how, unfiltered=resonant.unfiltered, plain=resonant.plain.crossover,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return gains, margins and checks as plain values."""
        r, resonant, asked = self.robustness, self.resonance, self.specification
        out = {
            "schema": "pmsm-ctrl/tuning/1",
            "defended": self.defended,
            "methods": {loop: getattr(asked, loop) if asked else "as_given" for loop in ("current", "speed")},
            "slowed": dict(self.slowed),
            "limited": dict(self.limited),
            "loops": self.loops.model_dump(exclude_none=True),
            "gains": self.gains,
            "margins": {name: m.to_dict() for name, m in self.margins.items()},
            "highest_crossover_hz": dict(self.highest),
            "delay_models": {name: m.to_dict() for name, m in self.delay_models.items()},
            "stiffness": vars(self.stiffness),
            "noise": vars(self.noise),
            "robustness": {
                "worst_current": {"corner": r.worst_current.name, **r.worst_current.current.to_dict()},
                "worst_speed": {"corner": r.worst_speed.name, **r.worst_speed.speed.to_dict()},
                "missed": [f"{loop} loop at {corner.name}: {item}" for loop, corner, item in r.missed],
                "slowed": r.slowed,
            },
            "operating_points": [
                {**vars(at.point), "slowest_pole": at.slowest, "speed_loop": at.margins and at.margins.to_dict()}
                for at in self.points
            ],
            **self.doubts(),
        }
        if resonant is not None:
            out["resonance"] = {
                "antiresonance_hz": resonant.antiresonance,
                "resonance_hz": resonant.resonance,
                "before": resonant.before.to_dict(),
                "proposed": _option(resonant.proposed),
                "used": _option(resonant.used),
                "crossover_without_filter": resonant.unfiltered,
                "load_off": {name: found.to_dict() for name, found in resonant.moved.items()},
            }
        if self.proof is not None:
            out["proof"] = [
                {**vars(check), "explanation": check.explanation and vars(check.explanation)}
                for check in self.proof.checks
            ]
        return dict(jsonable(out))


def _option(option: FilterOption | None) -> dict[str, Any] | None:
    """Return a filter with its margins as plain values."""
    if option is None or option.filter is None:
        return None
    return {
        **option.filter.model_dump(exclude_none=True),
        **option.margins.to_dict(),
        "slowed": option.slowed,
        "crossover": option.crossover,
        "worst_corner": option.corner,
        "worst_sensitivity_peak": option.worst.sensitivity_peak,
    }
