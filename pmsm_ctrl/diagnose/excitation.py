"""What this motion cannot show, whatever is missing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.effects.base import Effect

__all__ = ["hidden_by_motion", "not_excited"]

# A base column of which less than this share is its own cannot be told from the others.
OWN_SHARE = 0.02
# An order counts as visible when it passes the filter for this share of the motion; cogging begins around the 12th.
VISIBLE_SHARE, COGGING_ORDER = 0.1, 12


def not_excited(fit: Fitted) -> str:
    """Say which friction parameters this motion cannot separate; empty when it separates all."""
    record = fit.record
    used = record.weight[0] * record.mask
    groups = [fit.model.group_of(k) for k in range(len(fit.model.names))]
    friction = [g.effect is not None and g.effect.id in ("coulomb", "viscous") for g in groups]
    names = [n for n, rubs in zip(fit.model.names, friction, strict=True) if n == "J" or rubs]
    rows = fit.model.matrix[0][:, [fit.model.names.index(n) for n in names]] * used[:, None]
    size = np.linalg.norm(rows, axis=0)
    dead = [n for n, s in zip(names, size, strict=True) if s == 0.0 and n != "J"]
    if dead:
        return f"{', '.join(dead)} never shows on this motion"
    rows = rows[:, size > 0.0] / size[size > 0.0]
    bound = []
    for k, name in enumerate(n for n, s in zip(names, size, strict=True) if s > 0.0):
        others = np.delete(rows, k, axis=1)
        if not others.shape[1]:
            continue
        left = rows[:, k] - others @ np.linalg.lstsq(others, rows[:, k], rcond=1e-8)[0]
        if np.linalg.norm(left) < OWN_SHARE and name != "J":
            bound.append(name)
    return f"this motion cannot tell {', '.join(bound)} apart" if bound else ""


def hidden_by_motion(fit: Fitted, effects: Mapping[str, Effect]) -> dict[str, str]:
    """Return the effects that this motion can hardly show, and why."""
    record = fit.record
    if record.linear or "cogging" not in effects:
        return {}
    speed = np.abs(record.at_grid(record.signals["omega"]))[record.mask]
    slow = float(np.mean(COGGING_ORDER * speed < 2.0 * np.pi * record.prepared.cutoff))
    if slow >= VISIBLE_SHARE:
        return {}
    why = (
        f"this log cannot show it: only {100 * slow:.0f} % of the motion is slow enough for orders from "
        f"{COGGING_ORDER}; it needs {effects['cogging'].needs}"
    )
    return {"cogging": why}
