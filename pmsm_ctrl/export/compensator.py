"""The friction compensator as a block: the terms of the compensated effects, as the simulated drive evaluates them."""

from __future__ import annotations

import ast

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.errors import RequestError
from pmsm_ctrl.export.blocks import Block, Value, identifier, loop_gains
from pmsm_ctrl.export.program import Flattener
from pmsm_ctrl.export.trees import constant, name
from pmsm_ctrl.export.writers import symbols_of
from pmsm_ctrl.simulate.feedforward import (
    READABLE,
    TRUSTED,
    Feedforward,
    core_lines,
    estimate_lines,
    largest_current,
    limit_lines,
    observer_values,
    ramp_length,
    require_present,
    smoothing_width,
)

__all__ = ["Terms", "compensator", "direction_lines", "exported_gain", "left_out"]

_SPEEDS = {
    "measured": "measured speed, rad/s",
    "reference": "speed of the motion's reference, rad/s",
    "adaptive": "speed of the motion's reference, rad/s",
    "commanded": "commanded speed: the reference's and what the position controller adds, rad/s",
}
# estimates of the tracker, inputs of an adaptive compensation
_TRACKED = {"coulomb": ("F_c", "N m"), "viscous": ("F_v", "N m s/rad")}


_NOTES = {
    "direction": "1, sign of the speed, between -1 and 1 where it is smoothed",
    "feedforward": "N m, torque to compensate",
    "swing": "1, direction of the friction, between -1 and 1 during a reversal",
    "torque": "N m, torque asked for without compensation",
    "observed": "N m, filtered torque of current and inertia",
}


class Terms:
    """Calls of effects' terms for a program's text, with their parameters as named constants.

    Parameters
    ----------
    effects : list of (Effect, dict of str to float)
        The effects and their parameters.
    inputs : dict of str to str, optional
        Effect to the parameter that is held in the block's memory, not a constant.
    motion : {"rotary", "linear"}
        Of the axis, for the words.
    """

    def __init__(
        self,
        effects: list[tuple[Effect, dict[str, float]]],
        inputs: dict[str, str] | None = None,
        motion: str = "rotary",
    ) -> None:
        self.scope: dict[str, object] = {}
        self.given: dict[str, ast.expr] = {}
        self.calls: list[tuple[str, str]] = []
        self.constants: list[Value] = []
        self._taken: set[str] = set()
        for k, (effect, values) in enumerate(effects):
            for symbol, value in values.items():
                if effect.id in (inputs or {}) and symbol == (inputs or {})[effect.id]:
                    place = list(inputs or {}).index(effect.id)
                    self.given[f"v{k}_{symbol}"] = ast.Subscript(name("held"), ast.Tuple([constant(place)]))
                    continue
                parameter = effect.parameter(symbol)
                label = self._label(f"{effect.id}_{symbol}".upper())
                self.given[f"v{k}_{symbol}"] = constant(value, label)
                self.constants.append(Value(label, f"{parameter.unit}, {parameter.description}", value))
            own = {p.symbol for p in effect.parameters}
            arguments = (f"v{k}_{a}" if a in own else a for a in effect.arguments)
            self.scope[f"term_{k}"] = effect.term
            self.calls.append((effect.title_on(motion), f"term_{k}({', '.join(arguments)})"))

    def _label(self, text: str) -> str:
        label, number = text, 1
        while label in self._taken:
            number += 1
            label = f"{text}_{number}"
        self._taken.add(label)
        return label

    def lines(self, total: str) -> list[str]:
        """Return the lines of Python that add every term to `total`."""
        out = [f"{total} = 0.0"]
        for title, call in self.calls:
            out += [repr(title), f"{total} = {total} + {call}"]
        return out


