"""placeholder"""

from __future__ import annotations
from pmsm_ctrl.design import Design
from pmsm_ctrl.log import Log


def check(log: Log, design: Design | None = None) -> tuple[str, ...]:
    """x"""
    return ()
