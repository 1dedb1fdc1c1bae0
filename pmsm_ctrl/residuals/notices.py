"""The words of what is left of a balance."""

from __future__ import annotations

from pmsm_ctrl.section import Template

__all__ = ["SINGLE_WAVE"]

SINGLE_WAVE = Template(
    "single_wave",
    "{percent:.0f} % of the residual of the {balance} balance is a single wave over {coordinate} ({period}, "
    "{amplitude:.2g} {unit})",
)
