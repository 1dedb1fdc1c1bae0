"""Variants of a design: without friction compensation, and with a chosen one, its parameters right or wrong."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pmsm_ctrl.design import Design
from pmsm_ctrl.effects import bound_effects
from pmsm_ctrl.sampling import speed_lag

__all__ = ["baseline", "compensated"]


def baseline(design: Design) -> Design:
    """Return the design without friction compensation, inertia and delay fed forward.

    The drive's speed lags the true one; a reference that is not delayed alike makes an error of lag times
    acceleration, which must not be taken for friction's.
    """
    loops = design.require_loops()
    lag = speed_lag(design.drive.speed_period, design.sensor.speed_filter)
    speed = loops.speed.model_copy(update={"reference_filter": loops.speed.reference_filter or lag})
    position = loops.position.model_copy(
        update={"acceleration_feedforward": loops.position.acceleration_feedforward or 1.0}
    )
    loops = loops.model_copy(update={"speed": speed, "position": position})
    off = design.compensation.model_copy(update={"gain": 0.0})
    return design.model_copy(update={"loops": loops, "compensation": off})


def compensated(
    design: Design, effects: Iterable[str], *, gain: float = 1.0, source: str = "reference", factor: float = 1.0,
    smoothing: float | None = None,
) -> Design:  # fmt: skip
    """Return the design with these effects compensated, their linear parameters off by `factor`.

    The sign of the commanded speed, which follows the measured angle, is smoothed over what five counts of the
    encoder make of it, unless `smoothing` or the design says otherwise.
    """
    chosen = tuple(effects)
    entries = []
    for entry, (effect, values) in zip(design.effects, bound_effects(design), strict=True):
        if effect.id in chosen:
            values = values | {p.symbol: values[p.symbol] * factor for p in effect.linear}
        entries.append(entry.model_copy(update={"parameters": values}))
    width = design.compensation.smoothing if smoothing is None else smoothing
    if smoothing is None and width == 0.0 and source == "commanded" and design.loops is not None:
        turn = 1.0 if design.motion == "linear" else 2.0 * np.pi
        width = float(5.0 * design.loops.position.K_v * turn / (design.sensor.encoder_counts or 1 << 20))
    changed = design.compensation.model_copy(
        update={"gain": gain, "source": source, "smoothing": width, "effects": chosen}
    )
    return design.replace_effects(tuple(entries)).model_copy(update={"compensation": changed})
