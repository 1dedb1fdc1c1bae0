"""A tuning as text, as plain values and as a section of the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.result import Section, jsonable
from pmsm_ctrl.tune import plots
from pmsm_ctrl.tune.drive_units import NOTE

if TYPE_CHECKING:
    from pmsm_ctrl.tune.tuning import Tuning

AS_GIVEN = "as given in the design"  # the method of gains that were only judged
PROOF = 'Promised and measured ("shown" is not judged)'

__all__ = ["AS_GIVEN", "section", "summary", "to_dict", "warnings"]

Table = tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]


def _number(value: float) -> str:
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "unlimited" if value > 0 else "-unlimited"
    return f"{value:.4g}"


def warnings(tuning: Tuning) -> tuple[str, ...]:
    """Return the reasons to doubt the gains."""
    out = []
    for name, found in tuning.margins.items():
        out += [f"{name} loop misses a requirement: {item}" for item in tuning.requirements.missed(found)]
    out += [f"worst corner of the tolerances, {item}" for item in tuning.robustness.missed]
    for item in tuning.points:
        if item.margins is not None and (missed := tuning.requirements.missed(item.margins)):
            out.append(f"speed loop at {item.point.speed:.3g} rad/s and {item.point.load:.3g} N m: {', '.join(missed)}")
    resonant = tuning.resonance
    if resonant is not None and resonant.slowed:
        cure = resonant.proposed
        out.append(
            f"resonance at {resonant.resonance:.4g} Hz: the speed loop had to be slowed down to run without a filter"
            + (
                f"; a {cure.filter.kind.replace('_', '-')} at {cure.filter.frequency:.4g} Hz would save it"
                if cure
                else ""
            )
        )
    limit = tuning.design.drive.i_max
    if math.isfinite(limit) and tuning.noise.encoder_ripple > 0.02 * limit:
        out.append(
            f"the encoder's resolution makes {1e3 * tuning.noise.encoder_ripple:.3g} mA rms of current ripple, more "
            "than 2 % of the current limit; filter the speed or slow the loop down"
        )
    if tuning.linear_deviation > 1e-4:
        out.append(
            f"analytic and numerical linearisation differ by {100.0 * tuning.linear_deviation:.2g} %: an effect's "
            "term is not smooth at the operating point"
        )
    if tuning.proof is not None:
        for figure in tuning.proof.failed:
            out.append(
                f"proof: {figure.loop}, {figure.name}: promised {_number(figure.promised)} {figure.unit}, measured "
                f"{_number(figure.measured)} {figure.unit}, unexplained"
            )
    return tuple(out)


def _pi(K_p: float, T_n: float, unit: str) -> str:
    return f"K_p {_number(K_p)} {unit}, T_n {_number(1e3 * T_n)} ms"


def _gains(tuning: Tuning) -> Table:
    loops, methods = tuning.loops, tuning.methods
    rows = [
        ("current (q)", _pi(loops.current.K_p, loops.current.T_n, "V/A"), methods["current"]),
        ("speed", _pi(loops.speed.K_p, loops.speed.T_n, "A/(rad/s)")
         + f", reference filter {_number(1e3 * loops.speed.reference_filter)} ms", methods["speed"]),
        ("position", f"K_v {_number(loops.position.K_v)} 1/s", methods["position"]),
    ]  # fmt: skip
    if loops.current.K_p_d is not None:
        assert loops.current.T_n_d is not None
        rows.insert(0, ("current (d)", _pi(loops.current.K_p_d, loops.current.T_n_d, "V/A"), methods["current"]))
    return ("loop", "gains", "method"), tuple(rows)


def _margins(tuning: Tuning) -> Table:
    names = list(tuning.margins)
    rows = []
    for label, unit, get in (
        ("crossover", "Hz", lambda m: m.crossover),
        ("bandwidth (-3 dB)", "Hz", lambda m: m.bandwidth),
        ("phase margin", "deg", lambda m: m.phase_margin),
        ("gain margin", "dB", lambda m: m.gain_margin_db),
        ("delay margin", "us", lambda m: 1e6 * m.delay_margin),
        ("disk margin", "1", lambda m: m.disk_margin),
        ("sensitivity peak", "1", lambda m: m.sensitivity_peak),
        ("complementary peak", "1", lambda m: m.complementary_peak),
    ):
        rows.append((label, unit, *(_number(get(tuning.margins[name])) for name in names)))
    allowed = tuple(_number(tuning.highest.get(name, math.nan)) for name in names)
    rows.append(("highest crossover at 45 deg", "Hz", *allowed))
    return ("margin", "unit", *names), tuple(rows)


def _resistance(tuning: Tuning) -> Table:
    s, n = tuning.stiffness, tuning.noise
    by_angle = f"{_number(s.position_dynamic)} at {_number(s.position_frequency)} Hz"
    by_speed = f"{_number(s.speed_dynamic)} at {_number(s.speed_frequency)} Hz"
    return ("figure", "value", "unit"), (
        ("least dynamic stiffness, position", by_angle, "N m/rad"),
        ("least dynamic stiffness, speed", by_speed, "N m s/rad"),
        ("proportional stiffness K_t K_p (K_v + 1/T_n)", _number(s.position_proportional), "N m/rad"),
        ("static stiffness", "unlimited (integrator)", "N m/rad"),
        ("noise gain, encoder angle to current", _number(n.encoder_gain), "A/rad"),
        ("current ripple from encoder steps", _number(1e3 * n.encoder_ripple), "mA rms"),
        ("current ripple from current noise", _number(1e3 * n.current_ripple), "mA rms"),
        ("torque ripple from both", _number(1e3 * n.torque_ripple), "mN m rms"),
    )  # fmt: skip


def _point_table(tuning: Tuning) -> Table:
    rows = []
    for item in tuning.points:
        p, m = item.point, item.margins
        rows.append((
            _number(p.speed), _number(p.load), p.case, _number(p.i_q), _number(p.friction_slope), _number(item.slowest),
            _number(m.crossover) if m else "nothing moves", _number(m.phase_margin) if m else "-",
        ))  # fmt: skip
    return (
        "speed [rad/s]", "load [N m]", "shaft", "i_q [A]", "friction slope [N m s/rad]", "slowest pole [1/s]",
        "crossover [Hz]", "phase margin [deg]",
    ), tuple(rows)  # fmt: skip


def _delay_table(tuning: Tuning) -> Table:
    return ("delay written as", "crossover [Hz]", "phase margin [deg]", "gain margin [dB]"), tuple(
        (m.name, _number(m.margins.crossover), _number(m.margins.phase_margin), _number(m.margins.gain_margin_db))
        for m in tuning.delay_models
    )


def _robust_table(tuning: Tuning) -> Table:
    r = tuning.robustness
    rows = []
    for loop, corner in (
        ("current", r.nominal),
        ("current", r.worst_current),
        ("speed", r.nominal),
        ("speed", r.worst_speed),
    ):
        m = corner.current if loop == "current" else corner.speed
        rows.append(
            (loop, corner.name, _number(m.phase_margin), _number(m.gain_margin_db), _number(m.sensitivity_peak))
        )
    return ("loop", "corner", "phase margin [deg]", "gain margin [dB]", "sensitivity peak"), tuple(rows)


def _proof_table(tuning: Tuning) -> Table | None:
    if tuning.proof is None:
        return None
    rows = tuple(
        (f.loop, f.name, f.unit, _number(f.promised), _number(f.measured),
         ": ".join(filter(None, (f.verdict, f.explanation))))
        for f in tuning.proof.figures
    )  # fmt: skip
    return ("loop", "figure", "unit", "promised", "measured", "verdict"), rows


def _resonance_table(tuning: Tuning) -> Table | None:
    r = tuning.resonance
    if r is None:
        return None
    rows = [("none, gains of the rigid axis", *_brief(r.before), ", ".join(r.before_missed) or "kept")]
    for option in r.options:
        f = option.filter
        text = f"{f.kind.replace('_', '-')} {f.frequency:.4g} Hz, damping {f.damping_denominator:.2g}"
        if f.kind == "notch":
            text += f", depth {f.damping_numerator / f.damping_denominator:.2g}"
        rows.append((text, *_brief(option.margins), ", ".join(option.missed) or "kept"))
    rows.append(("none, gains of this design", *_brief(tuning.margins["speed"]), "kept" if not
                 tuning.requirements.missed(tuning.margins["speed"]) else "missed"))  # fmt: skip
    return (
        "filter",
        "crossover [Hz]",
        "phase margin [deg]",
        "gain margin [dB]",
        "sensitivity peak",
        "requirements",
    ), tuple(rows)


def _brief(m: Any) -> tuple[str, str, str, str]:
    if m.stable is False:
        return _number(m.crossover), "unstable", "unstable", "-"
    return _number(m.crossover), _number(m.phase_margin), _number(m.gain_margin_db), _number(m.sensitivity_peak)


def _text(table: Table) -> str:
    header, rows = table
    widths = [max(len(row[k]) for row in (header, *rows)) for k in range(len(header))]

    def line(row: Sequence[str]) -> str:
        return "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()

    return "\n".join([line(header), "  ".join("-" * w for w in widths), *(line(row) for row in rows)])


def _trust(tuning: Tuning) -> str:
    kept = "every margin is kept" if not any(
        tuning.requirements.missed(m) for m in tuning.margins.values()
    ) else "NOT every margin is kept"  # fmt: skip
    if tuning.proof is None:
        return f"{kept}; not proved on the simulated drive"
    judged = [f for f in tuning.proof.figures if f.verdict != "shown"]
    met = sum(f.verdict == "met" for f in judged)
    explained = sum(f.verdict == "explained" for f in judged)
    return (
        f"{kept}; proof at {tuning.proof.speed:.4g} rad/s: {met} of {len(judged)} judged figures met, "
        f"{explained} explained, {len(tuning.proof.failed)} failed"
    )


def _tables(tuning: Tuning) -> list[tuple[str, Table]]:
    found = [
        ("Gains", _gains(tuning)),
        ("Margins of the discrete loops as they run", _margins(tuning)),
        ("Delay of the current loop, by the way it is written", _delay_table(tuning)),
        ("Operating points and the speed loop there", _point_table(tuning)),
        ("Resistance to loads and noise", _resistance(tuning)),
        (f"Tolerances ({tuning.robustness.corners} points, worst named)", _robust_table(tuning)),
    ]
    for title, table in (("Resonance", _resonance_table(tuning)), (PROOF, _proof_table(tuning))):
        if table is not None:
            found.append((title, table))
    return found


def summary(tuning: Tuning) -> str:
    """Return the tuning as text, trust first."""
    done = "judged as given" if tuning.methods["speed"] == AS_GIVEN else "tuned"
    lines = [f"{tuning.design.name}: loops {done}; {_trust(tuning)}"]
    lines += [f"warning: {item}" for item in tuning.warnings]
    for title, table in _tables(tuning):
        lines += ["", title, _text(table)]
    return "\n".join(lines)


def section(tuning: Tuning) -> Section:
    """Return the section of the report."""
    sliding = tuning.cascade.model.point
    paragraphs = [
        f"Trust: {_trust(tuning)}.",
        *(f"Warning: {item}." for item in tuning.warnings),
        f"Linearised about {sliding.speed:.4g} rad/s, i_q = {sliding.i_q:.4g} A. The analytic Jacobian and "
        f"python-control's numerical one agree to {tuning.linear_deviation:.1e} at every operating point.",
        f"Speed loop: {tuning.delays.explain_speed()}. Current loop: {tuning.delays.explain_current()}.",
        "Discretisation: PI by forward Euler, first-order filters exact, the voltage held for one control period; the "
        "margins are those of the sampled loops, found by python-control.",
    ]
    units = tuning.gains
    rows = tuple((maker, name, _number(value)) for maker, gains in units.items() for name, value in gains.items())
    tables = [*_tables(tuning), ("The gains as drives take them", (("drive", "parameter", "value"), rows))]
    paragraphs.append(NOTE)
    figures = [
        (
            tuning.plot(),
            "Open loops, their distance to the critical point, and the steps they promise (lines) with what the "
            "simulated drive did (crosses, dashes).",
        )
    ]
    resonant = tuning.resonance
    if resonant is not None and resonant.options:
        from pmsm_ctrl.tune.speed import open_loop

        best = resonant.options[0]
        figures.append((
            plots.resonance_figure(
                open_loop(tuning.cascade, resonant.gains), open_loop(tuning.cascade, resonant.gains, (best.filter,)),
                f"with the {best.filter.kind.replace('_', '-')} at {best.filter.frequency:.4g} Hz",
            ),
            "The resonance lifts the loop gain where the phase has passed -180 deg; the filter takes the peak away.",
        ))  # fmt: skip
    captions, shown = zip(*tables, strict=True)
    return Section("Tuning of the loops", tuple(paragraphs), shown, tuple(figures), captions)


def to_dict(tuning: Tuning) -> dict[str, Any]:
    """Return gains, margins and proof as plain values fit for JSON."""
    r, resonant = tuning.robustness, tuning.resonance
    out = {
        "schema": "pmsm-ctrl/tuning/1",
        "defended": tuning.defended,
        "methods": dict(tuning.methods),
        "loops": tuning.loops.model_dump(exclude_none=True),
        "gains": tuning.gains,
        "margins": {name: m.to_dict() for name, m in tuning.margins.items()},
        "highest_crossover_hz": dict(tuning.highest),
        "delay_models": {m.name: m.margins.to_dict() for m in tuning.delay_models},
        "stiffness": vars(tuning.stiffness),
        "noise": vars(tuning.noise),
        "robustness": {
            "worst_current": {"corner": r.worst_current.name, **r.worst_current.current.to_dict()},
            "worst_speed": {"corner": r.worst_speed.name, **r.worst_speed.speed.to_dict()},
            "missed": r.missed,
            "slowed": r.slowed,
        },
        "operating_points": [
            {**vars(item.point), "slowest_pole": item.slowest, "speed_loop": item.margins and item.margins.to_dict()}
            for item in tuning.points
        ],
        "warnings": tuning.warnings,
    }
    if resonant is not None:
        cure = resonant.proposed
        out["resonance"] = {
            "antiresonance_hz": resonant.antiresonance,
            "resonance_hz": resonant.resonance,
            "before": resonant.before.to_dict(),
            "proposed": {**vars(cure.filter), **cure.margins.to_dict()} if cure else None,
        }
    if tuning.proof is not None:
        out["proof"] = [vars(figure) for figure in tuning.proof.figures]
    return dict(jsonable(out))
