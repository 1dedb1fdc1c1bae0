"""What a motion cannot show, whatever is missing."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pmsm_ctrl.diagnose import notices
from pmsm_ctrl.diagnose.fit import Fitted
from pmsm_ctrl.diagnose.policy import POLICY, Policy
from pmsm_ctrl.diagnose.refusal import Reason, Refusal
from pmsm_ctrl.effects.base import Effect
from pmsm_ctrl.evidence.linalg import own_shares
from pmsm_ctrl.section import Notice

__all__ = ["hidden_by_motion", "not_excited"]

Array = NDArray[np.float64]


def not_excited(fit: Fitted, policy: Policy = POLICY) -> Notice | None:
    """Return which friction parameters this motion does not excite or cannot separate; None when there are none.

    Parameters
    ----------
    fit : Fitted
    policy : Policy
    """
    effects = [fit.model.group_of(k).effect for k in range(len(fit.model.names))]
    rubs = [effect is not None and effect.id in ("coulomb", "viscous") for effect in effects]
    places = [k for k, name in enumerate(fit.model.names) if name == "J" or rubs[k]]
    names = [fit.model.names[k] for k in places]
    columns = fit.model.matrix[0][:, places] * (fit.record.weight[0] * fit.record.mask)[:, None]
    friction = [(name, k) for k, name in enumerate(names) if name != "J"]
    dead = [name for name, k in friction if not np.any(columns[:, k])]
    if dead:
        return notices.NOT_EXCITED(parameters=", ".join(dead))
    shares = own_shares(columns)
    bound = [name for name, k in friction if shares[k] < policy.own_share]
    return notices.NOT_SEPARABLE(parameters=", ".join(bound)) if bound else None


def hidden_by_motion(fit: Fitted, effects: Mapping[str, Effect], policy: Policy = POLICY) -> dict[str, Refusal]:
    """Return the candidates that this motion can hardly show, and why.

    Parameters
    ----------
    fit : Fitted
    effects : dict of id to Effect
    policy : Policy
    """
    record = fit.record
    if record.linear:
        return {}
    speed = np.abs(record.at_grid(record.signals["omega"]))[record.mask]
    out = {}
    for effect in effects.values():
        slow = float(np.mean(effect.lowest_order * speed < 2.0 * np.pi * record.cutoff))
        if effect.lowest_order and slow < policy.visible_share:
            detail = {"percent": 100.0 * slow, "order": effect.lowest_order, "needs": effect.needs}
            out[effect.id] = Refusal(Reason.NOT_EXCITED, detail)
    return out
