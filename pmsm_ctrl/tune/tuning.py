"""The verb: from the datasheet to gains, with the margins they keep and a check on the simulated drive."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pmsm_ctrl.design import CurrentLoop, Design, Filter, Loops, SpeedLoop
from pmsm_ctrl.errors import DesignError, NextCommand, RequestError, require_kind
from pmsm_ctrl.simulate.parameters import Plant
from pmsm_ctrl.tune import current as current_methods
from pmsm_ctrl.tune import position
from pmsm_ctrl.tune import speed as speed_methods
from pmsm_ctrl.tune.delays import compare_delay_models, delays
from pmsm_ctrl.tune.limits import within_ripple, within_voltage
from pmsm_ctrl.tune.linearise import linearise, rigid
from pmsm_ctrl.tune.margins import Margins, margins
from pmsm_ctrl.tune.noise import noise
from pmsm_ctrl.tune.proof import default_speed, durations
from pmsm_ctrl.tune.proof import prove as run_proof
from pmsm_ctrl.tune.requirements import Requirements, Specification
from pmsm_ctrl.tune.resonance import (
    WORTH,
    Resonance,
    moved_margins,
    resonance,
    slow_down,
    slower_gains,
)  # fmt: skip
from pmsm_ctrl.tune.result import PointMargins, Tuning, UnstableLoopError
from pmsm_ctrl.tune.robust import robust_gains, robustness
from pmsm_ctrl.tune.sampled import Cascade, current_loop, frequencies
from pmsm_ctrl.tune.steps import linear_steps

__all__ = ["assess", "open_loops", "tune"]

FREE = "current, shaft free"  # the current loop as it is measured: the EMF moves with it
POINTS = (0.01, 0.1, 1.0, 5.0)  # speeds judged, as shares of that of the operating point
# By how much slower it is, the current controllers, the filters behind it.
Family = Callable[[float, CurrentLoop, tuple[Filter, ...]], SpeedLoop]
SAME = 1e-3  # share by which a crossover on the grid of frequencies differs from the one that gains were made for
LOAD = 0.3  # load judged, as a share of the drive's largest torque


def tune(
    design: Design,
    specification: Specification | None = None,
    *,
    prove: bool = True,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Tuning:
    """Tune the current, speed and position loops of a design, and check the result on the simulated drive.

    Parameters
    ----------
    design : Design
        Its loops, if any, are replaced.
    specification : Specification, optional
        Methods, bandwidths, requirements; by default modulus optimum and symmetrical optimum.
    prove : bool
        Check every predicted figure on the simulated drive.
    seed : int
        Of the simulated noise.
    progress : function, optional
        Called with the share done, 0 to 1.

    Returns
    -------
    Tuning

    Raises
    ------
    DesignError
        When the motor's electrical data are not known, or a loop has no crossover.
    RequestError
        When the delays do not allow what is asked for; the message says what they do allow.
    """
    wanted = specification or Specification()
    wanted = replace(wanted, at=_speed(design, wanted.at))
    full = current_methods.tune_current(design, wanted)
    asked = within_voltage(design, full) if wanted.current_bandwidth is None else full
    stiff, at = rigid(design), _speed(design, wanted.at)

    def slower(factor: float, inner: CurrentLoop, behind: tuple[Filter, ...] = ()) -> SpeedLoop:
        cascade = Cascade.of(stiff, inner, at=at)
        reduced = speed_methods.slowed(wanted, factor, delays(stiff, inner, behind))
        return speed_methods.tune_speed(cascade, reduced, behind)

    judged = resonance(
        Cascade.of(design, asked, at=at), lambda factor, behind: slower(factor, asked, behind), wanted.requirements
    )
    current, speed, slowed, judged = _by_margins(design, asked, slower, wanted, judged)
    by_margins = slowed > 1.0
    if wanted.speed_bandwidth is None:
        swift = slowed
        found_speed, slowed = within_ripple(
            Cascade.of(design, current, speed, at=at), lambda factor: slower(factor, current, speed.filters), slowed
        )
        speed = speed if slowed == swift else found_speed
    place = position.tune_position(Cascade.of(design, current, speed, at=at), wanted.position_gain)
    tuned = design.model_copy(update={"loops": Loops(current=current, speed=speed, position=place)})
    found = replace(_assemble(tuned, wanted, judged), slowed={"current": full.K_p / current.K_p, "speed": slowed})
    if wanted.robust:
        found = replace(found, robustness=replace(found.robustness, slowed=slowed))
    found = replace(found, limited=_limited(full, asked, by_margins, slowed))
    return _checked(found, prove, seed, progress)


def _by_margins(
    design: Design, asked: CurrentLoop, slower: Family, wanted: Specification, judged: Resonance | None
) -> tuple[CurrentLoop, SpeedLoop, float, Resonance | None]:
    """Return controllers that meet the requirements, the factor of the speed loop, and what a filter gains.

    A filter against a resonance is taken where it allows a tenth more of crossover than the gains without. It has to
    meet the requirements over the tolerances of the load: what it gains on the nominal resonance alone is lost when
    that moves. The gains without a filter meet them nominally, or over all tolerances where those are asked for.
    """
    need, at = wanted.requirements, _speed(design, wanted.at)
    cascade = Cascade.of(design, asked, at=at)

    def gains(behind: tuple[Filter, ...], factor: float | None) -> tuple[CurrentLoop, SpeedLoop, float]:
        if wanted.robust:
            return robust_gains(design, asked, lambda slow, inner: slower(slow, inner, behind), need, at)
        if factor is not None:
            return asked, slower(factor, asked, behind), factor
        return asked, *slow_down(cascade, lambda slow: slower(slow, asked, behind), need)

    def crossover(current: CurrentLoop, speed: SpeedLoop) -> float:
        return margins(speed_methods.open_loop(replace(cascade, current=current), speed)).crossover

    if judged is None:
        full = speed_methods.open_loop(cascade, slower(1.0, asked, ()))
        return *gains((), 1.0 if margins(full).stable and not wanted.robust else None), None
    plain, refused = None, None
    exact = _crossing_as_asked(cascade, wanted)
    try:
        plain = gains((), None) if exact is None else (asked, exact, 1.0)
    except RequestError as error:
        refused = error
    unfiltered = 0.0 if plain is None else crossover(*plain[:2])
    judged = replace(judged, unfiltered=unfiltered, slowed=plain is None or plain[2] > 1.0)
    best = judged.options[0] if wanted.filters and judged.options else None
    if best is not None and best.filter is not None and judged.slowed and best.crossover > WORTH * unfiltered:
        with contextlib.suppress(RequestError):  # over the other tolerances
            chosen = gains((best.filter,), best.slowed)
            if crossover(*chosen[:2]) > WORTH * unfiltered:
                return *chosen, replace(judged, used=best)
    if plain is None:
        assert refused is not None
        raise refused
    return *plain, judged


def _crossing_as_asked(cascade: Cascade, wanted: Specification) -> SpeedLoop | None:
    """Return gains that cross where asked on the axis itself, with its spring, and meet the requirements; else None.

    Where there are none the gains are those of the rigid axis, slowed down until they meet the requirements. The
    bandwidths that a spring allows need not be an interval.
    """
    if wanted.speed != "bandwidth" or wanted.robust or wanted.speed_bandwidth is None:
        return None
    with contextlib.suppress(RequestError):
        found = speed_methods.tune_speed(cascade, wanted)
        judged = margins(speed_methods.open_loop(cascade, found))
        first = math.isclose(judged.crossover, wanted.speed_bandwidth, rel_tol=SAME)
        return found if first and not wanted.requirements.missed(judged) else None
    return None


def _limited(full: CurrentLoop, asked: CurrentLoop, by_margins: bool, slowed: float) -> dict[str, float]:
    """Return by which factor voltage and encoder slowed the loops down."""
    factors = {"voltage": full.K_p / asked.K_p, "encoder": 1.0 if by_margins else slowed}
    return {cause: factor for cause, factor in factors.items() if factor > 1.0}


def assess(
    design: Design,
    *,
    requirements: Requirements | None = None,
    at: float | None = None,
    prove: bool = True,
    seed: int = 0,
) -> Tuning:
    """Judge the gains that a design already has, without changing them.

    Parameters
    ----------
    design : Design
        With its loops set.
    requirements : Requirements, optional
    at : float, optional
        Speed of the operating point, rad/s; by default a tenth of the no-load speed.
    prove : bool
        Check every predicted figure on the simulated drive.
    seed : int
        Of the simulated noise.

    Returns
    -------
    Tuning

    Raises
    ------
    UnstableLoopError
        When a loop is unstable: the message says which, its section shows it.
    DesignError
        When the design has no loops, or the motor's electrical data are not known.
    """
    wanted = Specification(requirements=requirements or Requirements(), at=_speed(design, at))
    loops = design.require_loops()
    judged = resonance(
        Cascade.of(design, loops.current, at=_speed(design, at)),
        lambda factor, behind: slower_gains(loops.speed.model_copy(update={"filters": behind}), factor),
        wanted.requirements,
    )
    found = _assemble(design, wanted, judged)
    return _checked(replace(found, specification=None), prove, seed, None)


def open_loops(cascade: Cascade) -> dict[str, Any]:
    """Return the discrete open loops of a cascade with its speed loop set."""
    assert cascade.speed is not None
    loops = {
        "current": current_loop(cascade.design, cascade.current, truth=cascade.truth),
        "speed": speed_methods.open_loop(cascade, cascade.speed),
    }
    if cascade.position is not None:
        loops["position"] = position.open_loop(cascade, cascade.position.K_v)
    return loops


def _speed(design: Design, at: float | None) -> float:
    """Speed of the operating point; refuses a design that cannot be tuned."""
    require_kind(design, Design, "design")
    if not design.motor.electrical:
        raise DesignError(
            f"{design.source or design.name}: motor: the loops are tuned from p, psi_f, R, L_d and L_q; this design "
            "knows only K_t",
            next_command=NextCommand.ELECTRICAL_DATA,
        )
    Plant.of(design)
    return default_speed(design) if at is None else at


def _assemble(tuned: Design, wanted: Specification, judged: Resonance | None) -> Tuning:
    """Collect everything that is predicted for the gains; refuse loops that are unstable."""
    loops, requirements, at = tuned.require_loops(), wanted.requirements, _speed(tuned, wanted.at)
    cascade = Cascade.of(tuned, loops.current, loops.speed, loops.position, at=at)
    found = _stable_margins(cascade)
    rigid_cascade = Cascade.of(rigid(tuned), loops.current, at=at)
    return Tuning(
        design=tuned,
        specification=wanted,
        requirements=requirements,
        cascade=cascade,
        points=_points(cascade),
        delays=delays(tuned, loops.current, loops.speed.filters),
        delay_models=compare_delay_models(tuned, loops.current),
        margins=found,
        highest={
            "current": current_methods.highest_bandwidth(tuned),
            "speed": speed_methods.highest_bandwidth(rigid_cascade),
        },
        stiffness=position.stiffness(cascade),
        noise=noise(cascade),
        robustness=robustness(tuned, requirements=requirements, at=at),
        resonance=replace(judged, moved=moved_margins(cascade, requirements)) if judged is not None else None,
        predicted=linear_steps(cascade, durations(found)),
    )


def _stable_margins(cascade: Cascade) -> dict[str, Margins]:
    """Return the margins of every loop, and of the current loop with the shaft free."""
    found, design = {}, cascade.design
    loops = open_loops(cascade) | {"current (d)": current_loop(design, cascade.current, "d")}
    for name, loop in loops.items():
        found[name] = margins(loop)
        if not found[name].stable:
            raise UnstableLoopError(name, loop, found[name])
        if not math.isfinite(found[name].crossover):
            raise DesignError(
                f"{design.source or design.name}: {name} loop: its gain never crosses 1, so it controls nothing; "
                f"is J = {design.J:.4g} right for this motor and its friction?"
            )
    del found["current (d)"]
    free = cascade.current_response(frequencies(1.0 / design.drive.f_control, 1e-3, 1500))
    return {"current": found.pop("current"), FREE: margins(free), **found}


def _points(cascade: Cascade) -> tuple[PointMargins, ...]:
    """Judge standstill and slow, usual and fast running, unloaded and loaded, as far as the drive reaches."""
    design, at, speed = cascade.design, cascade.model.point.speed, cascade.speed
    assert speed is not None
    load = LOAD * design.K_t * design.drive.i_max if math.isfinite(design.drive.i_max) else 0.0
    wanted = [(0.0, 0.0), *((share * at, torque) for share in POINTS for torque in (0.0, load))]
    grid, found = frequencies(cascade.period, 1e-3, 600), []
    for omega, torque in dict.fromkeys(wanted):
        try:
            model = linearise(design, omega, torque)
        except RequestError:
            continue  # more current or voltage than the drive has: not a point it can run at
        if model.point.case == "stuck":
            found.append(PointMargins(model.point, 0.0, None))
            continue
        poles = [p for p in np.linalg.eigvals(np.delete(np.delete(model.A, 3, 0), 3, 1)) if abs(p) > 1e-9]
        judged = margins(speed_methods.open_loop(replace(cascade, model=model), speed), grid)
        found.append(PointMargins(model.point, float(max(p.real for p in poles)), judged))
    return tuple(found)


def _checked(found: Tuning, prove: bool, seed: int, progress: Callable[[float], None] | None) -> Tuning:
    if not prove:
        return found
    at = found.cascade.model.point.speed
    return replace(found, proof=run_proof(found.design, speed=at, seed=seed, progress=progress))
