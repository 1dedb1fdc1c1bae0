"""The verb: from datasheet to gains, with every margin that defends them and the proof on the simulated drive."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pmsm_ctrl.design import CurrentLoop, Design, Loops, SpeedLoop
from pmsm_ctrl.errors import DesignError, RequestError
from pmsm_ctrl.result import Result, Section
from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.tune import current as current_methods
from pmsm_ctrl.tune import plots, position, report, steps
from pmsm_ctrl.tune import speed as speed_methods
from pmsm_ctrl.tune.delays import DelayModel, Delays, compare_delay_models, delays
from pmsm_ctrl.tune.drive_units import drive_units
from pmsm_ctrl.tune.linearise import OperatingPoint, linearise, rigid
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.noise import Noise, noise
from pmsm_ctrl.tune.proof import Proof, default_speed
from pmsm_ctrl.tune.proof import prove as run_proof
from pmsm_ctrl.tune.requirements import Requirements
from pmsm_ctrl.tune.resonance import Resonance, resonance, resonance_frequencies, slow_down
from pmsm_ctrl.tune.robust import Robustness, robust_gains, robustness
from pmsm_ctrl.tune.sampled import Cascade, current_loop, frequencies

__all__ = ["Tuning", "UnstableLoopError", "assess", "tune"]


FREE = "current, shaft free"  # the current loop as it is measured: the EMF moves with it


class UnstableLoopError(RequestError):
    """A loop is unstable with the gains given; `figure` shows its Nyquist plot.

    Attributes
    ----------
    loop : name of the loop
    figure : matplotlib Figure
    """

    def __init__(self, message: str, loop: str, figure: Figure) -> None:
        super().__init__(message)
        self.loop = loop
        self.figure = figure

    def section(self) -> Section:
        """Return the section of a report that shows it."""
        caption = "The open loop encloses the critical point: closed, it oscillates with growing amplitude."
        return Section("An unstable loop", (f"{self}.",), (), ((self.figure, caption),))


@dataclass(frozen=True)
class PointMargins:
    """An operating point, its poles, and the margins of the speed loop there.

    Attributes
    ----------
    point : OperatingPoint
    slowest : rad/s, real part of the slowest pole of the drive without control (0 for a stuck shaft)
    margins : Margins of the speed loop, None for a stuck shaft: what it does then moves nothing
    """

    point: OperatingPoint
    slowest: float
    margins: Margins | None


@dataclass(frozen=True, eq=False)
class Tuning(Result):
    """Tuned loops, what they promise, and what was measured of it.

    Attributes
    ----------
    design : Design
        The design with its loops set.
    methods : how each loop was tuned
    cascade : the linear sampled cascade that the promises are made for
    points : operating points looked at, standstill first, with the speed loop's margins where it slides
    linear_deviation : largest difference between the analytic and the numerical linearisation at any of them
    delays, delay_models : small time constants by name; margins by each way to write the delay
    margins : by loop, of the discrete loops as they run; "current" is that of the winding alone,
        "current, shaft free" has the EMF of the moving shaft and its late feedforward in it
    highest : Hz by loop, the highest crossover that the delays allow at 45 deg
    stiffness, noise, robustness, resonance, proof : see their classes; resonance and proof may be None
    promised : step responses by name
    requirements : what the loops are held against
    """

    design: Design
    methods: Mapping[str, str]
    cascade: Cascade
    points: tuple[PointMargins, ...]
    linear_deviation: float
    delays: Delays
    delay_models: tuple[DelayModel, ...]
    margins: Mapping[str, Margins]
    highest: Mapping[str, float]
    stiffness: position.Stiffness
    noise: Noise
    robustness: Robustness
    resonance: Resonance | None
    promised: Mapping[str, steps.Step]
    requirements: Requirements
    proof: Proof | None = None

    @property
    def loops(self) -> Loops:
        """The gains."""
        assert self.design.loops is not None
        return self.design.loops

    @property
    def gains(self) -> dict[str, dict[str, float]]:
        """The gains in the units that drives take, by manufacturer."""
        return drive_units(self.design, self.loops)

    @property
    def defended(self) -> bool:
        """Whether the nominal margins are kept and the proof, if it was made, did not fail."""
        kept = not any(self.requirements.missed(found) for found in self.margins.values())
        return kept and (self.proof is None or self.proof.passed)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Reasons to doubt the gains."""
        return report.warnings(self)

    def open_loops(self) -> dict[str, Any]:
        """Return the discrete open loops by name."""
        return _open_loops(self.cascade)

    def summary(self) -> str:
        """Return the tables as text, trust first."""
        return report.summary(self)

    def plot(self) -> Figure:
        """Return Bode, Nyquist, Nichols and step plots on one page."""
        return plots.overview(self.open_loops(), dict(self.promised), self.proof)

    def to_dict(self) -> dict[str, Any]:
        """Return gains, margins and proof as plain values."""
        return report.to_dict(self)

    def section(self) -> Section:
        """Return the section of the report."""
        return report.section(self)


