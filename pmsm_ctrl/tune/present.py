"""A tuning as blocks: verdict, doubts, gains, margins, checks."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from pmsm_ctrl.rendering.numbers import number
from pmsm_ctrl.section import Block, Picture, Section, Table, present
from pmsm_ctrl.tune.drive_units import NOTE
from pmsm_ctrl.tune.result import Tuning, UnstableLoopError
from pmsm_ctrl.units import axis_unit, drives

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from pmsm_ctrl.design import Filter
    from pmsm_ctrl.tune.margins import Margins
    from pmsm_ctrl.tune.proof import Check
    from pmsm_ctrl.tune.resonance import FilterOption

__all__: list[str] = []

FORWARDED = "proportional with feedforward"
OUTCOMES = {"not_judged": "-"}
CAUSES = {
    "sensor_errors": "ideal sensors",
    "sensor_errors_and_effects": "ideal sensors and none of the nonlinear effects",
    "plant": "the plant that the design assumes",
}


@present.register
def _(result: Tuning) -> Section:
    blocks = (
        _verdict(result), *result.notices, _gains(result), _margins(result), *_checks(result), _tolerances(result),
        *_resonance(result), _resistance(result), *_loops(result), *_folded(result),
    )  # fmt: skip
    shown = tuple(_along(block, result.design.motion) for block in blocks)
    margins = tuple(one for one, block in zip(shown, blocks, strict=True) if block is blocks[2 + len(result.notices)])
    return Section(f"Tuning of {result.design.name}", shown, essential=margins)


def _along(block: Block, motion: str) -> Block:
    """Return a block with its units for this kind of axis; the texts of this module are written for rotary ones."""
    if motion == "rotary":
        return block
    if isinstance(block, str):
        return axis_unit(block, motion)
    if isinstance(block, Table):
        header = tuple(axis_unit(text, motion) for text in block.header)
        rows = tuple(tuple(axis_unit(str(cell), motion) for cell in row) for row in block.rows)
        return Table(header, rows, axis_unit(block.caption, motion), block.folded)
    return block


@present.register
def _(error: UnstableLoopError) -> Section:
    caption = "The open loop encloses the critical point: closed, it oscillates with growing amplitude."
    return Section("An unstable loop", (f"{error}.", Picture(lambda: _unstable(error), caption)))


def _loops(result: Tuning) -> tuple[Picture, ...]:
    def drawn(name: str) -> Figure:
        from pmsm_ctrl.tune import figures

        figure: Figure = getattr(figures, name)(result)
        return figure

    captions = {
        "bode": "Open loops. The phase margin is the distance from -180 deg at 0 dB, the gain margin that from 0 dB "
        "at -180 deg.",
        "distances": "Distance of the open loops to the critical point.",
        "steps": "Predicted step responses (lines), and those of the simulated drive (dashes).",
    }
    return tuple(Picture(partial(drawn, name), caption) for name, caption in captions.items())


def _unstable(error: UnstableLoopError) -> Figure:
    from pmsm_ctrl.tune.figures import unstable

    return unstable(error.loop, error.system, error.found)


def _filtered(result: Tuning, words: str) -> Figure:
    from pmsm_ctrl.tune.figures import filtered

    return filtered(result, words)


def _number(value: float) -> str:
    return "unlimited" if math.isinf(value) else number(value)


def _verdict(result: Tuning) -> str:
    done = "loops judged as given" if result.specification is None else "loops tuned"
    met = "all margins are met" if result.margins_met else "NOT all margins are met"
    proof = result.proof
    if proof is None:
        return f"{result.design.name}: {done}; {met}; not checked in simulation."
    from pmsm_ctrl.tune.proof import Outcome

    passed, explained, failed = (len(proof.having(o)) for o in (Outcome.PASSED, Outcome.EXPLAINED, Outcome.FAILED))
    counts = f"{passed}/{passed + explained + failed} checks passed in simulation at {number(proof.speed)} rad/s"
    known = f", {explained} with a known cause" if explained else ""
    return f"{result.design.name}: {done}; {met}; {counts}{known}."


def _method(result: Tuning, loop: str) -> str:
    asked = result.specification
    if asked is None:
        return "as given in the design"
    if loop == "position":
        return FORWARDED if asked.position_gain is None else f"{FORWARDED}, gain as specified"
    words = str(getattr(asked, loop)).replace("_", " ")
    bandwidth, slowed = getattr(asked, f"{loop}_bandwidth"), result.slowed.get(loop, 1.0)
    if bandwidth is not None:
        words += f", {bandwidth:g} Hz specified"
        spring = loop == "speed" and asked.speed == "bandwidth" and result.resonance is not None
        if spring and not math.isclose(result.margins["speed"].crossover, bandwidth, rel_tol=0.01):
            words += " of the rigid axis"
    return words if slowed == 1.0 else f"{words}, slowed down {slowed:.3g} times {_why_slowed(result, loop, slowed)}"


def _why_slowed(result: Tuning, loop: str, slowed: float) -> str:
    """Return what slowed a loop down: the drive's limit, the margins, or both."""
    limit = {"current": "voltage", "speed": "encoder"}[loop]
    factor = result.limited.get(limit, 1.0)
    because = {"voltage": "by the voltage limit", "encoder": "by the encoder's resolution"}[limit]
    if factor == 1.0:
        return "to meet the margins"
    return because if math.isclose(factor, slowed, rel_tol=1e-6) else f"{because} and to meet the margins"