def compensator(design: Design) -> Block:
    """Return the compensator of a design.

    Parameters
    ----------
    design : Design
        Its ``[compensation]`` names the effects.

    Returns
    -------
    Block

    Raises
    ------
    RequestError
        When there is nothing to compensate, or an effect that a drive cannot evaluate.
    """
    if design.compensation.source == "observer":
        return _observer(design)
    effects = _compensated(design)
    if not effects:
        raise RequestError(f"{design.source or design.name}: no effect to compensate; identify friction first")
    chosen = design.compensation
    adaptive = {e.id: _TRACKED[e.id][0] for e, _ in effects if chosen.source == "adaptive" and e.id in _TRACKED}
    terms = Terms(effects, adaptive, design.motion)
    numbers = {
        "K_t": Value("K_T", "N m/A, torque constant", design.K_t_assumed),
        "gain": Value("GAIN", "share of the friction that is fed forward", exported_gain(design)),
        "smoothing": Value("SMOOTHING", "rad/s, half width of the line through zero speed", smoothing_width(design)),
        "dead_zone": Value("DEAD_ZONE", "rad/s, speed up to which the direction counts as 0", chosen.dead_zone),
        "limit": Value("LIMIT", "A, largest current that is added", largest_current(design)),
        "trusted": Value("TRUSTED", "deviation of a tracked value, as a share of it, below which it is used", TRUSTED),
    }
    ramp = ramp_length(design)
    if ramp > 0.0:
        share = design.drive.speed_period / ramp
        numbers["turning"] = Value("TURNING", "s/rad, period of the calls over the travel of a reversal", share)
    constants = [*numbers.values(), *terms.constants]
    inputs = (
        Value("omega", _SPEEDS[chosen.source]),
        Value("theta", "measured angle, rad"),
        Value("i_d", "d-axis current, A"),
        Value("i_q", "current asked for without compensation, A"),
        *(value for effect in adaptive for value in _tracked(*_TRACKED[effect])),
        Value("enable", "FALSE: nothing is added", kind="flag"),
    )
    given: dict[str, ast.expr] = {
        **terms.given,
        **{key: constant(value.number, value.name) for key, value in numbers.items()},
        "p": constant(float(design.motor.p or 0)),
        **{value.name: name(value.name) for value in inputs},
        "held": name("held"),
        "swing": name("swing"),
    }
    outputs = (
        Value("i_q_add", "current to add to the speed controller's output, A"),
        Value("fault", "an input is not a number: nothing is added", kind="flag"),
    )
    lines, begin = _text(terms, inputs, adaptive, dict(effects_start(effects)), ramp > 0.0)
    arrays: dict[str, tuple[int, ...]] = {"held": (len(adaptive),)} if adaptive else {}
    arrays |= {"swing": ()} if ramp > 0.0 else {}
    reserved = [value.name for value in (*inputs, *constants, *outputs)] + ["held", "swing"]
    read_later = {value.name for value in outputs} | set(arrays)
    flat = Flattener(reserved).program(ast.parse("\n".join(lines)).body, terms.scope, given, read_later)
    first = Flattener(reserved).program(ast.parse("\n".join(begin)).body, terms.scope, given, set(arrays)).statements
    used = symbols_of(flat.statements)
    return Block(
        identifier(design.name), "compensation", f"Friction compensation of {design.name}", inputs, outputs, flat,
        constants=tuple(value for value in constants if value.name in used),
        arrays=arrays, start=first if arrays else (),
        gains=loop_gains(design), linear=design.motion == "linear",
        notes=_NOTES | {"held": "last trusted " + ", ".join(" in ".join(_TRACKED[effect]) for effect in adaptive)},
    )  # fmt: skip


def _observer(design: Design) -> Block:
    """Return the disturbance observer; it observes also while it is not enabled, and so starts without a step."""
    own = observer_values(design)
    numbers = {
        "K_t": Value("K_T", "N m/A, torque constant", design.K_t_assumed),
        "gain": Value("GAIN", "1, share of the observed disturbance that is fed back", exported_gain(design)),
        "limit": Value("LIMIT", "A, largest current that is added", largest_current(design)),
        "bandwidth": Value("BANDWIDTH", "rad/s, of the observer", own["bandwidth"]),
        "share": Value("SHARE", "1, of the filter per call: the speed controller's period is part of it", own["share"]),
        "inertia": Value("INERTIA", "kg m^2, as assumed", own["inertia"]),
    }
    inputs = (
        Value("omega", _SPEEDS["measured"]),
        Value("applied", "current reference of the last call, as it was limited, A"),
        Value("enable", "FALSE: nothing is added", kind="flag"),
    )
    outputs = (
        Value("i_q_add", "current to add to the speed controller's output, A"),
        Value("fault", "an input is not a number: nothing is added", kind="flag"),
    )
    lines = ["i_q_add = 0.0", "fault = True", "if isfinite(omega) and isfinite(applied):", "    fault = False"]
    lines += ["    observed = held[0]", *(f"    {line}" for line in estimate_lines()), "    held[0] = observed"]
    lines += ["    if enable:", *(f"        {line}" for line in limit_lines())]
    given: dict[str, ast.expr] = {
        **{key: constant(value.number, value.name) for key, value in numbers.items()},
        **{value.name: name(value.name) for value in inputs},
        "held": name("held"),
    }
    reserved = [value.name for value in (*inputs, *numbers.values(), *outputs)] + ["held"]
    kept = {value.name for value in outputs} | {"held"}
    flat = Flattener(reserved).program(ast.parse("\n".join(lines)).body, {}, given, kept)
    first = Flattener(reserved).program(ast.parse("held[0] = 0.0").body, {}, given, {"held"}).statements
    return Block(
        identifier(design.name), "compensation", f"Disturbance observer of {design.name}", inputs, outputs, flat,
        constants=tuple(numbers.values()), arrays={"held": (1,)}, start=first, gains=loop_gains(design),
        linear=design.motion == "linear", notes=_NOTES | {"held": "N m, filtered torque of current and inertia"},
    )  # fmt: skip


