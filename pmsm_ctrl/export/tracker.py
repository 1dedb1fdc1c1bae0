"""The friction tracker as a block: the loop of the compiled extended filter, flattened for this design.

The number of operations of a call is bounded and known: every loop has a fixed length, and nothing iterates until
something has converged.
"""

from __future__ import annotations

import ast
import math

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects.catalogue import bound_effects
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export.blocks import Block, Value, identifier
from pmsm_ctrl.export.compensator import Terms, direction_lines
from pmsm_ctrl.export.program import Flattener, Program, body_of
from pmsm_ctrl.export.tracker_names import AS_THEY_ARE, EVENTS, MEMORY, NOTES, SECTIONS, SETTINGS, STATES, VECTORS
from pmsm_ctrl.export.trees import Statements, assigned, constant, expressions, name, read
from pmsm_ctrl.export.writers import symbols_of
from pmsm_ctrl.kernels.balance import torque_em
from pmsm_ctrl.track import model
from pmsm_ctrl.track.inputs import KnownTorque
from pmsm_ctrl.track.settings import Settings, covariance, memory, numbers, start
from pmsm_ctrl.track.twin import take
from pmsm_ctrl.units import psi_f_from

__all__ = ["tracker"]

WAITED = "waited"  # s since the last valid sample, up to the last call
LONG = 1e30  # s, the time since a sample that is not known

# what stands in the block's memory: name -> shape, meaning
_STORED: dict[str, tuple[tuple[int, ...], str]] = {text: ((), meaning) for text, meaning in MEMORY.values()}
_STORED |= {long: ((model.SIZE,), meaning) for long, meaning in SECTIONS.values()}
_STORED[WAITED] = ((), "s since the last valid sample")
_ARRAYS = {long: (shape, meaning) for long, shape, meaning in VECTORS.values()} | _STORED
_UNITS = {"T_load": "N m", "J": "kg m^2"}


def tracker(design: Design, settings: Settings | None = None, period: float | None = None) -> Block:
    """Return the tracker of a design.

    Parameters
    ----------
    design : Design
    settings : pmsm_ctrl.track.Settings, optional
        As for `pmsm_ctrl.track.track`; the torque noise must follow from the design or be given.
    period : float, optional
        Time between two calls, s; by default that of the design's log.

    Returns
    -------
    Block

    Raises
    ------
    RequestError
        When the design lacks friction to start from, or holds an effect that a drive cannot evaluate.
    """
    settings = settings or Settings()
    if settings.torque_noise is None and design.sensor.current_noise == 0.0:
        raise RequestError(
            f"{design.source or design.name}: sensor.current_noise is 0, so the noise of the torque is unknown; "
            "give it, or torque_noise in the tracker's settings"
        )
    logged = design.log_period if period is None else period
    s = numbers(design, settings, logged)
    known = KnownTorque(design)
    if known.notices:
        raise RequestError(f"{design.source or design.name}: {known.notices[0]}")
    terms = Terms(list(known.effects), motion=design.motion)
    signals = {a for effect, _ in known.effects for a in effect.signals}
    inputs, outputs, motor = _inputs(design, settings, signals), _outputs(settings), _motor(design)
    constants = [*motor.values(), *_settings(s).values(), *terms.constants, *_sources()]
    lines = _text(design, settings, inputs, terms)
    body = ast.parse("\n".join([*lines, *_reading(settings)])).body
    scope = {**vars(model), **body_of(take)[1], "take": take, "torque_em": torque_em, **terms.scope}
    given = _given(settings, inputs, terms, motor)
    taken = [v.name for v in (*inputs, *outputs, *constants)] + list(_ARRAYS)

    def flattened(statements: Statements, kept: set[str]) -> Program:
        return Flattener(taken, _symbols(), _elements(s), _sections()).program(statements, scope, given, kept)

    flat = flattened(body, {value.name for value in outputs})
    words = _words(list(flat.statements))
    stored = ({text for text, _ in MEMORY.values()} & words) | {WAITED}
    begin = ast.parse("\n".join(_start(design, settings, s, words))).body
    first = flattened(begin, stored).statements
    used = _words([*flat.statements, *first])
    return Block(
        identifier(design.name), "tracker", _title(design),
        inputs, outputs, flat,
        constants=tuple(value for value in constants if value.name in used),
        arrays={long: shape for long, (shape, _) in _ARRAYS.items() if long in used}, start=first,
        linear=design.motion == "linear", notes=_notes(settings),
    )  # fmt: skip


def _title(design: Design) -> str:
    left = {one.id for one, values in bound_effects(design) if one.enters == "measurement" and one.active(values)}
    doubt = f"; its inputs are not corrected for {', '.join(sorted(left))}" if left else ""
    return f"Friction tracker of {design.name}, extended Kalman filter{doubt}"


# -- names and numbers --------------------------------------------------------------------------------------------