def _gains(result: Tuning) -> Table:
    def pi(K_p: float, T_n: float, unit: str) -> str:
        return f"K_p {number(K_p)} {unit}, T_n {number(1e3 * T_n)} ms"

    current, speed, position = result.loops.current, result.loops.speed, result.loops.position
    methods = {loop: _method(result, loop) for loop in ("current", "speed", "position")}
    rows = [("current (q)", pi(current.K_p, current.T_n, "V/A"), methods["current"])]
    if current.K_p_d is not None and current.T_n_d is not None:
        rows.insert(0, ("current (d)", pi(current.K_p_d, current.T_n_d, "V/A"), methods["current"]))
    reference = f", reference filter {number(1e3 * speed.reference_filter)} ms"
    rows.append(("speed", pi(speed.K_p, speed.T_n, "A/(rad/s)") + reference, methods["speed"]))
    rows += [("current reference", _filter(one), "filter behind the speed controller") for one in speed.filters]
    matched = 1e3 * result.loops.reference_filter(in_position=True)
    velocity = f"K_v {number(position.K_v)} 1/s, filter of the reference speed {number(matched)} ms"
    rows.append(("position", velocity, methods["position"]))
    return Table(("loop", "gains", "method"), tuple(rows), "Gains")


QUANTITIES: dict[str, Callable[[Margins], float]] = {
    "crossover [Hz]": lambda m: m.crossover,
    "phase margin [deg]": lambda m: m.phase_margin,
    "gain margin [dB]": lambda m: m.gain_margin_db,
    "sensitivity peak": lambda m: m.sensitivity_peak,
    "bandwidth (-3 dB) [Hz]": lambda m: m.bandwidth,
    "delay margin [us]": lambda m: 1e6 * m.delay_margin,
    "disk margin": lambda m: m.disk_margin,
    "complementary peak": lambda m: m.complementary_peak,
}
BRIEF = tuple(QUANTITIES)[:4]  # those of the smaller tables


def _brief(found: Margins) -> tuple[str, ...]:
    if found.stable is False:
        return _number(found.crossover), "unstable", "unstable", "-"
    return tuple(_number(QUANTITIES[label](found)) for label in BRIEF)


