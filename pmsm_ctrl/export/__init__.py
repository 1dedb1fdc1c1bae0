"""Export: the tuned gains and the friction compensator as C99 or IEC 61131-3 Structured Text."""

from pmsm_ctrl.export.code import export
from pmsm_ctrl.export.tables import cogging_table, friction_table

__all__ = ["cogging_table", "export", "friction_table"]
