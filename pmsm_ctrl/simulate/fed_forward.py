"""The current that a design's compensator adds, over the samples of a log and effect by effect.

It runs `core_lines`, the lines that the simulated drive runs and the code export prints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import Effect, bound_effects
from pmsm_ctrl.errors import LogError, RequestError
from pmsm_ctrl.simulate.feedforward import (
    Feedforward,
    core_lines,
    largest_current,
    ramp_length,
    smoothing_width,
)

__all__ = ["fed_currents", "read_speed"]

Array = NDArray[np.float64]

_SIGNALS = {"theta": "theta", "i_d": "i_d", "i_q": "i_q_ref"}  # what a compensator reads: channel of a log


def read_speed(design: Design, channels: Mapping[str, Array]) -> Array:
    """Return the speed that a design's compensator reads, rad/s (m/s), shape (n,).

    Parameters
    ----------
    design : Design
    channels : mapping of str to array, shape (n,)
        Of a log.

    Returns
    -------
    array, shape (n,)

    Raises
    ------
    LogError
        When a channel that it needs is missing.
    RequestError
        For a disturbance observer, which reads no speed that a log can repeat.
    """
    source = design.compensation.source
    if source == "observer":
        raise RequestError(
            f"{design.source or design.name}: compensation.source: 'observer' has no feedforward of its own; accepted: "
            "reference, adaptive, commanded, measured"
        )
    needed = {"measured": ("omega",), "commanded": ("omega_ref", "theta_ref", "theta")}.get(source, ("omega_ref",))
    missing = [name for name in needed if name not in channels]
    if missing:
        raise LogError(f"no {', '.join(missing)}: the compensator reads the {source} speed (present: "
                       f"{', '.join(channels)})")  # fmt: skip
    if source == "measured":
        return channels["omega"]
    if source == "commanded":
        place = design.require_loops().position
        error = channels["theta_ref"] - channels["theta"]
        return place.velocity_feedforward * channels["omega_ref"] + place.K_v * error
    return channels["omega_ref"]


def fed_currents(
    design: Design, channels: Mapping[str, Array], speed: Array, period: float
) -> dict[str, Array]:  # fmt: skip
    """Return the current that the compensator adds for each of its effects at a gain of 1, A, shape (n,).

    Parameters
    ----------
    design : Design
        Its ``[compensation]``.
    channels : mapping of str to array, shape (n,)
        ``theta`` and the currents, where an effect reads them.
    speed : array, shape (n,)
        That the compensator reads, rad/s (m/s).
    period : float
        Of the samples, s.

    Returns
    -------
    dict of effect to array, shape (n,)

    Raises
    ------
    RequestError
        When the design compensates nothing.
    LogError
        When a channel that an effect reads is missing.
    """
    chosen = design.compensation.model_copy(update={"gain": 1.0})
    feedforward = Feedforward.of(design.model_copy(update={"compensation": chosen}))
    if feedforward is None:
        raise RequestError(
            f"{design.source or design.name}: compensation.effects: none of {', '.join(chosen.effects)} is in the "
            "design with a parameter above 0"
        )
    known = {name: channels[channel] for name, channel in _SIGNALS.items() if channel in channels}
    known.setdefault("i_d", np.zeros_like(speed))
    if "i_q" not in known and "i_q" in channels:
        known["i_q"] = channels["i_q"]
    ramp = ramp_length(design)
    constants = {
        "gain": 1.0, "smoothing": smoothing_width(design), "dead_zone": chosen.dead_zone,
        "limit": largest_current(design), "K_t": design.K_t_assumed, "p": float(design.motor.p or 0),
        "turning": period / ramp if ramp > 0.0 else 0.0,
    }  # fmt: skip
    active = {effect.id: values for effect, values in bound_effects(design)}
    out = {}
    for effect in feedforward.effects:
        missing = [name for name in effect.signals if name in ("theta", "i_q") and name not in known]
        if missing:
            raise LogError(f"no {', '.join(missing)}: the compensation of '{effect.id}' reads it (present: "
                           f"{', '.join(channels)})")  # fmt: skip
        loop = _loop(effect, turns=ramp > 0.0)
        rows = [known.get(name, speed).tolist() for name in ("i_d", "i_q", "theta")]
        out[effect.id] = np.array(loop(speed.tolist(), *rows, {**constants, **active[effect.id]}))
    return out


def _loop(effect: Effect, *, turns: bool) -> Callable[..., list[float]]:
    """Return the compensator of one effect as a plain Python function over lists."""
    own = {parameter.symbol for parameter in effect.parameters}
    named = {symbol: f"own_{symbol}" for symbol in own}
    given = ", ".join(named.get(name, name) for name in effect.arguments)
    fixed = ("gain", "smoothing", "dead_zone", "limit", "K_t", "p", "turning")
    lines = [
        "def loop(speeds, i_ds, i_qs, thetas, values):",
        f"    {', '.join(fixed)} = ({', '.join(f'values[{name!r}]' for name in fixed)})",
        *(f"    own_{symbol} = values[{symbol!r}]" for symbol in own),
        "    swing, out = 0.0, []",
        "    for omega, i_d, i_q, theta in zip(speeds, i_ds, i_qs, thetas):",
        *(f"        {line}" for line in core_lines([f"feedforward = effect_term({given})"], turns)),
        "        out.append(i_q_add)",
        "    return out",
    ]
    scope: dict[str, Any] = {"effect_term": effect.py_term}
    exec("\n".join(lines), scope)
    function: Callable[..., list[float]] = scope["loop"]
    return function