def _inputs(design: Design, settings: Settings, signals: set[str]) -> tuple[Value, ...]:
    measured = {settings.measure} | signals & {"theta"}
    counted = "of the axis" if design.motion == "linear" else "within one turn or counted on"
    salient = design.motor.L_d is not None and design.motor.L_q is not None and design.motor.p is not None
    wanted = [
        (True, Value("dt_s", "time since the last call, s")),
        ("t" in signals, Value("time_s", "time since the start, s")),
        ("theta" in measured, Value("theta", f"measured angle, rad, {counted}")),
        ("omega" in measured, Value("omega", "measured speed, rad/s")),
        (salient or "i_d" in signals, Value("i_d", "d-axis current, A peak")),
        (True, Value("i_q", "q-axis current, A peak")),
        (True, Value("T_load", "known load torque, N m, otherwise 0")),
    ]
    return tuple(value for included, value in wanted if included)


def _outputs(settings: Settings) -> tuple[Value, ...]:
    extra = []
    for text in settings.estimate:
        extra += [
            Value(f"{text}_hat", f"{_UNITS[text]}, estimate"),
            Value(f"sd_{text}", f"{_UNITS[text]}, its standard deviation"),
        ]
    return (
        Value("F_c", "N m, Coulomb friction"),
        Value("F_v", "N m s/rad, viscous friction"),
        Value("sd_F_c", "N m, standard deviation of F_c"),
        Value("sd_F_v", "N m s/rad, standard deviation of F_v"),
        *extra,
        Value("omega_hat", "rad/s, speed"),
        Value("event", ", ".join(f"{k} {text}" for k, text in enumerate(model.EVENTS)), kind="integer"),
        Value("innovation", "measured less predicted, 0 without a measurement update"),
        Value("innovation_variance", "its variance, 0 without a measurement update"),
    )


def _motor(design: Design) -> dict[str, Value]:
    """Return the numbers from which the drive's torque follows, as in `pmsm_ctrl.regression.signals.drive_torque`."""
    motor, K_t = design.motor, design.K_t_assumed
    found = {"K_t": Value("K_T", "N m/A peak, torque constant", K_t)}
    if motor.p is not None:
        found["p"] = Value("POLE_PAIRS", "pole pairs", float(motor.p))
        found["psi_f"] = Value("PSI_F", "Wb, flux linkage that gives the torque constant", psi_f_from(K_t, motor.p))
    if motor.L_d is not None and motor.L_q is not None:
        found["L_d"] = Value("L_D", "H, d-axis inductance", motor.L_d)
        found["L_q"] = Value("L_Q", "H, q-axis inductance", motor.L_q)
    return found


def _settings(s: NDArray[np.float64]) -> dict[str, Value]:
    return {key: Value(text, meaning, float(s[vars(model)[key]])) for key, (text, meaning) in SETTINGS.items()}


def _elements(s: NDArray[np.float64]) -> dict[tuple[str, int], ast.expr]:
    """Return what the elements of the filter's memory and of its fixed numbers are in the program."""
    found: dict[tuple[str, int], ast.expr] = {
        ("settings", vars(model)[k]): constant(v.number, v.name) for k, v in _settings(s).items()
    }
    found["settings", model.FROM_ANGLE] = constant(s[model.FROM_ANGLE])
    for first, (long, _) in SECTIONS.items():
        for k, text in enumerate(STATES):
            at = ast.Subscript(name(long), ast.Tuple([constant(k, f"STATE_{text}")]))
            found["settings", vars(model)[first] + k] = at
    return found | {("memory", vars(model)[key]): name(text) for key, (text, _) in MEMORY.items()}


def _notes(settings: Settings) -> dict[str, str]:
    """Return what the variables are, with the unit of the measured channel."""
    unit = "rad" if settings.measure == "theta" else "rad/s"
    square = "rad^2" if settings.measure == "theta" else "(rad/s)^2"
    notes = NOTES | {long: meaning for long, (_, meaning) in _ARRAYS.items()}
    one = {"rad or rad/s": unit, "rad^2 or (rad/s)^2": square, "angle or speed": "angle" if unit == "rad" else "speed"}
    for both, chosen in one.items():
        notes = {key: text.replace(both, chosen) for key, text in notes.items()}
    return notes


def _sections() -> dict[tuple[str, str], str]:
    return {("settings", first): long for first, (long, _) in SECTIONS.items()}


def _words(statements: Statements) -> set[str]:
    """Return the names of variables, arrays and constants in a program."""
    return set(symbols_of(statements)).union(assigned(statements), *(read(e) for e in expressions(statements)))


def _symbols() -> dict[str, str]:
    """Return the names that the source's constants get in the program."""
    found = {text: f"STATE_{text}" for text in STATES} | {text: f"EVENT_{text}" for text in EVENTS}
    return found | {text: text for text in (*AS_THEY_ARE, *SECTIONS)}


def _sources() -> list[Value]:
    notes = {
        f"STATE_{text}": f"position of {state} in the state" for text, state in zip(STATES, model.STATES, strict=True)
    }
    notes |= {f"EVENT_{text}": f"event: {meaning}" for text, meaning in zip(EVENTS, model.EVENTS, strict=True)}
    notes |= AS_THEY_ARE
    kinds = {int: "integer", float: "real"}
    numbered = {long: vars(model)[text] for text, long in _symbols().items() if text not in SECTIONS}
    found = [Value(long, notes[long], number, kinds[type(number)]) for long, number in numbered.items()]
    return [Value("TURN", "rad, one turn", 2.0 * math.pi), *found]


