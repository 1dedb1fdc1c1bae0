"""The experiment that would separate what this log cannot."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pmsm_ctrl.design import Design
from pmsm_ctrl.diagnose.selection import Selection
from pmsm_ctrl.effects.base import Effect

__all__ = ["next_experiment"]


def next_experiment(
    design: Design, selection: Selection, effects: Mapping[str, Effect], own: tuple[Effect, ...]
) -> Mapping[str, Any] | None:
    """Return the motion whose outcome differs most between the rivals; None when there are none."""
    return None