def exported_gain(design: Design) -> float:
    """Return the gain that is exported: the design's, also where it is 0; 1 where it states none."""
    stated = design.compensation.gain
    return 1.0 if stated is None else stated


def left_out(design: Design) -> tuple[str, ...]:
    """Return the effects of a design that could be fed forward and that its compensation does not name.

    `compensate` judges all of them where the design states no gain.

    Parameters
    ----------
    design : Design
    """
    from pmsm_ctrl.compensate.runs import compensated

    if not design.effects or design.compensation.source == "observer":
        return ()
    whole = Feedforward.of(compensated(design, [entry.id for entry in design.effects]))
    found = () if whole is None else dict.fromkeys(effect.id for effect in whole.effects)
    return tuple(name for name in found if name not in design.compensation.effects)


def effects_start(effects: list[tuple[Effect, dict[str, float]]]) -> list[tuple[str, float]]:
    """Return the values of the design for what the tracker renews, by symbol."""
    return [(symbol, v[symbol]) for e, v in effects if e.id in _TRACKED and (symbol := _TRACKED[e.id][0]) in v]


def _tracked(symbol: str, unit: str) -> tuple[Value, Value]:
    return Value(symbol, f"as tracked, {unit}"), Value(f"sd_{symbol}", f"its standard deviation, {unit}")


def _text(
    terms: Terms, inputs: tuple[Value, ...], adaptive: dict[str, str], start: dict[str, float], turns: bool
) -> tuple[list[str], list[str]]:
    """Return the lines of one call, and those that set the memory before the first one.

    An input that is no number adds nothing and sets the flag; a tracked value counts once it can be trusted, and is
    held while it cannot.
    """
    symbols = list(adaptive.values())
    gate = []
    for k, symbol in enumerate(symbols):
        gate += [f"    if {symbol} > 0.0 and sd_{symbol} < trusted * {symbol}:", f"        held[{k}] = {symbol}"]
    inner = core_lines(terms.lines("feedforward"), turns)
    finite = " and ".join(f"isfinite({value.name})" for value in inputs if value.kind == "real")
    lines = ["i_q_add = 0.0", "fault = True", f"if {finite}:", "    fault = False", *gate, "    if enable:"]
    return [*lines, *(f"        {line}" for line in inner)], [
        *(f"held[{k}] = {start[s]!r}" for k, s in enumerate(symbols)),
        *(["swing = 0.0"] if turns else []),
    ]


def direction_lines() -> list[str]:
    """Return the lines for the sign of the speed."""
    return ["direction = 0.0", "if omega > 0.0:", "    direction = 1.0", "elif omega < 0.0:", "    direction = -1.0"]


def _compensated(design: Design) -> list[tuple[Effect, dict[str, float]]]:
    """Return the compensated effects; refuse one that a drive cannot evaluate: leaving it out would go unnoticed."""
    if design.effects:
        require_present(design)
    chosen = []
    for effect, values in bound_effects(design):
        if effect.id not in design.compensation.effects or not effect.active(values):
            continue
        if effect.enters != "torque" or effect.has_state or not set(effect.signals) <= set(READABLE):
            raise RequestError(
                f"{design.source or design.name}: compensation.effects: '{effect.id}' cannot be evaluated in a drive; "
                "take it out of the compensation"
            )
        chosen.append((effect, values))
    return chosen
