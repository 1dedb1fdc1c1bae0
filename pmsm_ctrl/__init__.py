"""Control design, friction identification and model diagnosis for permanent-magnet synchronous servo drives.

Two nouns, `Design` and `Log`, and one plain function per verb. Nothing is imported before it is used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pmsm_ctrl.rooms import Room, provide

if TYPE_CHECKING:
    from pmsm_ctrl.compare import compare
    from pmsm_ctrl.compensate import compensate
    from pmsm_ctrl.design import Design
    from pmsm_ctrl.diagnose import add, diagnose
    from pmsm_ctrl.export import export
    from pmsm_ctrl.fleet import fleet
    from pmsm_ctrl.frf import frf
    from pmsm_ctrl.identify import identify, sweep
    from pmsm_ctrl.importers import read_log
    from pmsm_ctrl.log import Log
    from pmsm_ctrl.report import study
    from pmsm_ctrl.simulate import simulate
    from pmsm_ctrl.track import track
    from pmsm_ctrl.tune import tune
    from pmsm_ctrl.verify import verify

# public name -> the module that holds it; frozen by tests/unit/test_public_api.py
_EXPORTS = {
    "Design": "pmsm_ctrl.design",
    "Log": "pmsm_ctrl.log",
    "add": "pmsm_ctrl.diagnose",
    "compare": "pmsm_ctrl.compare",
    "compensate": "pmsm_ctrl.compensate",
    "diagnose": "pmsm_ctrl.diagnose",
    "export": "pmsm_ctrl.export",
    "fleet": "pmsm_ctrl.fleet",
    "frf": "pmsm_ctrl.frf",
    "identify": "pmsm_ctrl.identify",
    "read_log": "pmsm_ctrl.importers",
    "simulate": "pmsm_ctrl.simulate",
    "study": "pmsm_ctrl.report",
    "sweep": "pmsm_ctrl.identify",
    "track": "pmsm_ctrl.track",
    "tune": "pmsm_ctrl.tune",
    "verify": "pmsm_ctrl.verify",
}

__version__ = "0.1.0"
__all__ = [
    "Design", "Log", "add", "compare", "compensate", "diagnose", "export", "fleet", "frf", "identify", "read_log",
    "simulate", "study", "sweep", "track", "tune", "verify",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    if name not in _EXPORTS:
        from pmsm_ctrl.errors import nearest

        raise AttributeError(f"module 'pmsm_ctrl' has no attribute '{name}'{nearest(name, _EXPORTS)}")
    module = import_module(_EXPORTS[name])
    if _EXPORTS[name] == f"{__name__}.{name}":
        return module  # a room that is called by its verb
    value = globals()[name] = getattr(module, name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_EXPORTS})


provide("rules of effects", "pmsm_ctrl.effects.catalogue", "require_entry")
sys.modules[__name__].__class__ = Room