def _margins(result: Tuning) -> Table:
    names = list(result.margins)
    shown = dict(QUANTITIES)
    if any(m.phase_margin_crossover != m.crossover for m in result.margins.values() if math.isfinite(m.crossover)):
        # a resonance crosses 1 again: the margin does not belong to the crossover above
        place = list(shown).index("phase margin [deg]") + 1
        further = ("phase margin, found at [Hz]", lambda m: m.phase_margin_crossover)
        shown = dict([*list(shown.items())[:place], further, *list(shown.items())[place:]])
    rows = [(label, *(_number(get(result.margins[name])) for name in names)) for label, get in shown.items()]
    highest = (_number(result.highest.get(name, math.nan)) for name in names)
    rows.append(("crossover that the delays allow [Hz]", *highest))
    asked = result.requirements
    caption = (
        f"Margins of the sampled loops; required: phase margin {asked.phase_margin:g} deg, gain margin "
        f"{asked.gain_margin_db:g} dB, sensitivity peak at most {asked.sensitivity_peak:g}. The last row is "
        "not of these gains: there the delays leave 45 deg to a loop of a longer reset time, so of less stiffness"
    )
    return Table(("margin", *names), tuple(rows), caption)


def _outcome(check: Check) -> str:
    if check.explanation is None:
        return OUTCOMES.get(check.outcome, check.outcome)
    e = check.explanation
    cause = CAUSES.get(e.cause, f"no {e.cause}")
    return (
        f"{check.outcome}: with {cause} {e.crossover[1]:.4g} Hz and {e.phase_margin[1]:.1f} deg are simulated, "
        f"{e.crossover[0]:.4g} Hz and {e.phase_margin[0]:.1f} deg predicted"
    )


def _checks(result: Tuning) -> tuple[Table, ...]:
    if result.proof is None:
        return ()
    rows = tuple(
        (c.subject, c.quantity, c.unit, _number(c.predicted), _number(c.simulated), _outcome(c))
        for c in result.proof.checks
    )
    return (
        Table(
            ("of", "quantity", "unit", "predicted", "simulated", "outcome"),
            rows,
            "Checks in simulation (-: for information, not judged)",
        ),
    )


def _tolerances(result: Tuning) -> Table:
    r = result.robustness
    rows = [("current", corner.name, *_brief(corner.current)) for corner in (r.nominal, r.worst_current)]
    rows += [("speed", corner.name, *_brief(corner.speed)) for corner in (r.nominal, r.worst_speed)]
    return Table(("loop", "corner", *BRIEF), tuple(rows), f"Tolerances ({r.corners} points, the worst shown)")


def _filter(item: Filter) -> str:
    text = f"{item.kind.replace('_', '-')} {item.frequency:.4g} Hz"
    if item.kind == "notch":
        return f"{text}, width {item.width:.3g} Hz, " + ("complete" if item.depth is None else f"{item.depth:.3g} dB")
    if item.kind == "lead":
        return f"{text}, {item.phase:.3g} deg"
    return f"{text}, order 1" if item.order == 1 else f"{text}, damping {item.damping or math.sqrt(0.5):.2g}"


def _resonance(result: Tuning) -> tuple[Block, ...]:
    r, missed = result.resonance, result.requirements.missed
    if r is None:
        return ()

    def row(name: str, found: Margins, option: FilterOption | None = None) -> tuple[str, ...]:
        robust = ("-", "-")
        if option is not None:
            peak = "unstable" if option.worst.stable is False else _number(option.worst.sensitivity_peak)
            robust = (peak, _number(option.crossover) if option.crossover > 0.0 else "none")
        return name, *_brief(found), ", ".join(map(str, missed(found))) or "met", *robust

    rows = [row("none, gains of the rigid axis", r.before, r.plain)]
    rows += [row(_filter(option.filter), option.margins, option) for option in r.options if option.filter is not None]
    rows.append(row("none, gains of this design", result.margins["speed"]))
    caption = (
        f"Resonance at {r.resonance:.4g} Hz (antiresonance {r.antiresonance:.4g} Hz): filters with the gains of the "
        "rule for each, their abs(S) at the worst corner of stiffness and inertias, and the crossover of gains slow "
        "enough for every corner"
    )
    table = Table(("filter", *BRIEF, "requirements", "worst abs(S)", "for all [Hz]"), tuple(rows), caption)
    off = Table(
        ("load", *BRIEF, "requirements"),
        tuple((name, *_brief(found), ", ".join(map(str, missed(found))) or "met") for name, found in r.moved.items()),
        "The speed loop of this design with the load off (stiffness -20 % and +20 %: the resonance moves by a tenth)",
    )
    blocks: list[Block] = [*_filter_words(result), table, off]
    if r.options:
        best = r.options[0].filter
        assert best is not None
        words = f"with the {best.kind.replace('_', '-')} at {best.frequency:.4g} Hz"
        seen = "The resonance raises the loop gain where the phase has passed -180 deg; the filter removes the peak."
        blocks.append(Picture(lambda: _filtered(result, words), seen))
    return tuple(blocks)