def _given(settings: Settings, inputs: tuple[Value, ...], terms: Terms, motor: dict[str, Value]) -> dict[str, ast.expr]:
    given: dict[str, ast.expr] = {text: name(long) for text, (long, _, _) in VECTORS.items()}
    given |= {"m": name("memory"), "s": name("settings")} | {text: name(text) for text in _STORED}
    given |= {value.name: name(value.name) for value in inputs}
    given |= {text: constant(value.number, value.name) for text, value in motor.items()} | terms.given
    slow = 1 + max(k for k in settings.active if k != model.THETA)
    numbers_of = {"slow": constant(slow), "turn": constant(2.0 * math.pi, "TURN"), "long": constant(LONG)}
    return given | {"t": name("time_s")} | numbers_of


# -- the text around the filter's own step ----------------------------------------------------------------------------


def _text(design: Design, settings: Settings, inputs: tuple[Value, ...], terms: Terms) -> list[str]:
    """Return the lines of one call.

    Neither time nor angle is kept: a controller in single precision would lose the motion in them after some hours.
    Calls whose sample is no number add up to the time of the next one.
    """
    valid = " and ".join(f"isfinite({value.name})" for value in inputs if value.name != "dt_s")
    salient = "i_d" in {value.name for value in inputs}
    torque = "torque_em(p, psi_f, L_d, L_q, i_d, i_q)" if salient else "K_t * i_q"
    inner = [f"torque = {torque}", "drive = torque - T_load", *_turned(design, settings, terms)]
    inner += terms.lines("known_torque")
    step = "moved" if settings.measure == "theta" else "omega"
    arrays = "a, u, v, h, K"
    call = f"take(x, P, m, s, slow, {WAITED}, {step}, drive, known_torque, {arrays})"
    inner += [f"event, innovation, innovation_variance = {call}", f"{WAITED} = 0.0"]
    inner += ["m[Z_LAST] = theta"] if settings.measure == "theta" else []
    return [
        "innovation = 0.0", "innovation_variance = 0.0", "event = INVALID",
        "if not isfinite(dt_s):", f"    {WAITED} = long",
        "elif dt_s > 0.0:", f"    {WAITED} = min({WAITED} + dt_s, long)",
        f"    if {valid}:", *(f"        {line}" for line in inner),
    ]  # fmt: skip


def _turned(design: Design, settings: Settings, terms: Terms) -> list[str]:
    """Return the lines for the angle turned since the last sample, and the speed that further effects need.

    Where the angle wraps at a turn, the turn is taken that the last speed expects.
    """
    lines = []
    if settings.measure == "theta":
        lines += ["moved = theta - m[Z_LAST]"]
        if design.motion != "linear":
            lines += [f"if {WAITED} <= s[MAX_GAP]:", f"    ahead = moved - m[SPEED_LAST] * {WAITED}",
                      "    if ahead > 0.5 * turn:", "        moved = moved - turn",
                      "    elif ahead < -0.5 * turn:", "        moved = moved + turn"]  # fmt: skip
        if terms.calls:
            lines += ["omega = 0.0", f"if {WAITED} < long:", f"    omega = moved / {WAITED}"]
    return [*lines, *(direction_lines() if terms.calls else [])]


def _reading(settings: Settings) -> list[str]:
    extra = {"T_load": "T_LOAD", "J": "INERTIA"}
    lines = ["F_c = x[F_C]", "F_v = x[F_V]", "sd_F_c = sqrt(P[F_C, F_C])", "sd_F_v = sqrt(P[F_V, F_V])"]
    for text in settings.estimate:
        at = extra[text]
        lines += [f"{text}_hat = x[{at}]", f"sd_{text} = sqrt(P[{at}, {at}])"]
    return [*lines, "omega_hat = x[OMEGA]"]


def _start(design: Design, settings: Settings, s: NDArray[np.float64], used: set[str]) -> list[str]:
    """Return the lines that set the memory before the first sample; `used` are the names in the program."""
    lines = [f"for start_i in range({model.SIZE}):", f"    for start_j in range({model.SIZE}):"]
    lines += ["        P[start_i, start_j] = 0.0"]
    lines += [f"    {key}[start_i] = 0.0" for key in ("a", "h", "K", "u", "v") if VECTORS[key][0] in used]
    for name_of, value, variance in zip(STATES, start(design), np.diag(covariance(s, settings)), strict=True):
        lines += [f"x[{name_of}] = {float(value)!r}", f"P[{name_of}, {name_of}] = {float(variance)!r}"]
    numbers_of = zip(MEMORY.values(), memory(), strict=True)
    lines += [f"{text} = {float(value)!r}" for (text, _), value in numbers_of if text in used]
    lines.append(f"{WAITED} = long")
    for first, (long, _) in SECTIONS.items():
        lines += [f"{long}[{text}] = {float(s[vars(model)[first] + k])!r}" for k, text in enumerate(STATES)]
    return lines
