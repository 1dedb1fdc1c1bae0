"""The names that a term may use for its arguments besides its own parameters."""

from __future__ import annotations

__all__ = ["CURRENTS", "INTERNAL", "SIGNALS"]

SIGNALS: dict[str, str] = {
    "omega": "mechanical speed, rad/s",
    "theta": "mechanical angle, rad",
    "direction": "direction of motion or of impending motion, -1, 0 or 1",
    "i_d": "direct-axis current, A",
    "i_q": "quadrature-axis current, A",
    "torque": "electromagnetic torque, N m",
    "t": "time, s",
    "p": "pole pairs",
    "di_d": "time derivative of i_d, A/s",
    "di_q": "time derivative of i_q, A/s",
    "twist": "motor angle less load angle, rad",
    "twist_rate": "motor speed less load speed, rad/s",
    "zeta": "bristle deflection at the start of a step, as a share of the breakaway deflection",
    "travel": "angle turned since then, rad",
    "limit": "dry friction at this speed as a share of that at rest",
}
CURRENTS = ("i_d", "i_q")
# No channels of a log: they follow from the motion, or from the design.
INTERNAL = ("p", "zeta", "travel", "limit", "twist", "twist_rate")
