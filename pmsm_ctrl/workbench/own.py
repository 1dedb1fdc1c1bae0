"""Effects that are written in the page. They are Python code: it runs only where the server was started for that."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.files import write_text

if TYPE_CHECKING:
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.effects import Effect

__all__ = ["TEMPLATE", "bound", "described"]

TEMPLATE = '''import math

from pmsm_ctrl.effects import Effect, Parameter, kernel


@kernel
def seal_drag(omega: float, direction: float, k_seal: float) -> float:
    """The torque that opposes motion, from signals (omega, theta, direction, i_q, t, ...) and own parameters."""
    return k_seal * math.sqrt(abs(omega)) * direction


seal = Effect(
    id="seal_drag",
    title="Wiper seal",
    equation=r"k_{seal}\\,\\sqrt{|\\omega|}\\,\\mathrm{sgn}(\\omega)",
    source="own measurement",
    enters="torque",
    parameters=(Parameter("k_seal", "N m (s/rad)^0.5", 0.0, 0.0, math.inf, "drag at 1 rad/s", linear=True),),
    term=seal_drag,
    needs="steady motion at several speeds",
    look_alikes={"viscous_power": "with n = 1/2 they are the same"},
    validated="not at all",
)
'''
_loaded: dict[str, tuple[Effect, ...]] = {}


def _effects(folder: str, code: str) -> tuple[Effect, ...]:
    """Run the code once in this process; its file in the session's folder is what messages and numba name."""
    from pmsm_ctrl.effects.loading import load_effects

    digest = hashlib.sha256(code.encode()).hexdigest()[:12]
    if digest not in _loaded:
        path = Path(folder) / f"effects_{digest}.py"
        write_text(path, code)
        _loaded[digest] = load_effects(path)
    return _loaded[digest]


def bound(design: Design, request: Mapping[str, Any]) -> Design:
    """Return a design that offers the session's own effects.

    Parameters
    ----------
    design : Design
    request : dict
        ``folder`` and ``code``, which may be empty.

    Returns
    -------
    Design

    Raises
    ------
    RequestError
        When the code cannot be run, or an id is in use.
    """
    code = request.get("code", "")
    return design.with_own_effects(*_effects(request["folder"], code)) if code else design


def described(design: str, request: Mapping[str, Any]) -> list[dict[str, str]]:
    """Run the code of a page, and return what it defines.

    Parameters
    ----------
    design : str
        As TOML, whose effects must not have the same ids.
    request : dict
        As for `bound`.

    Returns
    -------
    list of dict
        ``id`` and ``title`` of every effect.
    """
    from pmsm_ctrl.design import Design

    bound(Design.from_toml(design), request)
    return [{"id": effect.id, "title": effect.title} for effect in _effects(request["folder"], request["code"])]
