"""The words of a comparison: notices, and its findings in words."""

from __future__ import annotations

import numpy as np

from pmsm_ctrl.compare.motion import Kind, Motion
from pmsm_ctrl.residuals.dependence import Dependence, Objection, ResidualStructure
from pmsm_ctrl.section import Template

__all__ = [
    "ABOVE_FLOOR", "CHANGES", "CLOSED_LOOP_FAILED", "HOLDOUT_IS_LOG", "LEFT_OUT", "LITTLE_EXPLAINED",
    "NOT_IN_FREE_RUN", "NOT_PREDICTED", "OBJECTIONS", "OTHER_ZERO_THAN_DESIGN", "STRUCTURE", "coordinate_words",
    "largest_words", "motion_words", "structure_words",
]  # fmt: skip

NOT_IN_FREE_RUN = Template("not_in_free_run", "{effect} is not part of the free run: {why}")
NOT_PREDICTED = Template("not_predicted", "{why}")
CLOSED_LOOP_FAILED = Template("closed_loop_failed", "the closed-loop simulation is not possible: {error}")
HOLDOUT_IS_LOG = Template(
    "holdout_is_log", "hold-out record and log are the same data: the hold-out error validates nothing"
)

LEFT_OUT = Template(
    "left_out_when_fitted", "{start:.2f} to {stop:.2f} s is left out, as it was when the design was fitted to this log"
)
CHANGES = Template(
    "other_friction_when_fitted",
    "from {at:.2f} s on the dry friction is fitted anew, as it was when the design was fitted to this log",
)

OTHER_ZERO_THAN_DESIGN = Template(
    "other_zero_than_design",
    "the position has another zero than the design's waves along it: with {shift:+.3g} {unit} added to it the error "
    "would be {after:.2f} % instead of {before:.2f} %",
)
STRUCTURE = Template("residual_structure", "{channel}: {words}")
LITTLE_EXPLAINED = Template(
    "little_explained",
    "the error is {percent:.0f} % of the torque: the design explains {explained:.0f} % of its mean square, less than "
    "half",
)
ABOVE_FLOOR = Template(
    "above_noise_floor",
    "{channel}: the residual is {ratio:.2g} times its noise floor, with no significant dependence on any coordinate",
)

OBJECTIONS = {
    Objection.NOT_SIGNIFICANT: "not significant",
    Objection.NOT_CONFIRMED: "not confirmed by cross-validation",
    Objection.TOO_SMALL: "too small to matter",
}


def coordinate_words(d: Dependence) -> str:
    """Return a coordinate as a sentence says it."""
    if d.coordinate == "speed" and np.isfinite(d.backward).any():
        return "speed and direction"
    if d.orders and d.rank:
        many = "orders" if len(d.orders) > 1 else "order"
        return f"position ({many} {', '.join(map(str, d.orders))} of a turn)"
    if d.period:
        return f"{d.coordinate} (a wave of {d.period / (2.0 * np.pi):.4g} turns)"
    return d.coordinate


def largest_words(d: Dependence) -> str:
    """Return where the curve of a dependence is large."""
    if d.coordinate == "direction":
        return f"{d.forward[1]:+.2g} forward, {d.backward[0]:+.2g} backward"
    if d.orders:
        return f"in order {d.strongest_order}"
    extent, unit = d.extent, f" {d.unit}".rstrip()
    low, high = (None if x is None else f"{x:.3g}" for x in (extent.low, extent.high))
    if low is None and high is None:
        place = "similar everywhere"
    elif low is None:
        place = f"below {high}{unit}"
    elif high is None:
        place = f"above {low}{unit}"
    else:
        place = f"between {low} and {high}{unit}" if low != high else f"near {low}{unit}"
    return place + {1: " moving forward", -1: " moving backward", 0: ""}[extent.direction]


def structure_words(found: ResidualStructure) -> str:
    """Return what a residual depends on as one sentence without a full stop."""
    parts = []
    if found.offset_significant:
        parts.append(f"{100 * found.offset_share:.0f} % of the residual is a constant {found.offset:+.2g} {found.unit}")
    for number, d in enumerate(found.named):
        share = f"{100 * d.added:.0f} %"
        start = f"{share} of the residual depends" if not parts else f"a further {share} depends"
        start = "a small part depends" if share == "0 %" else start  # of it nothing was left by the ones before
        text = f"{start} on {coordinate_words(d)}"
        if number == 0 and d.coordinate != "direction":
            place = "" if len(d.orders) == 1 else f"largest {largest_words(d)}, "
            text += f"; {place}up to {d.peak:.2g} {found.unit}"
        parts.append(text)
    return "; ".join(parts) if parts else "no significant structure in the residual"


def motion_words(motion: Motion, unit: str) -> str:
    """Return what an axis was doing; `unit` is that of the speed."""
    way = "forward" if motion.direction > 0 else "backward"
    low, high = f"{motion.low:.3g}", f"{motion.high:.3g} {unit}"
    match motion.kind:
        case Kind.REST:
            return "at rest"
        case Kind.CONSTANT:
            return f"constant {motion.direction * motion.high:+.3g} {unit}"
        case Kind.UNSTEADY:
            return f"unsteady, {low} to {high} {way}"
        case Kind.ACCELERATING:
            return f"accelerating {way}, {low} to {high}"
        case Kind.DECELERATING:
            return f"decelerating {way}, {high.split()[0]} to {low} {unit}"
        case Kind.BACK_AND_FORTH | Kind.REVERSAL | Kind.REVERSALS:
            return f"{motion.kind.value.replace('_', ' ')}, up to {high}"
        case _:
            return f"{motion.kind.value.replace('_', ' ')} {way}, up to {high}"
