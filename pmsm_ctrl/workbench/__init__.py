"""The workbench: a local page on which a design is compared with logs, and the missing effects are added one by one.

The server keeps sessions and draws nothing; the verbs compute, in a process of their own for every session. What a
session knows stands in its folder, so that it survives a reload and a restart. Extra ``workbench``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pmsm_ctrl.workbench.server import Settings, serve

__all__ = ["Settings", "serve"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'pmsm_ctrl.workbench' has no attribute '{name}'")
    from pmsm_ctrl.workbench import server

    return getattr(server, name)
