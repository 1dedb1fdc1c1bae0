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
from pmsm_ctrl.section import Notice

__all__ = ["hidden_by_motion", "not_excited", "own_shares"]

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
    shares = own_shares(fit.model.matrix[0][:, places] * (fit.record.weight[0] * fit.record.mask)[:, None])
    friction = [(name, share) for name, share in zip(names, shares.tolist(), strict=True) if name != "J"]
    dead = [name for name, share in friction if np.isnan(share)]
    if dead:
        return notices.NOT_EXCITED(parameters=", ".join(dead))
    bound = [name for name, share in friction if share < policy.own_share]
    return notices.NOT_SEPARABLE(parameters=", ".join(bound)) if bound else None


def own_shares(columns: Array) -> Array:
    """Return the share of every column that the others do not explain; NaN for one that is zero.

    Parameters
    ----------
    columns : array, shape (m, k)

    Returns
    -------
    array, shape (k,)
    """
    size = np.linalg.norm(columns, axis=0)
    out = np.full(len(size), np.nan)
    there = np.flatnonzero(size > 0.0)
    rows = columns[:, there] / size[there]
    for k, place in enumerate(there):
        others = np.delete(rows, k, axis=1)
        out[place] = 1.0
        if others.shape[1]:
            out[place] = np.linalg.norm(rows[:, k] - others @ np.linalg.lstsq(others, rows[:, k], rcond=1e-8)[0])
    return out


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