def _open_loops(cascade: Cascade) -> dict[str, Any]:
    assert cascade.speed is not None
    loops = {
        "current": current_loop(cascade.design, cascade.current, truth=cascade.truth),
        "speed": speed_methods.open_loop(cascade, cascade.speed),
    }
    if cascade.position is not None and cascade.position.K_v > 0.0:
        loops["position"] = position.open_loop(cascade, cascade.position.K_v)
    return loops


def tune(
    design: Design,
    *,
    current: str = "modulus_optimum",
    speed: str = "symmetrical_optimum",
    current_bandwidth: float | None = None,
    speed_bandwidth: float | None = None,
    phase_margin: float = 60.0,
    damping: float = 0.8,
    a: float = 1.0 + math.sqrt(2.0),
    position_gain: float | None = None,
    robust: bool = False,
    requirements: Requirements | None = None,
    at: float | None = None,
    prove: bool = True,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Tuning:
    """Tune the current, speed and position loops of a design, and prove the result on the simulated drive.

    Parameters
    ----------
    design : Design
        Its loops, if any, are replaced.
    current : {"modulus_optimum", "pole_cancellation", "bandwidth"}
    speed : {"symmetrical_optimum", "pole_placement", "bandwidth"}
    current_bandwidth, speed_bandwidth : Hz, optional
        Crossover asked for (natural frequency for "pole_placement").
    phase_margin : deg
        For the methods that take one.
    damping : float
        For "pole_placement".
    a : float
        For "symmetrical_optimum"; 2 is the textbook's, 1 + sqrt(2) has 45 deg.
    position_gain : 1/s, optional
        By default the largest without resonance.
    robust : bool
        Slow the loops down until the worst corner of ``motor.tolerance`` keeps the requirements.
    requirements : Requirements, optional
    at : rad/s, optional
        Speed of the operating point; by default a tenth of the no-load speed.
    prove : bool
        Measure everything again on the simulated drive.
    seed : int
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    Tuning

    Raises
    ------
    DesignError
        When the motor's electrical data are not known.
    RequestError
        When the delays do not allow what is asked for; the message says what they do allow.
    """
    requirements = requirements or Requirements()
    _check(design)
    at = at if at is not None else default_speed(design)
    stiff = rigid(design)
    gains = current_methods.tune_current(design, current, bandwidth=current_bandwidth, phase_margin=phase_margin)

    family = _SpeedFamily(stiff, at, speed, speed_bandwidth, phase_margin, damping, a)
    asked_current, asked_speed = gains, family.gains(1.0, gains)
    speed_gains, slowed, robustness_found = asked_speed, 1.0, None
    if robust:
        gains, speed_gains, robustness_found = robust_gains(
            design, gains, family.gains, requirements=requirements, at=at
        )
        slowed = robustness_found.slowed
    elif resonance_frequencies(design) is not None:
        real = Cascade.of(design, gains, at=at)
        speed_gains, _, slowed = slow_down(real, lambda factor: family.gains(factor, gains), requirements)
    cascade = Cascade.of(design, gains, speed_gains, at=at)
    place = position.tune_position(cascade, gain=position_gain)
    methods = {
        "current": _named(current, current_bandwidth, asked_current.K_p / gains.K_p),
        "speed": _named(speed, speed_bandwidth, slowed),
        "position": "proportional with feedforward" + ("" if position_gain is None else ", gain as asked"),
    }
    loops = Loops(current=gains, speed=speed_gains, position=place)
    found = _assemble(
        design, loops, methods, requirements, at, robustness_found,
        resonance(cascade, asked_speed, requirements, slowed > 1.0),
    )  # fmt: skip
    return _proved(found, prove, at, seed, progress)


@dataclass(frozen=True, eq=False)
class _SpeedFamily:
    """The speed loops of one request on the rigid axis, from as fast as asked to ever slower."""

    design: Design
    at: float
    method: str
    bandwidth: float | None
    phase_margin: float
    damping: float
    a: float

    def gains(self, factor: float, inner: CurrentLoop) -> SpeedLoop:
        """Return the speed loop that is slower than asked by a factor, around these current controllers."""
        a, asked = self.a, self.bandwidth
        if factor > 1.0 and self.method == "symmetrical_optimum" and asked is None:
            a *= factor
        elif factor > 1.0:
            if asked is None:
                budget = delays(self.design, inner).speed
                asked = 1.0 / (2.0 * math.pi * (1.0 + math.sqrt(2.0)) * budget * 2.0 * self.damping)
            asked /= factor
        return speed_methods.tune_speed(
            self.design, inner, self.method, cascade=Cascade.of(self.design, inner, at=self.at),
            bandwidth=asked, phase_margin=self.phase_margin, damping=self.damping, a=a,
        )  # fmt: skip


def assess(
    design: Design,
    *,
    requirements: Requirements | None = None,
    at: float | None = None,
    prove: bool = True,
    seed: int = 0,
) -> Tuning:
    """Judge the gains that a design already has, without changing them.

    Raises
    ------
    UnstableLoopError
        When a loop is unstable: the message says which, its `figure` shows it.
    DesignError
        When the design has no loops.
    """
    requirements = requirements or Requirements()
    _check(design)
    loops = design.require_loops()
    at = at if at is not None else default_speed(design)
    given = dict.fromkeys(("current", "speed", "position"), report.AS_GIVEN)
    cascade = Cascade.of(design, loops.current, loops.speed, at=at)
    found = _assemble(
        design, loops, given, requirements, at, None,
        resonance(cascade, loops.speed, requirements, False),
    )  # fmt: skip
    return _proved(found, prove, at, seed, None)


def _check(design: Design) -> None:
    where = f"{design.source or design.name}: "
    if not design.motor.electrical:
        raise DesignError(
            f"{where}motor: the loops are tuned from p, psi_f, R, L_d and L_q; this design knows only K_t"
        )
    Plant.of(design)


def _named(method: str, bandwidth: float | None, slowed: float) -> str:
    words = method.replace("_", " ")
    if bandwidth is not None:
        words += f", {bandwidth:g} Hz asked"
    return words if slowed == 1.0 else f"{words}, slowed down {slowed:.3g} times to keep the margins"


def _require_crossover(design: Design, name: str, crossover: float) -> None:
    if not math.isfinite(crossover):
        raise DesignError(
            f"{design.source or design.name}: {name} loop: its gain never crosses 1, so it controls nothing; "
            f"is J = {design.J:.4g} right for this motor and its friction?"
        )


def _assemble(
    design: Design,
    loops: Loops,
    methods: Mapping[str, str],
    requirements: Requirements,
    at: float,
    judged: Robustness | None,
    resonant: Resonance | None,
) -> Tuning:
    """Collect everything that the gains promise; refuse loops that are unstable."""
    tuned = design.model_copy(update={"loops": loops})
    in_position = loops.position if loops.position.K_v > 0.0 else None
    cascade = Cascade.of(tuned, loops.current, loops.speed, in_position, at=at)
    found = _stable_margins(tuned, loops, cascade)
    points, deviation = _points(tuned, loops, at)
    rigid_cascade = Cascade.of(rigid(tuned), loops.current, at=at)
    crossover = found["speed"].crossover
    promised = {
        "current": steps.linear_current(tuned, cascade, 8.0 / found["current"].crossover),
        "speed": steps.linear_speed(cascade, 5.0 / crossover),
        "load": steps.linear_load(cascade, 5.0 / crossover),
    }
    if in_position is not None:
        promised["position"] = steps.linear_position(cascade, 3.0 / found["position"].crossover)
    return Tuning(
        design=tuned,
        methods=methods,
        cascade=cascade,
        points=points,
        linear_deviation=deviation,
        delays=delays(tuned, loops.current),
        delay_models=compare_delay_models(tuned, loops.current),
        margins=found,
        highest={
            "current": current_methods.highest_bandwidth(tuned),
            "speed": speed_methods.highest_bandwidth(rigid_cascade),
        },
        stiffness=position.stiffness(cascade),
        noise=noise(cascade),
        robustness=judged or robustness(tuned, loops.current, loops.speed, requirements=requirements, at=at),
        resonance=resonant,
        promised=promised,
        requirements=requirements,
    )


def _stable_margins(tuned: Design, loops: Loops, cascade: Cascade) -> dict[str, Margins]:
    """Return the margins of every loop, and of the current loop with the shaft free; refuse what is unstable."""
    found = {}
    for name, loop in _open_loops(cascade).items():
        found[name] = margins(loop)
        if not found[name].stable:
            raise UnstableLoopError(
                f"{name} loop: unstable with the gains given (phase margin {found[name].phase_margin:.1f} deg at "
                f"{found[name].crossover:.4g} Hz); reduce them, or let `tune` find others",
                name,
                plots.unstable_figure(name, loop, found[name]),
            )
        _require_crossover(tuned, name, found[name].crossover)
    d_axis = current_loop(tuned, loops.current, "d")
    d_margins = margins(d_axis, brief=True)
    if not d_margins.stable:
        figure = plots.unstable_figure("current (d)", d_axis, d_margins)
        raise UnstableLoopError("current loop, d axis: unstable with the gains given; reduce them", "current", figure)
    free = frequencies(1.0 / tuned.drive.f_control, 1e-3, 1500)
    return {"current": found.pop("current"), FREE: margins(cascade.current_response(free)), **found}


def _points(tuned: Design, loops: Loops, at: float) -> tuple[tuple[PointMargins, ...], float]:
    """Look at standstill and at slow, usual and fast running, unloaded and loaded, as far as the drive reaches."""
    load = 0.3 * tuned.K_t * tuned.drive.i_max if math.isfinite(tuned.drive.i_max) else 0.0
    wanted = [(0.0, 0.0), *((share * at, torque) for share in (0.01, 0.1, 1.0, 5.0) for torque in (0.0, load))]
    found, deviations = [], [0.0]
    for speed, torque in dict.fromkeys(wanted):
        try:
            model = linearise(tuned, speed, torque)
        except RequestError:
            continue  # more current or voltage than the drive has: not a point it can run at
        poles = [p for p in np.linalg.eigvals(np.delete(np.delete(model.A, 3, 0), 3, 1)) if abs(p) > 1e-9]
        if model.point.case == "stuck":
            found.append(PointMargins(model.point, 0.0, None))
            continue
        deviations.append(model.deviation)
        cascade = Cascade(tuned, tuned, model, loops.current, loops.speed)
        grid = frequencies(cascade.period, 1e-3, 600)
        judged = margins(speed_methods.open_loop(cascade, loops.speed), grid, brief=True)
        found.append(PointMargins(model.point, float(max(p.real for p in poles)), judged))
    return tuple(found), max(deviations)


def _proved(found: Tuning, prove: bool, at: float, seed: int, progress: Callable[[float], None] | None) -> Tuning:
    if not prove:
        return found
    return replace(found, proof=run_proof(found.design, speed=at, seed=seed, progress=progress))
