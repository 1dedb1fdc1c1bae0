"""Export: gains, friction compensator and friction tracker as C99 or Structured Text; tables that drives accept."""

from pmsm_ctrl.export.code import export, export_files
from pmsm_ctrl.export.tables import cogging_table, friction_table

__all__ = ["cogging_table", "export", "export_files", "friction_table"]