def _filter_words(result: Tuning) -> tuple[str, ...]:
    """Say what the filter of the loop gains and what it costs."""
    r, speed = result.resonance, result.loops.speed
    if r is None or r.used is None or r.used.filter is None:
        return ()
    period = result.cascade.period
    z = cmath.exp(2j * math.pi * result.margins["speed"].crossover * period)
    cost = -math.degrees(sum(cmath.phase(one.biquad.sampled_at(z, period)) for one in speed.filters))
    without = f"instead of {r.unfiltered:.3g} Hz" if r.unfiltered > 0.0 else "where no gains without a filter do"
    return (
        f"A filter of the current reference is part of the loop: {_filter(r.used.filter)}. The speed loop crosses at "
        f"{result.margins['speed'].crossover:.3g} Hz {without}; the filter costs {cost:.3g} deg of phase there. It "
        "keeps the requirements with the stiffness and the inertias of motor and load at the ends of their tolerances.",
    )


def _resistance(result: Tuning) -> Table:
    s, n, smallest = result.stiffness, result.noise, "smallest dynamic stiffness"
    quantity = drives(result.design.motion)
    scale, unit = (1.0, "N rms") if quantity == "force" else (1e3, "mN m rms")
    rows = (
        (f"{smallest}, position loop (at {number(s.position_frequency)} Hz)", _number(s.position_dynamic), "N m/rad"),
        (f"{smallest}, speed loop (at {number(s.speed_frequency)} Hz)", _number(s.speed_dynamic), "N m s/rad"),
        ("proportional stiffness K_t K_p (K_v + 1/T_n)", _number(s.position_proportional), "N m/rad"),
        ("static stiffness (integrator)", "unlimited", "N m/rad"),
        ("noise gain, encoder to current reference", _number(n.encoder_gain), "A/rad"),
        ("ripple of the current reference from encoder quantisation", _number(1e3 * n.encoder_ripple), "mA rms"),
        ("ripple of the true current from current noise", _number(1e3 * n.current_ripple), "mA rms"),
        (f"ripple of the true {quantity} from both", _number(scale * n.torque_ripple), unit),
    )  # fmt: skip
    return Table(("quantity", "value", "unit"), rows, "Stiffness and noise")


def _folded(result: Tuning) -> tuple[Block, ...]:
    at, delays = result.cascade.model.point, result.delays
    points = []
    for item in result.points:
        p, m = item.point, item.margins
        loop = (_number(m.crossover), _number(m.phase_margin)) if m else ("-", "-")
        points.append((
            _number(p.speed), _number(p.load), p.case, _number(p.i_q), _number(p.friction_slope),
            _number(item.slowest), *loop,
        ))  # fmt: skip
    head = (
        "speed [rad/s]", "load [N m]", "shaft", "i_q [A]", "friction slope [N m s/rad]", "slowest pole [1/s]",
        "crossover [Hz]", "phase margin [deg]",
    )  # fmt: skip
    models = tuple((name, *_brief(found)) for name, found in result.delay_models.items())
    units = tuple((maker, name, _number(v)) for maker, gains in result.gains.items() for name, v in gains.items())
    return (
        f"Linearised at {at.speed:.4g} rad/s, i_q = {at.i_q:.4g} A. Speed loop: {delays.explain_speed()}. "
        f"Current loop: {delays.explain_current()}. Discretisation: PI by forward Euler, first-order filters exact, "
        "the voltage held for one control period.",
        Table(("delay modelled as", *BRIEF), models, "Current loop by the model of its delay", folded=True),
        Table(head, tuple(points), "Operating points and the speed loop there", folded=True),
        Table(("drive", "parameter", "value"), units, f"The gains in the units of drives. {NOTE}", folded=True),
    )
