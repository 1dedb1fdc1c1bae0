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
from pmsm_ctrl.simulate.feedforward import READABLE

__all__ = ["Terms", "compensator", "direction_lines"]

_SPEEDS = {
    "measured": "measured speed, rad/s",
    "reference": "speed of the motion's reference, rad/s",
    "adaptive": "speed of the motion's reference, rad/s",
    "commanded": "commanded speed: the reference's and what the position controller adds, rad/s",
}
# estimates of the tracker, inputs of an adaptive compensation
_TRACKED = {"coulomb": ("F_c", "N m"), "viscous": ("F_v", "N m s/rad")}


class Terms:
    """Calls of effects' terms for a program's text, with their parameters as named constants.

    Parameters
    ----------
    effects : list of (Effect, dict of str to float)
        The effects and their parameters.
    inputs : dict of str to str, optional
        Effect to the parameter that is an input of the block, not a constant.
    """

    def __init__(self, effects: list[tuple[Effect, dict[str, float]]], inputs: dict[str, str] | None = None) -> None:
        self.scope: dict[str, object] = {}
        self.given: dict[str, ast.expr] = {}
        self.calls: list[tuple[str, str]] = []
        self.constants: list[Value] = []
        self._taken: set[str] = set()
        for k, (effect, values) in enumerate(effects):
            for symbol, value in values.items():
                if effect.id in (inputs or {}) and symbol == (inputs or {})[effect.id]:
                    self.given[f"v{k}_{symbol}"] = name(symbol)
                    continue
                parameter = effect.parameter(symbol)
                label = self._label(f"{effect.id}_{symbol}".upper())
                self.given[f"v{k}_{symbol}"] = constant(value, label)
                self.constants.append(Value(label, f"{parameter.unit}, {parameter.description}", value))
            own = {p.symbol for p in effect.parameters}
            arguments = (f"v{k}_{a}" if a in own else a for a in effect.arguments)
            self.scope[f"term_{k}"] = effect.term
            self.calls.append((effect.title, f"term_{k}({', '.join(arguments)})"))

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
    effects = _compensated(design)
    if not effects:
        raise RequestError(f"{design.source or design.name}: no effect to compensate; identify friction first")
    chosen = design.compensation
    adaptive = {e.id: _TRACKED[e.id][0] for e, _ in effects if chosen.source == "adaptive" and e.id in _TRACKED}
    terms = Terms(effects, adaptive)
    lines = direction_lines(chosen.smoothing)
    lines += ["torque = K_t * i_q", *terms.lines("feedforward"), "i_q_add = gain * feedforward / K_t"]
    constants = [
        Value("K_T", "N m/A, torque constant", design.K_t_assumed),
        Value("GAIN", "share of the friction that is fed forward", chosen.gain or 1.0),
        *([Value("SMOOTHING", "rad/s, half width of the line through zero speed", chosen.smoothing)]
          if chosen.smoothing > 0.0 else []),
        *terms.constants,
    ]  # fmt: skip
    inputs = (
        Value("omega", _SPEEDS[chosen.source]),
        Value("theta", "measured angle, rad"),
        Value("i_d", "d-axis current, A"),
        Value("i_q", "current asked for without compensation, A"),
        *(Value(symbol, f"as tracked, {unit}") for effect, (symbol, unit) in _TRACKED.items() if effect in adaptive),
    )
    given: dict[str, ast.expr] = {
        **terms.given,
        "K_t": constant(design.K_t_assumed, "K_T"),
        "gain": constant(chosen.gain or 1.0, "GAIN"),
        "smoothing": constant(chosen.smoothing, "SMOOTHING"),
        "p": constant(float(design.motor.p or 0)),
        **{value.name: name(value.name) for value in inputs},
    }
    reserved = [value.name for value in (*inputs, *constants)] + ["i_q_add"]
    flat = Flattener(reserved).program(ast.parse("\n".join(lines)).body, terms.scope, given, {"i_q_add"})
    used = symbols_of(flat.statements)
    return Block(
        identifier(design.name), "compensation", f"Friction compensation of {design.name}",
        inputs, (Value("i_q_add", "current to add to the speed controller's output, A"),), flat,
        constants=tuple(value for value in constants if value.name in used), gains=loop_gains(design),
        linear=design.motion == "linear",
    )  # fmt: skip


def direction_lines(width: float = 0.0) -> list[str]:
    """Return the lines for the sign of the speed, linear between +- `width` rad/s."""
    if width > 0.0:
        return ["direction = min(max(omega / smoothing, -1.0), 1.0)"]
    return ["direction = 0.0", "if omega > 0.0:", "    direction = 1.0", "elif omega < 0.0:", "    direction = -1.0"]


def _compensated(design: Design) -> list[tuple[Effect, dict[str, float]]]:
    """Return the compensated effects; refuse one that a drive cannot evaluate: leaving it out would go unnoticed."""
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
